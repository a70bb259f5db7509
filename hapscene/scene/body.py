"""A body: a mesh at a pose, with a swatch on every face, or finer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.fine_paint import FinePaint
from hapscene.scene.mesh import Mesh

__all__ = ["Body"]


@dataclass(eq=False)
class Body:
    """A mesh at its place in the scene. Several bodies may share one mesh.

    Attributes:
        name: unique in its scene.
        mesh: its shape, in the body's frame B.
        X_WB: (4, 4) float64, pose of B in W.
        two_sided: True where the inside of a face is felt as well as its outside.
        face_swatch: (M,) int16, index into the scene's `swatches`; of a face painted finer, that of most of its area.
        made_of: the swatch that all its faces had before it was painted, which an eraser brings back; None: unknown.
        fine: what is painted finer than the faces; None: nothing. `paint_faces` and `paint_region` keep it.
        parent: name of the body that it hangs on, and moves with in `Scene.pose`; None: on none.
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
