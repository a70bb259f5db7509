"""The scene file, NAME.scene.json: bodies, poses and painting, keyed to the content of the meshes beside it.

    {
      "format": "hapscene scene", "version": 1,
      "swatches": ["plain", "wood", "mine.swatch"],
      "meshes": [{"path": "meshes/plate.obj", "unit": "mm", "sha256": "…", "face_count": 2400}],
      "bodies": [{"name": "plate", "mesh": 0, "two_sided": false, "pose": [[…], …],
                  "paint": [[1, 2000], [2, 400]], "made_of": 1}]
    }

`made_of`, which may be missing, is the swatch that the whole body had before it was painted; `parent`, likewise, the
name of the body that it hangs on (version 3). `paint` is a list of runs
[swatch, faces] in the order of the mesh's faces; where they are thousands, as after a brush, it is a packed text
(`encode_paint`), and the version is 2, which older readers refuse. In version 3 a mesh may have y up in its file
(`"up": "y"`), or another size than there (`"scale": 0.5`), else it is as in its file, glTF too; and what is painted
finer than faces stands in `fine` of its body (`encode_fine`). Paths are relative to the file, with "/".
A swatch that ends in ".swatch" is a file, else a shipped one; number 0 is always "plain". What the scene got from
memory is written beside the file, before it: meshes as NAME.BODY.HASH.ply (float64, so they come back to the bit),
swatches as NAME.SWATCH.HASH.swatch (`SidecarFiles`).
"""

import base64
import binascii
import hashlib
import json
import math
import os
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import SCENE_SUFFIX
from hapscene.errors import SceneError, warn
from hapscene.io.files import check_file, naming, read_bytes, refusing, write_whole
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import LEAF_MAX, LEVEL_MAX, FinePaint, blend, parts, put_leaves
from hapscene.scene.mesh import UNIT_M, Mesh, MeshWarning, check_reading
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.ply import mesh_to_ply

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = [
    "BODY_MAX",
    "BYTES_MAX",
    "RUN_MAX",
    "SUFFIX",
    "SidecarFiles",
    "check_place",
    "decode_fine",
    "decode_paint",
    "encode_fine",
    "encode_paint",
    "is_own",
    "read_scene",
    "save_scene",
    "sidecar_files",
]

# Files of a scene's own, beside its scene file: the meshes and swatches that no other file holds.
#
# They are called NAME.WHAT.HASH.ply and .swatch, with a piece of their content's SHA-256: other content has another
# name. So none is ever written over, neither ours nor anybody's; a scene file names what it was saved with, or nothing.


SUFFIX: Final = SCENE_SUFFIX

NAMING: Final = (SUFFIX, ".fidelity.json")
"""Ends of the names of files that name others beside them: what one of them names, no other one removes."""

PIECE_MIN: Final = 8
"""Shortest piece of the hash in a name [hexadecimal digits]."""

WHAT_MAX: Final = 40
"""Longest name of a body or swatch in the name of its file [characters]."""

_OWN: Final = re.compile(r".+\.(?=[0-9]*[a-f])([0-9a-f]{8,64})\.(?:ply|swatch)")  # digits alone may be a date


def is_own(file: Path) -> bool:
    """Whether a file is a scene's own, by its name."""
    return _OWN.fullmatch(file.name) is not None


