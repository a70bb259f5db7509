"""Handle files: an identified handle as JSON, with the suffix .handle.

Files from unknown sources are safe to open: reading executes no code and checks every type and number against the
annotations of `Identification`.
"""

import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.dsp.spectrogram import decibels
from hapscene.errors import FormatError, HandleError
from hapscene.handle.fit import Identification, IdentifiedGrip, sampled_response
from hapscene.handle.measure import GripRecording, Response
from hapscene.io.files import parse_format, read_bytes, refusing, to_struct, whole_folder, write_whole

__all__ = [
    "BYTES_MAX",
    "SUFFIX",
    "describe_lines",
    "handle_from_json",
    "handle_to_json",
    "load_handle",
    "modelled",
    "save_handle",
    "write_result",
]

SUFFIX: Final = ".handle"
FORMAT: Final = "hapscene handle"
VERSION: Final = 1
"""Version of the format. Increased when older versions of hapscene would misread a new file."""

BYTES_MAX: Final = 1 << 20
"""Size limit of a file [bytes]. A file with 20 grips has 15 kB."""


def save_handle(handle: Identification, path: str | os.PathLike[str]) -> None:
    """Write a handle to `path` (suffix .handle), atomically.

    Raises:
        HandleError: wrong suffix, values out of range, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix != SUFFIX:
        raise HandleError(f"{target}: the name of a handle file must end in {SUFFIX}")
    text = handle_to_json(handle)
    handle_from_json(text)  # write no file that cannot be read
    write_whole(target, text.encode(errors="backslashreplace"), HandleError)


def load_handle(path: str | os.PathLike[str]) -> Identification:
    """Read a handle file.

    Raises:
        HandleError: the file does not exist, is too large or damaged, has a later version, or is not a handle file.
    """
    file = Path(path)
    with refusing(HandleError):
        data = read_bytes(file, BYTES_MAX, "handle")
    with refusing(HandleError, file):
        return handle_from_json(data)


def handle_to_json(handle: Identification) -> str:
    """The content of a handle file. Numbers are written exactly."""
    content = {"format": FORMAT, "version": VERSION, **asdict(handle)}
    try:
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    except ValueError as error:
        raise HandleError(f"the numbers of a handle must be finite: {error}") from None


def handle_from_json(data: bytes | str) -> Identification:
    """Parse the content of a handle file.

    Raises:
        HandleError: not JSON, not a handle file, a later version, or a missing key, invalid type or number.
    """
    with refusing(HandleError):
        content = parse_format(data, "a handle", FORMAT, VERSION)
    try:
        return to_struct(content, Identification)
    except FormatError as error:
        raise HandleError(f"invalid handle: {error}") from None


# Results of `hapscene device identify`: the parameters as text, the Bode plot (Fig. 7 of the paper), the files.


_HANDLE: Final = (
    ("m_h_kg", "mass of the handle", 1e3, "g"),
    ("m_c_kg", "mass of the coil", 1e3, "g"),
    ("k_s_N_m", "stiffness of the coil's spring", 1.0, "N/m"),
    ("b_s_Ns_m", "damping of the coil", 1.0, "N·s/m"),
    ("amplifier_Hz", "bandwidth of the amplifier", 1.0, "Hz"),
)
_HAND: Final = (("k_u_N_m", "stiffness of the hand", 1.0, "N/m"), ("b_u_Ns_m", "damping of the hand", 1.0, "N·s/m"))

MISFIT_MAX: Final = 2.0
"""Misfit above which the text states that the model does not explain the measurement [1]."""


def modelled(handle: Identification, grip: IdentifiedGrip, frequency_Hz: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Response of the model in a grip, including amplifier, accelerometer and delay [1/kg]."""
    amplifier_s, accelerometer_s = 0.5 / np.pi / np.array([handle.plant.amplifier_Hz, handle.accelerometer_Hz])
    plant = handle.plant_in(grip)
    return sampled_response(plant, frequency_Hz, handle.rate_Hz, amplifier_s, accelerometer_s, handle.delay_s)


