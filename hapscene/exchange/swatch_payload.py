"""What a file carries of a swatch, and the swatch that comes of it."""

import hashlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError, SwatchError, warn
from hapscene.io.files import refusing
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import LEAF_MAX, put_leaves
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import SWATCH_MAX, Scene
from hapscene.scene.scene_file import decode_fine, encode_fine
from hapscene.scene.topology import weld
from hapscene.surface.swatch import BASIC_PARAMETERS, OWN_PARAMETERS, PLAIN, Swatch
from hapscene.surface.swatch_file import SUFFIX, is_number, swatch_from_json, swatch_to_json
from hapscene.swatches.library import load_swatch

__all__ = [
    "VERSION",
    "ExchangeWarning",
    "Piece",
    "check_version",
    "digest_of",
    "fine_told",
    "finite",
    "hang_again",
    "is_digest",
    "join",
    "known_swatch",
    "lose",
    "pieces_of",
    "restore",
    "restore_fine",
    "text_of",
]

VERSION: Final = 1
"""Version of what is written into other programs' formats. Raised when a reader of the old one would misread it."""

EMBEDDED_MAX: Final = 1_000_000
"""Longest text of a swatch that is put whole into a file for other programs [characters]. One of 100 models of order
120 has 300,000; a longer one travels as a .swatch file beside it, and its hash finds it in the library."""


class ExchangeWarning(UserWarning):
    """A scene that was read, but lost something on the way."""


def lose(message: str) -> None:
    """Warn of what is lost."""
    warn(message, ExchangeWarning)


def digest_of(swatch: Swatch) -> str:
    """SHA-256, in hex, of the text of the swatch's file: the same for the same surface under the same name."""
    return hashlib.sha256(swatch_to_json(swatch).encode()).hexdigest()


def text_of(swatch: Swatch) -> str | None:
    """The text of the swatch's file, or None where it is longer than `EMBEDDED_MAX`."""
    text = swatch_to_json(swatch)
    return text if len(text) <= EMBEDDED_MAX else None


def known_swatch(name: str) -> Swatch | None:
    """The shipped swatch of that name, or the one in the user's library; a name never opens another file."""
    if name == PLAIN.name:
        return PLAIN
    if "/" in name or "\\" in name or os.sep in name or name.endswith(SUFFIX):
        return None
    try:
        return load_swatch(name)
    except SwatchError:
        return None


def restore(
    path: Path, name: str, numbers: Mapping[str, Any], albedo_rgb: Any, sha256: str, text: str | None = None
) -> Swatch | str:
    """The swatch that a file speaks of: a name where the library has the very same, else the swatch itself.

    Args:
        path: the file, for messages.
        name: of the swatch.
        numbers: its own numbers, by name.
        albedo_rgb: its colour.
        sha256: of the text of its file.
        text: that text, where the file carries it.

    Raises:
        SceneError: not a number.
        SwatchError: the text is no swatch, or of another name.

    Warns:
        ExchangeWarning: neither the file nor the library has the whole swatch: its texture, taps and effects are lost.
    """
    known = known_swatch(name)
    if known is not None and digest_of(known) == sha256:
        return PLAIN if known is PLAIN else name
    if text is not None:
        with refusing(SwatchError, f"{path}: swatch {name[:60]!r}"):
            swatch = swatch_from_json(text)
        if swatch.name != name:
            raise SwatchError(f"{path}: the swatch of {name[:60]!r} calls itself {swatch.name!r}")
        return swatch
    if digest_of(bare := _bare(path, name, numbers, albedo_rgb)) != sha256:
        other = "is another one" if known is not None else "has none of that name"
        lose(
            f"{path}: swatch {name!r} comes with its numbers alone, and the library {other}: without texture, taps "
            "and effects; put its .swatch into the library (hapscene swatch add) and import again"
        )
    return bare


