"""What `hapscene device identify` tells of a handle: Bode plot (Fig. 7), words."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.dsp.spectrogram import decibels
from hapscene.errors import HandleError
from hapscene.handle.fit import Identification, IdentifiedGrip, sampled_response
from hapscene.handle.handle_file import SUFFIX, save_handle
from hapscene.handle.measure import GripRecording
from hapscene.handle.response import Response
from hapscene.io.files import whole_folder
from hapscene.view.chart import new_chart, save_chart
from hapscene.view.palette import INK, OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["describe_lines", "modelled", "write_result"]


COLOURS: Final = tuple(OKABE_ITO[name] for name in ("sky", "blue", "green", "orange", "vermilion", "purple"))
"""Of the grips, in turn."""


def write_bode(handle: Identification, responses: Sequence[Response], path: str | Path) -> None:
    """Draw the responses of the handle's grips, thin, over the model, thick, as PNG.

    Args:
        handle: what was identified.
        responses: of its grips, in their order.
        path: where the file shall be.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    title = f"{handle.name}: acceleration of the handle over force of its coil"
    with new_chart(11, 9, title, {"font.size": 11}) as figure:
        _draw(figure, handle, responses)
        save_chart(figure, path)


def modelled(handle: Identification, grip: IdentifiedGrip, frequency_Hz: NDArray[np.float64]) -> NDArray[np.complex128]:
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
        magnitude.plot(fine_Hz, decibels(np.abs(model)), color=colour, linewidth=4.5, alpha=0.45)
        phase.plot(fine_Hz, _degrees(model), color=colour, linewidth=4.5, alpha=0.45)
        low, high = (decibels(np.maximum(edge, 1e-6)) for edge in response.magnitude_interval())  # 0 is far down
        magnitude.fill_between(at_Hz, low, high, color=colour, alpha=0.3, linewidth=0)
        magnitude.plot(at_Hz, decibels(np.abs(response.response)), color=colour, linewidth=1.1)
        phase.plot(at_Hz, _degrees(response.response), color=colour, linewidth=1.1)
        label = f"{grip.name}: {grip.k_u_N_m:.0f} N/m, {grip.b_u_Ns_m:.1f} N·s/m"
        coherence.plot(at_Hz, response.coherence, color=colour, linewidth=1.3, label=label)
    _dress(figure, handle, (magnitude, phase, coherence))


def _dress(figure: "Figure", handle: Identification, axes: Sequence["Axes"]) -> None:
    """Axes, and what the lines are."""
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MultipleLocator

    magnitude, phase, coherence = axes
    level = float(decibels(np.array(1.0 / handle.plant.m_h_kg)))
    magnitude.axhline(level, color=INK, linewidth=1.0, linestyle=(0, (4, 3)))
    magnitude.set_ylabel("magnitude [dB re 1 m/s²/N]")
    phase.set_ylabel("phase [°]")
    phase.yaxis.set_major_locator(MultipleLocator(90.0))
    coherence.set(ylabel="coherence [1]", xlabel="frequency [Hz]", ylim=(0.0, 1.03))
    coherence.set_xscale("log")
    coherence.set_xlim(0.96 * handle.band_Hz[0], 1.04 * handle.band_Hz[1])
    coherence.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    coherence.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:g}"[0] in "25" else "")
    for one in axes:
        one.grid(which="both")
    looks = [
        Line2D([], [], color=INK, linewidth=1.1, label="measured, with 95 % interval"),
        Line2D([], [], color=INK, linewidth=4.5, alpha=0.45, label="model"),
        Line2D([], [], color=INK, linewidth=1.0, linestyle=(0, (4, 3)), label="1/m_h"),
    ]
    magnitude.legend(handles=looks, loc="lower right")
    figure.align_ylabels()
    figure.legend(loc="outside lower left", ncols=2 if len(handle.grips) > 3 else 3, title="grip", alignment="left")