class SidecarFiles:
    """What a scene file names. Made by `sidecar_files`.

    Args:
        path: the scene file, or another one that names files beside it.
        suffix: that its name ends in.
    """

    def __init__(self, path: Path, suffix: str = SUFFIX) -> None:
        self._path, self._folder = path, path.parent.resolve()
        self._stem = path.name.removesuffix(suffix)
        self._named: set[str] = set()
        self._made: list[Path] = []

    def name(self, file: Path | None) -> str | None:
        """How the scene file names a file; None for what it must have beside it: in memory alone, or own elsewhere."""
        if file is None or (is_own(file) and (file.resolve().parent != self._folder or not file.is_file())):
            return None
        return self._relative(file.resolve())

    def put(self, what: str, suffix: str, content: bytes) -> str:
        """How the scene file names a file of its own with that content, which is written unless it is there.

        Raises:
            SceneError: it cannot be written.
        """
        plain = re.sub(r"[^\w.-]+", "_", what)[:WHAT_MAX]
        digest = hashlib.sha256(content).hexdigest()
        pieces = (digest[:size] for size in range(PIECE_MIN, len(digest) + 1))
        files = (self._folder / f"{self._stem}.{plain}.{piece}{suffix}" for piece in pieces)
        file = next(f for f in files if is_own(f) and (not os.path.lexists(f) or _holds(f, content)))
        if not file.exists():
            write_whole(file, content, SceneError)
            self._made.append(file)
        return self._relative(file)

    def undo(self) -> None:
        """Remove what was written."""
        for file in self._made:
            file.unlink(missing_ok=True)

    def clear(self, before: bytes) -> None:
        """Remove what the scene file named `before` and does no more, unless another one of its folder does."""
        for file in self._folder.glob("*"):
            name = file.name.encode(errors="surrogateescape")
            if file.name in self._named or name not in before or not file.name.startswith(f"{self._stem}."):
                continue
            with suppress(OSError):
                found = (f for suffix in NAMING for f in self._folder.glob(f"*{suffix}"))
                others = (_content_of(f) for f in found if f.name != self._path.name)
                if _is_whole(file) and not any(name in other for other in others):
                    file.unlink()

    def _relative(self, file: Path) -> str:
        self._named.add(file.name)
        try:
            return Path(os.path.relpath(file, self._folder)).as_posix()
        except ValueError:  # another drive, on Windows
            return file.as_posix()


@contextmanager
def sidecar_files(path: Path, suffix: str = SUFFIX) -> Iterator[SidecarFiles]:
    """While a scene file is written, the last of all: what goes wrong leaves the old one and its files as they were."""
    before = _content_of(path)
    files = SidecarFiles(path, suffix)
    try:
        yield files
    except BaseException:
        files.undo()
        raise
    files.clear(before)


def _holds(file: Path, content: bytes) -> bool:
    with suppress(OSError):
        return file.stat().st_size == len(content) and _content_of(file) == content
    return False


def _content_of(file: Path) -> bytes:
    """What a file holds; nothing where it cannot be read, or is none: a pipe would be waited for."""
    with suppress(OSError):
        return file.read_bytes() if file.is_file() else b""
    return b""


def _is_whole(file: Path) -> bool:
    """Whether a file is a scene's own, and as it was written."""
    match = _OWN.fullmatch(file.name)
    return match is not None and hashlib.sha256(_content_of(file)).hexdigest().startswith(match[1])


# How a body's painting stands in a scene file: runs to read and compare; packed, where they are too many.


RUN_MAX: Final = 2000
"""Most runs that are written as such [count]. Painted by brush, a mesh of 330 k faces may have 260 k runs: 3 MB of
text that nobody reads, and seconds to write; packed it has 0.2 MB."""

_NUMBER: Final = np.dtype("<i2")


def encode_paint(face_swatch: NDArray[np.int16]) -> list[list[int]] | str:
    """A painting (M,): runs [swatch, faces]; or, where they are more than `RUN_MAX`, a text.

    The text is base64 of the zlib stream of a 16-bit number, low byte first, for each face.
    """
    start = np.flatnonzero(np.concatenate([[True], face_swatch[1:] != face_swatch[:-1]]))
    if len(start) > RUN_MAX:
        return base64.b64encode(zlib.compress(face_swatch.astype(_NUMBER).tobytes())).decode("ascii")
    length = np.diff(np.concatenate([start, [len(face_swatch)]]))
    return [[int(swatch), int(n)] for swatch, n in zip(face_swatch[start], length, strict=True)]


def decode_paint(paint: Any, face_count: int, swatch_count: int) -> NDArray[np.int16]:
    """The painting (face_count,) of a file, from anybody.

    Raises:
        ValueError: it is no painting of so many faces with so many swatches; the text goes on after "'paint'".
    """
    if isinstance(paint, str):
        return _unpack(paint, face_count, swatch_count)
    if not isinstance(paint, list):
        raise ValueError(f"must be a list of runs or a packed text, is {str(paint)[:60]!r}")
    for run in paint:
        if not (type(run) is list and len(run) == 2 and type(run[0]) is int and type(run[1]) is int and run[1] > 0):
            raise ValueError(f"must be a list of [swatch, number of faces], has {str(run)[:60]!r}")
        if not 0 <= run[0] < swatch_count:
            raise ValueError(f"names swatch {run[0]}; there are {swatch_count}, counted from 0")
    total = sum(run[1] for run in paint)  # before anything of that size is made
    if total != face_count:
        raise ValueError(f"covers {total:,} faces; the mesh has {face_count:,}")
    return np.repeat([run[0] for run in paint], [run[1] for run in paint]).astype(np.int16)


