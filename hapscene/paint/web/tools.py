"""Tools of the page: operations of the pointer on the scene."""

import math
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from hapscene.paint.model.history import face_count_text
from hapscene.paint.model.mesh import Hit
from hapscene.paint.model.regions import Outline
from hapscene.paint.model.session import ERASE, FACET_RAD, FILLS, Brush, Session, Stroke
from hapscene.paint.web.hand import TouchHand
from hapscene.paint.web.view import Pointer, SceneView, ToolMarks, Vector
from hapscene.surface.swatch import PLAIN, SwatchLike
from hapscene.view.feel_layer import OPACITY

__all__ = ["RADIUS_SHARE", "REGIONS", "STROKES", "TOOLS", "Tools"]

CORNERS_MAX: Final = 400
"""Largest number of corners of an outline [count]; beyond, every second one is dropped."""


class LassoOutline:
    """The outline that the lasso draws.

    Attributes:
        corners: (k, 2) positions on the canvas, from the left and the top, as fractions of its size.
    """

    def __init__(self) -> None:
        self.corners: list[tuple[float, float]] = []

    def add(self, pointer: Pointer) -> None:
        """Add the position of the pointer."""
        place = (pointer.x, pointer.y)
        if not self.corners or place != self.corners[-1]:
            self.corners.append(place)
        if len(self.corners) > CORNERS_MAX:
            del self.corners[1:-1:2]

    def take(self, view: SceneView, pointer: Pointer) -> tuple[Callable[[Vector], Outline], Vector] | None:
        """Return the region inside the outline and the eye, and clear the outline; None if it has no area.

        The region is a function of the map from W to the frame of the region.
        """
        corners, self.corners = np.array(self.corners), []
        eye = view.eye(pointer)
        if len(corners) < 3 or eye is None:
            return None
        X_WE, slope = eye
        flat = (2 * corners - 1) * slope
        X_EW = np.linalg.inv(X_WE)
        return lambda X_BW: Outline(X_EW @ np.linalg.inv(X_BW), flat), X_WE[:3, 3]


TOOLS: Final = ("brush", "fill", "sphere", "eraser", "pick", "touch", "lasso")

STROKES: Final = ("brush", "eraser")
REGIONS: Final = ("sphere", "lasso")
"""Tools that paint when the button is released."""

FIRST_SWATCH: Final = "wood"
"""Initial swatch for a scene that has only plain, so that a first stroke is visible."""

RADIUS_SHARE: Final = (0.002, 0.03, 0.3)
"""Smallest, initial and largest radius of the brush, in diagonals of the scene [1]."""


