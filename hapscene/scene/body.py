"""A body: a mesh with a pose, and a swatch for each face or part of a face."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.fine_paint import FinePaint
from hapscene.scene.mesh import Mesh

__all__ = ["Body"]


@dataclass(eq=False)
class Body:
    """A mesh with a pose and paint. Several bodies may share a mesh.

    Attributes:
        name: unique in the scene.
        mesh: the shape, in the body frame B.
        X_WB: pose of B in the world frame W (4, 4).
        two_sided: whether faces can be touched from both sides.
        face_swatch: index into `Scene.swatches` for each face (M,); for a subdivided face, the swatch with the largest
            area.
        made_of: the swatch of the whole body before painting, which an eraser restores; None if unknown.
        fine: paint of the subdivided faces; None if no face is subdivided. `paint_faces` and `paint_region` update it.
        parent: name of the body that this one is attached to and moves with; None if it is not attached.
    """

    name: str
    mesh: Mesh
    X_WB: NDArray[np.float64]
    two_sided: bool
    face_swatch: NDArray[np.int16]
    made_of: int | None = None
    fine: FinePaint | None = None
    parent: str | None = None

    def __repr__(self) -> str:
        x, y, z = (f"{v:g}" for v in self.X_WB[:3, 3])
        return f"<Body {self.name!r}: {len(self.mesh.faces):,} faces at ({x}, {y}, {z}) m>"

    @property
    def bounds_W_m(self) -> NDArray[np.float64]:
        """Bounding box in W (2, 3) [m]."""
        corners_m = np.array(list(product(*zip(*self.mesh.bounds_m, strict=True))))
        corners_m = corners_m @ self.X_WB[:3, :3].T + self.X_WB[:3, 3]
        return np.array([corners_m.min(axis=0), corners_m.max(axis=0)])
