"""Fig. 7: Bode plots of the handle in the hands of five simulated users, three trials each, and two models of it.

Each user holds the assumed handle with a grip of their own, each trial a little otherwise; sweeps are played, noise,
unrest of the hand and all, and the project's own identification fits eq. 8 to all of them together. The approximate
model has (s + ω₀)⁴ for s⁴: its inverse is the compensator, which the full model's cannot be, for it asks for endless
force at rest.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.capture.report_plots import DASHED, Plot, drawn
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.dsp.spectrogram import decibels
from hapscene.handle.compensator import COMPENSATORS
from hapscene.handle.fit import OWN, Identification, identify
from hapscene.handle.force_source import SCATTER, SimulatedSource, simulated_grips
from hapscene.handle.identification_report import modelled
from hapscene.handle.plant import Plant
from hapscene.handle.response import Response, estimate_response
from hapscene.handle.sweep import Sweep
from hapscene.view.palette import OKABE_ITO

from .finding import REMEMBERED, UNKNOWN, Array, Finding, Number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

USERS: Final = 5
TRIALS: Final = 3

PAPER_BAND_HZ: Final = (10.0, 200.0)
FULL_BAND_HZ: Final = (10.0, 1000.0)

SWEEP_S: Final = 5.0
"""Length of each sweep [s]."""

CORNER_HZ: Final = COMPENSATORS["inverse"].corner_Hz
"""f₀ of the approximate model [Hz]; the paper's is not known here."""

NAMES: Final = {
    "m_c_kg": ("mass of the coil", 1e3, "g"),
    "k_s_N_m": ("stiffness of its spring", 1.0, "N/m"),
    "b_s_Ns_m": ("its damping", 1.0, "N·s/m"),
    "m_h_kg": ("mass of the handle", 1e3, "g"),
}


@dataclass(frozen=True, eq=False)
class Trials:
    """What was identified in a band: the hands as they were planted, the responses measured, the handle fitted."""

    hands: tuple[Plant, ...]
    responses: tuple[Response, ...]
    handle: Identification


def try_users(band_Hz: tuple[float, float], planted: Plant, seed: int = 0) -> Trials:
    """Sweep the planted handle in every user's hand, and identify it from all trials."""
    rng = np.random.default_rng([seed, 7])
    force_N = Sweep(*band_Hz, sweep_s=SWEEP_S).force(ACCELERATION_RATE_HZ, Plant())
    hands, responses, names = [], [], []
    for user, (_, k_u_N_m, b_u_Ns_m) in enumerate(simulated_grips(USERS, seed)):
        for trial in range(TRIALS):
            k, b = np.array([k_u_N_m, b_u_Ns_m]) * np.exp(SCATTER * rng.standard_normal(2))
            hands.append(replace(planted, k_u_N_m=float(k), b_u_Ns_m=float(b)))
            source = SimulatedSource(hands[-1], seed=int(rng.integers(1 << 31)))
            played = source.play(force_N)
            responses.append(estimate_response(*played, ACCELERATION_RATE_HZ, band_Hz=band_Hz))
            names.append(f"user {user + 1}, trial {trial + 1}")
    return Trials(tuple(hands), tuple(responses), identify(responses, ACCELERATION_RATE_HZ, names))


def approximated(full: ArrayLike, frequency_Hz: ArrayLike) -> NDArray[np.complex128]:
    """The approximate model at those frequencies, from the full one: times ((s + ω₀)/s)⁴."""
    return np.asarray(np.asarray(full) * (1.0 - 1j * CORNER_HZ / np.asarray(frequency_Hz)) ** 4)


def misfits_dB(trials: Trials, approximate: bool) -> Array:
    """How far each trial's magnitude is from its own model's, root mean square over the band (15,) [dB]."""
    found = []
    for grip, response in zip(trials.handle.grips, trials.responses, strict=True):
        model = modelled(trials.handle, grip, response.frequency_Hz)
        model = approximated(model, response.frequency_Hz) if approximate else model
        away = decibels(np.abs(response.response)) - decibels(np.abs(model))
        found.append(float(np.sqrt(np.mean(away**2))))
    return np.array(found)


