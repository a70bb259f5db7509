"""Fig. 7: Bode plots of the handle in the hands of five simulated users, three trials each, and two models of it.

Each user holds the handle with a grip of their own, each trial a little otherwise; sweeps are played, with the sensor's
noise and the hand's unrest, and the project's own identification fits eq. 8 to all of them together. The approximate
model has (s + ω₀)⁴ for s⁴: its inverse is the compensator. The full model's would ask for endless force at rest.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.dsp.spectrogram import decibels
from hapscene.handle.compensator import COMPENSATORS
from hapscene.handle.fit import Identification, identify
from hapscene.handle.force_source import SCATTER, SimulatedSource, simulated_grips
from hapscene.handle.identification_report import modelled
from hapscene.handle.plant import Plant
from hapscene.handle.response import Response, estimate_response
from hapscene.handle.sweep import Sweep
from hapscene.view.palette import INK, OKABE_ITO

from .finding import REMEMBERED, Array, Finding, Number, Plot, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

USERS: Final = 5
TRIALS: Final = 3
PAPER_BAND_HZ: Final = (10.0, 200.0)
FULL_BAND_HZ: Final = (10.0, 1000.0)

CORNER_HZ: Final = COMPENSATORS["inverse"].corner_Hz
"""f₀ of the approximate model [Hz]; the paper's is not known here."""

PARAMETERS: Final = (
    ("m_c_kg", "coil", 1e3, "g"),
    ("k_s_N_m", "its spring", 1.0, "N/m"),
    ("b_s_Ns_m", "its damping", 1.0, "N·s/m"),
    ("m_h_kg", "handle", 1e3, "g"),
)


@dataclass(frozen=True, eq=False)
class Trials:
    """What was measured in every hand, and the handle that was identified from it."""

    responses: list[Response]
    handle: Identification


def try_users(band_Hz: tuple[float, float], planted: Plant, seed: int = 0) -> Trials:
    """Sweep the planted handle in every user's hand, and identify it from all trials."""
    rng = np.random.default_rng([seed, 7])
    force_N = Sweep(*band_Hz, sweep_s=5.0).force(ACCELERATION_RATE_HZ, Plant())
    responses, names = [], []
    for user, (_, *grip) in enumerate(simulated_grips(USERS, seed)):
        for trial in range(TRIALS):
            k, b = (np.array(grip) * np.exp(SCATTER * rng.standard_normal(2))).tolist()
            source = SimulatedSource(replace(planted, k_u_N_m=k, b_u_Ns_m=b), seed=int(rng.integers(1 << 31)))
            responses.append(estimate_response(*source.play(force_N), ACCELERATION_RATE_HZ, band_Hz=band_Hz))
            names.append(f"user {user + 1}, trial {trial + 1}")
    return Trials(responses, identify(responses, ACCELERATION_RATE_HZ, names))


def approximated(full: ArrayLike, frequency_Hz: ArrayLike) -> NDArray[np.complex128]:
    """The approximate model at those frequencies, from the full one: times ((s + ω₀)/s)⁴."""
    return np.asarray(np.asarray(full) * (1.0 - 1j * CORNER_HZ / np.asarray(frequency_Hz)) ** 4)


def misfit_dB(trials: Trials, approximate: bool = False) -> float:
    """How far the trials' magnitudes are from their own models', root mean square over the band [dB]."""
    away = []
    for grip, response in zip(trials.handle.grips, trials.responses, strict=True):
        model = modelled(trials.handle, grip, response.frequency_Hz)
        model = approximated(model, response.frequency_Hz) if approximate else model
        away.append(decibels(np.abs(response.response)) - decibels(np.abs(model)))
    return float(np.sqrt(np.mean(np.concatenate(away) ** 2)))


