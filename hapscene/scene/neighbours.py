"""The faces across the edges of each face of a mesh: where a proxy that leaves a face comes to."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.topology import edges_of, weld

__all__ = ["Neighbours", "neighbours_of"]


class Neighbours(NamedTuple):
    """The neighbours of a mesh's M faces."""

    # (M, 3) the face across edge k, from corner k to the next; −1 where there is not just one
    beyond: NDArray[np.int32]
    mixed: bool  # whether two are wound against each other
    closed: bool  # whether every edge has two faces


def neighbours_of(vertices_m: NDArray[np.float64], faces: NDArray[np.integer]) -> Neighbours:
    """The faces across each edge; −1 at borders, where three faces meet or more, or the two wind differently.

    Vertices at the same place count as one; a face with two corners there has no neighbours.
    """
    edges = edges_of(faces, weld(vertices_m))
    at = edges.start[edges.count == 2]
    alike = edges.forward[at] != edges.forward[at + 1]
    one, other = edges.order[at[alike]], edges.order[at[alike] + 1]
    beyond = np.full(3 * len(faces), -1, np.int32)
    beyond[one], beyond[other] = other // 3, one // 3
    return Neighbours(beyond.reshape(-1, 3), not alike.all(), edges.closed)
