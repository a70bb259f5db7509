"""The fidelity file, NAME.fidelity.json: how finely a scene is rendered, and what each choice costs.

    {
      "format": "hapscene fidelity", "version": 1,
      "scene": "…",
      "made": {"device": "omni", "budget_us": 50.0, …},
      "levels": [{"told": {"error_jnd": 0.4, …},
                  "bodies": {"toad": {"mesh": {"path": "demo.toad.1f00a2b3.ply", "sha256": "…", "face_count": 10240}}},
                  "swatches": {"wood": {"order": 24, "update_ticks": 2}}}]
    }

`scene` is the digest of what was measured (`scene_digest`): a fidelity of another scene, or of one that has changed, is
refused; poses may differ. A body or swatch that is not named is as it is. Of several `levels`, which earlier versions
wrote, the first is read, and their `left_out` is ignored. Coarser meshes lie beside the file as PLY, named by their
content as a scene's own are, with their painting as groups.
"""

import hashlib
import json
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.constants import ORDER_MAX
from hapscene.errors import FormatError, no_such
from hapscene.fidelity.fidelity import BodyFidelity, Fidelity, Level, SwatchFidelity
from hapscene.io.files import check_file, check_keys, naming, parse_format, read_bytes, short, write_whole
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.ply import HEADER_MAX_B, mesh_to_ply
from hapscene.scene.scene import Scene

if TYPE_CHECKING:
    from hapscene.scene.scene_file import SidecarFiles

__all__ = ["FidelityError", "check_scene_path", "fidelity_beside", "load_fidelity", "save_fidelity"]

FORMAT: Final = "hapscene fidelity"
VERSION: Final = 1
SUFFIX: Final = ".fidelity.json"

BYTES_MAX: Final = 16 << 20
"""Largest fidelity file that is opened [bytes]: 100,000 bodies take that."""

UPDATE_MAX: Final = 1000
"""Most ticks for which a texture's filter may stay as it is [count]."""

TOLD_MAX: Final = 100
"""Most entries of `told`, of `made`, and of `left_out` [count]."""


class FidelityError(FormatError):
    """A fidelity file that is missing, broken, of a later version, or of another scene."""


def fidelity_beside(scene: str | os.PathLike[str]) -> Path:
    """Where a scene's fidelity file lies unless it is said: x.fidelity.json of x.scene.json and of x.ply."""
    path = Path(scene)
    name = path.name.removesuffix(".scene.json") if path.name.endswith(".scene.json") else path.stem
    return path.with_name(name + SUFFIX)


def scene_digest(scene: Scene) -> str:
    """SHA-256, in hex, of what a fidelity depends on: meshes, painting, swatches, by name and in order; not poses."""
    from hapscene.surface.swatch_file import swatch_to_json

    content = hashlib.sha256()
    for swatch in scene.swatches:
        content.update(swatch_to_json(swatch).encode(errors="backslashreplace") + b"\0")
    for body in scene.bodies:
        head = json.dumps([body.name, body.mesh.digest, body.two_sided])
        content.update(head.encode() + b"\0" + body.face_swatch.astype("<i2").tobytes())
        for column in body.fine.columns if body.fine is not None else ():
            content.update(column.tobytes())
    return content.hexdigest()


def save_fidelity(fidelity: Fidelity, path: str | os.PathLike[str], scene: Scene) -> None:
    """Write a scene's fidelity, NAME.fidelity.json, and its coarser meshes beside it: whole, or not at all.

    Raises:
        FidelityError: the suffix is another, or the file cannot be written.
    """
    from hapscene.scene.scene_file import sidecar_files

    path = Path(path)
    check_scene_path(path)
    with sidecar_files(path, SUFFIX) as files:
        content = {
            "format": FORMAT,
            "version": VERSION,
            "scene": scene_digest(scene),
            "made": dict(fidelity.made),
            "levels": [_level_told(fidelity.level, files)],
        }
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        write_whole(path, text.encode(errors="backslashreplace"), FidelityError)


def check_scene_path(path: Path) -> None:
    """Refuse, before a scene is measured, a path to which its fidelity cannot be saved.

    Raises:
        FidelityError: it has another suffix, or is in no folder.
    """
    if not path.name.endswith(SUFFIX) or path.name == SUFFIX:
        raise FidelityError(f"{path}: the name of a fidelity file ends in {SUFFIX}, as in {path.stem}{SUFFIX}")
    check_file(path, FidelityError)


def _level_told(level: Level, files: "SidecarFiles") -> dict[str, Any]:
    def mesh_told(name: str, mesh: Mesh) -> dict[str, Any]:
        content = mesh_to_ply(mesh)
        file = files.put(name, ".ply", content)
        return {"path": file, "sha256": hashlib.sha256(content).hexdigest(), "face_count": len(mesh.faces)}

    return {
        "told": dict(level.told),
        "bodies": {name: {"mesh": mesh_told(name, body.mesh)} for name, body in level.bodies.items() if body.mesh},
        "swatches": {
            name: {"order": swatch.order, "update_ticks": swatch.update_ticks}
            for name, swatch in level.swatches.items()
        },
    }


