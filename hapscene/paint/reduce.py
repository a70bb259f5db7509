"""A mesh reduced to what a browser draws quickly, and which shown face stands for each of its faces."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import ViewError
from hapscene.paint.shape import Shape
from hapscene.scene.topology import area_of, weld

NORMAL_EDGES: Final = 2.0
"""How far apart two faces of one place count when one looks to the side of the other, in edges of the shown mesh [1]:
enough for the two sides of a wall thinner than an edge not to be taken for each other."""


SLIVER_SINE: Final = 0.045
"""Sine of the angle, 2.6°, under which fast-simplification keeps a triangle as it is [1]: where half of what may be
shown are such slivers, it tries for long and gets nowhere."""

GRID_MAX: Final = 4096
"""Most cells along the longest side of a mesh whose vertices are clustered [count]: finer than a screen."""

EXCESS: Final = 1.2
"""How many times too many faces may be left [1], before the other way is taken."""

Places = NDArray[np.float64]
Faces = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Reduced:
    """What is shown of a mesh, in the body's frame B.

    Attributes:
        vertices_m: (V, 3) float32 [m].
        faces: (S, 3) int32.
        shown_of: (M,) int32, the one shown face that stands for each face of the mesh.
        lent: (k, 2) int32, shown faces that stand for none, and the face of the mesh whose colour each wears.
    """

    vertices_m: NDArray[np.float32]
    faces: NDArray[np.int32]
    shown_of: NDArray[np.int32]
    lent: NDArray[np.int32]


def reduced(shape: Shape, count: int) -> Reduced:
    """A mesh with about `count` faces at most; itself, where it has no more.

    By quadric error metrics (Garland & Heckbert 1997, fast-simplification); by clusters of vertices (Rossignac & Borrel
    1993), where slivers keep those from it. A face of the mesh is stood for by the shown face that is nearest by
    centroid and normal.

    Raises:
        ViewError: the package that reduces is not there.
    """
    mesh = shape.mesh
    if len(mesh.faces) <= count:
        every = np.arange(len(mesh.faces), dtype=np.int32)
        return Reduced(mesh.vertices_m.astype(np.float32), mesh.faces, every, np.zeros((0, 2), np.int32))
    used, index = np.unique(weld(mesh.vertices_m)[mesh.faces], return_inverse=True)
    vertices_m, faces = mesh.vertices_m[used], index.reshape(-1, 3).astype(np.int32)
    found = None
    if np.count_nonzero(_smallest_sine(shape.corner_m) < SLIVER_SINE) < count / 2:
        found = _collapsed(vertices_m, faces, count)
    if found is None or len(found[1]) > EXCESS * count:
        found = _clustered(vertices_m, faces, shape.normal, count)
    return Reduced(found[0].astype(np.float32), found[1], *_stand_for(shape, *found))


def _collapsed(vertices_m: Places, faces: Faces, count: int) -> tuple[Places, Faces]:
    try:
        from fast_simplification import simplify
    except ImportError:
        raise ViewError(
            f"a mesh of {len(faces):,} faces is too large to show whole, and what reduces it is missing: "
            "pip install 'hapscene[paint]'"
        ) from None
    centre_m = vertices_m.mean(axis=0)
    vertices, left = simplify(vertices_m - centre_m, faces, target_count=count)
    return np.asarray(vertices, np.float64) + centre_m, np.asarray(left, np.int32)


def _clustered(vertices_m: Places, faces: Faces, normal: NDArray[np.float64], count: int) -> tuple[Places, Faces]:
    """Vertices of one cell of a grid, looking the same way, become one in their middle; the finest such grid."""
    around = np.stack(
        [np.bincount(faces.ravel(), np.repeat(normal[:, k], 3), len(vertices_m)) for k in range(3)], axis=1
    )
    look = np.rint(around / np.maximum(np.abs(around).max(axis=1, keepdims=True), 1e-300)).astype(np.int64) + 1
    low_m, span_m = vertices_m.min(axis=0), float(np.ptp(vertices_m, axis=0).max())
    coarse, fine = 1.0, float(GRID_MAX)  # cells along the longest side
    best = vertices_m, faces
    while fine / coarse > 1.05:
        cells = math.sqrt(coarse * fine)
        key = np.zeros(len(vertices_m), np.int64)
        for cell in ((vertices_m - low_m) / span_m * cells).astype(np.int64).T:
            key = key * (GRID_MAX + 1) + cell
        key = key * 27 + look @ np.array([9, 3, 1])
        cluster = np.unique(key, return_inverse=True)[1]
        left = _once(cluster[faces])
        if len(left) <= count:
            coarse = cells
        else:
            fine = cells
        if len(left) <= count or len(best[1]) > count:
            size = np.bincount(cluster)
            middle = [np.bincount(cluster, vertices_m[:, k]) / size for k in range(3)]
            best = np.stack(middle, axis=1), left.astype(np.int32)
    return best


def _once(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Faces (M, 3) without those that have lost a side, each once."""
    whole = corners[(corners != corners[:, (1, 2, 0)]).all(axis=1)]
    row, low = np.arange(len(whole)), np.argmin(whole, axis=1)
    turned = np.stack([whole[row, (low + k) % 3] for k in range(3)], axis=1)  # the lowest first: wound as it was
    size = int(corners.max()) + 1
    key = (turned[:, 0] * size + turned[:, 1]) * size + turned[:, 2]
    return np.asarray(turned[np.unique(key, return_index=True)[1]])


def _smallest_sine(corner_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sine (M,) of the smallest angle of triangles (M, 3, 3); 0 for those without area."""
    side = np.sort(np.linalg.norm(corner_m - corner_m[:, (1, 2, 0)], axis=2), axis=1)
    product = side[:, 1] * side[:, 2]
    return np.asarray(np.divide(2 * area_of(corner_m), product, out=np.zeros(len(side)), where=product > 0))


def _stand_for(
    shape: Shape, vertices_m: NDArray[np.float64], faces: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The shown face (M,) nearest to each face, by centroid and normal; and for those that are to none, `lent`."""
    from scipy.spatial import cKDTree

    corner = vertices_m[faces]
    edge = corner[:, 1] - corner[:, 0]
    cross = np.cross(edge, corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    normal = np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)
    scale_m = NORMAL_EDGES / 2 * float(np.median(np.linalg.norm(edge, axis=1)))  # normals that oppose are 2 apart
    shown = np.hstack([corner.mean(axis=1), scale_m * normal])
    full = np.hstack([shape.centroid_m, scale_m * shape.normal])
    shown_of = np.asarray(cKDTree(shown).query(full, workers=-1)[1], np.int32)
    idle = np.flatnonzero(np.bincount(shown_of, minlength=len(faces)) == 0)
    lender = cKDTree(full).query(shown[idle])[1] if len(idle) else idle
    return shown_of, np.stack([idle, lender], axis=1).astype(np.int32)
