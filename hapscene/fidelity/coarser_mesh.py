"""Reduction of a mesh to fewer faces by quadric error metrics; borders of the painting and of the mesh are kept."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.errors import HapsceneError
from hapscene.scene.mesh import Mesh

if TYPE_CHECKING:
    from hapscene.scene.body import Body

__all__ = ["coarser_mesh"]

SIZE: Final = 10.0
"""Diagonal to which a mesh is scaled during reduction [1]. fast-simplification treats lengths of 1e-4 to 0.1 as
zero: a mesh of the size of a hand has two to three times the error if it is reduced in metres."""

HASTE: Final = (3.0, 5.0, 7.0)
"""Growth rates of the allowed error; the next is used if the one before leaves more than `ENOUGH` times the faces
[1]."""

ENOUGH: Final = 1.3


def coarser_mesh(body: "Body", count: int, swatches: Sequence[str]) -> Mesh | None:
    """Return the mesh of a body with about `count` faces.

    The faces of each swatch are reduced separately (Garland & Heckbert 1997, fast-simplification), and keep their
    border exactly: no gaps open between two swatches, and borders are rendered where they were painted. The groups of
    the mesh are the swatches of the scene, its painting.

    Returns:
        the mesh, or None if it cannot have much fewer faces, or if the body is painted finer than its faces.

    Raises:
        HapsceneError: fast-simplification is not installed.
    """
    try:
        from fast_simplification import simplify
    except ImportError:
        raise HapsceneError("fast-simplification is not installed; run: pip install 'hapscene[paint]'") from None
    if body.fine is not None:
        return None
    own = body.mesh
    # merge vertices at the same position: texture coordinates may split them, but this is no border of the painting
    places, index = np.unique(own.vertices_m, axis=0, return_inverse=True)
    corners = index.reshape(-1)[own.faces]
    scale = 2.0 ** np.round(np.log2(SIZE / own.diagonal_m))  # a power of two scales without rounding
    pieces, faces, group, start = [], [], [], 0
    for swatch in np.unique(body.face_swatch):
        used, index = np.unique(corners[body.face_swatch == swatch], return_inverse=True)
        vertices, left = places[used], index.reshape(-1, 3).astype(np.int32)
        target = max(round(count * len(left) / len(corners)), 4)
        if target < len(left):
            for haste in HASTE:
                scaled, fewer = simplify(vertices * scale, left, target_count=target, agg=haste, preserve_border=True)
                if len(fewer) <= ENOUGH * target:
                    break
            vertices, left = scaled / scale, fewer
        pieces.append(vertices)
        faces.append(left + start)
        group.append(np.full(len(left), swatch, np.int16))
        start += len(vertices)
    concatenated, index = np.unique(np.concatenate(pieces), axis=0, return_inverse=True)
    made = index.reshape(-1)[np.concatenate(faces)].astype(np.int32)
    kept = (made != np.roll(made, 1, axis=1)).all(axis=1)
    if not 0 < np.count_nonzero(kept) < 0.9 * len(own.faces):
        return None
    return Mesh(concatenated, made[kept], np.concatenate(group)[kept], tuple(swatches))
