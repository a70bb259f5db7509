"""A stroke of the brush while it is being drawn: painted at once, one step of undo when it ends."""

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import SceneError
from hapscene.paint.history import FaceDelta, Step, faces_word

if TYPE_CHECKING:
    from hapscene.paint.paintable_mesh import Hit
    from hapscene.paint.painting import Canvas

SPLIT_MAX: Final = 64
"""Most pieces that one move of the pointer is split into [count]: a sweep over a window's width at some 20 pixels."""

STEP_SHARE: Final = 0.5
"""Longest way between two places of a stroke before the move is split, in radii of the brush [1]: a surface curved like
the brush itself is left by 3 % of the radius."""


class Stroke:
    """A stroke on a canvas.

    Args:
        canvas: painted at once.
        swatch: its index, or `ERASE`.
        radius_m: of the brush [m].
        word: what the step is called.

    Attributes:
        moves: how often it changed faces.

    Raises:
        SceneError: no such swatch, or no radius.
    """

    def __init__(self, canvas: "Canvas", swatch: int, radius_m: float, word: str) -> None:
        if not (math.isfinite(radius_m) and radius_m > 0.0):
            raise SceneError(f"a brush's radius must be above 0 mm, is {radius_m * 1e3:g} mm")
        canvas.ink(swatch, 0)
        self.moves = 0
        self._canvas, self._swatch, self._radius_m, self._word = canvas, swatch, float(radius_m), word
        self._before: dict[int, NDArray[np.int16]] = {}  # bodies as they were
        self._last: Hit | None = None
        self._ray: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def to(self, hit: "Hit | None") -> int:
        """Draw from the last place to this one, on the surface; how many faces became others.

        Where the last place was on another body, or beside the surface (None), only this place is painted.
        """
        last, self._last = self._last, hit
        if hit is None:
            return 0
        if last is None or last.body != hit.body:
            last = hit
        canvas, body = self._canvas, hit.body
        faces = canvas.shapes[body].brush((last.face, hit.face), (last.p_B_m, hit.p_B_m), self._radius_m)
        paint, ink = canvas.scene.bodies[body].face_swatch, canvas.ink(self._swatch, body)
        faces = faces[paint[faces] != ink]
        if len(faces):
            if body not in self._before:
                self._before[body] = paint.copy()
            paint[faces] = ink
            self.moves += 1
            canvas.note_faces(body, faces)
        return len(faces)

    def drag_to(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> "Hit | None":
        """Draw to where a ray from the eye through the pointer meets the surface; that place, or None beside it.

        A long move is split: rays between the last one and this one find the way on the surface that the eye saw.
        """
        hit = self._canvas.pick(origin_W_m, direction_W)
        origin, direction = np.asarray(origin_W_m, np.float64), np.asarray(direction_W, np.float64)
        length = float(np.linalg.norm(direction))
        ray = (origin, direction / length) if length > 0.0 else None
        if ray is not None and self._ray is not None:
            count = self._pieces(self._ray, ray, hit)
            for share in np.arange(1, count) / count:
                o, d = (was + share * (now - was) for was, now in zip(self._ray, ray, strict=True))
                self.to(self._canvas.pick(o, d))
        self._ray = ray
        self.to(hit)
        return hit

    def _pieces(
        self,
        was: tuple[NDArray[np.float64], NDArray[np.float64]],
        now: tuple[NDArray[np.float64], NDArray[np.float64]],
        hit: "Hit | None",
    ) -> int:
        """How many pieces a move is split into."""
        known = [h for h in (hit, self._last) if h is not None]
        if not known:
            return 1
        depth_m = max(h.distance_m for h in known)
        way_m = float(np.linalg.norm(now[0] - was[0])) + depth_m * float(np.linalg.norm(now[1] - was[1]))
        if len(known) == 2:
            way_m = max(way_m, float(np.linalg.norm(known[0].p_W_m - known[1].p_W_m)))
        return int(min(max(math.ceil(way_m / (STEP_SHARE * self._radius_m)), 1), SPLIT_MAX))

    def step(self) -> Step | None:
        """All that the stroke changed, as one step; None where that is nothing."""
        deltas = []
        for body, old in self._before.items():
            new = self._canvas.scene.bodies[body].face_swatch
            faces = np.flatnonzero(old != new)
            if len(faces):
                deltas.append(FaceDelta.pack(body, faces, old[faces], new[faces]))
        count = sum(delta.count for delta in deltas)
        return Step(f"{self._word}, {faces_word(count)}", faces=tuple(deltas)) if deltas else None
