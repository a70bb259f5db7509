"""Tools of the page: what the pointer does to the scene."""

import math
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from hapscene.paint.model.history import face_count_text
from hapscene.paint.model.mesh import Hit
from hapscene.paint.model.regions import Outline
from hapscene.paint.model.session import ERASE, FACET_RAD, FILLS, Session
from hapscene.paint.model.strokes import NONE
from hapscene.paint.web.hand import TouchHand
from hapscene.paint.web.view import Pointer, SceneView
from hapscene.surface.swatch import PLAIN, SwatchLike

__all__ = ["RADIUS_SHARE", "REGIONS", "STROKES", "TOOLS", "Tools"]

CORNERS_MAX: Final = 400
"""Most corners of a line [count]: then every second one goes."""

CLOSE_PIXELS: Final = 12.0
"""How near the first corner a click closes a polygon [pixels]."""


class OutlineTool:
    """The line that is drawn.

    Attributes:
        client: the page that it is drawn on.
        corners: (k, 2) from left and top of the canvas, in shares of its size.
    """

    def __init__(self) -> None:
        self.client = -1
        self.corners: list[tuple[float, float]] = []

    def add(self, pointer: Pointer) -> None:
        """The line goes on to where the pointer is; on another page, it begins there."""
        if pointer.client != self.client:
            self.client, self.corners = pointer.client, []
        place = (pointer.x, pointer.y)
        if not self.corners or place != self.corners[-1]:
            self.corners.append(place)
        if len(self.corners) > CORNERS_MAX:
            del self.corners[1:-1:2]

    def closes(self, pointer: Pointer) -> bool:
        """Whether a click there closes a polygon: near its first corner."""
        if pointer.client != self.client or len(self.corners) < 3:
            return False
        x, y = self.corners[0]
        return bool(np.hypot((x - pointer.x) * pointer.width, (y - pointer.y) * pointer.height) <= CLOSE_PIXELS)

    def take(self, view: SceneView, pointer: Pointer) -> tuple[Any, Any] | None:
        """What the line holds: a region for a map from W, and the eye; None for a line of no area. It is gone then."""
        corners, self.corners = np.array(self.corners), []
        eye = view.eye(pointer)
        if len(corners) < 3 or eye is None:
            return None
        X_WE, slope = eye
        flat = (2 * corners - 1) * slope
        X_EW = np.linalg.inv(X_WE)
        return lambda X_BW: Outline(X_EW @ np.linalg.inv(X_BW), flat), X_WE[:3, 3]

    @property
    def told(self) -> dict[str, Any] | None:
        """What the page draws of it."""
        return {"client": self.client, "corners": list(self.corners)} if self.corners else None


TOOLS: Final = ("brush", "fill", "box", "sphere", "eraser", "pick", "touch", "lasso", "polygon")

