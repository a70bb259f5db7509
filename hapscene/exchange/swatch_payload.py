"""Representation of swatches and paint in files of other formats, and their restoration."""

import hashlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError, SwatchError, warn
from hapscene.io.files import Json, refusing
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import SUBFACE_MAX, set_subfaces
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import SWATCH_MAX, Scene
from hapscene.scene.scene_file import decode_fine, encode_fine
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.surface.swatch_file import SUFFIX, swatch_from_json, swatch_to_json
from hapscene.swatches.library import load_swatch

__all__ = [
    "VERSION",
    "check_version",
    "digest_of",
    "fine_to_json",
    "groups_of",
    "is_digest",
    "known_swatch",
    "restore",
    "restore_fine",
    "warn_of_loss",
]

VERSION: Final = 1
"""Version of the hapscene data in other formats. Raised when an older reader would misinterpret a file."""


class ExchangeWarning(UserWarning):
    """A scene was read, but parts of it were lost."""


def warn_of_loss(message: str) -> None:
    """Warn that a part of a scene is lost."""
    warn(message, ExchangeWarning)


def digest_of(swatch: Swatch) -> str:
    """Return the SHA-256 of the swatch file in hex; it depends on the name and all properties of the swatch."""
    return hashlib.sha256(swatch_to_json(swatch).encode()).hexdigest()


def known_swatch(name: str) -> Swatch | None:
    """Return the swatch with this name from the library; None if it is unknown. A name never opens another file."""
    if name == PLAIN.name:
        return PLAIN
    if "/" in name or "\\" in name or name.endswith(SUFFIX):
        return None
    try:
        return load_swatch(name)
    except SwatchError:
        return None


def restore(path: Path, name: str, sha256: str, text: str | None) -> Swatch | str:
    """Restore a swatch from a file: its name if the library has the identical swatch, else the swatch itself.

    Args:
        path: the file, for messages.
        name: name of the swatch.
        sha256: hash of its swatch file.
        text: content of its swatch file; None if another program has removed it.

    Raises:
        SwatchError: the embedded swatch file is invalid or has another name.

    Warns:
        ExchangeWarning: the swatch is neither embedded nor in the library.
    """
    known = known_swatch(name)
    if known is not None and digest_of(known) == sha256:
        return PLAIN if known is PLAIN else name
    if text is None:
        instead = "plain" if known is None else "the library's swatch with this name"
        warn_of_loss(f"{path}: swatch {name[:60]!r} is no longer in the file; {instead} is used instead")
        return PLAIN if known is None else name
    with refusing(SwatchError, f"{path}: swatch {name[:60]!r}"):
        swatch = swatch_from_json(text)
    if swatch.name != name:
        raise SwatchError(f"{path}: the embedded swatch {name[:60]!r} has another name, {swatch.name!r}")
    return swatch


def check_version(path: Path, version: object) -> None:
    """Check the version of a file. Raises SceneError: the version is invalid, or later than `VERSION`."""
    if isinstance(version, float) and version.is_integer():  # some programs store all numbers as floats
        version = int(version)
    if type(version) is not int or version < 1:
        raise SceneError(f"{path}: hapscene_version must be an integer from 1 to {VERSION}, not {str(version)[:40]}")
    if version > VERSION:
        raise SceneError(
            f"{path}: format version {version} is later than {VERSION}, the latest supported version: update hapscene"
        )


def is_digest(text: object) -> bool:
    """Return whether a value is a SHA-256 in hex."""
    return isinstance(text, str) and re.fullmatch(r"[0-9a-f]{64}", text) is not None


# Formats with one material per mesh: a painted body is divided into pieces, one for each swatch.


def groups_of(body: Body) -> list[tuple[int, int, NDArray[np.int64]]]:
    """Divide the faces of a body into groups with the same swatch and material: swatch, material or −1, and faces."""
    order, swatch, material = order_of(body), body.face_swatch, _material_of(body)
    start = np.flatnonzero(np.diff(swatch[order]) | np.diff(material[order])) + 1
    return [(int(swatch[rows[0]]), int(material[rows[0]]), rows) for rows in np.split(order, start)]


def order_of(body: Body) -> NDArray[np.int64]:
    """Return the faces in the order in which they are written: by swatch, then by material."""
    return np.lexsort((_material_of(body), body.face_swatch))


def _material_of(body: Body) -> NDArray[np.int16]:
    material = body.mesh.material
    return np.full(len(body.mesh.faces), -1, np.int16) if material is None else material


def fine_to_json(scene: Scene, body: Body) -> dict[str, Json] | None:
    """Encode the paint of subdivided faces, with faces in the order of `order_of`; None without subdivided faces."""
    if body.fine is None:
        return None
    order = order_of(body)
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order))
    fine = replace(body.fine, face=place[body.fine.face])
    content = encode_fine(fine[np.argsort(fine.face, kind="stable")])
    return content | {"swatches": [swatch.name for swatch in scene.swatches], "corners": _corners_of(body.mesh, order)}


def restore_fine(path: Path, scene: Scene, body: Body, content: Json) -> None:
    """Restore the paint of subdivided faces from `fine_to_json`; the scene must have all its swatches.

    Raises:
        SceneError: the data is damaged.

    Warns:
        ExchangeWarning: the faces have changed or a swatch is missing, so only whole faces are painted.
    """
    where = f"{path}: body {body.name[:60]!r}"
    index = {swatch.name: i for i, swatch in enumerate(scene.swatches)}
    names = content.get("swatches") if isinstance(content, dict) else None
    if not isinstance(names, list) or len(names) > SWATCH_MAX or not all(isinstance(name, str) for name in names):
        raise SceneError(f"{where}: 'fine' must have a list of swatch names 'swatches'")
    if content.get("corners") != _corners_of(body.mesh) or not index.keys() >= set(names):
        warn_of_loss(f"{where}: another program has changed the faces or swatches: only whole faces are painted")
        return
    left = SUBFACE_MAX - sum(len(known.fine) for known in scene.bodies if known.fine is not None)
    try:
        fine = decode_fine(content, len(body.mesh.faces), [index[name] for name in names], left)
    except ValueError as error:
        raise SceneError(f"{where}: 'fine' {error}") from None
    set_subfaces(body, fine)


def _corners_of(mesh: Mesh, order: NDArray[np.int64] | slice = slice(None)) -> str:
    """Return a hash of the corners of all faces in an order, to detect changes."""
    corners = np.take(mesh.vertices_m.astype("<f4") + np.float32(0.0), mesh.faces[order], axis=0)
    return hashlib.sha256(corners.tobytes()).hexdigest()
