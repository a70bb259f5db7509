"""The region behind an outline on the screen, which the lasso paints."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.scene.region import Region

__all__ = ["Outline"]


@dataclass(frozen=True, eq=False)
class Outline(Region):
    """The cone behind a closed line on the screen.

    Attributes:
        X_EB: (4, 4) map from the body's frame to the frame of the eye, whose z axis points into the picture.
        corners: (k, 2) corners of the line, x and y at z = 1.
    """

    X_EB: NDArray[np.float64]
    corners: NDArray[np.float64]
    is_convex: ClassVar[bool] = False

    def distance_m(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Lower bound (n,) of the signed distance of points (n, 3) from the surface [m], negative inside.

        If the rays to a point at depth z and to the border differ by d at z = 1, the distance of the point from the
        border is at least z d divided by the length of the border's ray at z = 1.
        """
        p_E = points_m @ self.X_EB[:3, :3].T + self.X_EB[:3, 3]
        depth = p_E[:, 2]
        behind = depth <= 0.0
        seen = p_E[:, :2] / np.where(behind, 1.0, depth)[:, None]
        away = np.empty(len(seen))
        signed_distance(seen, np.ascontiguousarray(self.corners), away)
        longest = np.sqrt(1.0 + (self.corners**2).sum(axis=1).max())
        return np.where(behind, np.maximum(-depth, 0.0), depth * away / longest)


@native
def signed_distance(places: NDArray[np.float64], corners: NDArray[np.float64], away: NDArray[np.float64]) -> None:
    """Write the signed distance of points (n, 2) from a closed polygon (k, 2), negative inside, into `away` (n,)."""
    for i in range(len(places)):
        x, y = places[i, 0], places[i, 1]
        nearest2, inside = np.inf, False
        ax, ay = corners[-1, 0], corners[-1, 1]
        for k in range(len(corners)):
            bx, by = corners[k, 0], corners[k, 1]
            sx, sy, px, py = bx - ax, by - ay, x - ax, y - ay
            length2 = sx * sx + sy * sy
            t = min(max((px * sx + py * sy) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
            gap_x, gap_y = px - t * sx, py - t * sy
            nearest2 = min(nearest2, gap_x * gap_x + gap_y * gap_y)
            if (ay > y) != (by > y) and px < py * sx / sy:
                inside = not inside
            ax, ay = bx, by
        away[i] = -np.sqrt(nearest2) if inside else np.sqrt(nearest2)
