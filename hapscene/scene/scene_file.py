"""The scene file, NAME.scene.json: bodies, poses and paint. Meshes are identified by the hash of their content.

    {
      "format": "hapscene scene", "version": 1,
      "swatches": ["plain", "wood", "mine.swatch"],
      "meshes": [{"path": "meshes/plate.obj", "unit": "mm", "sha256": "…", "face_count": 2400}],
      "bodies": [{"name": "plate", "mesh": 0, "two_sided": false, "pose": [[…], …],
                  "paint": [[1, 2000], [2, 400]], "made_of": 1}]
    }

`paint` is a list of runs [swatch, number of faces] in the order of the faces. Paint with thousands of runs is a packed
string (`encode_paint`); the file then has version 2, which older readers reject. Optional keys of a body: `made_of`,
its swatch before painting; `parent`, the body that it is attached to (version 3); `fine`, the paint of subdivided faces
(`encode_fine`, version 3). Since version 3 a mesh may have `up` (default "z") and `scale` (default 1.0).

Paths are relative to the scene file, with "/". A swatch that ends in ".swatch" is a file, others are names in the
swatch library; swatch 0 is always "plain". Meshes and swatches without a file are written beside the scene file: meshes
as NAME.BODY.HASH.ply (float64, without loss), swatches as NAME.SWATCH.HASH.swatch (see `SidecarFiles`).
"""

import base64
import binascii
import hashlib
import json
import os
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from hapscene.constants import SCENE_SUFFIX as SUFFIX
from hapscene.errors import FormatError, SceneError, no_such, warn
from hapscene.io.files import Json, check_file, naming, read_bytes, refusing, to_struct, write_whole
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import LEVEL_MAX, SUBFACE_MAX, FinePaint, blend, parts, set_subfaces
from hapscene.scene.mesh import UNIT_M, Mesh, MeshWarning, check_reading
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.ply import mesh_to_ply

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = [
    "BODY_MAX",
    "BYTES_MAX",
    "SUFFIX",
    "check_scene_path",
    "decode_fine",
    "encode_fine",
    "is_own",
    "read_scene",
    "save_scene",
]

# Sidecar files: meshes and swatches of a scene that have no other file.
#
# They are named NAME.WHAT.HASH.ply and .swatch, with the first digits of the SHA-256 of their content. Different
# content
# has a different name, so no file is overwritten, and a scene file always refers to what was saved with it.


PIECE_MIN: Final = 8
"""Minimum length of the hash in a file name [hexadecimal digits]."""

WHAT_MAX: Final = 40
"""Maximum length of the name of a body or swatch in a file name [characters]."""

_OWN: Final = re.compile(r".+\.(?=[0-9]*[a-f])([0-9a-f]{8,64})\.(?:ply|swatch)")  # digits alone could be a date


def is_own(file: Path) -> bool:
    """Return whether a file name is that of a sidecar file."""
    return _OWN.fullmatch(file.name) is not None


class SidecarFiles:
    """Sidecar files of one scene file. Created by `sidecar_files`.

    Args:
        path: the scene file.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._folder = path, path.parent.resolve()
        self._stem = path.name.removesuffix(SUFFIX)
        self._named: set[str] = set()
        self._made: list[Path] = []

    def name(self, file: Path | None) -> str | None:
        """Return the reference to a file; None if a sidecar file is needed: no file, or a sidecar file elsewhere."""
        if file is None or (is_own(file) and (file.resolve().parent != self._folder or not file.is_file())):
            return None
        return self._relative(file.resolve())

    def put(self, what: str, suffix: str, content: bytes) -> str:
        """Write a sidecar file unless it exists; return the reference to it.

        Raises:
            SceneError: the file cannot be written.
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
        """Remove the files that were written."""
        for file in self._made:
            file.unlink(missing_ok=True)

    def clear(self, before: bytes) -> None:
        """Remove sidecar files that only the previous content of the scene file, `before`, refers to."""
        for file in self._folder.glob("*"):
            name = file.name.encode(errors="surrogateescape")
            if file.name in self._named or name not in before or not file.name.startswith(f"{self._stem}."):
                continue
            with suppress(OSError):
                others = (_content_of(f) for f in self._folder.glob(f"*{SUFFIX}") if f.name != self._path.name)
                if _is_whole(file) and not any(name in other for other in others):
                    file.unlink()

    def _relative(self, file: Path) -> str:
        self._named.add(file.name)
        try:
            return Path(os.path.relpath(file, self._folder)).as_posix()
        except ValueError:  # on another drive, on Windows
            return file.as_posix()


