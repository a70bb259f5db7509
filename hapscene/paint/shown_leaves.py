"""Paint finer than faces as it is shown: its leaves as triangles, in patches, of which a stroke changes few."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.paint.history import leaf_marks
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import LEVEL_MAX, NOTHING, FinePaint

PATCHES: Final = 64
"""About how many patches the large faces of a body are cut into [count]: a stroke changes a few, and each is sent in
some milliseconds."""

PATCH_BITS: Final = 8
"""Most cuts from a face to a patch of it [count]."""

LARGE: Final = 1 << 32
"""Patches of large faces are numbered from here; of small ones below 0; chunks of whole faces lie between."""

LEAVES_MAX: Final = 2_000
"""Most leaves of a patch that are shown [count]: where it has more, the smallest are shown as the first of them is."""

OVERLAP: Final = 1e-4
"""How far leaves reach over their borders, in diagonals of the body [1]: a twentieth of a pixel, as finely as triangles
are placed; so there are no hairline cracks between a leaf and the smaller ones beside it."""


class ShownLeaves:
    """The leaves of a body.

    A patch is a piece of a large face, or the leaves of all small faces of one group. It is known by a number.

    Args:
        body: whose they are.
        area_m2: (M,) of its faces [m²].
        group: (M,) of neighbours that each face is in, from 0.
    """

    def __init__(self, body: Body, area_m2: NDArray[np.float64], group: NDArray[np.int32]) -> None:
        self._body, self._group = body, group
        share = PATCHES * area_m2 / max(float(area_m2.sum()), 1e-300)
        self._bits = np.clip(np.ceil(np.log2(np.maximum(share, 1e-9))), 0, PATCH_BITS).astype(np.int64)
        self._shown = NOTHING
        self.has = np.zeros(len(group), np.bool_)

    def update(self, faces: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.integer]]:
        """Look again at faces (n,): the patches that became others, and the faces that won or lost their leaves."""
        fine = self._body.fine or NOTHING
        if fine is self._shown:
            return np.zeros(0, np.int64), faces[:0]
        faces = np.unique(faces)
        old, new = self._shown.of_faces(faces), fine.of_faces(faces)
        self._shown = fine
        one, other = leaf_marks(old), leaf_marks(new)
        changed = [self._patch(old[~np.isin(one, other)]), self._patch(new[~np.isin(other, one)])]
        before = self.has[faces]
        self.has[faces] = False
        self.has[new.faces] = True
        return np.unique(np.concatenate(changed)), faces[before != self.has[faces]]

    def patches(self) -> NDArray[np.int64]:
        """Those that there are."""
        return np.unique(self._patch(self._shown))

    def leaves(self, patch: int) -> FinePaint:
        """The leaves of a patch, no more than are shown."""
        if patch >= LARGE:
            leaves = self._shown.of_faces([(patch - LARGE) >> PATCH_BITS])
        else:
            leaves = self._shown.of_faces(np.flatnonzero(self.has & (self._group == -1 - patch)))
        leaves = leaves[self._patch(leaves) == patch]
        while len(leaves) > LEAVES_MAX:
            leaves = _coarser(leaves)
        return leaves

    def _patch(self, leaves: FinePaint) -> NDArray[np.int64]:
        """The patch (k,) of each leaf."""
        bits = self._bits[leaves.face]
        piece = leaves.path.astype(np.int64) >> (LEVEL_MAX - bits)
        large = LARGE + (leaves.face.astype(np.int64) << PATCH_BITS | piece)
        return np.where(bits > 0, large, -1 - self._group[leaves.face].astype(np.int64))


def leaf_triangles(leaves: FinePaint, corner_m: NDArray[np.floating], overlap_m: float) -> NDArray[np.float32]:
    """Corners (k, 3, 3) [m] of leaves, of faces with corners (k, 3, 3) [m], a little larger than they are."""
    corners = leaves.corners() @ corner_m
    out = corners - corners.mean(axis=1, keepdims=True)
    length = np.linalg.norm(out, axis=2, keepdims=True)
    return np.asarray(corners + out * (overlap_m / np.maximum(length, overlap_m)), np.float32)


def _coarser(leaves: FinePaint) -> FinePaint:
    """Without the last cut: of its pieces the first stands for all."""
    level = int(leaves.level.max()) - 1
    piece = leaves.path & np.uint32((2**level - 1) << (LEVEL_MAX - level))
    key = leaves.face.astype(np.uint64) << np.uint64(32) | np.where(leaves.level > level, piece, leaves.path)
    kept = np.concatenate([[True], key[1:] != key[:-1]])
    return replace(leaves, level=np.minimum(leaves.level, level).astype(np.uint8))[kept]
