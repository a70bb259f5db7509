"""Lasso and polygon: a closed line on the screen; what is seen inside it is painted."""

from typing import Any, Final

import numpy as np

from hapscene.paint.tool_region import Outline
from hapscene.paint.web.scene_view import Pointer, SceneView

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