def bode(name: str, trials: Trials) -> Plot:
    """Every trial, thin, and both models in the mean hand."""
    handle = trials.handle
    fine_Hz = np.geomspace(*handle.band_Hz, 400)
    mean = replace(handle.grips[0], k_u_N_m=handle.plant.k_u_N_m, b_u_Ns_m=handle.plant.b_u_Ns_m)
    full = modelled(handle, mean, fine_Hz)
    models = {"full model, mean hand": full, "approximate model": approximated(full, fine_Hz)}

    def draw(upper: "Axes", lower: "Axes") -> None:
        for i, response in enumerate(trials.responses):
            colour = list(OKABE_ITO.values())[(0, 1, 2, 4, 5)[i // TRIALS]]
            label = f"user {i // TRIALS + 1}" if i % TRIALS == 0 else None
            looks = {"color": colour, "linewidth": 0.7}
            upper.plot(response.frequency_Hz, decibels(np.abs(response.response)), label=label, **looks)
            lower.plot(response.frequency_Hz, degrees(response.response), **looks)
        for (label, model), dash in zip(models.items(), ("-", DASHED), strict=True):
            for axes, values in ((upper, decibels(np.abs(model))), (lower, degrees(model))):
                axes.plot(
                    fine_Hz, values, color="#222222", linewidth=1.8, linestyle=dash,
                    label=label if axes is upper else None,
                )  # fmt: skip
        upper.set_ylabel("magnitude [dB re 1 m/s²/N]")
        lower.set(ylabel="phase [°]", xlabel="frequency [Hz]", xscale="log", xlim=handle.band_Hz)
        ticks = [f for f in (10, 20, 50, 100, 200, 500, 1000) if f <= 1.01 * handle.band_Hz[1]]
        lower.set_xticks(ticks, [str(f) for f in ticks])
        lower.set_xticks([], minor=True)

    low, high = handle.band_Hz
    said = f"{USERS} simulated users, {TRIALS} trials each; acceleration of the handle over force of its coil."
    return Plot(f"{low:.0f} to {high:.0f} Hz", said, drawn(name, draw, 4.8, 3, panels=(3, 2)), "Bode plot. " + said)


def degrees(response: NDArray[np.complex128]) -> Array:
    """Phase without jumps [°], at its lowest frequency between 0 and 360: s⁴ gives 360, less what the hand delays."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return np.asarray(phase - 360.0 * np.floor(phase[0] / 360.0))


def parameter_numbers(trials: Trials, planted: Plant) -> list[Number]:
    """Each parameter as fitted, and how far that is from what was planted [%]."""
    found = []
    for name in OWN:
        words, scale, unit = NAMES[name]
        true, fitted = getattr(planted, name), getattr(trials.handle.plant, name)
        why = f"fitted to a simulated handle that was given {scale * true:g} {unit}, which is assumed"
        found.append(Number(f"{words}, {name}", scale * fitted, unit, known=UNKNOWN, why=why))
    return found


def handle_in_hands(planted: Plant, seed: int = 0) -> Finding:
    """Fig. 7."""
    trials = try_users(PAPER_BAND_HZ, planted, seed)
    full, near = (float(misfits_dB(trials, approximate).mean()) for approximate in (False, True))
    numbers = [
        Number("users", USERS, "1", 5, REMEMBERED, "simulated here: hands between a light and a firm grip"),
        Number("trials of each", TRIALS, "1", 3, REMEMBERED),
        Number("lowest frequency", PAPER_BAND_HZ[0], "Hz", 10.0, REMEMBERED),
        Number("highest frequency", PAPER_BAND_HZ[1], "Hz", 200.0, REMEMBERED),
        *parameter_numbers(trials, planted),
        Number("full model against the trials, rms", full, "dB", known=UNKNOWN, why="ours is of the model's kind"),
        Number(
            "approximate model against the trials, rms", near, "dB", known=UNKNOWN,
            why=f"too loud below 20 Hz by design: f₀ = {CORNER_HZ:g} Hz, the paper's is not known here",
        ),
    ]  # fmt: skip
    text = (
        "Simulated: no handle and no hand was measured. The grips are drawn from the project's model of hands; sensor "
        "noise and the unrest of a hand are in. Below its resonance the handle follows s⁴, above it is its mass."
    )
    return Finding("Fig. 7: Bode plots of the handle", text, tuple(numbers), (bode("fig7", trials),))
