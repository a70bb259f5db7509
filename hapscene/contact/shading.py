"""Force shading: interpolates normals over faces, so that a curved mesh feels smooth across its edges. Optional.

Morgenbesser & Srinivasan 1996 and Ruspini, Kolarov & Khatib 1997 interpolate normals from the corners of a face, like
Phong shading, and rotate the contact force accordingly. Edges at which the surface turns by less than the crease angle
are smoothed; the others stay sharp. Only the direction of the force changes. The penetration depth keeps its steps at
edges, and the force field has a curl: sliding to an edge at one depth d₁ and back at another d₂ generates the energy
K(1 − cos δ/2)[(d₁ − d₂)L/δ − (d₁² − d₂²)/2] on faces of length L that meet at the angle δ.
"""

import math
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

if TYPE_CHECKING:
    from hapscene.scene.mesh import Mesh

__all__ = ["CornerGroups", "corner_normals"]


def corner_normals(mesh: "Mesh", crease_rad: float) -> NDArray[np.float64]:
    """Return unit normals (f, 3, 3) at the corners of each face, in the frame of the mesh."""
    return CornerGroups(mesh, crease_rad).normals(np.asarray(mesh.vertices_m, np.float64)[mesh.faces])


class CornerGroups:
    """Groups of face corners that share one normal. The groups stay the same when the mesh changes shape.

    The faces around a vertex that are connected by edges flatter than the crease angle form a group. Its normal is the
    mean of the face normals, weighted by their angles at the vertex. Vertices at the same position count as one.
    """

    def __init__(self, mesh: "Mesh", crease_rad: float) -> None:
        faces = np.asarray(mesh.faces)
        normal = _face_normals(np.asarray(mesh.vertices_m, np.float64)[faces])
        _, index = np.unique(mesh.vertices_m, axis=0, return_inverse=True)
        vertex = index.reshape(-1)[faces]

        start, end = vertex.ravel(), np.roll(vertex, -1, axis=1).ravel()  # half-edge i runs from corner i to the next
        first = np.arange(len(start))
        after = 3 * (first // 3) + (first + 1) % 3
        order = np.lexsort((np.maximum(start, end), np.minimum(start, end)))
        low, high = np.minimum(start, end)[order], np.maximum(start, end)[order]
        same = (low[1:] == low[:-1]) & (high[1:] == high[:-1])
        one, two = order[:-1][same], order[1:][same]
        flat = np.einsum("ei,ei->e", normal[one // 3], normal[two // 3]) >= math.cos(crease_rad)
        one, two = one[flat], two[flat]
        # consistent winding: neighbours traverse their shared edge in opposite directions
        turned = start[one] == end[two]
        ends = np.concatenate((one, after[one]))
        others = np.concatenate((np.where(turned, after[two], two), np.where(turned, two, after[two])))
        joined = scipy.sparse.coo_array((np.ones(len(ends), bool), (ends, others)), shape=(len(start), len(start)))
        self._count, self._group = scipy.sparse.csgraph.connected_components(joined, directed=False)

    def normals(self, corner: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return unit normals (f, 3, 3) at the corners (f, 3, 3) of the faces."""
        normal = _face_normals(corner)
        weight = _angles(corner).ravel()
        total = np.zeros((self._count, 3))
        for i in range(3):
            total[:, i] = np.bincount(self._group, weight * np.repeat(normal[:, i], 3), self._count)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        own = np.repeat(normal, 3, axis=0)
        group = self._group
        shade = np.where(length[group] > 1e-12, total[group] / np.maximum(length[group], 1e-300), own)
        return np.ascontiguousarray(shade.reshape(-1, 3, 3))


def _face_normals(corner: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return unit normals (f, 3) of triangles (f, 3, 3), 0 for triangles without area."""
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return np.asarray(area / np.maximum(np.linalg.norm(area, axis=1, keepdims=True), 1e-300))


def _angles(corner: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles (f, 3) of triangles (f, 3, 3) at their corners [rad]."""
    out = np.roll(corner, -1, axis=1) - corner
    back = np.roll(corner, 1, axis=1) - corner
    cross = np.linalg.norm(np.cross(out, back), axis=2)
    return np.asarray(np.arctan2(cross, np.einsum("fki,fki->fk", out, back)))