@contextmanager
def sidecar_files(path: Path) -> Iterator[SidecarFiles]:
    """Context for writing a scene file, which must be written last: on failure the old file and its sidecars remain."""
    before = _content_of(path)
    files = SidecarFiles(path)
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
    """Return the content of a regular file, else b"". Reading a pipe would block."""
    with suppress(OSError):
        return file.read_bytes() if file.is_file() else b""
    return b""


def _is_whole(file: Path) -> bool:
    """Return whether a file is a sidecar file whose content matches its name."""
    match = _OWN.fullmatch(file.name)
    return match is not None and hashlib.sha256(_content_of(file)).hexdigest().startswith(match[1])


# Encoding of the paint of a body.


RUN_MAX: Final = 2000
"""Maximum number of runs in a list [count]. Brush strokes on a mesh of 330,000 faces can have 260,000 runs: 3 MB of
text that takes seconds to write; packed it has 0.2 MB."""

_NUMBER: Final = np.dtype("<i2")


def encode_paint(face_swatch: NDArray[np.int16]) -> list[list[int]] | str:
    """Encode paint (M,) as runs [swatch, number of faces]; with more than `RUN_MAX` runs, as a string.

    The string is the base64 encoding of a zlib stream of one little-endian 16-bit integer for each face.
    """
    start = np.flatnonzero(np.concatenate([[True], face_swatch[1:] != face_swatch[:-1]]))
    if len(start) > RUN_MAX:
        return base64.b64encode(zlib.compress(face_swatch.astype(_NUMBER).tobytes())).decode("ascii")
    length = np.diff(np.concatenate([start, [len(face_swatch)]]))
    return [[int(swatch), int(n)] for swatch, n in zip(face_swatch[start], length, strict=True)]


def decode_paint(paint: Sequence[tuple[int, int]] | str, face_count: int, swatch_count: int) -> NDArray[np.int16]:
    """Decode the paint (face_count,) of an untrusted file.

    Raises:
        ValueError: invalid for this number of faces or swatches; the message continues after "'paint' ".
    """
    if isinstance(paint, str):
        return _unpack(paint, face_count, swatch_count)
    for swatch, count in paint:
        if count < 1:
            raise ValueError(f"has a run of {count} faces; expected at least 1")
        if not 0 <= swatch < swatch_count:
            raise ValueError(f"swatch index {swatch} out of range; expected 0 to {swatch_count - 1}")
    total = sum(count for _, count in paint)  # before memory of that size is allocated
    if total != face_count:
        raise ValueError(f"covers {total:,} faces, but the mesh has {face_count:,}")
    return np.repeat([swatch for swatch, _ in paint], [count for _, count in paint]).astype(np.int16)


def _unpack(text: str, face_count: int, swatch_count: int) -> NDArray[np.int16]:
    content = _inflate(text, face_count * _NUMBER.itemsize)
    painting = np.frombuffer(content, _NUMBER).astype(np.int16)
    if painting.min() < 0 or painting.max() >= swatch_count:
        bad = int(painting[(painting < 0) | (painting >= swatch_count)][0])
        raise ValueError(f"swatch index {bad} out of range; expected 0 to {swatch_count - 1}")
    return painting


def _inflate(text: str, size: int) -> bytes:
    """Decompress a packed string, which must contain exactly `size` bytes."""
    unpacker = zlib.decompressobj()
    try:
        content = unpacker.decompress(base64.b64decode(text, validate=True), size + 1)  # limits the output
    except (binascii.Error, ValueError, zlib.error) as error:
        raise ValueError(f"is a damaged packed string: {error}") from None
    if len(content) != size or not unpacker.eof:
        raise ValueError("is a packed string for another number of faces, or truncated")
    return content


_FINE: Final = {"face": "<i4", "level": "<u1", "edge": "<u8", "paint": "<i8"}
"""Packed arrays of `FinePaint` in their order. `face` lists each face once. `path` follows from the levels, since the
subfaces of a face cover it."""


