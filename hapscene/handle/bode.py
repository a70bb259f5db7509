"""The Bode plot of an identified handle, as the haptography paper's Fig. 7: measured and model, and coherence below."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from hapscene.handle.identification import Grip, Identification
from hapscene.handle.lag import sampled_response
from hapscene.handle.response import Response
from hapscene.output import whole_file
from hapscene.view.palette import INK, OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS: Final = tuple(OKABE_ITO[name] for name in ("sky", "blue", "green", "orange", "vermilion", "purple"))
"""Of the grips, in turn."""

STYLE: Final[dict[str, Any]] = {
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": 11,
    "legend.frameon": False,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


def write_bode(handle: Identification, responses: Sequence[Response], path: str | Path) -> None:
    """Draw the responses of the handle's grips, thin, over the model, thick, as PNG.

    Args:
        handle: what was identified.
        responses: of its grips, in their order.
        path: where the file shall be.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(cast(Any, STYLE)):  # its type lists every key by name
        figure = Figure(figsize=(11, 9), layout="constrained")
        FigureCanvasAgg(figure)
        _draw(figure, handle, responses)
        with whole_file(path) as part:
            figure.savefig(part, format="png", dpi=110, metadata={"Software": "hapscene"})


def modelled(handle: Identification, grip: Grip, frequency_Hz: NDArray[np.float64]) -> NDArray[np.complex128]:
    """The response that the model has in that grip, amplifier, accelerometer and delay included [1/kg]."""
    amplifier_s, accelerometer_s = 0.5 / np.pi / np.array([handle.plant.amplifier_Hz, handle.accelerometer_Hz])
    plant = handle.plant_in(grip)
    return sampled_response(plant, frequency_Hz, handle.rate_Hz, amplifier_s, accelerometer_s, handle.delay_s)


def _draw(figure: "Figure", handle: Identification, responses: Sequence[Response]) -> None:
    magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2.4, 1.3))
    fine_Hz = np.geomspace(*handle.band_Hz, 600)
    for i, (grip, response) in enumerate(zip(handle.grips, responses, strict=True)):
        colour, at_Hz = COLOURS[i % len(COLOURS)], response.frequency_Hz
        model = modelled(handle, grip, fine_Hz)
        magnitude.plot(fine_Hz, _decibels(np.abs(model)), color=colour, linewidth=4.5, alpha=0.45)
        phase.plot(fine_Hz, _degrees(model), color=colour, linewidth=4.5, alpha=0.45)
        low, high = (_decibels(edge) for edge in response.magnitude_interval())
        magnitude.fill_between(at_Hz, low, high, color=colour, alpha=0.3, linewidth=0)
        magnitude.plot(at_Hz, _decibels(np.abs(response.response)), color=colour, linewidth=1.1)
        phase.plot(at_Hz, _degrees(response.response), color=colour, linewidth=1.1)
        label = f"{grip.name}: {grip.k_u_N_m:.0f} N/m, {grip.b_u_Ns_m:.1f} N·s/m"
        coherence.plot(at_Hz, response.coherence, color=colour, linewidth=1.3, label=label)
    _dress(figure, handle, (magnitude, phase, coherence))


def _dress(figure: "Figure", handle: Identification, axes: Sequence["Axes"]) -> None:
    """Axes, and what the lines are."""
    from matplotlib.lines import Line2D

    magnitude, phase, coherence = axes
    level = float(_decibels(np.array(1.0 / handle.plant.m_h_kg)))
    magnitude.axhline(level, color=INK, linewidth=1.0, linestyle=(0, (4, 3)))
    magnitude.set_ylabel("magnitude [dB re 1 m/s²/N]")
    phase.set_ylabel("phase [°]")
    phase.yaxis.set_major_locator(_steps(90.0))
    coherence.set(ylabel="coherence [1]", xlabel="frequency [Hz]", ylim=(0.0, 1.03))
    coherence.set_xscale("log")
    coherence.set_xlim(0.96 * handle.band_Hz[0], 1.04 * handle.band_Hz[1])
    coherence.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    coherence.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:g}"[0] in "25" else "")
    for one in axes:
        one.grid(which="both", color="#DDDDDD", linewidth=0.6)
        one.set_axisbelow(True)
    looks = [
        Line2D([], [], color=INK, linewidth=1.1, label="measured, with 95 % interval"),
        Line2D([], [], color=INK, linewidth=4.5, alpha=0.45, label="model"),
        Line2D([], [], color=INK, linewidth=1.0, linestyle=(0, (4, 3)), label="1/m_h"),
    ]
    magnitude.legend(handles=looks, loc="lower right")
    figure.align_ylabels()
    figure.suptitle(f"{handle.name}: acceleration of the handle over force of its coil", x=0.01, ha="left", fontsize=13)
    figure.legend(loc="outside lower left", ncols=2 if len(handle.grips) > 3 else 3, title="grip", alignment="left")


def _steps(step: float) -> Any:
    from matplotlib.ticker import MultipleLocator

    return MultipleLocator(step)


def _decibels(magnitude: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(20.0 * np.log10(np.maximum(magnitude, 1e-6)))


def _degrees(response: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Phase without jumps, near 0 in the middle of the band, where the handle is a mass."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return np.asarray(phase - 360.0 * np.round(phase[len(phase) // 2] / 360.0))
