"""Fig. 7: Bode plots of the handle in the hands of five simulated users, three trials each, and two models.

Each user has a grip; each trial varies it slightly. A swept sine is played with sensor noise and hand tremor, and
`hapscene.handle.fit.identify` fits eq. 8 of the paper to all trials together. The approximate model replaces s⁴ by
(s + ω₀)⁴, so that its inverse, the compensator, has a finite gain at zero frequency; that of the full model has not.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_BAND_HZ, ACCELERATION_RATE_HZ
from hapscene.dsp.spectrogram import decibels
from hapscene.handle.compensator import COMPENSATORS
from hapscene.handle.fit import Identification, identify
from hapscene.handle.force_source import SCATTER, SimulatedSource, simulated_grips
from hapscene.handle.handle_file import modelled
from hapscene.handle.measure import Response, Sweep, estimate_response
from hapscene.handle.plant import Plant
from hapscene.view.palette import INK, OKABE_ITO

from .result import SETTING, Array, FigureResult, Number, Plot, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

USERS: Final = 5
TRIALS: Final = 3
PAPER_BAND_HZ: Final = (10.0, 200.0)
FULL_BAND_HZ: Final = (10.0, 1000.0)

CORNER_HZ: Final = COMPENSATORS["inverse"].corner_Hz
"""Corner f₀ = ω₀/2π of the approximate model [Hz]. The paper's text does not state its own."""

PARAMETERS: Final = (
    ("m_c_kg", "mass of the coil", 1e3, "g"),
    ("k_s_N_m", "stiffness of its springs", 1.0, "N/m"),
    ("b_s_Ns_m", "damping of the coil", 1.0, "N·s/m"),
    ("m_h_kg", "mass of the handle", 1e3, "g"),
)


SPEAKER: Final = "the paper cites a speaker at the fingertips; here the inverse of a model that is known exactly"


@dataclass(frozen=True, eq=False)
class Trials:
    """The responses that were measured in every hand, and the handle identified from them."""

    responses: list[Response]
    handle: Identification


def try_users(band_Hz: tuple[float, float], true_plant: Plant, seed: int = 0) -> Trials:
    """Sweep a simulated handle in the hand of every user, and identify it from all trials."""
    rng = np.random.default_rng([seed, 7])
    force_N = Sweep(*band_Hz, sweep_s=5.0).force(ACCELERATION_RATE_HZ, Plant())
    responses, names = [], []
    for user, (_, *grip) in enumerate(simulated_grips(USERS, seed)):
        for trial in range(TRIALS):
            k, b = (np.array(grip) * np.exp(SCATTER * rng.standard_normal(2))).tolist()
            source = SimulatedSource(replace(true_plant, k_u_N_m=k, b_u_Ns_m=b), seed=int(rng.integers(1 << 31)))
            responses.append(estimate_response(*source.play(force_N), ACCELERATION_RATE_HZ, band_Hz=band_Hz))
            names.append(f"user {user + 1}, trial {trial + 1}")
    return Trials(responses, identify(responses, ACCELERATION_RATE_HZ, names))


def approximated(full: ArrayLike, frequency_Hz: ArrayLike) -> NDArray[np.complex128]:
    """Return the response of the approximate model at those frequencies: the full one times ((s + ω₀)/s)⁴."""
    return np.asarray(np.asarray(full) * (1.0 - 1j * CORNER_HZ / np.asarray(frequency_Hz)) ** 4)


def flatness() -> float:
    """Return the ratio of the largest to the smallest output with the inverse of the approximate model."""
    low, high = np.abs(approximated(1.0, ACCELERATION_BAND_HZ))
    return float(low / high)


def misfit_dB(trials: Trials, approximate: bool = False) -> float:
    """Return the rms difference over the band between the magnitudes of the trials and of their models [dB]."""
    differences = []
    for grip, response in zip(trials.handle.grips, trials.responses, strict=True):
        model = modelled(trials.handle, grip, response.frequency_Hz)
        model = approximated(model, response.frequency_Hz) if approximate else model
        differences.append(decibels(np.abs(response.response)) - decibels(np.abs(model)))
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2)))