STROKES: Final = ("brush", "eraser")
REGIONS: Final = ("box", "sphere", "lasso")
"""Tools that paint when the button goes up."""

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
        softness, opacity, symmetry: of what is painted, see `strokes.Brush`; a fill has none of them.
        fill: one of `FILLS`.
        angle_rad: of the facet.
        margin_m: what a box reaches beyond the two places that span it, on every side.
        through: whether what is not seen is painted too: backs, and what something else hides.
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
        self.through = False
        self.softness, self.opacity, self.symmetry = 0.0, 1.0, NONE
        self.outline = OutlineTool()
        self._hovered: Pointer | None = None
        self.force_N = 1.0
        self.client: int | None = None
        self._start: Hit | None = None
        self._last: Hit | None = None
        self._eye_W_m: Any = None
        self._before = 0  # where the history stood when this stroke began

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
        self.outline.corners = []
        self._session.end_stroke()
        self._touch.lift(time.monotonic())
        self._view.show_box(None)
        self._view.show_sphere(None)
        self.client = self._start = self._last = None

    async def hover(self, pointer: Pointer) -> None:
        """The pointer moves, its button up."""
        if self.client is not None:
            return
        self._hovered = pointer
        ray = self._view.ray(pointer)
        drawn = self.name in (*STROKES, "sphere")
        hit = self._session.pick(*ray, seen=True) if ray is not None and drawn else None
        self._view.show_ring(hit, self.radius_m)

    async def press(self, pointer: Pointer) -> None:
        """The button goes down."""
        ray = self._view.ray(pointer)
        if ray is None:
            return
        if self.client is not None:  # another page draws, or its end was lost
            self.finish()
        if self.name in ("lasso", "polygon"):
            self._outline(pointer)
            return
        hit = self._session.pick(*ray, seen=True)
        if hit is None:
            self._say("Beside the surface: point at it, then hold Shift and press.")
            return
        swatch = self.ensure_swatch() if self.name in ("brush", "fill", "box", "sphere") else ERASE
        self.client, self._start, self._last, self._eye_W_m = pointer.client, hit, hit, ray[0]
        if self.name in STROKES:
            self._session.begin_stroke(swatch, self.radius_m, **self._brush)
            self._session.drag_to(*ray)
            self._view.show_ring(hit, self.radius_m)
            self._before = self._session.history.state
        elif self.name == "fill":
            self._fill(hit, swatch)
        elif self.name == "pick":
            self._take(hit)
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
        if self.name == "lasso":
            self.outline.add(pointer)
            return
        if self.name in STROKES:
            with self._session.lock:
                if not self._session.stroking:  # ended by what else was done, from another page or by a key
                    swatch = ERASE if self.name == "eraser" else self.ensure_swatch()
                    self._session.begin_stroke(swatch, self.radius_m, **self._brush)
                hit = self._session.drag_to(*ray)
            self._view.show_ring(hit, self.radius_m)
            return
        hit = self._session.pick(*ray, seen=True)
        if hit is None:
            return
        self._last, self._eye_W_m = hit, ray[0]
        if self.name == "touch":
            self._touch.move(*self._contact(hit, ray[1]))
        else:
            self._show_region()

    async def release(self, pointer: Pointer | None) -> None:
        """The button goes up; None where it was lost: what was begun ends, boxes and spheres without painting."""
        if pointer is not None and self.client != pointer.client:
            return
        if pointer is not None and self.name == "polygon":
            return  # it goes on with the next click
        try:
            if pointer is not None and self.client is not None:
                await self.drag(pointer)  # where the button went up, it was last
                self._fill_region(pointer)
                self._session.end_stroke()
                if self.name in STROKES and self._session.history.state == self._before:
                    self._say(self._why_nothing())
        finally:
            self.finish()

    def sample(self, client: int) -> None:
        """Take the swatch under the pointer of a page, whatever the tool."""
        ray = self._view.ray(self._hovered) if self._hovered is not None and self._hovered.client == client else None
        hit = self._session.pick(*ray, seen=True) if ray is not None else None
        if hit is None:
            self._say("Beside the surface: point at the swatch to take.")
        else:
            self._take(hit)

    def close_outline(self) -> None:
        """Paint what the polygon holds, as it is."""
        if self.name == "polygon" and self.outline.corners and self._hovered is not None:
            try:
                self._fill_region(self._hovered)
            finally:
                self.finish()

    @property
    def _brush(self) -> dict[str, Any]:
        names = ("softness", "opacity", "through", "symmetry")
        return {name: getattr(self, name) for name in names}

    def _outline(self, pointer: Pointer) -> None:
        """Begin a lasso; go on with a polygon, or close it."""
        self.ensure_swatch()
        self._hovered = pointer
        if self.name == "lasso":
            self.client, self.outline.corners = pointer.client, []
        elif self.outline.closes(pointer):
            self.close_outline()
            return
        self.outline.add(pointer)

    def _take(self, hit: Hit) -> None:
        picked = self._session.scene.swatches[self._session.swatch_at(hit)]
        self.choose_swatch(picked.name, picked)
        self._say(f"Picked {self.chosen}.")

    def _show_region(self) -> None:
        """See what the box or the ball would hold."""
        if self.name == "box":
            X_WK, size_m = self._box()
            self._view.show_box(size_m, X_WK)
        elif self.name == "sphere":
            self._view.show_sphere(*self._sphere())

    def _fill_region(self, pointer: Pointer) -> None:
        """Paint what the box, the ball or the line holds."""
        if self.name not in (*REGIONS, "polygon"):
            return
        more: dict[str, Any] = {"opacity": self.opacity, "symmetry": self.symmetry}
        more["eye_W_m"] = None if self.through else self._eye_W_m
        if self.name == "box":
            count = self._session.fill_box(*self._box(), self.ensure_swatch(), **more)
        elif self.name == "sphere":
            count = self._session.fill_sphere(*self._sphere(), self.ensure_swatch(), **more)
        else:
            taken = self.outline.take(self._view, pointer)
            if taken is None:
                self._say("Draw around what shall be painted.")
                return
            more["eye_W_m"] = None if self.through else taken[1]
            count = self._session.fill_region(self.name, taken[0], self.ensure_swatch(), **more)
        self._say(f"{face_count_text(count)} painted." if count else "There is no face inside that is not painted so.")

    def _why_nothing(self) -> str:
        """Why a stroke has changed nothing."""
        name = None if self._last is None else self._session.scene.bodies[self._last.body].name
        if name in self._session.painting.locked:
            return f"{name} is locked: the tab Bodies unlocks it."
        if self.name == "eraser":
            return "Nothing is painted here."
        return f"It is {self.chosen} already. Choose another swatch at the right."

    def _fill(self, hit: Hit, swatch: int) -> None:
        count = self._session.fill_at(hit, self.fill, swatch, self.angle_rad)
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
