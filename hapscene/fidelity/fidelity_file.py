"""The fidelity file NAME.fidelity.json: the level of detail of a scene, and its measured cost.

    {
      "format": "hapscene fidelity", "version": 1,
      "scene": "…",
      "made": {"device": "omni", "budget_us": 50.0, …},
      "levels": [{"told": {"error_jnd": 0.4, …},
                  "bodies": {"toad": {"mesh": {"path": "demo.toad.1f00a2b3.ply", "sha256": "…", "face_count": 10240}}},
                  "swatches": {"wood": {"order": 24, "update_ticks": 2}}}]
    }

`scene` is the digest of the measured scene (`scene_digest`): a file for another scene, or for one that has changed
since, is refused; only poses may differ. `told` is the measured cost. Bodies and swatches that are not named are
unchanged. Files of earlier versions may have several `levels`, of which the first is read; their `left_out` is
ignored. The coarser meshes are PLY files beside the fidelity file, named by their content, with their painting as
groups.
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
from hapscene.io.files import Json, check_file, check_keys, naming, parse_format, read_bytes, short, write_whole
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.ply import HEADER_MAX_B, mesh_to_ply
from hapscene.scene.scene import Scene

if TYPE_CHECKING:
    from hapscene.scene.scene_file import SidecarFiles

__all__ = ["FidelityError", "check_fidelity_path", "fidelity_beside", "load_fidelity", "save_fidelity"]

FORMAT: Final = "hapscene fidelity"
VERSION: Final = 1
SUFFIX: Final = ".fidelity.json"

BYTES_MAX: Final = 16 << 20
"""Largest fidelity file [bytes], enough for 100,000 bodies."""

UPDATE_MAX: Final = 1000
"""Largest update interval of a texture filter [ticks]."""

COST: Final = "told"  # key of the measured cost of a level
COST_MAX: Final = 100  # most entries of `told` and of `made`


class FidelityError(FormatError):
    """A fidelity file that is missing, damaged, of a later version, or of another scene."""


def fidelity_beside(scene: str | os.PathLike[str]) -> Path:
    """The default path of the fidelity file of a scene: x.fidelity.json for x.scene.json and for x.ply."""
    path = Path(scene)
    name = path.name.removesuffix(".scene.json") if path.name.endswith(".scene.json") else path.stem
    return path.with_name(name + SUFFIX)


def scene_digest(scene: Scene) -> str:
    """SHA-256, in hex, of the properties that a fidelity depends on: meshes, painting and swatches, but not poses."""
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
    """Write the fidelity of a scene, NAME.fidelity.json, and its coarser meshes beside it; on failure nothing is
    written.

    Raises:
        FidelityError: the name has another suffix, or the file cannot be written.
    """
    from hapscene.scene.scene_file import sidecar_files

    path = Path(path)
    check_fidelity_path(path)
    with sidecar_files(path, SUFFIX) as files:
        content = {
            "format": FORMAT,
            "version": VERSION,
            "scene": scene_digest(scene),
            "made": dict(fidelity.made),
            "levels": [_level_content(fidelity.level, files)],
        }
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        write_whole(path, text.encode(errors="backslashreplace"), FidelityError)


def check_fidelity_path(path: Path) -> None:
    """Check a path for a fidelity file before the scene is measured.

    Raises:
        FidelityError: the name has another suffix, or the folder does not exist.
    """
    if not path.name.endswith(SUFFIX) or path.name == SUFFIX:
        raise FidelityError(f"{path}: expected a file name that ends with {SUFFIX}, as in {path.stem}{SUFFIX}")
    check_file(path, FidelityError)


def _level_content(level: Level, files: "SidecarFiles") -> dict[str, Json]:
    def mesh_content(name: str, mesh: Mesh) -> dict[str, Json]:
        content = mesh_to_ply(mesh)
        file = files.put(name, ".ply", content)
        return {"path": file, "sha256": hashlib.sha256(content).hexdigest(), "face_count": len(mesh.faces)}

    return {
        COST: dict(level.cost),
        "bodies": {name: {"mesh": mesh_content(name, body.mesh)} for name, body in level.bodies.items() if body.mesh},
        "swatches": {
            name: {"order": swatch.order, "update_ticks": swatch.update_ticks}
            for name, swatch in level.swatches.items()
        },
    }


def load_fidelity(path: str | os.PathLike[str], scene: Scene) -> Fidelity:
    """Read the fidelity of a scene. Safe for files from untrusted sources.

    Raises:
        FidelityError: the file or one of its meshes is missing, damaged, of a later version, or of another scene.
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


