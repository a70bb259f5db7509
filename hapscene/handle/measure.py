"""The sweep played in one grip after another, and what is made of the recordings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hapscene.errors import HandleError
from hapscene.handle.force_source import ForceSource
from hapscene.handle.plant import Array, Plant
from hapscene.handle.response import Response, estimate_response
from hapscene.handle.sweep import Sweep
from hapscene.io.files import refusing, whole_file

__all__ = ["GripRecording", "load_grip", "load_grips", "play_grips"]


@dataclass(frozen=True)
class GripRecording:
    """Force (n,) [N] and acceleration (n,) [m/s²] of one grip."""

    name: str
    force_N: Array
    acceleration_m_s2: Array
    rate_Hz: float

    def response(self, band_Hz: tuple[float, float]) -> Response:
        """Acceleration over force in the band, as far as the rate goes.

        Raises:
            HandleError: as of `estimate_response`, with the recording's name.
        """
        band_Hz = (band_Hz[0], min(band_Hz[1], 0.45 * self.rate_Hz))
        with refusing(HandleError, self.name):
            return estimate_response(self.force_N, self.acceleration_m_s2, self.rate_Hz, band_Hz=band_Hz)

    def save(self, path: Path) -> None:
        """Write it as npz, whole or not at all: `hapscene device identify --from` reads it.

        Raises:
            OSError: the folder is missing or cannot be written.
        """
        with whole_file(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file,
                force=self.force_N.astype(np.float32),
                acceleration=self.acceleration_m_s2.astype(np.float32),
                rate_Hz=self.rate_Hz,
                units=np.array(["force=N", "acceleration=m/s2"]),
            )


def play_grips(
    source: ForceSource, sweep: Sweep, guess: Plant, names: Sequence[str], ready: Callable[[int], None]
) -> list[GripRecording]:
    """Play the sweep once in each grip.

    Args:
        source: the handle.
        sweep: what is played.
        guess: the handle as far as it is known, by which travel is predicted.
        names: of the grips.
        ready: called with each grip's index before it is played; returns when the hand holds the handle so.

    Raises:
        HandleError: the handle is gone, or cannot play it.
    """
    force_N = sweep.force(source.rate_Hz, guess)
    recordings = []
    for i, name in enumerate(names):
        ready(i)
        recordings.append(GripRecording(name, *source.play(force_N), source.rate_Hz))
    return recordings


def load_grips(
    paths: Sequence[str],
    rate_Hz: float | None = None,
    columns: dict[str, str] | None = None,
    units: dict[str, str] | None = None,
) -> list[GripRecording]:
    """A grip from each file, all at one rate; see `load_grip`.

    Raises:
        CaptureError, HandleError: as there.
        HandleError: the files differ in rate.
    """
    recordings = [load_grip(path, rate_Hz, columns, units) for path in paths]
    for recording, path in zip(recordings, paths, strict=True):
        if recording.rate_Hz != recordings[0].rate_Hz:
            raise HandleError(
                f"{path}: {recording.rate_Hz:g} Hz, {paths[0]}: {recordings[0].rate_Hz:g} Hz: "
                "grips must be recorded at one rate to be identified together"
            )
    return recordings


def load_grip(
    path: str, rate_Hz: float | None = None, columns: dict[str, str] | None = None, units: dict[str, str] | None = None
) -> GripRecording:
    """A grip from a file with columns force and acceleration; what the file does not say is given, as to `capture`.

    Raises:
        CaptureError: a file that is missing, not of numbers, or without rate or units.
        HandleError: no force; or three axes, which cannot be made one here, as their phase would be lost.
    """
    from hapscene.capture.io.formats import read_recording_source
    from hapscene.capture.io.recording import load_recording

    chosen = columns or {}
    named = chosen.get("acceleration", "acceleration")
    known = read_recording_source(Path(path)).columns
    if named not in known and ("acceleration" not in chosen or "+" in named):
        raise HandleError(
            f"{path}: one column must be the acceleration along the handle: --columns acceleration=COLUMN; "
            f"there are: {', '.join(known)}"
        )
    del known
    recording = load_recording(path, rate_Hz, columns={"acceleration": named, **chosen}, units=units)
    if recording.force_N is None:
        raise HandleError(f'{path}: no column "force": --columns force=COLUMN says which holds the actuator\'s force')
    return GripRecording(Path(path).stem, recording.force_N, recording.acceleration_m_s2, recording.rate_Hz)
