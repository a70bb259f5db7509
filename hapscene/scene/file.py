"""The scene file, NAME.scene.json: bodies, poses and painting, keyed to the content of the meshes beside it.

    {
      "format": "hapscene scene", "version": 1,
      "swatches": ["plain", "wood", "mine.swatch"],
      "meshes": [{"path": "meshes/plate.obj", "unit": "mm", "sha256": "…", "face_count": 2400}],
      "bodies": [{"name": "plate", "mesh": 0, "two_sided": false, "pose": [[…], …],
                  "paint": [[1, 2000], [2, 400]], "made_of": 1}]
    }

`made_of`, which may be missing, is the swatch that the whole body had before it was painted. `paint` is a list of runs
[swatch, faces] in the order of the mesh's faces; where they are thousands, as after a brush, it is a packed text
(`hapscene.scene.painting`), and the version is 2, which older readers refuse. Paths are relative to the file, with "/".
A swatch that ends in ".swatch" is a file, else a shipped one; number 0 is always "plain". What the scene got from
memory is written beside the file, before it: meshes as NAME.BODY.HASH.ply (float64, so they come back to the bit),
swatches as NAME.SWATCH.HASH.swatch (`hapscene.scene.beside`).
"""

import json
import math
import os
import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.errors import SceneError
from hapscene.output import check_file, write_whole
from hapscene.scene.beside import SCENE_SUFFIX, Beside, beside
from hapscene.scene.body import Body
from hapscene.scene.mesh import UNIT_M, Mesh, load_mesh, warn
from hapscene.scene.painting import read, written
from hapscene.scene.ply import mesh_to_ply
from hapscene.scene.scene import Scene

SUFFIX: Final = SCENE_SUFFIX
FORMAT: Final = "hapscene scene"
VERSION: Final = 2
"""Version of the format. Raised when a reader of the old one would misread the new one: 2 has packed paintings. A file
that has none is written as 1."""

BYTES_MAX: Final = 256 * 1024 * 1024
"""Largest scene file that is opened [bytes]: room for some 20 million runs of painting."""

BODY_MAX: Final = 10_000
"""Most bodies of a scene file [count]."""


def save_scene(scene: Scene, path: Path) -> None:
    """What `Scene.save` does. Through a link, what it points to is written, and named from there."""
    check_place(path)
    path = path.resolve() if path.is_symlink() else path
    if len(scene.bodies) > BODY_MAX:
        raise SceneError(f"{path}: {len(scene.bodies):,} bodies; a scene file holds at most {BODY_MAX:,}")
    with beside(path) as files:
        write_whole(path, _layout(_content(scene, files)).encode(), SceneError)


def check_place(path: Path) -> None:
    """Refuse a path that no scene can be saved to.

    Raises:
        SceneError: it has another suffix, or is in no folder.
    """
    if not path.name.endswith(SUFFIX) or path.name == SUFFIX:
        raise SceneError(f"{path}: a scene's file name ends in {SUFFIX}, as in {path.stem.split('.')[0]}{SUFFIX}")
    check_file(path.resolve() if path.is_symlink() else path, SceneError)


def _content(scene: Scene, files: Beside) -> dict[str, Any]:
    """What the file says; what the scene got from memory is written beside it."""
    index: dict[int, int] = {}
    meshes: list[dict[str, Any]] = []
    bodies: list[dict[str, Any]] = []
    for body in scene.bodies:
        if id(body.mesh) not in index:
            index[id(body.mesh)] = len(meshes)
            meshes.append(_write_mesh(body, files))
        told = {
            "name": body.name,
            "mesh": index[id(body.mesh)],
            "two_sided": body.two_sided,
            "pose": body.X_WB.tolist(),
            "paint": written(body.face_swatch),
        }
        bodies.append(told if body.made_of is None else {**told, "made_of": body.made_of})
    return {
        "format": FORMAT,
        "version": 2 if any(isinstance(body["paint"], str) for body in bodies) else 1,
        "swatches": [_write_swatch(scene, i, files) for i in range(len(scene.swatches))],
        "meshes": meshes,
        "bodies": bodies,
    }


def load_scene(path: str | os.PathLike[str], accept_changed: bool = False) -> Scene:
    """Load a scene as `Scene.save` wrote it.

    Args:
        path: the file, NAME.scene.json.
        accept_changed: take a mesh that has changed since, if it still has as many faces; the painting stays
            on faces of the same number.

    Raises:
        SceneError: the file is missing, damaged or of a later version, or a mesh has changed.
        MeshError: a mesh cannot be loaded.
        SwatchError: a swatch is unknown or broken.
    """
    path = Path(path)
    content = _Place(path, "", _parse(path))
    if content.get("format", str) != FORMAT:
        raise SceneError(f"{path}: not a scene: format is {content.get('format', str)!r}, expected {FORMAT!r}")
    version = content.get("version", int)
    if not 1 <= version <= VERSION:
        raise SceneError(f"{path}: format version {version}; this hapscene reads up to {VERSION}: update hapscene")
    scene = Scene()
    swatches = [_load_swatch(scene, place, path) for place in content.items("swatches", str)]
    meshes = [_load_mesh(place, path, accept_changed) for place in content.items("meshes", dict)]
    for place in content.items("bodies", dict):
        _load_body(scene, place, meshes, swatches)
    return scene