class Tools:
    """The current tool of a page, and its settings.

    Args:
        session, view, touch: session, view and simulated hand that the tools work on.

    Attributes:
        name: current tool, one of `TOOLS`.
        chosen: name of the selected swatch.
        radius_m: radius of brush and eraser, and of a sphere that is clicked [m].
        falloff, opacity: see `session.Brush`; the fill tool does not use them.
        fill: area that the fill tool fills, one of `FILLS`.
        angle_rad: angle of a facet [rad].
        force_N: normal force of the hand [N].
        pressed: whether the pointer button is pressed on the surface.
    """

    def __init__(self, session: Session, view: SceneView, touch: TouchHand) -> None:
        self._session, self._view, self._touch = session, view, touch
        self.name = "brush"
        last = session.scene.swatches[-1]
        self._source: SwatchLike = FIRST_SWATCH if last is PLAIN else last
        self.chosen = FIRST_SWATCH if last is PLAIN else last.name
        self.radius_m = RADIUS_SHARE[1] * view.diagonal_m
        self.fill = FILLS[0]
        self.angle_rad = FACET_RAD
        self.falloff, self.opacity = 0.0, 1.0
        self.outline = LassoOutline()
        self.force_N = 1.0
        self.pressed = False
        self._stroke: Stroke | None = None
        self._start: Hit | None = None
        self._last: Hit | None = None
        self._eye_W_m: Vector | None = None
        self._before = 0  # state of the history when the button was pressed

    def attach(self, marks: ToolMarks, say: Callable[[str], None]) -> None:
        """Use the marks of a page, and show messages there; call it before all others."""
        self._marks, self._say = marks, say

    @property
    def swatch(self) -> int | None:
        """Index of the selected swatch; None if the scene does not use it."""
        return self._session.painting.swatch_named(self.chosen)

    def ensure_swatch(self) -> int:
        """Index of the selected swatch, which is added to the scene if necessary.

        Raises:
            SwatchError: the swatch is unknown or damaged.
            SceneError: the scene has a different swatch of that name.
        """
        index = self.swatch
        return self._session.tuning.add_swatch(self._source, with_next=True) if index is None else index

    def choose_swatch(self, name: str, source: SwatchLike) -> None:
        """Select a swatch, given by its name and the argument for `Session.add_swatch`."""
        self.chosen, self._source = name, source

    def choose_tool(self, name: str) -> None:
        """Select a tool."""
        if name in TOOLS and name != self.name:
            self.finish()
            self.name = name

    def resize(self, radius_m: float) -> None:
        """Set the radius of the brush, limited to its range."""
        low, high = (share * self._view.diagonal_m for share in (RADIUS_SHARE[0], RADIUS_SHARE[2]))
        self.radius_m = min(max(radius_m, low), high)

    def finish(self) -> None:
        """End the operation of the pointer."""
        self.outline.corners = []
        if self.stroking:
            self._session.end_stroke()
        if self.pressed and self.name == "touch":
            self._touch.lift(time.monotonic())
        self._marks.show_sphere(None)
        self.pressed, self._stroke, self._start, self._last = False, None, None, None

    async def cancel(self) -> None:
        """End the operation of the pointer, and undo what it has changed."""
        pressed = self.pressed
        await self.release(None)
        if pressed and self._session.history.state != self._before:
            self._say(f"Cancelled: {self._session.undo()}.")

    def stamp(self) -> dict[str, float] | None:
        """Size and opacity of what the page shows until the painted faces arrive; None for tools without a brush."""
        if self.name != "brush" or self._view.show == "look":
            return None
        opacity = self.opacity * (OPACITY if self._view.show == "both" and self._view.has_look else 1.0)
        return {"radius_m": (1 - self.falloff / 2) * self.radius_m, "opacity": opacity}

    @property
    def stroking(self) -> bool:
        """Whether a stroke of this page is in progress."""
        return self._stroke is not None and self._stroke.in_progress

    async def hover(self, pointer: Pointer) -> None:
        """Handle a move of the pointer without a pressed button."""
        if self.pressed:
            return
        ray = self._view.ray(pointer)
        drawn = self.name in (*STROKES, "sphere")
        hit = self._session.pick(*ray, visible_only=True) if ray is not None and drawn else None
        self._marks.show_ring(hit, self.radius_m)

    async def press(self, pointer: Pointer) -> None:
        """Handle a press of the button."""
        ray = self._view.ray(pointer)
        if ray is None:
            return
        self.finish()  # in case a release was lost
        self._before = self._session.history.state
        if self.name == "lasso":
            self.ensure_swatch()
            self.pressed = True
            self.outline.add(pointer)
            return
        hit = self._session.pick(*ray, visible_only=True)
        if hit is None:
            self._say("There is no surface here: start on a body.")
            return
        swatch = self.ensure_swatch() if self.name in ("brush", "fill", "sphere") else ERASE
        self.pressed, self._start, self._last, self._eye_W_m = True, hit, hit, ray[0]
        if self.name in STROKES:
            with self._session.lock:
                brush = Brush(self.radius_m, self.falloff, self.opacity)
                self._stroke = Stroke(self._session.painting, swatch, brush)
                self._stroke.drag_to(*ray)
            self._marks.show_ring(hit, self.radius_m)
        elif self.name == "fill":
            self._fill(hit, swatch)
        elif self.name == "pick":
            self._take(hit)
        elif self.name == "touch":
            self.pressed = not self._touch.touching
            if not self.pressed:
                self._say("Another browser is using the simulated hand.")
            elif not self._touch.press(*self._contact(hit, ray[1])):
                self._say("The simulated hand is not ready yet. The status line shows what it waits for.")
        else:
            self._marks.show_ring(None, self.radius_m)
            self._show_region()

    async def drag(self, pointer: Pointer) -> None:
        """Handle a move of the pointer with the button pressed."""
        ray = self._view.ray(pointer)
        if ray is None or not self.pressed:
            return
        if self.name == "lasso":
            self.outline.add(pointer)
            return
        if self._stroke is not None:
            with self._session.lock:
                if not self._stroke.in_progress:  # ended by an operation of another page or by a key
                    self._stroke.resume(ERASE if self.name == "eraser" else self.ensure_swatch())
                hit = self._stroke.drag_to(*ray)
            self._marks.show_ring(hit, self.radius_m)
            return
        hit = self._session.pick(*ray, visible_only=True)
        if hit is None:
            return
        self._last, self._eye_W_m = hit, ray[0]
        if self.name == "touch":
            self._touch.move(*self._contact(hit, ray[1]))
        else:
            self._show_region()

    async def release(self, pointer: Pointer | None) -> None:
        """Handle a release of the button; None cancels a sphere or lasso without painting."""
        try:
            if pointer is not None and self.pressed:
                await self.drag(pointer)  # the position of the release
                self._fill_region(pointer)
                if self.stroking:
                    self._session.end_stroke()
                if self.name in STROKES and self._session.history.state == self._before:
                    self._say(self._why_nothing())
        finally:
            self.finish()

    def _take(self, hit: Hit) -> None:
        picked = self._session.scene.swatches[self._session.swatch_at(hit)]
        self.choose_swatch(picked.name, picked)
        self._say(f"Picked {self.chosen}.")

    def _show_region(self) -> None:
        """Show the sphere that would be painted."""
        if self.name == "sphere":
            self._marks.show_sphere(*self._sphere())

    def _fill_region(self, pointer: Pointer) -> None:
        """Paint inside the sphere or the outline."""
        if self.name not in REGIONS:
            return
        if self.name == "sphere":
            count = self._session.fill_sphere(
                *self._sphere(), self.ensure_swatch(), opacity=self.opacity, eye_W_m=self._eye_W_m
            )
        else:
            taken = self.outline.take(self._view, pointer)
            if taken is None:
                self._say("Draw an outline around the area to paint.")
                return
            region_of, eye_W_m = taken
            count = self._session.fill_region(
                self.name, region_of, self.ensure_swatch(), opacity=self.opacity, eye_W_m=eye_W_m
            )
        self._say(f"{face_count_text(count)} painted." if count else "Nothing changed: no unpainted faces inside.")

    def _why_nothing(self) -> str:
        """Message for a stroke that has changed nothing."""
        if self.name == "eraser":
            return "There is nothing to erase here."
        return f"The surface here is {self.chosen} already. Select another swatch."

    def _fill(self, hit: Hit, swatch: int) -> None:
        count = self._session.fill_at(hit, self.fill, swatch, self.angle_rad)
        self._say(f"{face_count_text(count)} painted." if count else self._why_nothing())

    def _contact(self, hit: Hit, direction_W: Vector) -> tuple[Vector, Vector, float, float]:
        """Position, outward normal, force and stiffness for the hand."""
        nhat = hit.nhat_W if float(hit.nhat_W @ direction_W) <= 0.0 else -hit.nhat_W
        stiffness = self._session.tuning.parameters(self._session.swatch_at(hit))[0].given
        return hit.p_W_m, nhat, self.force_N, stiffness

    def _sphere(self) -> tuple[Vector, float]:
        """Centre and radius of the sphere from the press to the present position."""
        assert self._start is not None and self._last is not None
        radius = math.dist(self._start.p_W_m, self._last.p_W_m)
        return self._start.p_W_m, radius if radius > 1e-9 else self.radius_m
