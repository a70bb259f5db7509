"""Adjacency of the faces of a mesh: the contact solver uses it to move the proxy from face to face."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.topology import edges_of, weld

__all__ = ["Neighbours", "neighbours_of"]


class Neighbours(NamedTuple):
    """Adjacency of the M faces of a mesh."""

    # (M, 3) index of the face across edge k, which runs from corner k to corner k + 1; −1 if there is not exactly one
    beyond: NDArray[np.int32]
    mixed: bool  # whether two neighbours have opposite winding
    closed: bool  # whether every edge has exactly two faces


def neighbours_of(vertices_m: NDArray[np.float64], faces: NDArray[np.integer]) -> Neighbours:
    """Compute the adjacency of faces.

    The entry is −1 at borders, at edges with three or more faces, and between faces with opposite winding. Vertices at
    the same position count as one; faces that have two corners at the same position have no neighbours.
    """
    edges = edges_of(faces, weld(vertices_m))
    at = edges.start[edges.count == 2]
    agree = edges.forward[at] != edges.forward[at + 1]
    one, other = edges.order[at[agree]], edges.order[at[agree] + 1]
    beyond = np.full(3 * len(faces), -1, np.int32)
    beyond[one], beyond[other] = other // 3, one // 3
    return Neighbours(beyond.reshape(-1, 3), not agree.all(), edges.closed)
