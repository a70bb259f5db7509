"""Cracks: places where a mesh is open by less than can be seen."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.anatomy import Anatomy
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import Index

CHUNK: Final = 100_000
"""Edges that are looked at together [count]."""


@dataclass(frozen=True, eq=False)
class Cracks:
    """Vertices on open edges that lie where other open edges pass or end.

    Attributes:
        on_edge: (n,) vertices on an open edge of another face: T-junctions.
        edge_gap_m: (n,) how far off that edge [m].
        near: (m, 2) vertices that nearly meet, at the ends of different open edges.
        near_gap_m: (m,) how far apart [m].
    """

    on_edge: Index
    edge_gap_m: NDArray[np.float64]
    near: Index
    near_gap_m: NDArray[np.float64]


def cracks(mesh: Mesh, body: Anatomy, tolerance_m: float) -> Cracks:
    """Cracks no wider than a tolerance [m]."""
    from scipy.spatial import cKDTree

    ends = body.edges.ends(np.flatnonzero(body.edges.count == 1))
    rim = np.unique(ends)
    if not len(rim):
        none = np.zeros(0, np.int64)
        return Cracks(none, np.zeros(0), none.reshape(0, 2), np.zeros(0))
    place = mesh.vertices_m[rim]
    tree = cKDTree(place)
    near = tree.query_pairs(tolerance_m, output_type="ndarray")
    near = rim[near]
    size = np.int64(len(mesh.vertices_m))
    side = ends.min(axis=1) * size + ends.max(axis=1)
    near = near[~np.isin(near.min(axis=1) * size + near.max(axis=1), side)]  # not the two ends of one short edge
    gap = np.linalg.norm(mesh.vertices_m[near[:, 0]] - mesh.vertices_m[near[:, 1]], axis=1)
    vertex, off = [np.zeros(0, np.int64)], [np.zeros(0)]
    for at in range(0, len(ends), CHUNK):
        found = _on_edges(mesh.vertices_m, ends[at : at + CHUNK], rim, tree, tolerance_m)
        vertex.append(found[0])
        off.append(found[1])
    which, distance = np.concatenate(vertex), np.concatenate(off)
    order = np.lexsort((distance, which))  # of several edges that a vertex lies on, the nearest
    unique, first = np.unique(which[order], return_index=True)
    return Cracks(unique, distance[order][first], near, gap)


def _on_edges(
    vertices_m: NDArray[np.float64], ends: Index, rim: Index, tree: Any, tolerance_m: float
) -> tuple[Index, NDArray[np.float64]]:
    """Rim vertices on the inside of edges (n, 2), and how far off."""
    start, end = vertices_m[ends[:, 0]], vertices_m[ends[:, 1]]
    length = np.linalg.norm(end - start, axis=1)
    found = tree.query_ball_point((start + end) / 2, length / 2)
    edge = np.repeat(np.arange(len(ends)), [len(f) for f in found])
    vertex = rim[np.concatenate([np.asarray(f, np.int64) for f in found])]
    along = (end - start)[edge] / length[edge, None]
    t = np.einsum("ij,ij->i", vertices_m[vertex] - start[edge], along)
    off = np.linalg.norm(vertices_m[vertex] - start[edge] - t[:, None] * along, axis=1)
    on = (off <= tolerance_m) & (t > tolerance_m) & (t < length[edge] - tolerance_m)
    return vertex[on], off[on]
