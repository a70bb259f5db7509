"""The surfaces of the figures: recordings where a folder has them, else what the shipped swatches synthesise."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hapscene.capture.recording_file import SurfaceRecording
from hapscene.capture.streams import clean
from hapscene.capture.synthesis import synthesize
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.errors import CaptureError
from hapscene_swatches.fit import SOURCES, load_source

from .finding import Array

SYNTHETIC_S: Final = 1.9
"""Length of a stroke that is synthesised [s]: that of the project's recordings."""


@dataclass(frozen=True, eq=False)
class Material:
    """A tool on a surface: n samples of each stream; the acceleration as it came, and high-passed at 20 Hz."""

    name: str
    real: bool
    rate_Hz: float
    t_s: Array
    distance_m: Array
    force_N: Array
    acceleration_m_s2: Array
    cleaned_m_s2: Array

    @property
    def title(self) -> str:
        """Its name, and what it is."""
        return f"{self.name}, {'recorded' if self.real else 'synthesised'}"


def load_materials(folder: Path | None) -> dict[str, Material]:
    """The materials of the shipped swatches by name: from `folder` where that has the recording.

    Raises:
        CaptureError: a folder that has none of them, or a recording that is none.
    """
    found = {name: folder is not None and (folder / source.file).is_file() for name, source in SOURCES.items()}
    if folder is not None and not any(found.values()):
        files = ", ".join(source.file for source in SOURCES.values())
        raise CaptureError(f"{folder}: has no recording; expected one or more of {files}")
    return {
        name: _material(name, load_source(name, folder) if folder is not None and found[name] else None)
        for name in SOURCES
    }


def _material(name: str, recording: SurfaceRecording | None) -> Material:
    real = recording is not None
    r = _stroke(name) if recording is None else recording
    streams = clean(r.acceleration_m_s2, r.rate_Hz, r.force_N, r.speed_m_s)
    distance_m = np.cumsum(streams.speed_m_s) / r.rate_Hz
    t_s = np.arange(len(distance_m)) / r.rate_Hz
    force_N = streams.force_N
    return Material(
        name, real, r.rate_Hz, t_s, distance_m, force_N, r.acceleration_m_s2, streams.acceleration_m_s2
    )  # fmt: skip


def _stroke(name: str) -> SurfaceRecording:
    """What a swatch gives along a stroke at about 1.2 N and 0.15 m/s."""
    t_s = np.arange(round(SYNTHETIC_S * ACCELERATION_RATE_HZ)) / ACCELERATION_RATE_HZ
    force_N, speed_m_s = 1.2 + 0.4 * np.sin(2.0 * np.pi * 0.9 * t_s), 0.15 + 0.05 * np.sin(2.0 * np.pi * 1.3 * t_s)
    acceleration = synthesize(name, force_N, speed_m_s, rate_Hz=ACCELERATION_RATE_HZ)
    return SurfaceRecording(ACCELERATION_RATE_HZ, acceleration, force_N, speed_m_s, None)
