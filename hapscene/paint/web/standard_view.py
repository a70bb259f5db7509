"""Where a page looks from: the standard views, and what is framed."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from hapscene.motion.look_from_above import bounds_of
from hapscene.paint.web.scene_view import ASPECT_MIN, FOV_RAD, SceneView
from hapscene.scene.body import Body

VIEWS: Final[Mapping[str, tuple[float, float, float]]] = {
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, -1e-4, 1.0),
    "bottom": (0.0, -1e-4, -1.0),
    "perspective": (0.35, -0.8, 0.6),
}
"""Ways from the scene to the eye, z up; a hair off the poles, so that the front is at the picture's foot."""

ROOM: Final = 1.1
"""How far the eye is from what it frames, in distances from which that would just fit [1]."""


def look(camera: Any, view: SceneView, bodies: Sequence[Body], aspect: float, name: str = "") -> None:
    """Have bodies in view, all of each.

    Args:
        camera: a page's, viser's.
        view: what it shows.
        bodies: at least one.
        aspect: how many times as wide as high its picture is.
        name: one of `VIEWS`; else it looks the way it did.
    """
    bounds = np.array([bounds_of(body) for body in bodies])
    low, high = view.to_view(bounds[:, 0].min(axis=0)), view.to_view(bounds[:, 1].max(axis=0))
    way = np.asarray(VIEWS[name]) if name in VIEWS else np.asarray(camera.position) - np.asarray(camera.look_at)
    away = ROOM * max(float(np.linalg.norm(high - low)), 1e-6) / (2 * np.tan(FOV_RAD / 2))
    away /= min(max(aspect, ASPECT_MIN), 1.0)
    camera.position = (low + high) / 2 + away * way / max(float(np.linalg.norm(way)), 1e-9)
    camera.look_at = (low + high) / 2  # which the other takes along