def _unpack(text: str, face_count: int, swatch_count: int) -> NDArray[np.int16]:
    content = _inflate(text, face_count * _NUMBER.itemsize, f"; the mesh has {face_count:,}")
    painting = np.frombuffer(content, _NUMBER).astype(np.int16)
    if painting.min() < 0 or painting.max() >= swatch_count:
        bad = int(painting[(painting < 0) | (painting >= swatch_count)][0])
        raise ValueError(f"names swatch {bad}; there are {swatch_count}, counted from 0")
    return painting


def _inflate(text: str, size: int, told: str = "") -> bytes:
    """The `size` bytes of a packed text."""
    unpacker = zlib.decompressobj()
    try:
        content = unpacker.decompress(base64.b64decode(text, validate=True), size + 1)  # no more than there should be
    except (binascii.Error, ValueError, zlib.error) as error:
        raise ValueError(f"is packed, and damaged: {error}") from None
    if len(content) != size or not unpacker.eof:
        raise ValueError(f"is packed for another number of faces, or cut off{told}")
    return content


_FINE: Final = {"face": "<i4", "level": "<u1", "edge": "<u8", "paint": "<i8"}
"""What is packed of `FinePaint`, in this order. `face` is each face once; `path` follows from the levels, since the
leaves of a face cover it."""


def encode_fine(fine: FinePaint) -> dict[str, Any]:
    """What is painted finer than faces: numbers of faces and leaves, and a text.

    The text is base64 of the zlib stream of the faces that have leaves, the leaves' levels, the sides that their cuts
    halved, and their paints, as `FinePaint` has them, low byte first.
    """
    columns: dict[str, NDArray[Any]] = {"face": fine.faces, "level": fine.level, "edge": fine.edge, "paint": fine.paint}
    content = b"".join(columns[name].astype(kind).tobytes() for name, kind in _FINE.items())
    packed = base64.b64encode(zlib.compress(content)).decode("ascii")
    return {"faces": len(fine.faces), "leaves": len(fine), "packed": packed}


def decode_fine(told: Any, face_count: int, swatches: list[int], leaf_max: int) -> FinePaint:
    """What is painted finer than faces, from anybody; at most `leaf_max` leaves of `swatches` in a scene.

    Raises:
        ValueError: it is no such paint of so many faces; the text goes on after "'fine'".
    """
    if type(told) is not dict or [type(told.get(key)) for key in ("faces", "leaves", "packed")] != [int, int, str]:
        raise ValueError(f"must have whole numbers 'faces' and 'leaves' and a text 'packed', is {str(told)[:60]!r}")
    m, k = told["faces"], told["leaves"]
    if not 0 < m <= min(k, face_count) or k > leaf_max:
        raise ValueError(f"has {k:,} leaves of {m:,} faces; the mesh has {face_count:,}, and {leaf_max:,} are read")
    sizes = [np.dtype(kind).itemsize * (m if name == "face" else k) for name, kind in _FINE.items()]
    content = _inflate(told["packed"], sum(sizes))
    starts = np.cumsum([0, *sizes])
    face, level, edge, paint = (
        np.frombuffer(content[a:b], kind).astype(kind[1:])
        for a, b, kind in zip(starts, starts[1:], _FINE.values(), strict=False)
    )
    if face[0] < 0 or face[-1] >= face_count or (np.diff(face.astype(np.int64)) <= 0).any():
        raise ValueError(f"names faces that are not in order, or none of the mesh's {face_count:,}")
    if level.max() > LEVEL_MAX:
        raise ValueError(f"has a face cut {level.max()} times; at most {LEVEL_MAX} are read")
    size = np.uint64(1) << (LEVEL_MAX - level).astype(np.uint64)  # of each leaf, in the paths below it
    start = np.cumsum(size) - size
    if int(start[-1] + size[-1]) != m << LEVEL_MAX or (start & (size - np.uint64(1))).any():
        raise ValueError("has leaves that overlap, or leave gaps")
    fine = FinePaint(face[(start >> np.uint64(LEVEL_MAX)).astype(np.intp)], start.astype(np.uint32), edge, level, paint)
    if not fine.is_sound():
        raise ValueError("has leaves that cut one piece in two ways")
    a, b, weight = parts(paint)
    if paint.min() < 0 or max(a.max(), b.max()) >= len(swatches) or (blend(a, b, weight) != paint).any():
        raise ValueError(f"swatch index out of range: there are {len(swatches)} swatches, counted from 0")
    index = np.array(swatches)
    return replace(fine, paint=blend(index[a], index[b], weight))


