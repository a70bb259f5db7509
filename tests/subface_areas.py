"""Areas of the faces and subfaces of painted bodies."""

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.fine_paint import FinePaint
from hapscene.scene.mesh import Mesh


def areas_m2(fine: FinePaint, mesh: Mesh) -> NDArray[np.float64]:
    """The areas (k,) of subfaces, from their corners."""
    a, b, c = np.moveaxis(fine.corners_m(mesh), 1, 0)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)