def _bare(path: Path, name: str, numbers: Mapping[str, Any], albedo_rgb: Any) -> Swatch:
    values = {key: numbers.get(key, None if key in BASIC_PARAMETERS else 0.0) for key in OWN_PARAMETERS}
    colour = tuple(albedo_rgb) if isinstance(albedo_rgb, list | tuple) else ()
    for value in (*values.values(), *colour):
        if not is_number(value):
            raise SceneError(f"{path}: swatch {name[:60]!r}: expected numbers for {', '.join(values)} and its colour")
    with refusing(SwatchError, path):
        return Swatch(name, **{k: float(v) for k, v in values.items()}, albedo_rgb=colour)  # type: ignore[arg-type]


def check_version(path: Path, version: Any) -> None:
    """Refuse what a later hapscene wrote.

    Raises:
        SceneError: the version is none, or later than `VERSION`.
    """
    if isinstance(version, float) and version.is_integer():  # some programs keep every number as a float
        version = int(version)
    if type(version) is not int or version < 1:
        raise SceneError(
            f"{path}: hapscene_version must be a whole number from 1 to {VERSION}, is {str(version)[:40]!r}"
        )
    if version > VERSION:
        raise SceneError(f"{path}: written as version {version}; this hapscene reads up to {VERSION}: update hapscene")


def is_digest(text: Any) -> bool:
    """Whether a value is a SHA-256 in hex."""
    return isinstance(text, str) and re.fullmatch(r"[0-9a-f]{64}", text) is not None


def finite(text: str) -> float:
    """The finite number in a text.

    Raises:
        ValueError: there is none.
    """
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


# A painted body cut into pieces, one for each swatch, for formats that have a material per mesh; and joined again.


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


def fine_told(scene: Scene, body: Body) -> dict[str, Any] | None:
    """What a body's leaves are, for `restore_fine`, its faces in the order of `pieces_of`; None where it has none."""
    if body.fine is None:
        return None
    order = np.argsort(body.face_swatch, kind="stable")
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order))
    fine = replace(body.fine, face=place[body.fine.face])
    told = encode_fine(fine[np.argsort(fine.face, kind="stable")])
    return told | {"swatches": [swatch.name for swatch in scene.swatches], "corners": _corners_of(body.mesh, order)}


def restore_fine(path: Path, scene: Scene, body: Body, told: Any) -> None:
    """Paint a body as `fine_told` said, whose faces are those that were written, once its scene has all swatches.

    Raises:
        SceneError: it is damaged.

    Warns:
        ExchangeWarning: the faces are others now, or a swatch is missing: it stays painted by whole faces.
    """
    where = f"{path}: body {body.name[:60]!r}"
    index = {swatch.name: i for i, swatch in enumerate(scene.swatches)}
    names = told.get("swatches") if isinstance(told, dict) else None
    if not isinstance(names, list) or len(names) > SWATCH_MAX or not all(isinstance(name, str) for name in names):
        raise SceneError(f"{where}: what is painted finer than faces needs a list of names, 'swatches'")
    if told.get("corners") != _corners_of(body.mesh) or not index.keys() >= set(names):
        lose(f"{where}: is painted finer than its faces, which another program has changed: whole faces are painted")
        return
    left = LEAF_MAX - sum(len(known.fine) for known in scene.bodies if known.fine is not None)
    try:
        fine = decode_fine(told, len(body.mesh.faces), [index[name] for name in names], left)
    except ValueError as error:
        raise SceneError(f"{where}: what is painted finer than faces {error}") from None
    put_leaves(body, fine)


def hang_again(path: Path, scene: Scene, body: Body, parent: Any) -> None:
    """Hang a body on its parent, as a file says; None: it hung on none.

    Warns:
        ExchangeWarning: there is no such parent any more.
    """
    try:
        if parent is not None:
            scene.hang(body.name, str(parent))
    except SceneError:
        lose(f"{path}: body {body.name[:60]!r} hangs on nothing now: {str(parent)[:60]!r} is not there, or hangs on it")


def _corners_of(mesh: Mesh, order: Any = slice(None)) -> str:
    """A hash of the corners of all faces, in an order, which tells whether they are the same again."""
    corners = np.take(mesh.vertices_m.astype("<f4") + np.float32(0.0), mesh.faces[order], axis=0)
    return hashlib.sha256(corners.tobytes()).hexdigest()
