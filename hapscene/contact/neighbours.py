"""The faces across the edges of each face of a mesh: where a proxy that leaves one comes to."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.native import native

FAN_MAX: Final = 256
"""Most edges of one vertex among which pairs are looked for [count]: each is compared with each."""


def faces_beyond(vertices_m: NDArray[np.float64], faces: NDArray[np.integer]) -> NDArray[np.int32]:
    """The face (M, 3) across edge k of each face, from its corner k to the next; −1 where there is not just one.

    So it is at borders, where three faces meet or more, where the two wind differently, and about a vertex of more than
    `FAN_MAX` edges. Vertices at the same place count as one.
    """
    count = len(vertices_m)
    size = 1 << max(4, (2 * count - 1).bit_length())
    same = np.empty(count, np.int32)
    _join(np.ascontiguousarray(vertices_m, np.float64), np.full(size, -1, np.int32), same)
    beyond = np.full((len(faces), 3), -1, np.int32)
    first = np.zeros(count + 2, np.int32)
    _pair(np.ascontiguousarray(faces, np.int32), same, first, np.empty((3 * len(faces), 2), np.int32), beyond)
    return beyond


@native
def _join(vertices_m: NDArray[np.float64], table: NDArray[np.int32], same: NDArray[np.int32]) -> None:
    """For each vertex (N, 3) the first at the same place, by a hash table whose size is a power of two."""
    words = vertices_m.view(np.int64)
    mask = len(table) - 1
    for i in range(len(vertices_m)):
        h = 0
        for k in range(3):
            word = words[i, k] if vertices_m[i, k] != 0.0 else 0  # −0.0 is 0.0
            h = (h ^ word) * 0x2545F4914F6CDD1D
            h ^= h >> 29
        at = h & mask
        while True:
            j = table[at]
            if j < 0:
                table[at] = i
                same[i] = i
                break
            if (
                vertices_m[i, 0] == vertices_m[j, 0]
                and vertices_m[i, 1] == vertices_m[j, 1]
                and vertices_m[i, 2] == vertices_m[j, 2]
            ):
                same[i] = j
                break
            at = (at + 1) & mask


@native
def _pair(
    faces: NDArray[np.int32],
    same: NDArray[np.int32],
    first: NDArray[np.int32],
    edges: NDArray[np.int32],
    beyond: NDArray[np.int32],
) -> None:
    """Sort the edges (3M, 2), their other vertex and their number, by the lower vertex, and pair those of both."""
    for f in range(len(faces)):
        for k in range(3):
            first[min(same[faces[f, k]], same[faces[f, (k + 1) % 3]]) + 2] += 1
    for v in range(2, len(first)):
        first[v] += first[v - 1]
    for f in range(len(faces)):
        for k in range(3):
            a, b = same[faces[f, k]], same[faces[f, (k + 1) % 3]]
            at = first[min(a, b) + 1]
            edges[at, 0] = max(a, b)
            edges[at, 1] = 3 * f + k
            first[min(a, b) + 1] = at + 1
    for v in range(len(first) - 2):
        low, high = first[v], first[v + 1]
        if high - low > FAN_MAX:
            continue
        for i in range(low, high):
            found, other = 0, 0
            for j in range(low, high):
                if j != i and edges[j, 0] == edges[i, 0]:
                    found += 1
                    other = edges[j, 1]
            f, k = edges[i, 1] // 3, edges[i, 1] % 3
            if found == 1 and same[faces[f, k]] == same[faces[other // 3, (other % 3 + 1) % 3]]:
                beyond[f, k] = other // 3