def _degrees(response: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Phase without jumps, near 0 in the middle of the band, where the handle is a mass."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return np.asarray(phase - 360.0 * np.round(phase[len(phase) // 2] / 360.0))


# An identified handle in words and figures.


_OWN: Final = (
    ("m_h_kg", "mass of the handle", 1e3, "g"),
    ("m_c_kg", "mass of the coil", 1e3, "g"),
    ("k_s_N_m", "stiffness of the coil's spring", 1.0, "N/m"),
    ("b_s_Ns_m", "damping of the coil", 1.0, "N·s/m"),
    ("amplifier_Hz", "bandwidth of the amplifier", 1.0, "Hz"),
)
_HAND: Final = (("k_u_N_m", "stiffness of the hand", 1.0, "N/m"), ("b_u_Ns_m", "damping of the hand", 1.0, "N·s/m"))

MISFIT_MAX: Final = 2.0
"""Misfit above which it is told that the model does not explain the measurement [1]."""


def describe_lines(handle: Identification) -> list[str]:
    """The handle for a reader: a line for each parameter, with its interval or why there is none."""
    said = [f"{handle.name}: {handle.provenance}" if handle.provenance else handle.name]
    said += [_line(handle, row) for row in _OWN]
    for grip in handle.grips:
        said.append(f"grip {grip.name}; coherence {grip.coherence:.3f}, least {grip.coherence_least:.2f}")
        said += [_line(grip, row) for row in _HAND]
    low, high = handle.asymptote_Hz
    said.append(f"first estimate of the mass: {1e3 * handle.asymptote_kg:.4g} g, from {low:.0f} to {high:.0f} Hz")
    said.append(
        f"beside the poles of amplifier and accelerometer ({handle.accelerometer_Hz:g} Hz, taken as known) "
        f"the acceleration comes {round(1e6 * handle.delay_s)} µs late"
    )
    plant = handle.plant
    said.append(f"limits, as given: {plant.force_limit_N:g} N, {1e3 * plant.travel_limit_m:g} mm to either side")
    if handle.misfit <= MISFIT_MAX:
        return [*said, f"the model leaves {handle.misfit:.2f} times what noise explains"]
    return [
        *said,
        f"the model leaves {handle.misfit:.1f} times what noise explains: the handle is not quite of this kind, or "
        "the grip changed during a sweep. The intervals are wider by that, and still may be too narrow",
    ]


def _line(known: Identification | IdentifiedGrip, row: tuple[str, str, float, str]) -> str:
    name, words, scale, unit = row
    value = scale * getattr(known.plant if isinstance(known, Identification) else known, name)
    if name in known.intervals:
        low, high = (scale * edge for edge in known.intervals[name])
        # as many digits as tell the interval's ends apart
        digits = max(0, 1 - math.floor(math.log10(high - low))) if high > low else 6
        return f"  {words:<31} {value:>9.{digits}f} {unit:<6} between {low:.{digits}f} and {high:.{digits}f}"
    return f"  {words:<31} {value:>9.4g} {unit:<6} not known: {known.absent.get(name, 'no interval')}"


# What an identification leaves on disk: the handle's file, and on wish the plot, the responses and the recordings.


def write_result(
    handle: Identification, responses: Sequence[Response], recordings: Sequence[GripRecording], path: Path
) -> list[Path]:
    """Write the handle's file to `path`; or, where that does not end in .handle, all there is into that folder.

    The folder has NAME.handle, bode.png, response.csv and a grip-N.npz for each recording. Gives what was written.

    Raises:
        HandleError: the file cannot be written, or the handle's name cannot be a file's.
        OSError: the folder cannot be written.
    """
    if path.suffix == SUFFIX:
        save_handle(handle, path)
        return [path]
    name = handle.name + SUFFIX
    if Path(name).name != name:
        raise HandleError(f"{handle.name!r} cannot be the name of a file: give another --name, or -o FILE{SUFFIX}")
    with whole_folder(path) as folder:
        save_handle(handle, folder / name)
        write_bode(handle, responses, folder / "bode.png")
        (folder / "response.csv").write_text(_table(handle, responses), encoding="utf-8", newline="\n")
        for i, recording in enumerate(recordings):
            recording.save(folder / f"grip-{i + 1}.npz")
        made = [path / file.name for file in sorted(folder.iterdir())]
    return made


def _table(handle: Identification, responses: Sequence[Response]) -> str:
    """Measured and modelled response and coherence over frequency, a row for each band and grip."""
    rows = [
        "grip,frequency_Hz,magnitude_m_s2_N,low_m_s2_N,high_m_s2_N,phase_rad,coherence,model_m_s2_N,model_phase_rad"
    ]
    for grip, response in zip(handle.grips, responses, strict=True):
        at_Hz, measured, model = response.frequency_Hz, response.response, modelled(handle, grip, response.frequency_Hz)
        magnitudes = np.abs(measured), *response.magnitude_interval()
        columns = (at_Hz, *magnitudes, np.angle(measured), response.coherence, np.abs(model), np.angle(model))
        name = '"' + grip.name.replace('"', '""') + '"'
        rows += [",".join([name, *(f"{value:.6g}" for value in row)]) for row in zip(*columns, strict=True)]
    return "\n".join(rows) + "\n"