def write_bode(handle: Identification, responses: Sequence[Response], path: str | Path) -> None:
    """Draw magnitude, phase and coherence of each grip as PNG: measured (thin) over the model (thick).

    Raises:
        OSError: the folder does not exist or is not writable.
    """
    from hapscene.view.chart import new_chart, save_chart
    from hapscene.view.palette import OKABE_ITO

    colours = [OKABE_ITO[name] for name in ("sky", "blue", "green", "orange", "vermilion", "purple")]
    title = f"{handle.name}: acceleration of the handle over force of its coil, measured (thin) and modelled (thick)"
    with new_chart(11, 9, title, {"font.size": 11}) as figure:
        magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2.4, 1.3))
        fine_Hz = np.geomspace(*handle.band_Hz, 600)
        for i, (grip, response) in enumerate(zip(handle.grips, responses, strict=True)):
            colour = colours[i % len(colours)]
            model = modelled(handle, grip, fine_Hz)
            thick, thin = {"linewidth": 4.5, "alpha": 0.45}, {"linewidth": 1.1}
            for at_Hz, curve, look in ((fine_Hz, model, thick), (response.frequency_Hz, response.response, thin)):
                magnitude.plot(at_Hz, decibels(np.abs(curve)), color=colour, **look)
                phase.plot(at_Hz, _degrees(curve), color=colour, **look)
            label = f"{grip.name}: {grip.k_u_N_m:.0f} N/m, {grip.b_u_Ns_m:.1f} N·s/m"
            coherence.plot(response.frequency_Hz, response.coherence, color=colour, linewidth=1.3, label=label)
        magnitude.set_ylabel("magnitude [dB re 1 m/s²/N]")
        phase.set_ylabel("phase [°]")
        coherence.set(ylabel="coherence [1]", xlabel="frequency [Hz]", ylim=(0.0, 1.03), xscale="log")
        figure.legend(loc="outside lower left", ncols=3, title="grip", alignment="left")
        save_chart(figure, path)


def _degrees(response: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Phase [°] without jumps, near 0 in the middle of the band, where the handle is a mass."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return np.asarray(phase - 360.0 * np.round(phase[len(phase) // 2] / 360.0))


def describe_lines(handle: Identification) -> list[str]:
    """Describe a handle: one line a parameter, with its 95 % interval or the reason why it has none."""
    lines = [f"{handle.name}: {handle.provenance}" if handle.provenance else handle.name]
    lines += [_line(handle, row) for row in _HANDLE]
    for grip in handle.grips:
        lines.append(f"grip {grip.name}: coherence {grip.coherence:.3f}, lowest {grip.coherence_least:.2f}")
        lines += [_line(grip, row) for row in _HAND]
    low, high = handle.asymptote_Hz
    lines.append(f"first estimate of the mass: {1e3 * handle.asymptote_kg:.4g} g, from {low:.0f} to {high:.0f} Hz")
    lines.append(
        f"delay of the acceleration, in addition to the poles of amplifier and accelerometer "
        f"({handle.accelerometer_Hz:g} Hz, from the data sheet): {round(1e6 * handle.delay_s)} µs"
    )
    plant = handle.plant
    lines.append(f"limits (given): {plant.force_limit_N:g} N, {1e3 * plant.travel_limit_m:g} mm to either side")
    lines.append(f"misfit: {handle.misfit:.3g} times the measurement noise")
    if handle.misfit > MISFIT_MAX:
        lines.append(
            "warning: the model does not explain the measurement: the handle differs from it, or the grip changed "
            "during a sweep. The intervals are widened accordingly, and may still be too narrow"
        )
    return lines


def _line(known: Identification | IdentifiedGrip, row: tuple[str, str, float, str]) -> str:
    name, words, scale, unit = row
    value = scale * getattr(known.plant if isinstance(known, Identification) else known, name)
    if name in known.intervals:
        low, high = (scale * edge for edge in known.intervals[name])
        # as many digits as distinguish the ends of the interval
        digits = max(0, 1 - math.floor(math.log10(high - low))) if high > low else 6
        return f"  {words:<31} {value:>9.{digits}f} {unit:<6} between {low:.{digits}f} and {high:.{digits}f}"
    return f"  {words:<31} {value:>9.4g} {unit:<6} not determined: {known.absent.get(name, 'no interval')}"


def write_result(
    handle: Identification, responses: Sequence[Response], recordings: Sequence[GripRecording], path: Path
) -> list[Path]:
    """Write the handle file to `path`; or, if `path` has no suffix .handle, write all results into that folder.

    The folder contains NAME.handle, bode.png, and grip-N.npz for each recording. Returns the paths that were written.

    Raises:
        HandleError: the file cannot be written, or the handle's name is not a valid file name.
        OSError: the folder is not writable.
    """
    if path.suffix == SUFFIX:
        save_handle(handle, path)
        return [path]
    name = handle.name + SUFFIX
    if Path(name).name != name:
        raise HandleError(f"{handle.name!r} is not a valid file name: choose another --name, or use -o FILE{SUFFIX}")
    with whole_folder(path) as folder:
        save_handle(handle, folder / name)
        write_bode(handle, responses, folder / "bode.png")
        for i, recording in enumerate(recordings):
            recording.save(folder / f"grip-{i + 1}.npz")
        made = [path / file.name for file in sorted(folder.iterdir())]
    return made
