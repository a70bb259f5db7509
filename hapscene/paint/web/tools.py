"""The tools of the page: what the pointer does to the scene."""

import math
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from hapscene.paint.history import face_count_text
from hapscene.paint.paintable_mesh import Hit
from hapscene.paint.session import ERASE, FACET_RAD, Session
from hapscene.paint.web.scene_view import Pointer, SceneView
from hapscene.paint.web.touch_hand import TouchHand
from hapscene.surface.swatch import PLAIN, SwatchLike

TOOLS: Final = ("brush", "fill", "box", "sphere", "eraser", "pick", "touch")

FILLS: Final = ("facet", "whole body", "material", "same swatch")
"""What the bucket fills from the place that is clicked."""

FIRST_SWATCH: Final = "wood"
"""The swatch to begin with where a scene has none but plain: a first stroke must be seen."""

RADIUS_SHARE: Final = (0.002, 0.03, 0.3)
"""Smallest brush, brush at the start and largest brush, in diagonals of the scene [1]."""


class Tools:
    """The tool in hand and its settings.

    Args:
        session, view, touch: what it works on.
        say: shows a line to the user.

    Attributes:
        name: one of `TOOLS`.
        chosen: name of the swatch to paint with.
        radius_m: of brush, eraser, and of box and sphere that are clicked.
        fill: one of `FILLS`.
        angle_rad: of the facet.
        margin_m: what a box reaches beyond the two places that span it, on every side.
        force_N: with which the hand presses.
        client: the page whose pointer is down on the surface; None while none is.
    """

    def __init__(self, session: Session, view: SceneView, touch: TouchHand, say: Callable[[str], None]) -> None:
        self._session, self._view, self._touch, self._say = session, view, touch, say
        self.name = "brush"
        last = session.scene.swatches[-1]
        self._source: SwatchLike = FIRST_SWATCH if last is PLAIN else last
        self.chosen = FIRST_SWATCH if last is PLAIN else last.name
        self.radius_m = RADIUS_SHARE[1] * view.diagonal_m
        self.fill = FILLS[0]
        self.angle_rad = FACET_RAD
        self.margin_m = 0.01 * view.diagonal_m
        self.force_N = 1.0
        self.client: int | None = None
        self._start: Hit | None = None
        self._last: Hit | None = None
        self._before = 0  # where the history stood when this stroke began
        self._coarse = False  # whether this stroke has met faces larger than the brush

    @property
    def swatch(self) -> int | None:
        """Index of the chosen swatch; None where the scene has it not, or no longer."""
        return self._session.painting.swatch_named(self.chosen)

    def ensure_swatch(self) -> int:
        """The same; it is put into the scene where that has it not.

        Raises:
            SwatchError: it is unknown or broken.
            SceneError: another swatch of its name is in the scene.
        """
        index = self.swatch
        return self._session.add_swatch(self._source) if index is None else index

    def choose_swatch(self, name: str, source: SwatchLike) -> None:
        """Paint with another swatch from now on: its name, and itself or what the scene loads it by."""
        self.chosen, self._source = name, source

    def choose_tool(self, name: str) -> None:
        """Take another tool."""
        if name in TOOLS and name != self.name:
            self.finish()
            self.name = name

    def resize(self, radius_m: float) -> None:
        """Another brush size, within its bounds."""
        low, high = (share * self._view.diagonal_m for share in (RADIUS_SHARE[0], RADIUS_SHARE[2]))
        self.radius_m = min(max(radius_m, low), high)

    def finish(self) -> None:
        """End what the pointer was doing."""
        self._session.end_stroke()
        self._touch.lift(time.monotonic())
        self._view.show_box(None)
        self._view.show_sphere(None)
        self.client = self._start = self._last = None

    async def hover(self, pointer: Pointer) -> None:
        """The pointer moves, its button up."""
        if self.client is not None:
            return
        ray = self._view.ray(pointer)
        drawn = self.name in ("brush", "eraser", "sphere")
        hit = self._session.pick(*ray) if ray is not None and drawn else None
        self._view.show_ring(hit, self.radius_m)

    async def press(self, pointer: Pointer) -> None:
        """The button goes down."""
        ray = self._view.ray(pointer)
        if ray is None:
            return
        if self.client is not None:  # another page draws, or its end was lost
            self.finish()
        hit = self._session.pick(*ray)
        if hit is None:
            self._say("Beside the surface: point at it, then hold Shift and press.")
            return
        swatch = self.ensure_swatch() if self.name in ("brush", "fill", "box", "sphere") else ERASE
        self.client, self._start, self._last = pointer.client, hit, hit
        if self.name in ("brush", "eraser"):
            self._session.begin_stroke(swatch, self.radius_m)
            self._session.drag_to(*ray)
            self._view.show_ring(hit, self.radius_m)
            self._coarse, self._before = False, self._session.history.state
            self._look_at_faces(hit)
        elif self.name == "fill":
            self._fill(hit, swatch)
        elif self.name == "pick":
            picked = self._session.scene.swatches[self._session.swatch_at(hit)]
            self.choose_swatch(picked.name, picked)
            self._say(f"Picked {self.chosen}.")
        elif self.name == "touch":
            self._touch.press(*self._contact(hit, ray[1]))
        else:
            self._view.show_ring(None, self.radius_m)
            self._show_region()

    async def drag(self, pointer: Pointer) -> None:
        """It moves, the button down."""
        ray = self._view.ray(pointer)
        if ray is None or self.client != pointer.client:
            return
        if self.name in ("brush", "eraser"):
            with self._session.lock:
                if not self._session.stroking:  # ended by what else was done, from another page or by a key
                    self._session.begin_stroke(ERASE if self.name == "eraser" else self.ensure_swatch(), self.radius_m)
                hit = self._session.drag_to(*ray)
            self._view.show_ring(hit, self.radius_m)
            self._look_at_faces(hit)
            return
        hit = self._session.pick(*ray)
        if hit is None:
            return
        self._last = hit
        if self.name == "touch":
            self._touch.move(*self._contact(hit, ray[1]))
        else:
            self._show_region()

    async def release(self, pointer: Pointer | None) -> None:
        """The button goes up; None where it was lost: what was begun ends, boxes and spheres without painting."""
        if pointer is not None and self.client != pointer.client:
            return
        try:
            if pointer is not None and self._start is not None:
                await self.drag(pointer)  # where the button went up, it was last
                self._fill_region()
                self._session.end_stroke()
                if self.name in ("brush", "eraser") and self._session.history.state == self._before:
                    self._say(self._why_nothing())
        finally:
            self.finish()

    def _look_at_faces(self, hit: Hit | None) -> None:
        """Say it once in a stroke, where the faces are larger than the brush."""
        if hit is None or self._coarse:
            return
        self._coarse = self._session.shapes[hit.body].longest_edge_m(hit.face) > 2 * self.radius_m
        if self._coarse:
            self._say("Whole faces are painted; here they are larger than the brush. A finer mesh has finer borders.")

    def _show_region(self) -> None:
        """See what the box or the ball would hold."""
        if self.name == "box":
            X_WK, size_m = self._box()
            self._view.show_box(size_m, X_WK)
        elif self.name == "sphere":
            self._view.show_sphere(*self._sphere())

    def _fill_region(self) -> None:
        """Paint what the box or the ball holds."""
        if self.name == "box":
            X_WK, size_m = self._box()
            count = self._session.fill_box(X_WK, size_m, self.ensure_swatch())
        elif self.name == "sphere":
            count = self._session.fill_sphere(*self._sphere(), self.ensure_swatch())
        else:
            return
        self._say(f"{face_count_text(count)} painted." if count else "There is no face inside that is not painted so.")

    def _why_nothing(self) -> str:
        """Why a stroke has changed nothing."""
        if self.name == "eraser":
            return "Nothing is painted here."
        return f"It is {self.chosen} already. Choose another swatch at the right: Paint with it."

    def _fill(self, hit: Hit, swatch: int) -> None:
        session = self._session
        if self.fill == "whole body":
            count = session.fill_body(hit.body, swatch)
        elif self.fill == "material":
            count = session.fill_group_at(hit, swatch)
        elif self.fill == "same swatch":
            count = session.fill_swatch(hit.body, session.swatch_at(hit), swatch)
        else:
            count = session.fill_facet(hit, swatch, self.angle_rad)
        self._say(f"{face_count_text(count)} painted." if count else self._why_nothing())

    def _contact(self, hit: Hit, direction_W: Any) -> tuple[Any, Any, float, float]:
        """Place, outward normal, force and stiffness for the hand."""
        nhat = hit.nhat_W if float(hit.nhat_W @ direction_W) <= 0.0 else -hit.nhat_W
        stiffness = self._session.tuning.parameters(self._session.swatch_at(hit))[0].given
        return hit.p_W_m, nhat, self.force_N, stiffness

    def _box(self) -> tuple[Any, Any]:
        """Pose and size of the box from where the button went down to where it is, along the body's axes."""
        assert self._start is not None and self._last is not None
        R_WB = self._session.scene.bodies[self._start.body].X_WB[:3, :3]
        way_B = R_WB.T @ (self._last.p_W_m - self._start.p_W_m)
        X_WK = np.eye(4)
        X_WK[:3, :3] = R_WB
        X_WK[:3, 3] = (self._start.p_W_m + self._last.p_W_m) / 2
        margin_m = self.radius_m if not way_B.any() else self.margin_m
        return X_WK, np.abs(way_B) + 2 * margin_m

    def _sphere(self) -> tuple[Any, float]:
        """Middle and radius of the ball from where the button went down to where it is."""
        assert self._start is not None and self._last is not None
        radius = math.dist(self._start.p_W_m, self._last.p_W_m)
        return self._start.p_W_m, radius if radius > 1e-9 else self.radius_m