def encode_fine(fine: FinePaint) -> dict[str, Json]:
    """Encode the paint of subdivided faces: the numbers of faces and subfaces, and a packed string.

    The string is the base64 encoding of a zlib stream of the faces and of level, edge and paint of the subfaces, as in
    `FinePaint`, little-endian.
    """
    columns = (fine.faces, fine.level, fine.edge, fine.paint)
    content = b"".join(np.asarray(column, kind).tobytes() for column, kind in zip(columns, _FINE.values(), strict=True))
    packed = base64.b64encode(zlib.compress(content)).decode("ascii")
    return {"faces": len(fine.faces), "leaves": len(fine), "packed": packed}


def decode_fine(content: object, face_count: int, swatches: list[int], subface_max: int) -> FinePaint:
    """Decode the paint of subdivided faces from an untrusted file.

    Args:
        content: the JSON object from `encode_fine`.
        face_count: number of faces of the mesh.
        swatches: index in the scene for each swatch index in the file.
        subface_max: maximum number of subfaces.

    Raises:
        ValueError: invalid for this mesh; the message continues after "'fine' ".
    """
    keys = ("faces", "leaves", "packed")
    if type(content) is not dict or [type(content.get(key)) for key in keys] != [int, int, str]:
        raise ValueError(f"must have integers 'faces' and 'leaves' and a string 'packed', is {str(content)[:60]!r}")
    m, k = content["faces"], content["leaves"]
    if not 0 < m <= k <= subface_max:
        raise ValueError(
            f"has {k:,} subfaces in {m:,} faces; the mesh has {face_count:,} faces, and {subface_max:,} subfaces are "
            "allowed"
        )
    sizes = [np.dtype(kind).itemsize * (m if name == "face" else k) for name, kind in _FINE.items()]
    unpacked = _inflate(content["packed"], sum(sizes))
    starts = np.cumsum([0, *sizes])
    face, level, edge, paint = (
        np.frombuffer(unpacked[a:b], kind).astype(kind[1:])
        for a, b, kind in zip(starts, starts[1:], _FINE.values(), strict=False)
    )
    if face[0] < 0 or face[-1] >= face_count or (np.diff(face.astype(np.int64)) <= 0).any():
        raise ValueError(f"has face indices that are not ascending or out of range; expected 0 to {face_count - 1}")
    if level.max() > LEVEL_MAX:
        raise ValueError(f"has subdivision level {level.max()}; at most {LEVEL_MAX} is allowed")
    size = np.uint64(1) << (LEVEL_MAX - level).astype(np.uint64)  # number of paths in each subface
    start = np.cumsum(size) - size
    if int(start[-1] + size[-1]) != m << LEVEL_MAX or (start & (size - np.uint64(1))).any():
        raise ValueError("has subfaces that overlap or leave gaps")
    fine = FinePaint(face[(start >> np.uint64(LEVEL_MAX)).astype(np.intp)], start.astype(np.uint32), edge, level, paint)
    if not fine.is_consistent():
        raise ValueError("has subfaces that disagree on a cut")
    a, b, weight = parts(paint)
    if paint.min() < 0 or max(a.max(), b.max()) >= len(swatches) or (blend(a, b, weight) != paint).any():
        raise ValueError(f"has a swatch index out of range; expected 0 to {len(swatches) - 1}")
    index = np.array(swatches)
    return replace(fine, paint=blend(index[a], index[b], weight))


FORMAT: Final = "hapscene scene"
VERSION: Final = 3
"""Version of the format: 2 added packed paint; 3 added paint of subdivided faces, rotated or scaled meshes, and
attached bodies. A file has the lowest version that supports its content."""

BYTES_MAX: Final = 256 * 1024 * 1024
"""Maximum size of a scene file [bytes]: about 20 million runs of paint."""

BODY_MAX: Final = 10_000
"""Maximum number of bodies in a scene file [count]."""


def save_scene(scene: "Scene", path: str | os.PathLike[str]) -> None:
    """Save a scene as NAME.scene.json beside its mesh files; `load_scene` reads it.

    A symbolic link is followed: its target is written, and references are relative to the target.

    Raises:
        SceneError: the suffix is not .scene.json, or the file cannot be written.
    """
    path = Path(path)
    check_scene_path(path)
    path = path.resolve() if path.is_symlink() else path
    if len(scene.bodies) > BODY_MAX:
        raise SceneError(f"{path}: {len(scene.bodies):,} bodies, at most {BODY_MAX:,} are allowed in a scene file")
    if (subfaces := sum(len(body.fine or ()) for body in scene.bodies)) > SUBFACE_MAX:
        raise SceneError(
            f"{path}: {subfaces:,} subfaces, at most {SUBFACE_MAX:,} are allowed in a scene file: paint with a larger "
            "resolution_m"
        )
    with sidecar_files(path) as files:
        write_whole(path, _layout(_content(scene, files)).encode(errors="backslashreplace"), SceneError)


