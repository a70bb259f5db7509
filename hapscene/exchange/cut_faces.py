"""Conversion of subdivided faces to separate faces, for formats that have one colour per face: PLY and OBJ.

The result has no cracks: a part is cut further where a neighbour has a vertex on its side. Each cut bisects a side
(`hapscene.scene.fine_paint`), so such a vertex is the midpoint of the side or of one of its halves.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.body import Body
from hapscene.scene.fine_paint import parts
from hapscene.scene.topology import weld

__all__ = ["cut_faces"]


class CutFaces(NamedTuple):
    """The faces of a body, divided along its paint.

    Attributes:
        vertices_m: vertices (n, 3) in the body frame [m], those of the mesh first.
        faces: indices into them (m, 3). Parts replace their face in the order of faces.
        swatch: swatch of each part (m,); a blend is reduced to its heavier swatch unless blends are kept.
        face: face of the mesh that each part belongs to (m,).
        bary: barycentric coordinates of the corners of each part in that face (m, 3, 3); None if no face is divided.
    """

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    swatch: NDArray[np.integer]
    face: NDArray[np.int64]
    bary: NDArray[np.float64] | None

    def corners(self, values: NDArray[np.generic], rows: NDArray[np.generic]) -> NDArray[np.generic]:
        """Interpolate values at the corners of the faces of the mesh (M, 3, c) to some parts (k, 3, c)."""
        found = values[self.face[rows]]
        return np.asarray(found if self.bary is None else self.bary[rows] @ found)


def cut_faces(body: Body, keep_blends: bool = False) -> CutFaces:
    """Divide the faces of a body along its paint."""
    mesh = body.mesh
    faces, swatch = mesh.faces.astype(np.int64), body.face_swatch
    fine = body.fine
    if fine is not None:
        fine = fine if keep_blends else replace(fine, paint=parts(fine.paint)[0]).joined()
    if not fine:
        return CutFaces(mesh.vertices_m, faces, swatch, np.arange(len(faces)), None)
    names = weld(mesh.vertices_m)[faces]
    near = np.isin(names, names[fine.faces]).sum(axis=1) > 1  # neighbours that share a side
    near[fine.faces] = False
    left = np.ones(len(faces), np.bool_)
    left[fine.faces] = left[near] = False
    plain = np.flatnonzero(near)
    subfaces = fine.corners()
    table = np.unique(_keys(names, fine.face, subfaces))
    face = np.concatenate([fine.face, plain]).astype(np.int64)
    bary = np.concatenate([subfaces, np.tile(np.eye(3), (len(plain), 1, 1))])
    paint = np.concatenate([fine.paint, swatch[plain]]).astype(np.int64 if keep_blends else np.int16)
    done = []
    while len(face):
        middle = (bary[:, [1, 2, 0]] + bary[:, [2, 0, 1]]) / 2
        there = np.isin(_keys(names, face, middle), table)
        cut = there.any(axis=1)
        done.append((face[~cut], bary[~cut], paint[~cut]))
        edge, row = there[cut].argmax(axis=1), np.arange(np.count_nonzero(cut))
        halves = [bary[cut], bary[cut]]
        for half, corners in enumerate(halves):
            corners[row, (edge + 2 - half) % 3] = middle[cut][row, edge]
        face, bary, paint = np.tile(face[cut], 2), np.concatenate(halves), np.tile(paint[cut], 2)
    face, bary, paint = (np.concatenate(column) for column in zip(*done, strict=True))
    corner = faces[face[:, None], bary.argmax(axis=2)]  # corners of the parts that are corners of the face
    new = bary.max(axis=2) < 1.0
    _, first, index = np.unique(_keys(names, face, bary)[new], return_index=True, return_inverse=True)
    corner[new] = len(mesh.vertices_m) + index
    at = np.broadcast_to(face[:, None], new.shape)[new][first]
    places_m = np.einsum("nc,ncx->nx", bary[new][first], mesh.vertices_m[faces[at]])
    whole = np.flatnonzero(left)
    order = np.argsort(np.concatenate([whole, face]), kind="stable")
    return CutFaces(
        np.concatenate([mesh.vertices_m, places_m]),
        np.concatenate([faces[whole], corner])[order],
        np.concatenate([swatch[whole], paint])[order],
        np.concatenate([whole, face])[order],
        np.concatenate([np.broadcast_to(np.eye(3), (len(whole), 3, 3)), bary])[order],
    )


def _keys(names: NDArray[np.int64], face: NDArray[np.integer], bary: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Return hashes of points (k, 3) on faces; a point on the common side of two faces has the same hash in both.

    The points are given by exact barycentric coordinates (k, 3, 3): sums of powers of ½. `names` are the welded
    vertices of all faces (m, 3). A collision among 12 million points happens in one of 250,000 files.
    """
    named = np.where(bary > 0.0, names[face][:, None, :], -1)
    order = np.argsort(named, axis=2, kind="stable")
    names, weights = np.take_along_axis(named, order, 2), np.take_along_axis(bary, order, 2)
    key = np.zeros(bary.shape[:2], np.uint64)
    for column in (*np.moveaxis(names.view(np.uint64), 2, 0), *np.moveaxis(weights.view(np.uint64), 2, 0)):
        key = (key ^ column) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    return key