class _Place:
    """A value in the file, and how to get there, for errors."""

    def __init__(self, path: Path, where: str, value: Any) -> None:
        self.path, self.where, self.value = path, where, value

    def fail(self, problem: str) -> SceneError:
        return SceneError(f"{self.path}: {self.where or 'file'}: {problem}")

    def get(self, key: str, kind: type) -> Any:
        """A member of an object, of exactly that type: true is no number."""
        if not isinstance(self.value, dict) or key not in self.value:
            raise self.fail(f"{key!r} is missing")
        if type(self.value[key]) is not kind:
            raise self.fail(f"{key!r} must be {_KIND[kind]}, is {str(self.value[key])[:60]!r}")
        return self.value[key]

    def index(self, key: str, count: int) -> int:
        number = int(self.get(key, int))
        if not 0 <= number < count:
            raise self.fail(f"{key!r} must be one of {count}, counted from 0, is {number}")
        return number

    def items(self, key: str, kind: type) -> "list[_Place]":
        values = self.get(key, list)
        if len(values) > BODY_MAX:
            raise self.fail(f"{len(values):,} {key}; at most {BODY_MAX:,} are read")
        places = [_Place(self.path, f"{key}[{i}]", value) for i, value in enumerate(values)]
        for place in places:
            if type(place.value) is not kind:
                raise place.fail(f"must be {_KIND[kind]}, is {str(place.value)[:60]!r}")
        return places


_KIND: Final = {
    str: "a text",
    int: "a whole number",
    bool: "true or false",
    list: "a list",
    dict: "an object",
}


def _parse(path: Path) -> Any:
    try:
        with path.open("rb") as file:
            data = file.read(BYTES_MAX + 1)
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > BYTES_MAX:
        raise SceneError(f"{path}: larger than {BYTES_MAX >> 20} MiB, which no scene is")
    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{path}: not a scene file, or truncated: {error}") from None
    if not isinstance(content, dict):
        raise SceneError(f'{path}: not a scene: the file must be a JSON object with "format": "{FORMAT}"')
    return content


def _named(path: Path, name: str) -> Path:
    """The file that a scene file names: from its own folder, or, opened through a link, from where the link is."""
    own, link = path.resolve().parent / name, path.parent / name
    there = os.path.exists  # which, other than Path's, takes any name
    return own if path.is_symlink() and (there(own) or not there(link)) else link


def _load_swatch(scene: Scene, place: _Place, path: Path) -> int:
    name = place.value
    return scene.swatch_index(_named(path, name) if name.endswith(".swatch") else name)


def _load_mesh(place: _Place, path: Path, accept_changed: bool) -> Mesh:
    file, unit = _named(path, place.get("path", str)), place.get("unit", str)
    if unit not in UNIT_M:
        raise place.fail(f"no unit of length {unit[:60]!r}; there are: {', '.join(UNIT_M)}")
    mesh = load_mesh(file, unit)
    if mesh.digest == place.get("sha256", str):
        return mesh
    was, now = place.get("face_count", int), len(mesh.faces)
    if was != now:
        raise place.fail(
            f"{file} has changed since the scene was saved: it had {was:,} faces and has {now:,}, so the "
            "painting no longer fits; put the old mesh back, or add the new one to a new scene and paint it"
        )
    if not accept_changed:
        raise place.fail(
            f"{file} has changed since the scene was saved: as many faces ({now:,}), but other positions or "
            "corners; put the old mesh back, or load with accept_changed=True to keep the paint (`hapscene paint "
            "--accept-changed`), and save again"
        )
    warn(f"{path}: {file} has changed since the scene was saved; its paint stays")
    return mesh


def _load_body(scene: Scene, place: _Place, meshes: list[Mesh], swatches: list[int]) -> None:
    mesh = meshes[place.index("mesh", len(meshes))]
    pose = place.get("pose", list)
    if not all(type(row) is list and all(type(x) in (int, float) and abs(x) < math.inf for x in row) for row in pose):
        raise place.fail("'pose' must be four rows of four finite numbers")
    name, two_sided = place.get("name", str), place.get("two_sided", bool)
    if "paint" not in place.value:
        raise place.fail("'paint' is missing")
    try:
        painting = read(place.value["paint"], len(mesh.faces), len(swatches))
    except ValueError as error:
        raise place.fail(f"'paint' {error}") from None
    body = scene.add(mesh, name=name, pose=pose, two_sided=two_sided)
    body.face_swatch[:] = np.array(swatches, np.int16)[painting]
    if "made_of" in place.value:
        body.made_of = swatches[place.index("made_of", len(swatches))]


def _write_mesh(body: Body, files: Beside) -> dict[str, Any]:
    mesh, unit = body.mesh, body.mesh.unit
    name = files.name(mesh.path)
    if name is None:
        name, unit = files.put(body.name, ".ply", mesh_to_ply(mesh)), "m"
    return {"path": name, "unit": unit, "sha256": mesh.digest, "face_count": len(mesh.faces)}


def _write_swatch(scene: Scene, index: int, files: Beside) -> str:
    source, swatch = scene.swatch_source[index], scene.swatches[index]
    if isinstance(source, str):
        return source
    name = files.name(source)
    if name is None:
        from hapscene.surface.swatch_file import swatch_to_bytes

        name = files.put(swatch.name, ".swatch", swatch_to_bytes(swatch))
    return name


def _layout(content: dict[str, Any]) -> str:
    """JSON with a line for each key, row of a pose and run of a painting: to read, and to compare."""
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    # Lists of plain numbers on one line; then the runs of a body's painting, ten to a line at most.
    # Innermost lists go on one line. Only the layout has line breaks: in a text they are escaped.
    return re.sub(r"\[\n([^\[\]{}\"]+)\n\s*\]", lambda m: "[" + " ".join(m[1].split()) + "]", text) + "\n"
