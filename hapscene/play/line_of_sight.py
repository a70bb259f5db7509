"""The surface that the eye sees along a line: where a pointer on the page touches the scene."""

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.geometry import Vector
from hapscene.motion.look_from_above import caster_of
from hapscene.scene.topology import normals_of

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["LineOfSight"]

PAD_M: Final = (0.16, 0.12)
"""Width and height of the flat pad that is shown without a scene [m]."""

CLEAR_M: Final = 0.02
"""Height of a lifted tool above the scene [m]."""

STEEPEST: Final = 0.1
"""Smallest share of a line of sight that points downwards [1]. A flatter line reaches the height of a lifted tool far
beside the scene."""

FAR_M: Final = 1e6
"""Largest coordinate of the eye [m]."""


class LineOfSight:
    """Casts rays on the faces of a scene that point to the eye; inner faces are seen on two-sided bodies only.

    Attributes:
        low_m, size_m: (3,) lowest corner and size of the box around the scene, in W.
        clear_m: height above the whole scene.
    """

    def __init__(self, scene: "Scene | None") -> None:
        bodies = [] if scene is None else scene.bodies
        self._bodies = [(body, caster_of(body.mesh), body.bounds_W_m) for body in bodies]
        half = np.array([0.5 * PAD_M[0], 0.5 * PAD_M[1], 0.0])
        corners_m = np.array([bounds_m for _, _, bounds_m in self._bodies] or [np.array([-half, half])])
        self.low_m: NDArray[np.float64] = corners_m[:, 0].min(axis=0)
        self.size_m: NDArray[np.float64] = np.maximum(corners_m[:, 1].max(axis=0) - self.low_m, 1e-9)
        self.clear_m = float(self.low_m[2] + self.size_m[2]) + CLEAR_M
        above_m = (*(self.low_m + 0.5 * self.size_m)[:2], self.clear_m)
        self.find(above_m, (0.0, 0.0, -1.0))  # builds the search structures before the first touch

    def find(self, eye_m: Vector, direction: Vector) -> tuple[Vector, Vector, Vector] | None:
        """The first surface point on a line from the eye, the unit vector from it to the eye, and the normal, in W.

        None if there is no surface, or the line does not point downwards (`STEEPEST`).
        """
        length = math.hypot(*direction)
        if not (math.isfinite(length) and all(abs(x_m) < FAR_M for x_m in eye_m) and -direction[2] > STEEPEST * length):
            return None
        eye, d = np.array(eye_m), np.array(direction) / length
        nearest_m = math.inf if self._bodies else -eye[2] / d[2]  # without a scene: the plane z = 0
        normal = np.array((0.0, 0.0, 1.0))
        for body, caster, bounds_m in self._bodies:
            middle_m = bounds_m.mean(axis=0)
            if np.linalg.norm(np.cross(middle_m - eye, d)) > 0.5 * np.linalg.norm(np.ptp(bounds_m, axis=0)):
                continue  # a ray costs up to a millisecond
            R_WB, p_WB = body.X_WB[:3, :3], body.X_WB[:3, 3]
            at_B, _, face = caster.intersects_location([(eye - p_WB) @ R_WB], [d @ R_WB], multiple_hits=False)
            if not len(at_B):
                continue
            n = R_WB @ normals_of(body.mesh.vertices_m[body.mesh.faces[face]])[0]
            far_m = (R_WB @ at_B[0] + p_WB - eye) @ d
            if far_m < nearest_m and (n @ d < 0.0 or body.two_sided):
                nearest_m, normal = float(far_m), n if n @ d < 0.0 else -n
        if not 0.0 < nearest_m < math.inf:
            return None
        (x_m, y_m, z_m), (x, y, z), (a, b, c) = (eye + nearest_m * d).tolist(), (-d).tolist(), normal.tolist()
        return (x_m, y_m, z_m), (x, y, z), (a, b, c)