def handle_in_hands(true_plant: Plant, band_Hz: tuple[float, float], seed: int = 0) -> FigureResult:
    """Reproduce Fig. 7 in the paper's band, or repeat it in the band up to 1000 Hz."""
    trials, numbers = try_users(band_Hz, true_plant, seed), list[Number]()
    for name, words, scale, unit in PARAMETERS:
        note = f"the simulation knows it: {scale * getattr(true_plant, name):g} {unit}, an assumed value"
        numbers.append(Number(f"{words}, {name}", scale * getattr(trials.handle.plant, name), unit, note=note))
    note = "the simulated handle has exactly the form of eq. 8; a real one has not"
    numbers.append(Number("full model: difference from the trials, rms", misfit_dB(trials), "dB", note=note))
    note = f"above the full model below 20 Hz by design: f₀ = {CORNER_HZ:g} Hz"
    difference = misfit_dB(trials, approximate=True)
    numbers.append(Number("approximate model: difference from the trials, rms", difference, "dB", note=note))
    plots = [_bode(trials, band_Hz)]
    if band_Hz != PAPER_BAND_HZ:
        text = (
            "The paper sweeps to 200 Hz and uses its model to 1000 Hz. Above 200 Hz the handle behaves as its mass, "
            "while amplifier, accelerometer and delay change the measurement; the longer sweep separates them."
        )
        return FigureResult("Beyond Fig. 7: the handle to 1000 Hz", text, numbers, plots)
    place = "Section 4, System Dynamics"
    paper = [
        Number("users", USERS, "1", 5, place, SETTING),
        Number("trials of each user", TRIALS, "1", 3, place, SETTING),
        Number("lowest frequency of the sweep", band_Hz[0], "Hz", 10.0, place, SETTING),
        Number("highest frequency of the sweep", band_Hz[1], "Hz", 200.0, place, SETTING),
        Number("peak force of the actuator", true_plant.force_limit_N, "N", 6.6, "Section 4, Prototype", SETTING),
        Number("output over 20–1000 Hz, largest to smallest", flatness(), "1", 2.24, "Section 4, Prior Work", SPEAKER),
    ]
    text = (
        "Simulated: no handle and no hand was measured. The grips are drawn from a light to a firm one; sensor noise "
        "and tremor are included. The parameters of the paper's model stand in its picture, which is not available "
        "here."
    )
    return FigureResult("Fig. 7: Bode plots of the handle", text, [*paper, *numbers], plots)


def _bode(trials: Trials, band_Hz: tuple[float, float]) -> Plot:
    """Draw every trial as a thin line, and both models for the mean hand."""
    handle, fine_Hz = trials.handle, np.geomspace(*band_Hz, 400)
    mean = replace(handle.grips[0], k_u_N_m=handle.plant.k_u_N_m, b_u_Ns_m=handle.plant.b_u_Ns_m)
    full = modelled(handle, mean, fine_Hz)

    def draw(upper: "Axes", lower: "Axes") -> None:
        def line(f_Hz: Array, values: NDArray[np.complex128], label: str | None, **style: Any) -> None:
            phase = np.degrees(np.unwrap(np.angle(values)))
            upper.plot(f_Hz, decibels(np.abs(values)), label=label, **style)
            lower.plot(f_Hz, phase - 360.0 * np.floor(phase[0] / 360.0), **style)

        for i, response in enumerate(trials.responses):
            user, trial = divmod(i, TRIALS)
            colour = list(OKABE_ITO.values())[(0, 1, 2, 4, 5)[user]]
            label = None if trial else f"user {user + 1}"
            line(response.frequency_Hz, response.response, label, color=colour, linewidth=0.7)
        line(fine_Hz, full, "full model, mean hand", color=INK, linewidth=1.8)
        line(fine_Hz, approximated(full, fine_Hz), "approximate model", color=INK, linewidth=1.8, linestyle="--")
        upper.set_ylabel("magnitude [dB re 1 m/s²/N]")
        lower.set(ylabel="phase [°]", xlabel="frequency [Hz]", xscale="log", xlim=band_Hz)
        ticks = [f for f in (10, 20, 50, 100, 200, 500, 1000) if f <= band_Hz[1]]
        lower.set_xticks(ticks, [str(f) for f in ticks])
        lower.set_xticks([], minor=True)

    caption = f"{USERS} simulated users with {TRIALS} trials each: acceleration of the handle over force of the coil."
    drawing = drawn(f"bode-{band_Hz[1]:.0f}", draw, 4.8, panels=(3, 2))
    return Plot(f"{band_Hz[0]:.0f} to {band_Hz[1]:.0f} Hz", caption, drawing)