def load_fidelity(path: str | os.PathLike[str], scene: Scene) -> Fidelity:
    """Read a scene's fidelity that `save_fidelity` wrote. Safe to call on a file from anybody.

    Raises:
        FidelityError: the file is missing, damaged, of a later version, or of another scene; a mesh beside it is.
    """
    path = Path(path)
    try:
        with naming(path):
            return _read(
                path, parse_format(read_bytes(path, BYTES_MAX, "fidelity file"), "a fidelity", FORMAT, VERSION), scene
            )
    except FidelityError:
        raise
    except FormatError as fault:
        raise FidelityError(str(fault)) from None


def _read(path: Path, content: dict[str, Any], scene: Scene) -> Fidelity:
    check_keys("", content, ("format", "version", "scene", "made", "levels"))
    if not (isinstance(content["scene"], str) and re.fullmatch("[0-9a-f]{64}", content["scene"])):
        raise FidelityError(f"scene must be a SHA-256 in hex, is {short(content['scene'])}")
    if content["scene"] != scene_digest(scene):
        raise FidelityError(
            "was measured on another scene, or on this one before its meshes, painting or swatches changed: run "
            "`hapscene tune` on it again"
        )
    levels = content["levels"]
    if not (isinstance(levels, list) and levels):
        raise FidelityError(f"levels must be a list of one level, is {_counted(levels)}")
    made = _flat("made", content["made"], str | int | float | bool | None)
    return Fidelity(_level(levels[0], path, scene), made)


def _level(content: Any, path: Path, scene: Scene) -> Level:
    where = "levels[0]"
    check_keys(where, content, ("told", "bodies", "swatches"))
    bodies, swatches = {}, {}
    meshes: dict[str, Mesh] = {}
    known = {body.name: body for body in scene.bodies}
    for name, value in _named(f"{where}.bodies", content["bodies"], known, "body"):
        place = f"{where}.bodies[{short(name)}]"
        check_keys(place, value, ("mesh",))
        bodies[name] = BodyFidelity(_mesh(f"{place}.mesh", value["mesh"], path, meshes, len(known[name].mesh.faces)))
    of_scene = {swatch.name: swatch for swatch in scene.swatches}
    for name, value in _named(f"{where}.swatches", content["swatches"], of_scene, "swatch"):
        place = f"{where}.swatches[{short(name)}]"
        check_keys(place, value, ("order", "update_ticks", "left_out"), required=("order", "update_ticks"))
        texture = of_scene[name].texture
        own = 0 if texture is None else min(texture.order, ORDER_MAX)
        order, ticks = value["order"], value["update_ticks"]
        if order is not None and not (type(order) is int and 1 <= order <= own):
            raise FidelityError(f"{place}.order must be null or a whole number from 1 to {own}, is {short(order)}")
        if not (type(ticks) is int and 1 <= ticks <= UPDATE_MAX):
            raise FidelityError(f"{place}.update_ticks must be a whole number from 1 to {UPDATE_MAX}: {short(ticks)}")
        swatches[name] = SwatchFidelity(order, ticks)
    return Level(bodies, swatches, _flat(f"{where}.told", content["told"], int | float))


def _mesh(where: str, told: Any, path: Path, meshes: dict[str, Mesh], own_count: int) -> Mesh:
    """A coarser mesh, from the file beside; each file is read once."""
    check_keys(where, told, ("path", "sha256", "face_count"))
    name, count = told["path"], told["face_count"]
    if not (_name(name) and name.endswith(".ply") and not re.search(r"[/\\:]", name)):
        raise FidelityError(f"{where}.path must be the name of a PLY file beside this one, is {short(name)}")
    if not (type(count) is int and 1 <= count <= own_count):
        raise FidelityError(f"{where}.face_count must be from 1 to those of the body, {own_count}, is {short(count)}")
    if name not in meshes:
        file = path.with_name(name)
        # a vertex has 24 bytes, a face 15, and as many vertices as corners at most; and there are the swatches' names
        found = hashlib.sha256(read_bytes(file, HEADER_MAX_B + 87 * count, "mesh of so few faces")).hexdigest()
        if found != told["sha256"]:
            raise FidelityError(f"{where}: {file} has changed since: run `hapscene tune` again")
        meshes[name] = load_mesh(file, "m")
    mesh = meshes[name]
    if len(mesh.faces) != count:
        raise FidelityError(f"{where}.face_count is {count:,}, and {name} has {len(mesh.faces):,} faces")
    return mesh


def _named(where: str, value: Any, known: Mapping[str, Any], what: str) -> Any:
    if not isinstance(value, dict):
        raise FidelityError(f"{where} must be an object, is {short(value)}")
    for name in value:
        if name not in known:
            raise FidelityError(f"{where}: {no_such(what, name[:60], list(known)[:20])}")
    return value.items()


def _flat(where: str, value: Any, kind: Any) -> dict[str, Any]:
    """An object of plain values."""
    if not (isinstance(value, dict) and len(value) <= TOLD_MAX):
        raise FidelityError(f"{where} must be an object of at most {TOLD_MAX} entries, is {_counted(value)}")
    for key, one in value.items():
        if not isinstance(one, kind) or (isinstance(one, float) and not math.isfinite(one)):
            raise FidelityError(f"{where}[{short(key)}] must be a plain value, is {short(one)}")
    return value


def _name(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 300 and value.isprintable()


def _counted(value: Any) -> str:
    return f"one of {len(value)}" if isinstance(value, list | dict) else short(value)
