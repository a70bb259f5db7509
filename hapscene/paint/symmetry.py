"""Painting in symmetry: what a tool does at one place, it does at its images in mirrors and turns of the body."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError
from hapscene.scene.body import Body

TURNS_MAX: Final = 64
"""Most images around an axis [count]."""


@dataclass(frozen=True)
class Symmetry:
    """Mirrors and turns, through the middle of a body, along its axes.

    Attributes:
        mirrors: axes, of "xyz", that are mirrored: "x" paints right what is painted left.
        turns: how many images there are around the axis; 1 for none.
        axis: "x", "y" or "z".

    Raises:
        SceneError: an axis is none, or there are too many turns.
    """

    mirrors: str = ""
    turns: int = 1
    axis: str = "z"

    def __post_init__(self) -> None:
        if not set(self.mirrors) <= set("xyz") or self.axis not in ("x", "y", "z"):
            raise SceneError(f"an axis is x, y or z; the mirrors are {self.mirrors!r}, the axis is {self.axis!r}")
        if not 1 <= self.turns <= TURNS_MAX:
            raise SceneError(f"there are 1 to {TURNS_MAX} images around an axis, not {self.turns}")

    def images_W(self, body: Body) -> list[NDArray[np.float64]]:
        """Maps (4, 4) in W from a place to each of its images; the first is where it is itself."""
        around = "xyz".index(self.axis)
        i, j = (around + 1) % 3, (around + 2) % 3
        maps = []
        for k in range(self.turns):
            c, s = math.cos(2 * math.pi * k / self.turns), math.sin(2 * math.pi * k / self.turns)
            turn = np.eye(3)
            turn[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
            maps.append(turn)
        for axis in sorted(set(self.mirrors)):
            mirror = np.eye(3)
            mirror["xyz".index(axis), "xyz".index(axis)] = -1.0
            maps += [mirror @ found for found in maps]
        different: list[NDArray[np.float64]] = []
        for found in maps:  # an even number of turns has some mirrors' images already
            if not any(np.allclose(found, other) for other in different):
                different.append(found)
        used_m = body.mesh.vertices_m[np.unique(body.mesh.faces)] if different[1:] else np.zeros((1, 3))
        middle_m = (used_m.min(axis=0) + used_m.max(axis=0)) / 2
        X_BW = np.linalg.inv(body.X_WB)
        return [body.X_WB @ _about(found, middle_m) @ X_BW for found in different]


NONE: Final = Symmetry()
"""Each place is its only image."""


def _about(R: NDArray[np.float64], middle_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The map (4, 4) that turns or mirrors about a point (3,)."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = R, middle_m - R @ middle_m
    return found
