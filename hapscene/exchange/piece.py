"""A painted body cut into pieces, one for each swatch, for formats that have a material per mesh; and joined again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.body import Body
from hapscene.scene.topology import weld


@dataclass(frozen=True, eq=False)
class Piece:
    """The faces of a body that one swatch is painted on.

    Attributes:
        swatch: index into the scene's swatches.
        vertices_m: (n, 3) those of the faces, in the body's frame [m].
        faces: (m, 3) indices into them, in the body's order.
    """

    swatch: int
    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]


def pieces_of(body: Body) -> list[Piece]:
    """The pieces of a body, by number of swatch."""
    pieces = []
    for swatch in np.unique(body.face_swatch):
        corners = body.mesh.faces[body.face_swatch == swatch]
        used, faces = np.unique(corners, return_inverse=True)
        pieces.append(Piece(int(swatch), body.mesh.vertices_m[used], faces.reshape(-1, 3)))
    return pieces


def join(pieces: Sequence[Piece]) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Vertices (n, 3) [m], faces (m, 3) and the swatch of each face (m,), piece after piece.

    Vertices at exactly the same place become one, so that pieces meet where the body was cut.
    """
    vertices_m = np.concatenate([piece.vertices_m for piece in pieces])
    start = np.cumsum([0] + [len(piece.vertices_m) for piece in pieces])
    faces = np.concatenate([piece.faces + at for piece, at in zip(pieces, start, strict=False)])
    kept, place = np.unique(weld(vertices_m), return_inverse=True)
    swatch = np.repeat([piece.swatch for piece in pieces], [len(piece.faces) for piece in pieces])
    return vertices_m[kept], place[faces], swatch


def cut_alike(body: Body) -> tuple[int, bytes]:
    """Equal for bodies of one mesh with one painting: they may share what was made of them."""
    return id(body.mesh), body.face_swatch.tobytes()
