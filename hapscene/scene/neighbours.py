"""The faces across the edges of each face of a mesh: where a proxy that leaves one comes to, and how they are wound."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.scene.topology import weld

FAN_MAX: Final = 512
"""Most sides of faces at one vertex among which pairs are looked for [count]: each is compared with each."""

_MIXED, _OPEN, _UNSEEN = 1, 2, 4


class Neighbours(NamedTuple):
    """The neighbours of a mesh's M faces."""

    # (M, 3) the face across edge k, from corner k to the next; −1 where there is not just one
    beyond: NDArray[np.int32]
    mixed: bool | None  # whether two are wound against each other; None where some were not looked at
    closed: bool | None  # whether every edge has two faces; likewise


def neighbours_of(vertices_m: NDArray[np.float64], faces: NDArray[np.integer]) -> Neighbours:
    """The faces across each edge; −1 at borders, where three faces meet or more, or the two wind differently.

    And about a vertex of more than `FAN_MAX` sides of faces. Vertices at the same place count as one; a face with two
    corners there has no neighbours.
    """
    beyond = np.full((len(faces), 3), -1, np.int32)
    first = np.zeros(len(vertices_m) + 2, np.int32)
    edges = np.empty((3 * len(faces), 2), np.int32)
    seen = _pair(np.ascontiguousarray(faces, np.int32), weld(vertices_m), first, edges, beyond)
    if seen & _UNSEEN:
        return Neighbours(beyond, None, None)
    return Neighbours(beyond, seen & _MIXED > 0, seen & _OPEN == 0)


@native
def _pair(
    faces: NDArray[np.int32],
    same: NDArray[np.int64],
    first: NDArray[np.int32],
    edges: NDArray[np.int32],
    beyond: NDArray[np.int32],
) -> int:
    """Sort the edges (3M, 2), their other vertex and their number, by the lower vertex, and pair those of both.

    Returns what was seen.
    """
    for f in range(len(faces)):
        a, b, c = same[faces[f, 0]], same[faces[f, 1]], same[faces[f, 2]]
        if a != b and b != c and c != a:
            first[min(a, b) + 2] += 1
            first[min(b, c) + 2] += 1
            first[min(c, a) + 2] += 1
    for v in range(2, len(first)):
        first[v] += first[v - 1]
    for f in range(len(faces)):
        a, b, c = same[faces[f, 0]], same[faces[f, 1]], same[faces[f, 2]]
        if a != b and b != c and c != a:
            for k in range(3):
                low, high = min(a, b), max(a, b)
                at = first[low + 1]
                # which way it runs stands in the number
                edges[at, 0], edges[at, 1] = high, 3 * f + k if a == low else -1 - (3 * f + k)
                first[low + 1] = at + 1
                a, b, c = b, c, a
    seen = 0 if first[-2] > 0 else _OPEN
    for v in range(len(first) - 2):
        low, high = first[v], first[v + 1]
        if high - low > FAN_MAX:
            seen |= _UNSEEN
            continue
        for i in range(low, high):
            found, other = 0, 0
            for j in range(low, high):
                if j != i and edges[j, 0] == edges[i, 0]:
                    found += 1
                    other = edges[j, 1]
            one = edges[i, 1]
            if found != 1:
                seen |= _OPEN
            elif (one < 0) == (other < 0):
                seen |= _MIXED
            else:
                one, other = max(one, -1 - one), max(other, -1 - other)
                beyond[one // 3, one % 3] = other // 3
    return seen