def handle_in_hands(planted: Plant, band_Hz: tuple[float, float], seed: int = 0) -> Finding:
    """Fig. 7 in its own band, or beyond it in the whole one that is felt."""
    trials, numbers = try_users(band_Hz, planted, seed), list[Number]()
    for name, words, scale, unit in PARAMETERS:
        why = f"simulated: the handle was given {scale * getattr(planted, name):g} {unit}, which is assumed"
        numbers.append(Number(f"{words}, {name}", scale * getattr(trials.handle.plant, name), unit, why=why))
    numbers.append(
        Number("full model against the trials, rms", misfit_dB(trials), "dB", why="one of the handle's kind")
    )
    why = f"too loud below 20 Hz by design: f₀ = {CORNER_HZ:g} Hz"
    numbers.append(Number("approximate model against the trials, rms", misfit_dB(trials, True), "dB", why=why))
    plots = [_bode(trials, band_Hz)]
    if band_Hz != PAPER_BAND_HZ:
        text = (
            "Above 200 Hz the handle is its mass, and amplifier, accelerometer and delay bend what is measured. The "
            "longer sweep tells them from the handle; the band that is felt ends at 1000 Hz."
        )
        return Finding("Beyond: the handle to 1000 Hz", text, numbers, plots)
    paper = [
        Number("users", USERS, "1", 5, REMEMBERED, "simulated: hands between a light and a firm grip"),
        Number("trials of each", TRIALS, "1", 3, REMEMBERED),
        Number("lowest frequency", band_Hz[0], "Hz", 10.0, REMEMBERED),
        Number("highest frequency", band_Hz[1], "Hz", 200.0, REMEMBERED),
    ]
    text = (
        "Simulated: no handle and no hand was measured. The grips are drawn from the project's model of hands; sensor "
        "noise and the unrest of a hand are in. The approximate model is the one whose inverse is the compensator."
    )
    return Finding("Fig. 7: Bode plots of the handle", text, [*paper, *numbers], plots)


def _bode(trials: Trials, band_Hz: tuple[float, float]) -> Plot:
    """Every trial, thin, and both models in the mean hand."""
    handle, fine_Hz = trials.handle, np.geomspace(*band_Hz, 400)
    mean = replace(handle.grips[0], k_u_N_m=handle.plant.k_u_N_m, b_u_Ns_m=handle.plant.b_u_Ns_m)
    full = modelled(handle, mean, fine_Hz)

    def draw(upper: "Axes", lower: "Axes") -> None:
        def line(f_Hz: Array, values: NDArray[np.complex128], label: str | None, **look: Any) -> None:
            phase = np.degrees(np.unwrap(np.angle(values)))
            upper.plot(f_Hz, decibels(np.abs(values)), label=label, **look)
            lower.plot(f_Hz, phase - 360.0 * np.floor(phase[0] / 360.0), **look)

        for i, response in enumerate(trials.responses):
            user, again = divmod(i, TRIALS)
            colour = list(OKABE_ITO.values())[(0, 1, 2, 4, 5)[user]]
            label = None if again else f"user {user + 1}"
            line(response.frequency_Hz, response.response, label, color=colour, linewidth=0.7)
        line(fine_Hz, full, "full model, mean hand", color=INK, linewidth=1.8)
        line(fine_Hz, approximated(full, fine_Hz), "approximate model", color=INK, linewidth=1.8, linestyle="--")
        upper.set_ylabel("magnitude [dB re 1 m/s²/N]")
        lower.set(ylabel="phase [°]", xlabel="frequency [Hz]", xscale="log", xlim=band_Hz)
        ticks = [f for f in (10, 20, 50, 100, 200, 500, 1000) if f <= band_Hz[1]]
        lower.set_xticks(ticks, [str(f) for f in ticks])
        lower.set_xticks([], minor=True)

    said = f"{USERS} simulated users, {TRIALS} trials each; acceleration of the handle over force of its coil."
    drawing = drawn(f"bode-{band_Hz[1]:.0f}", draw, 4.8, panels=(3, 2))
    return Plot(f"{band_Hz[0]:.0f} to {band_Hz[1]:.0f} Hz", said, drawing)
