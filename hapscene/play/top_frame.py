"""Top view of a scene: its picture, and the mapping between the picture and the surface."""

from io import BytesIO
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.motion.look_from_above import bounds_of, look_from_above
from hapscene.view.body_triangles import scene_solids
from hapscene.view.camera import MARGIN, fit_cameras
from hapscene.view.offscreen import draw
from hapscene.view.palette import Theme
from hapscene.view.triangles import Drawing, Frame

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["TopFrame"]

WIDTH: Final = 1400
"""Width of the picture [pixels]."""

HEIGHT_SHARES: Final = (0.3, 1.4)
"""Smallest and largest ratio of height to width of the picture [1]."""

PAD_M: Final = (0.16, 0.12)
"""Width and height of the flat pad that is shown without a scene [m]."""

CLEAR_M: Final = 0.02
"""Height of a lifted tool above the scene [m]."""

OVERSAMPLING: Final = 2


class TopFrame:
    """Orthographic top view with coordinates u from left to right and v from top to bottom, 0 to 1.

    Attributes:
        size: width and height of the picture [pixels].
        size_m: width and height of the shown area.
        clear_m: height above the whole scene.
    """

    def __init__(self, scene: "Scene | None") -> None:
        self._scene = scene = scene if scene is not None and scene.bodies else None
        bounds_m = np.array([[-0.5 * PAD_M[0], -0.5 * PAD_M[1], 0.0], [0.5 * PAD_M[0], 0.5 * PAD_M[1], 0.0]])
        self._bodies_m: list[tuple[str, NDArray[np.float64]]] = []
        if scene is not None:
            corners_m = np.array([bounds_of(body) for body in scene.bodies])
            self._bodies_m = [(body.name, corners) for body, corners in zip(scene.bodies, corners_m, strict=True)]
            bounds_m = np.array([corners_m[:, 0].min(axis=0), corners_m[:, 1].max(axis=0)])
            self._look = look_from_above(scene)
            self._look(*corners_m[:, :, :2].mean(axis=1).T)  # builds the search structures before the first touch
        self._middle_m = bounds_m.mean(axis=0)
        span_m = np.maximum(np.ptp(bounds_m, axis=0), 1e-9)
        self.size = WIDTH, round(WIDTH * float(np.clip(span_m[1] / span_m[0], *HEIGHT_SHARES)))
        pixel_m = (MARGIN if scene is not None else 1.0) * max(span_m[0] / self.size[0], span_m[1] / self.size[1])
        self.size_m = float(pixel_m * self.size[0]), float(pixel_m * self.size[1])
        self.clear_m = float(bounds_m[1, 2]) + CLEAR_M
        self._corners_m = bounds_m

    def find(self, u: float, v: float) -> tuple[float, float, float] | None:
        """Surface point under a point of the picture, in W [m]; None outside all bodies."""
        x_m, y_m = self._middle_m[:2] + np.multiply((u - 0.5, 0.5 - v), self.size_m)
        if self._scene is None:
            return float(x_m), float(y_m), 0.0
        z_m = float(self._look(np.array([x_m]), np.array([y_m])).z_m[0])
        return None if np.isnan(z_m) else (float(x_m), float(y_m), z_m)

    def point(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Coordinates u, v of a point in W."""
        return (
            float(0.5 + (x_m - self._middle_m[0]) / self.size_m[0]),
            float(0.5 - (y_m - self._middle_m[1]) / self.size_m[1]),
        )

    def bodies(self) -> list[tuple[str, tuple[float, float, float, float]]]:
        """Name and extent of each body: smallest u and v, largest u and v."""
        found = []
        for name, (low_m, high_m) in self._bodies_m:
            (u0, v1), (u1, v0) = self.point(*low_m[:2]), self.point(*high_m[:2])
            found.append((name, (u0, v0, u1, v1)))
        return found

    def picture(self, theme: Theme) -> bytes:
        """Picture of the scene as PNG; empty without a scene.

        Raises:
            ViewError: OpenGL is not available.
        """
        if self._scene is None:
            return b""
        from PIL import Image

        solids = [s._replace(corner_m=s.corner_m - self._middle_m) for s in scene_solids(self._scene)]
        poses, extent_m, _ = fit_cameras(self._corners_m - self._middle_m, [np.eye(3)], self.size)
        parts = [(i, np.eye(4)) for i in range(len(solids))]
        drawing = Drawing(solids, [Frame(poses[0], parts)], extent_m, self.size, theme.background, OVERSAMPLING)
        (pixels,) = draw(drawing)
        file = BytesIO()
        Image.fromarray(pixels).save(file, format="PNG")
        return file.getvalue()
