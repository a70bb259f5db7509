"""Structure of a mesh for the mesh check: duplicate and degenerate faces, edges, winding, shells."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import Edges, Index, Winding, area_of, edges_of, first_of, weld, winding_of

__all__ = ["FLAT_RATIO", "MeshStructure", "height_of", "mesh_structure"]

Mask = NDArray[np.bool_]

FLAT_RATIO: Final = 1e-12
"""Height of a face relative to the diagonal of the mesh [1] below which the face has no area apart from rounding."""


@dataclass(frozen=True, eq=False)
class MeshStructure:
    """Structure of a mesh with N vertices and M faces.

    Attributes:
        welded: lowest index of a vertex at the same position, for each vertex (N,).
        flat: faces without area (M,).
        spare: flat faces that can be deleted without opening an edge (M,).
        doubled: duplicates of an earlier face with the same winding (M,).
        opposed: duplicates of an earlier face with the opposite winding (M,).
        edges: edges between the other faces.
        winding: winding of the other faces.
    """

    mesh: Mesh
    welded: Index
    flat: Mask
    spare: Mask
    doubled: Mask
    opposed: Mask
    edges: Edges
    winding: Winding

    @property
    def kept(self) -> Mask:
        """Mask (M,) of the faces in `edges`."""
        return ~(self.spare | self.doubled | self.opposed)

    @cached_property
    def shells(self) -> "Shells":
        """Closed shells of the mesh."""
        return _shells(self.mesh.triangles_m, self.edges, self.winding, self.kept)


@dataclass(frozen=True, eq=False)
class Shells:
    """Closed shells of a mesh.

    Attributes:
        closed: faces of shells in which every edge has exactly two faces (M,).
        inside_out: faces of closed shells that are wound inward (M,).
        volume_m3: volume enclosed by the closed shells without their cavities [m³].
    """

    closed: Mask
    inside_out: Mask
    volume_m3: float


def mesh_structure(mesh: Mesh) -> MeshStructure:
    """Analyse the structure of a mesh."""
    triangles = mesh.triangles_m
    welded = weld(mesh.vertices_m)
    height = height_of(triangles)
    corners = welded[mesh.faces]
    flat = (height <= FLAT_RATIO * mesh.diagonal_m) | (corners == corners[:, (1, 2, 0)]).any(axis=1)
    doubled, opposed = _copies(corners)
    copy = doubled | opposed
    spare = np.zeros(len(corners), np.bool_)
    if flat.any():
        # A flat face may fill a T-junction: then one of its edges has one other face and would be open without it.
        spare = flat & ~(edges_of(mesh.faces, welded, ~copy).count_by_face() == 2).any(axis=1)
    edges = edges_of(mesh.faces, welded, ~(spare | copy))
    winding = winding_of(edges, area_of(triangles))
    return MeshStructure(mesh, welded, flat, spare, doubled, opposed, edges, winding)


def height_of(triangles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the smallest height (M,) of triangles (M, 3, 3) [m]."""
    longest = np.linalg.norm(triangles_m - triangles_m[:, (1, 2, 0)], axis=2).max(axis=1)
    height = np.divide(2 * area_of(triangles_m), longest, out=np.zeros(len(longest)), where=longest > 0)
    return np.asarray(height)


def _copies(corners: Index) -> tuple[Mask, Mask]:
    """Return the duplicates (M,) of earlier faces: those with the same winding, and those with the opposite winding."""
    low = np.argmin(corners, axis=1)
    row = np.arange(len(corners))
    first = corners[row, low]
    second, third = corners[row, (low + 1) % 3], corners[row, (low + 2) % 3]
    up = second < third  # the winding, when listed from the lowest corner
    key = np.stack([first, np.minimum(second, third), np.maximum(second, third)], axis=1)
    original = first_of(key.astype(np.uint64))
    copy, agree = original != row, up == up[original]
    return copy & agree, copy & ~agree


def _shells(triangles_m: NDArray[np.float64], edges: Edges, winding: Winding, kept: Mask) -> Shells:
    """Find the closed shells and which of them are inside out."""
    shell, count = winding.shell, int(winding.shell.max()) + 1
    open_side = (edges.count_by_face() != 2).any(axis=1) | winding.one_sided
    is_open = np.bincount(shell, open_side, minlength=count) > 0
    closed = ~is_open[shell] & kept
    middle = triangles_m[closed].reshape(-1, 3).mean(axis=0) if closed.any() else np.zeros(3)
    a, b, c = np.moveaxis(triangles_m - middle, 1, 0)  # relative to the centre, to avoid cancellation
    sign = np.where(winding.turned, -1.0, 1.0)
    volume = np.bincount(shell, sign * closed * np.einsum("ij,ij->i", a, np.cross(b, c)) / 6, minlength=count)
    inside_out = np.zeros(count, np.bool_)
    for inward in np.flatnonzero(volume < 0):
        # A cavity is correctly wound inward. A shell is inside out if an even number of other shells encloses it.
        inside_out[inward] = _depth(triangles_m, shell, closed, int(inward)) % 2 == 0
    volume = np.where(inside_out, -volume, volume)
    return Shells(closed, inside_out[shell] & closed, float(volume.sum()))


def _depth(triangles_m: NDArray[np.float64], shell: Index, closed: Mask, one: int) -> int:
    """Count the closed shells that enclose a shell, by their winding numbers about one of its points.

    Solid angles after Van Oosterom & Strackee 1983, eq. 8.
    """
    own = triangles_m[shell == one]
    point = own[np.argmax(area_of(own))].mean(axis=0)
    low = np.full((int(shell.max()) + 1, 3), np.inf)
    high = -low
    np.minimum.at(low, shell, triangles_m.min(axis=1))
    np.maximum.at(high, shell, triangles_m.max(axis=1))
    around = (low < point).all(axis=1) & (high > point).all(axis=1)
    around[one] = False
    chosen = closed & around[shell]
    if not chosen.any():
        return 0
    a, b, c = np.moveaxis(triangles_m[chosen] - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    over = np.einsum("ij,ij->i", a, np.cross(b, c))
    under = la * lb * lc
    for u, v, length in ((a, b, lc), (b, c, la), (c, a, lb)):
        under = under + np.einsum("ij,ij->i", u, v) * length
    turns = np.bincount(shell[chosen], np.arctan2(over, under) / (2 * np.pi))
    return int(np.count_nonzero(np.abs(turns) > 0.5))
