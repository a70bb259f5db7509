"""The surfaces of the figures: recordings if a folder is given, otherwise signals synthesised from shipped swatches."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hapscene.capture.fit.synthesis import synthesize
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import Streams, clean
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.errors import CaptureError
from hapscene_swatches.fit import SOURCES, load_source


@dataclass(frozen=True, eq=False)
class Material:
    """A drag of a tool over a surface.

    Attributes:
        name: name of the surface.
        recorded: True for a recording, False for a signal synthesised from the swatch.
        streams: the cleaned streams.
    """

    name: str
    recorded: bool
    streams: Streams

    @property
    def title(self) -> str:
        """Name of the surface, and the origin of the streams."""
        return f"{self.name}, {'recorded' if self.recorded else 'synthesised'}"


def load_materials(folder: Path | None) -> dict[str, Material]:
    """Return the materials of the shipped swatches by name, from the recordings in `folder` where present.

    Raises:
        CaptureError: a folder without any of the recordings, or an invalid recording.
    """
    present = {name for name, source in SOURCES.items() if folder is not None and (folder / source.file).is_file()}
    if folder is not None and not present:
        files = ", ".join(source.file for source in SOURCES.values())
        raise CaptureError(f"{folder}: no recording found; expected one or more of {files}")
    found = {}
    for name in SOURCES:
        r = load_source(name, folder) if folder is not None and name in present else _stroke(name)
        found[name] = Material(name, name in present, clean(r.acceleration_m_s2, r.rate_Hz, r.force_N, r.speed_m_s))
    return found


def _stroke(name: str) -> SurfaceRecording:
    """Synthesise a stroke of 1.9 s, the length of the recordings, at about 1.2 N and 0.15 m/s."""
    t_s = np.arange(round(1.9 * ACCELERATION_RATE_HZ)) / ACCELERATION_RATE_HZ
    force_N, speed_m_s = 1.2 + 0.4 * np.sin(2.0 * np.pi * 0.9 * t_s), 0.15 + 0.05 * np.sin(2.0 * np.pi * 1.3 * t_s)
    acceleration = synthesize(name, force_N, speed_m_s, rate_Hz=ACCELERATION_RATE_HZ)
    return SurfaceRecording(ACCELERATION_RATE_HZ, acceleration, force_N, speed_m_s, None)
