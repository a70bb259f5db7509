"""Where the surfaces that are compared come from: swatches, recordings, libraries."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hapscene.capture.compare import compare
from hapscene.capture.recording_file import SurfaceRecording, load_surface_recording
from hapscene.capture.swatch_fit import fit_parts, prepare
from hapscene.errors import CaptureError, HapsceneError
from hapscene.surface.library import library_folder
from hapscene.surface.swatch import NAME_MAX, Swatch
from hapscene.surface.swatch_file import SUFFIX, load_swatch, shipped_swatches


@dataclass(frozen=True)
class Surface:
    """A surface to compare.

    Attributes:
        swatch: how it feels.
        repeat_jnd: how far two halves of its recording are apart, in units of what is felt; None for a swatch, and for
            a recording too short to be halved. Differences below it may be the recording's own.
    """

    swatch: Swatch
    repeat_jnd: float | None = None


def load_surface(
    name_or_path: str | os.PathLike[str],
    rate_Hz: float | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> Surface:
    """The surface of a swatch's name or file, or of a recording, to which a swatch is fitted.

    Text that ends in ".swatch", and text that names no file, is a swatch; every other file is a recording, of which
    `rate_Hz`, `columns` and `units` are as in `load_surface_recording`.

    Raises:
        SwatchError: no such swatch, or a broken one.
        CaptureError: no swatch can be fitted to the recording.
    """
    path = Path(name_or_path)
    if path.suffix == SUFFIX or not path.is_file():
        return Surface(load_swatch(name_or_path))
    recording = load_surface_recording(path, rate_Hz, columns, units)
    try:
        swatch = _fitted(recording, path.stem)
    except CaptureError as error:
        raise CaptureError(f"{path}: {error}") from None
    try:
        middle = len(recording.acceleration_m_s2) // 2
        halves = [_fitted(_part(recording, part), path.stem, swatch) for part in (slice(middle), slice(middle, None))]
    except CaptureError:
        return Surface(swatch)  # the halves are too short, the whole was not
    return Surface(swatch, compare(*halves).distance_jnd)


def load_library(folder: str | os.PathLike[str] | None = None) -> tuple[list[Swatch], dict[str, str]]:
    """The swatches of a folder, and file to reason of those that cannot be read; without a folder those shipped and
    those of the user's own library.

    Raises:
        CaptureError: the folder is missing, or holds no swatch that can be read.
    """
    if folder is None:
        shipped = [load_swatch(name) for name in shipped_swatches()]
        if not library_folder().is_dir():
            return shipped, {}
        own, broken = _folder(library_folder())
        return shipped + own, broken
    path = Path(folder)
    if not path.is_dir():
        raise CaptureError(f"{path}: no such folder of swatches")
    found, broken = _folder(path)
    if not found:
        raise CaptureError(f"{path}: holds no swatch that can be read ({len(broken)} broken)")
    return found, broken


def _folder(path: Path) -> tuple[list[Swatch], dict[str, str]]:
    found, broken = [], {}
    for file in sorted(path.rglob("*" + SUFFIX)):
        try:
            found.append(load_swatch(file))
        except HapsceneError as error:
            broken[str(file)] = str(error)
    return found, broken


def _fitted(recording: SurfaceRecording, name: str, like: Swatch | None = None) -> Swatch:
    order: int | Literal["auto"] = "auto" if like is None or like.texture is None else like.texture.order
    printable = "".join(c for c in name if c.isprintable())[:NAME_MAX] or "unnamed"
    return fit_parts([prepare(recording)], printable, order)


def _part(recording: SurfaceRecording, part: slice) -> SurfaceRecording:
    """A stretch of all streams."""
    streams = ((f.name, getattr(recording, f.name)) for f in fields(recording))
    chosen: dict[str, Any] = {name: stream[part] for name, stream in streams if isinstance(stream, np.ndarray)}
    return replace(recording, **chosen)
