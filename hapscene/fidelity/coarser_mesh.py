"""A mesh of fewer faces: the least change of shape by quadrics, borders of the painting and of the mesh kept."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.errors import HapsceneError
from hapscene.scene.mesh import Mesh

if TYPE_CHECKING:
    from hapscene.scene.body import Body

__all__ = ["coarser_mesh"]

SIZE: Final = 10.0
"""Diagonal that a mesh is scaled to while it is reduced [1]: the package takes lengths of 1e-4 to 0.1 for nothing, and
what is a hand's size has two to three times the error if it is reduced in metres."""

HASTE: Final = (3.0, 5.0, 7.0)
"""How fast it lets the error grow, the next where the one before leaves more than `ENOUGH` times the faces [1]."""

ENOUGH: Final = 1.3


def coarser_mesh(body: "Body", count: int, swatches: Sequence[str]) -> Mesh | None:
    """The mesh of a body in about `count` faces; None where it cannot be had in much fewer than it has.

    Nor where a body is painted finer than its faces: their borders are kept in its own mesh alone.

    Each swatch's faces are reduced by themselves (Garland & Heckbert 1997, fast-simplification) and keep their border
    to the bit, so that no crack opens between two and a border is felt where it was painted. The groups of the mesh are
    the scene's swatches, by their names: its painting.

    Raises:
        HapsceneError: the package that reduces is not there.
    """
    try:
        from fast_simplification import simplify
    except ImportError:
        raise HapsceneError("what reduces meshes is missing: pip install 'hapscene[paint]'") from None
    if body.fine is not None:
        return None
    own = body.mesh
    # corners at one place are one: where a texture's seam parts them, there is no border to be felt
    places, index = np.unique(own.vertices_m, axis=0, return_inverse=True)
    corners = index.reshape(-1)[own.faces]
    scale = 2.0 ** np.round(np.log2(SIZE / own.diagonal_m))  # a power of two: borders come back to the bit
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
    joined, index = np.unique(np.concatenate(pieces), axis=0, return_inverse=True)
    made = index.reshape(-1)[np.concatenate(faces)].astype(np.int32)
    kept = (made != np.roll(made, 1, axis=1)).all(axis=1)
    if not 0 < np.count_nonzero(kept) < 0.9 * len(own.faces):
        return None
    return Mesh(joined, made[kept], np.concatenate(group)[kept], tuple(swatches))
