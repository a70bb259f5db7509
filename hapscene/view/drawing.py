"""What is handed to GL: triangles in parts, and for each frame which parts are shown, where, and from where."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapscene.view.solid import Solid

Shown = list[tuple[int, NDArray[np.float64]]]
"""Indices of parts that are seen, each with its pose X_SP (4, 4)."""


@dataclass(frozen=True)
class Frame:
    """One frame."""

    X_SC: NDArray[np.float64]
    """(4, 4) pose of the camera, which looks along its own −z."""
    shown: Shown


@dataclass(frozen=True)
class Drawing:
    """Parts and frames. Frame S is W moved to the scene's middle, since GL counts in float32."""

    parts: Sequence[Solid]
    """Each in a frame P of its own."""
    frames: Sequence[Frame]
    """As many as there are to draw."""
    extent_m: tuple[float, float, float]
    """Half width and half height of what the orthographic camera sees, and how far it sees."""
    size: tuple[int, int]
    """Width and height [pixels]."""
    background: str
    """Colour, "#rrggbb"."""
    oversampling: int
    """Pixels drawn for each pixel of `size`, along each side."""

    def save(self, path: Path) -> None:
        """Write as npz, for the process that draws."""
        shown = [(k, part, X_SP) for k, frame in enumerate(self.frames) for part, X_SP in frame.shown]
        with path.open("wb") as file:
            np.savez(
                file,
                **packed(self.parts),
                X_SC=np.array([frame.X_SC for frame in self.frames]),
                shown=np.array([(k, part) for k, part, _ in shown]),
                X_SP=np.array([X_SP for *_, X_SP in shown]),
                extent_m=self.extent_m,
                size=self.size,
                background=self.background,
                oversampling=self.oversampling,
            )

    @classmethod
    def load(cls, path: Path) -> "Drawing":
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as archive:
            shown: list[Shown] = [[] for _ in archive["X_SC"]]
            for (k, part), X_SP in zip(archive["shown"], archive["X_SP"], strict=True):
                shown[k].append((int(part), X_SP))
            x_m, y_m, far_m = (float(m) for m in archive["extent_m"])
            width, height = (int(n) for n in archive["size"])
            return cls(
                unpacked(archive),
                [Frame(X_SC, parts) for X_SC, parts in zip(archive["X_SC"], shown, strict=True)],
                (x_m, y_m, far_m),
                (width, height),
                str(archive["background"]),
                int(archive["oversampling"]),
            )


def same(a: Shown, b: Shown) -> bool:
    """Whether the same parts are seen at the same places."""
    return len(a) == len(b) and all(i == j and np.array_equal(X, Y) for (i, X), (j, Y) in zip(a, b, strict=True))


def packed(parts: Sequence[Solid]) -> dict[str, Any]:
    """Arrays that hold all the parts, in float32 as GL takes them."""
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts]).astype(np.float32)
        for name in ("corner_m", "normal", "colour")
    }
    return arrays | {"part_end": np.cumsum([len(part.corner_m) for part in parts])}


def unpacked(archive: Any) -> list[Solid]:
    """The parts from those arrays."""
    names = ("corner_m", "normal", "colour")
    pieces = [np.split(archive[name], archive["part_end"][:-1]) for name in names]
    return [Solid(*arrays) for arrays in zip(*pieces, strict=True)]
