"""Cutting a body by swatch, and joining it again."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.exchange.piece import join, pieces_of
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_joined_pieces_are_the_body_again(seed: int, swatches: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = np.concatenate([np.eye(3), rng.normal(size=(9, 3))])
    faces = np.concatenate([[[0, 1, 2]], [rng.choice(12, 3, replace=False) for _ in range(29)]]).astype(np.int32)
    painted = rng.integers(0, swatches, 30).astype(np.int16)
    pieces = pieces_of(Body("b", Mesh(vertices, faces), np.eye(4), False, painted))
    assert [piece.swatch for piece in pieces] == sorted(set(painted.tolist()))
    p, f, swatch = join(pieces)
    order = np.argsort(painted, kind="stable")  # by swatch, within each in the body's order
    assert np.array_equal(p[f], vertices[faces[order]])
    assert np.array_equal(swatch, painted[order])
    assert len(p) == len(np.unique(faces))  # each vertex once, though several pieces have it