def _read(path: Path, content: dict[str, Json], scene: Scene) -> Fidelity:
    check_keys("", content, ("format", "version", "scene", "made", "levels"))
    if not (isinstance(content["scene"], str) and re.fullmatch("[0-9a-f]{64}", content["scene"])):
        raise FidelityError(f"scene is {short(content['scene'])}; expected a SHA-256 in hex")
    if content["scene"] != scene_digest(scene):
        raise FidelityError(
            "the scene is not the measured one, or its meshes, painting or swatches have changed; run `hapscene tune` "
            "again"
        )
    levels = content["levels"]
    if not (isinstance(levels, list) and levels):
        raise FidelityError(f"levels is {_counted(levels)}; expected a list of one level")
    made = _flat("made", content["made"], str | int | float | bool | None)
    return Fidelity(_level(levels[0], path, scene), made)


def _level(content: Json, path: Path, scene: Scene) -> Level:
    where = "levels[0]"
    check_keys(where, content, (COST, "bodies", "swatches"))
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
            raise FidelityError(f"{place}.order is {short(order)}; expected null or an integer from 1 to {own}")
        if not (type(ticks) is int and 1 <= ticks <= UPDATE_MAX):
            raise FidelityError(f"{place}.update_ticks is {short(ticks)}; expected an integer from 1 to {UPDATE_MAX}")
        swatches[name] = SwatchFidelity(order, ticks)
    return Level(bodies, swatches, _flat(f"{where}.{COST}", content[COST], int | float))


def _mesh(where: str, content: Json, path: Path, meshes: dict[str, Mesh], own_count: int) -> Mesh:
    """Read a coarser mesh from the file beside; each file is read once."""
    check_keys(where, content, ("path", "sha256", "face_count"))
    name, count = content["path"], content["face_count"]
    if not (_name(name) and name.endswith(".ply") and not re.search(r"[/\\:]", name)):
        raise FidelityError(f"{where}.path is {short(name)}; expected the name of a PLY file in the same folder")
    if not (type(count) is int and 1 <= count <= own_count):
        raise FidelityError(f"{where}.face_count is {short(count)}; expected 1 to {own_count}, the faces of the body")
    if name not in meshes:
        file = path.with_name(name)
        # at most: 15 bytes per face, 3 vertices of 24 bytes per face, and the header with the names of swatches
        found = hashlib.sha256(read_bytes(file, HEADER_MAX_B + 87 * count, "mesh of so few faces")).hexdigest()
        if found != content["sha256"]:
            raise FidelityError(f"{where}: {file} has changed since the measurement; run `hapscene tune` again")
        meshes[name] = load_mesh(file, "m")
    mesh = meshes[name]
    if len(mesh.faces) != count:
        raise FidelityError(f"{where}.face_count is {count:,}, but {name} has {len(mesh.faces):,} faces")
    return mesh


def _named(where: str, value: Json, known: Mapping[str, Any], what: str) -> Any:
    if not isinstance(value, dict):
        raise FidelityError(f"{where} is {short(value)}; expected an object")
    for name in value:
        if name not in known:
            raise FidelityError(f"{where}: {no_such(what, name[:60], list(known)[:20])}")
    return value.items()


def _flat(where: str, value: Json, kind: Any) -> dict[str, Json]:
    """Check an object of plain values."""
    if not (isinstance(value, dict) and len(value) <= COST_MAX):
        raise FidelityError(f"{where} is {_counted(value)}; expected an object of at most {COST_MAX} entries")
    for key, one in value.items():
        if not isinstance(one, kind) or (isinstance(one, float) and not math.isfinite(one)):
            raise FidelityError(f"{where}[{short(key)}] is {short(one)}; expected a number, text, true, false or null")
    return value


def _name(value: Json) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 300 and value.isprintable()


def _counted(value: Json) -> str:
    return f"one with {len(value)} entries" if isinstance(value, list | dict) else short(value)