FORMAT: Final = "hapscene scene"
VERSION: Final = 3
"""Version of the format. Raised when a reader of the old one would misread the new one: 2 has packed paintings, 3
what is painted finer than faces, meshes that are turned or scaled, and bodies that hang on others. A file is written
as the first that has what is in it."""

BYTES_MAX: Final = 256 * 1024 * 1024
"""Largest scene file that is opened [bytes]: room for some 20 million runs of painting."""

BODY_MAX: Final = 10_000
"""Most bodies of a scene file [count]."""


def save_scene(scene: "Scene", path: str | os.PathLike[str]) -> None:
    """Save a scene as one readable file, NAME.scene.json, next to its meshes; `load_scene` reads it.

    Through a link, what it points to is written, and named from there.

    Raises:
        SceneError: the suffix is another, or the file cannot be written.
    """
    path = Path(path)
    check_place(path)
    path = path.resolve() if path.is_symlink() else path
    if len(scene.bodies) > BODY_MAX:
        raise SceneError(f"{path}: {len(scene.bodies):,} bodies; a scene file holds at most {BODY_MAX:,}")
    if (leaves := sum(len(body.fine or ()) for body in scene.bodies)) > LEAF_MAX:
        raise SceneError(
            f"{path}: {leaves:,} pieces of fine paint; a scene file holds at most {LEAF_MAX:,}: paint with a larger "
            "finest_m"
        )
    with sidecar_files(path) as files:
        write_whole(path, _layout(_content(scene, files)).encode(errors="backslashreplace"), SceneError)


def check_place(path: Path) -> None:
    """Refuse a path that no scene can be saved to.

    Raises:
        SceneError: it has another suffix, or is in no folder.
    """
    if not path.name.endswith(SUFFIX) or path.name == SUFFIX:
        example = path.stem.split(".")[0] + SUFFIX
        raise SceneError(f"{path}: a scene's file name ends in {SUFFIX}, as in {example}")
    check_file(path.resolve() if path.is_symlink() else path, SceneError)


def _content(scene: "Scene", files: SidecarFiles) -> dict[str, Any]:
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
            "paint": encode_paint(body.face_swatch),
        }
        if body.made_of is not None:
            told["made_of"] = body.made_of
        if body.fine is not None:
            told["fine"] = encode_fine(body.fine)
        if body.parent is not None:
            told["parent"] = body.parent
        bodies.append(told)
    is_third = any("fine" in body or "parent" in body for body in bodies) or any("up" in mesh for mesh in meshes)
    packed = any(isinstance(body["paint"], str) for body in bodies)
    return {
        "format": FORMAT,
        "version": 3 if is_third else 2 if packed else 1,
        "swatches": [_write_swatch(scene, i, files) for i in range(len(scene.swatches))],
        "meshes": meshes,
        "bodies": bodies,
    }


def read_scene(scene: "Scene", path: Path, accept_changed: bool) -> None:
    """Fill an empty scene with what a file says: what `hapscene.load_scene` does."""
    content = _Place(path, "", _parse(path))
    if content.get("format", str) != FORMAT:
        raise SceneError(f"{path}: not a scene: format is {content.get('format', str)!r}, expected {FORMAT!r}")
    version = content.get("version", int)
    if not 1 <= version <= VERSION:
        raise SceneError(f"{path}: format version {version}; this hapscene reads up to {VERSION}: update hapscene")
    with naming(path):
        swatches = [_load_swatch(scene, place, path) for place in content.items("swatches", str)]
        meshes = [_load_mesh(place, path, accept_changed) for place in content.items("meshes", dict)]
        places = content.items("bodies", dict)
        for place in places:
            _load_body(scene, place, meshes, swatches)
        for place, body in zip(places, scene.bodies, strict=True):
            if "parent" in place.value:
                try:
                    scene.hang(body.name, place.get("parent", str))
                except SceneError as error:
                    raise place.fail(f"'parent': {error}") from None


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