def check_scene_path(path: Path) -> None:
    """Check that a scene can be saved to a path.

    Raises:
        SceneError: the suffix is not .scene.json, or the folder does not exist.
    """
    if not path.name.endswith(SUFFIX) or path.name == SUFFIX:
        example = path.stem.split(".")[0] + SUFFIX
        raise SceneError(f"{path}: the name of a scene file must end in {SUFFIX}, such as {example}")
    check_file(path.resolve() if path.is_symlink() else path, SceneError)


def _content(scene: "Scene", files: SidecarFiles) -> dict[str, Json]:
    """Return the content of the scene file; write the sidecar files."""
    index: dict[int, int] = {}
    meshes: list[dict[str, Json]] = []
    bodies: list[dict[str, Json]] = []
    for body in scene.bodies:
        if id(body.mesh) not in index:
            index[id(body.mesh)] = len(meshes)
            meshes.append(_write_mesh(body, files))
        entry = {
            "name": body.name,
            "mesh": index[id(body.mesh)],
            "two_sided": body.two_sided,
            "pose": body.X_WB.tolist(),
            "paint": encode_paint(body.face_swatch),
        }
        if body.made_of is not None:
            entry["made_of"] = body.made_of
        if body.fine is not None:
            entry["fine"] = encode_fine(body.fine)
        if body.parent is not None:
            entry["parent"] = body.parent
        bodies.append(entry)
    is_third = any("fine" in body or "parent" in body for body in bodies) or any("up" in mesh for mesh in meshes)
    packed = any(isinstance(body["paint"], str) for body in bodies)
    return {
        "format": FORMAT,
        "version": 3 if is_third else 2 if packed else 1,
        "swatches": [_write_swatch(scene, i, files) for i in range(len(scene.swatches))],
        "meshes": meshes,
        "bodies": bodies,
    }


class _MeshEntry(msgspec.Struct):
    path: str
    unit: str
    sha256: str
    face_count: int
    up: str = "z"
    scale: float = 1.0


class _BodyEntry(msgspec.Struct):
    name: str
    mesh: int
    two_sided: bool
    pose: list[list[float]]
    paint: list[tuple[int, int]] | str
    made_of: int | None = None
    fine: Any = None
    parent: str | None = None


class _SceneContent(msgspec.Struct):
    swatches: Annotated[list[str], Meta(max_length=BODY_MAX)]
    meshes: Annotated[list[_MeshEntry], Meta(max_length=BODY_MAX)]
    bodies: Annotated[list[_BodyEntry], Meta(max_length=BODY_MAX)]


def read_scene(scene: "Scene", path: Path, accept_changed: bool) -> None:
    """Fill an empty scene from a file; the implementation of `hapscene.load_scene`."""
    content = _parse(path)
    with naming(path):
        swatches = [
            scene.swatch_index(_resolve(path, name) if name.endswith(".swatch") else name) for name in content.swatches
        ]
        meshes = [_load_mesh(f"meshes[{i}]", entry, path, accept_changed) for i, entry in enumerate(content.meshes)]
        for i, entry in enumerate(content.bodies):
            _load_body(f"bodies[{i}]", scene, entry, meshes, swatches)
        for i, entry in enumerate(content.bodies):
            if entry.parent is not None:
                with refusing(SceneError, f"bodies[{i}]: 'parent'"):
                    scene.attach(scene.bodies[i].name, entry.parent)


def _parse(path: Path) -> _SceneContent:
    with refusing(SceneError):
        data = read_bytes(path, BYTES_MAX, "scene file")
    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{path}: not a valid scene file, or truncated: {error}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise SceneError(f'{path}: not a scene file: expected a JSON object with "format": "{FORMAT}"')
    version = content.get("version")
    if type(version) is not int or not 1 <= version <= VERSION:
        raise SceneError(
            f"{path}: format version {str(version)[:20]} is not supported; expected 1 to {VERSION}: update hapscene"
        )
    try:
        return to_struct(content, _SceneContent)
    except FormatError as error:
        raise SceneError(f"{path}: invalid scene file: {error}") from None


