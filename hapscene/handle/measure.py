"""Record the sweep in several grips, or load the recordings from files."""

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
    """Force (n,) [N] and acceleration (n,) [m/s²] of one grip, at `rate_Hz`."""

    name: str
    force_N: Array
    acceleration_m_s2: Array
    rate_Hz: float

    def response(self, band_Hz: tuple[float, float]) -> Response:
        """Estimate the frequency response in the band, up to 0.45 of the sample rate.

        Raises:
            HandleError: as `estimate_response`, with the name of the recording.
        """
        band_Hz = (band_Hz[0], min(band_Hz[1], 0.45 * self.rate_Hz))
        with refusing(HandleError, self.name):
            return estimate_response(self.force_N, self.acceleration_m_s2, self.rate_Hz, band_Hz=band_Hz)

    def save(self, path: Path) -> None:
        """Write the recording as npz, atomically, for `hapscene device identify --from`.

        Raises:
            OSError: the folder does not exist or is not writable.
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
        sweep: the sweep.
        guess: the plant that predicts the travel of the coil.
        names: names of the grips.
        ready: called with the index of each grip before the sweep; returns when the hand holds the handle in that grip.

    Raises:
        HandleError: the handle is disconnected, or cannot play the sweep.
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
    """Load one grip from each file (`load_grip`).

    Raises:
        CaptureError, HandleError: as `load_grip`.
        HandleError: the files differ in sample rate.
    """
    recordings = [load_grip(path, rate_Hz, columns, units) for path in paths]
    for recording, path in zip(recordings, paths, strict=True):
        if recording.rate_Hz != recordings[0].rate_Hz:
            raise HandleError(
                f"{path}: sample rate {recording.rate_Hz:g} Hz differs from {recordings[0].rate_Hz:g} Hz of "
                f"{paths[0]}: record all grips at the same rate"
            )
    return recordings


def load_grip(
    path: str, rate_Hz: float | None = None, columns: dict[str, str] | None = None, units: dict[str, str] | None = None
) -> GripRecording:
    """Load a grip from a file with the columns force and acceleration.

    Args:
        path: CSV, WAV, NPZ, MAT or .hsrec.
        rate_Hz: sample rate, if the file does not contain it [Hz].
        columns: names of the file's columns, by quantity, if they differ.
        units: units by quantity, if the file does not contain them.

    Raises:
        CaptureError: the file does not exist, is not numeric, or lacks rate or units.
        HandleError: the force is missing; or the acceleration has three axes, whose combination would lose the phase.
    """
    from hapscene.capture.io.formats import read_recording_source
    from hapscene.capture.io.recording import load_recording

    chosen = columns or {}
    named = chosen.get("acceleration", "acceleration")
    known = read_recording_source(Path(path)).columns
    if named not in known and ("acceleration" not in chosen or "+" in named):
        raise HandleError(
            f"{path}: the column of the acceleration along the handle is not known: name it by "
            f"--columns acceleration=COLUMN; columns of the file: {', '.join(known)}"
        )
    del known
    recording = load_recording(path, rate_Hz, columns={"acceleration": named, **chosen}, units=units)
    if recording.force_N is None:
        raise HandleError(f'{path}: no column "force": name the column of the force by --columns force=COLUMN')
    return GripRecording(Path(path).stem, recording.force_N, recording.acceleration_m_s2, recording.rate_Hz)