_KIND: Final = {str: "a text", int: "a whole number", bool: "true or false", list: "a list", dict: "an object"}


def _parse(path: Path) -> Any:
    with refusing(SceneError):
        data = read_bytes(path, BYTES_MAX, "scene")
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


def _load_swatch(scene: "Scene", place: _Place, path: Path) -> int:
    name = place.value
    return scene.swatch_index(_named(path, name) if name.endswith(".swatch") else name)


def _load_mesh(place: _Place, path: Path, accept_changed: bool) -> Mesh:
    file, unit = _named(path, place.get("path", str)), place.get("unit", str)
    if unit not in UNIT_M:
        raise place.fail(f"no unit of length {unit[:60]!r}; there are: {', '.join(UNIT_M)}")
    up, scale = place.value.get("up", "z"), place.value.get("scale", 1.0)  # versions 1 and 2 turned nothing
    with refusing(SceneError, f"{path}: {place.where}"):
        check_reading(up, scale)
    # damaged, if it was when the scene was saved, as its hash says
    mesh = load_mesh(file, unit, up=up, scale=scale, accept_damaged=True)
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
    warn(f"{path}: {file} has changed since the scene was saved; its paint stays", MeshWarning)
    return mesh


def _load_body(scene: "Scene", place: _Place, meshes: list[Mesh], swatches: list[int]) -> None:
    mesh = meshes[place.index("mesh", len(meshes))]
    pose = place.get("pose", list)
    if not all(type(row) is list and all(type(x) in (int, float) and abs(x) < math.inf for x in row) for row in pose):
        raise place.fail("'pose' must be four rows of four finite numbers")
    name, two_sided = place.get("name", str), place.get("two_sided", bool)
    if "paint" not in place.value:
        raise place.fail("'paint' is missing")
    try:
        painting = decode_paint(place.value["paint"], len(mesh.faces), len(swatches))
    except ValueError as error:
        raise place.fail(f"'paint' {error}") from None
    body = scene.add(mesh, name=name, pose=pose, two_sided=two_sided)
    body.face_swatch[:] = np.array(swatches, np.int16)[painting]
    if "made_of" in place.value:
        body.made_of = swatches[place.index("made_of", len(swatches))]
    if "fine" in place.value:
        leaves = sum(len(other.fine or ()) for other in scene.bodies)
        try:
            put_leaves(body, decode_fine(place.value["fine"], len(mesh.faces), swatches, LEAF_MAX - leaves))
        except ValueError as error:
            raise place.fail(f"'fine' {error}") from None


def _write_mesh(body: Body, files: SidecarFiles) -> dict[str, Any]:
    mesh = body.mesh
    told: dict[str, Any] = {"path": files.name(mesh.path), "unit": mesh.unit}
    if told["path"] is None:
        told = {"path": files.put(body.name, ".ply", mesh_to_ply(mesh)), "unit": "m"}
    elif mesh.up != "z" or mesh.scale != 1.0:
        told |= {"up": mesh.up, "scale": mesh.scale}
    return {**told, "sha256": mesh.digest, "face_count": len(mesh.faces)}


def _write_swatch(scene: "Scene", index: int, files: SidecarFiles) -> str:
    source, swatch = scene.swatch_source[index], scene.swatches[index]
    if isinstance(source, str):
        return source
    name = files.name(source) if source is None or source.is_file() else None  # a library's may be gone
    if name is None:
        from hapscene.surface.swatch_file import swatch_to_bytes

        name = files.put(swatch.name, ".swatch", swatch_to_bytes(swatch))
    return name


def _layout(content: dict[str, Any]) -> str:
    """JSON with a line for each key, row of a pose and run of a painting: to read, and to compare."""
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    # Innermost lists go on one line. Only the layout has line breaks: in a text they are escaped.
    return re.sub(r"\[\n([^\[\]{}\"]+)\n\s*\]", lambda m: "[" + " ".join(m[1].split()) + "]", text) + "\n"