def _resolve(path: Path, name: str) -> Path:
    """Resolve a reference: relative to the scene file or, if it is opened through a link, also to the link."""
    own, link = path.resolve().parent / name, path.parent / name
    exists = os.path.exists  # unlike Path.exists, it accepts any name
    return own if path.is_symlink() and (exists(own) or not exists(link)) else link


def _load_mesh(where: str, entry: _MeshEntry, path: Path, accept_changed: bool) -> Mesh:
    file = _resolve(path, entry.path)
    if entry.unit not in UNIT_M:
        raise SceneError(f"{where}: {no_such('unit of length', entry.unit[:60], UNIT_M)}")
    with refusing(SceneError, where):
        check_reading(entry.up, entry.scale)
    mesh = load_mesh(file, entry.unit, up=entry.up, scale=entry.scale)
    if mesh.digest == entry.sha256:
        return mesh
    was, now = entry.face_count, len(mesh.faces)
    if was != now:
        raise SceneError(
            f"{where}: {file} has changed since the scene was saved: it had {was:,} faces and now has {now:,}, so the "
            "paint does not fit; restore the old mesh, or add the new mesh to a new scene and paint it"
        )
    if not accept_changed:
        raise SceneError(
            f"{where}: {file} has changed since the scene was saved: it has the same number of faces ({now:,}) but "
            "different vertices; restore the old mesh, or keep the paint with accept_changed=True (`hapscene paint "
            "--accept-changed`) and save again"
        )
    warn(f"{path}: {file} has changed since the scene was saved; the paint is kept", MeshWarning)
    return mesh


def _load_body(where: str, scene: "Scene", entry: _BodyEntry, meshes: list[Mesh], swatches: list[int]) -> None:
    mesh = meshes[_index(where, "mesh", entry.mesh, len(meshes))]
    try:
        painting = decode_paint(entry.paint, len(mesh.faces), len(swatches))
    except ValueError as error:
        raise SceneError(f"{where}: 'paint' {error}") from None
    body = scene.add(mesh, name=entry.name, pose=entry.pose, two_sided=entry.two_sided)
    body.face_swatch[:] = np.array(swatches, np.int16)[painting]
    if entry.made_of is not None:
        body.made_of = swatches[_index(where, "made_of", entry.made_of, len(swatches))]
    if entry.fine is not None:
        subfaces = sum(len(other.fine or ()) for other in scene.bodies)
        try:
            set_subfaces(body, decode_fine(entry.fine, len(mesh.faces), swatches, SUBFACE_MAX - subfaces))
        except ValueError as error:
            raise SceneError(f"{where}: 'fine' {error}") from None


def _index(where: str, key: str, index: int, count: int) -> int:
    if not 0 <= index < count:
        raise SceneError(f"{where}: {key!r} must be an index from 0 to {count - 1}, not {index}")
    return index


def _write_mesh(body: Body, files: SidecarFiles) -> dict[str, Json]:
    mesh = body.mesh
    entry: dict[str, Json] = {"path": files.name(mesh.path), "unit": mesh.unit}
    if entry["path"] is None:
        entry = {"path": files.put(body.name, ".ply", mesh_to_ply(mesh)), "unit": "m"}
    elif mesh.up != "z" or mesh.scale != 1.0:
        entry |= {"up": mesh.up, "scale": mesh.scale}
    return {**entry, "sha256": mesh.digest, "face_count": len(mesh.faces)}


def _write_swatch(scene: "Scene", index: int, files: SidecarFiles) -> str:
    source, swatch = scene.swatch_source[index], scene.swatches[index]
    if isinstance(source, str):
        return source
    # the file may be gone if the swatch was removed from the library
    name = files.name(source) if source is None or source.is_file() else None
    if name is None:
        from hapscene.surface.swatch_file import swatch_to_bytes

        name = files.put(swatch.name, ".swatch", swatch_to_bytes(swatch))
    return name


def _layout(content: dict[str, Json]) -> str:
    """Format JSON with one line for each key, row of a pose and run of paint, to be readable in diffs."""
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    # Join the lines of innermost lists. All line breaks are layout, since those in strings are escaped.
    return re.sub(r"\[\n([^\[\]{}\"]+)\n\s*\]", lambda m: "[" + " ".join(m[1].split()) + "]", text) + "\n"
