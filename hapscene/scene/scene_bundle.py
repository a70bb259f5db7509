"""A scene in one file, NAME.scene.zip: the scene file, its meshes with what they need, and its own swatches.

It is opened from anybody: what it unpacks to is bounded, every member stays in the folder that it is unpacked into, and
the scene in it names nothing outside.
"""

import json
import re
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final

from hapscene.constants import BUNDLE_SUFFIX
from hapscene.errors import FormatError, SceneError
from hapscene.io.files import check_memory, open_zip, refusing, whole_file
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import files_of
from hapscene.scene.scene_file import BYTES_MAX, SUFFIX, save_scene

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["ZIP_SUFFIX", "read_bundle", "save_bundle", "unpack_bundle", "unpacked_beside"]

ZIP_SUFFIX: Final = BUNDLE_SUFFIX

UNPACKED_MAX_B: Final = 2_000_000_000
"""Most that a bundle may unpack to [bytes]."""

MEMBER_MAX: Final = 5_000
"""Most files of a bundle [count]."""

LIST_B: Final = 64
"""Most memory that a number, or an empty list, of JSON takes [bytes]: twenty times its text."""

_NAME: Final = re.compile(r"[^/\\:\0-\x1f.][^/\\:\0-\x1f]{0,199}")  # of a folder or file; none that is hidden


def save_bundle(scene: "Scene", path: Path) -> None:
    """Write a scene with all that it needs as one file, whole or not at all.

    Raises:
        SceneError: the suffix is another, or a file cannot be read or written.
    """
    if not path.name.endswith(ZIP_SUFFIX) or path.name == ZIP_SUFFIX:
        raise SceneError(f"{path}: a scene in one file has a name that ends in {ZIP_SUFFIX}")
    from hapscene.swatches.library import shipped_swatches

    packed = scene.copy()
    with tempfile.TemporaryDirectory() as name:
        folder, moved = Path(name), dict[int, Mesh]()
        for body in packed.bodies:
            mesh = body.mesh
            if mesh.path is not None and id(mesh) not in moved:
                moved[id(mesh)] = replace(mesh, path=_copied(mesh.path, folder / "meshes" / str(len(moved) + 1)))
            body.mesh = moved.get(id(mesh), mesh)
        shipped = set(shipped_swatches())
        packed.swatch_source[:] = [s if isinstance(s, str) and s in shipped else None for s in packed.swatch_source]
        packed.swatch_source[0] = scene.swatch_source[0]
        save_scene(packed, folder / (path.name.removesuffix(ZIP_SUFFIX) + SUFFIX))
        try:
            with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
                for file in sorted(file for file in folder.rglob("*") if file.is_file()):
                    archive.write(file, file.relative_to(folder).as_posix())
        except OSError as error:
            raise SceneError(f"{path}: cannot be written: {error.strerror}") from None


def _copied(mesh: Path, folder: Path) -> Path:
    """A mesh file in a new folder, with the files that it needs; where it is there."""
    home = mesh.resolve().parent
    for file in (mesh.resolve(), *files_of(mesh)):
        target = folder / file.relative_to(home)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    return folder / mesh.resolve().name


def unpack_bundle(path: Path, folder: Path) -> Path:
    """Unpack a bundle, from anybody, into a folder that is not there yet; the scene file in it.

    Raises:
        SceneError: it is no bundle, damaged or too large, a member would lie elsewhere, or the folder is there.
    """
    with refusing(SceneError, path):
        try:
            with path.open("rb") as file, open_zip(file, UNPACKED_MAX_B, "send its meshes as files") as archive:
                members = _checked(archive)
                scene = _scene_of(archive, members)
                folder.mkdir(parents=True)
                try:
                    archive.extractall(folder, members.values())
                except BaseException:
                    shutil.rmtree(folder, ignore_errors=True)
                    raise
        except FormatError:
            raise
        except OSError as error:
            raise SceneError(f"cannot be unpacked: {error.strerror or error}") from None
        except Exception as error:  # damaged, encrypted or packed in an odd way: zipfile raises anything at all
            raise SceneError(f"not a readable zip archive: {error}") from None
    return folder / scene


def _checked(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Its files by their paths."""
    members: dict[str, zipfile.ZipInfo] = {}
    seen: set[str] = set()
    for member in archive.infolist():
        name = member.filename
        kind = stat.S_IFMT(member.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise SceneError(f"{name[:60]!r} in it is a link or a device; expected files alone")
        if not all(_NAME.fullmatch(step) for step in name.removesuffix("/").split("/")):
            raise SceneError(f"{name[:60]!r} in it would lie outside, or is hidden; expected files in plain folders")
        if member.is_dir():
            continue
        if name.lower() in seen:
            raise SceneError(f"{name[:60]!r} is in it twice")
        seen.add(name.lower())
        members[name] = member
    if len(members) > MEMBER_MAX:
        raise SceneError(f"{len(members):,} files; at most {MEMBER_MAX:,} are unpacked")
    return members


def _scene_of(archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo]) -> str:
    """The scene file, which names nothing that is not in the archive."""
    found = [name for name in members if name.endswith(SUFFIX) and "/" not in name]
    if len(found) != 1:
        raise SceneError(f"expected one scene file, NAME{SUFFIX}, at its top, found {len(found)}")
    if members[found[0]].file_size > BYTES_MAX:
        raise SceneError(f"{found[0]} in it is larger than {BYTES_MAX:,} bytes")
    try:
        data = archive.read(members[found[0]])
        needed_B = LIST_B * sum(data.count(sign) for sign in (b"[", b"{", b","))
        check_memory(needed_B, len(data), found[0], "send it as a scene file beside its meshes")
        content = json.loads(data)
        named: list[Any] = [mesh["path"] for mesh in content["meshes"]]
        named += [swatch for swatch in content["swatches"] if swatch.endswith(".swatch")]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise SceneError(f"{found[0]} in it is not a scene file, or damaged") from None
    for name in named:
        if not isinstance(name, str) or PurePosixPath(name).as_posix() not in members:
            raise SceneError(f"{found[0]} in it names the file {str(name)[:60]!r}, which is not in it")
    return found[0]


def read_bundle(path: Path, load: Callable[[Path], "Scene"]) -> "Scene":
    """The scene of a bundle, in memory: its meshes and swatches have no files.

    Args:
        path: the bundle, from anybody.
        load: loads a scene file.

    Raises:
        SceneError: as `unpack_bundle`.
    """
    with tempfile.TemporaryDirectory() as name:
        scene = load(unpack_bundle(path, Path(name) / "scene"))
        kept: dict[int, Mesh] = {}
        for body in scene.bodies:
            body.mesh = kept.setdefault(id(body.mesh), replace(body.mesh, path=None))
    scene.swatch_source[:] = [source if isinstance(source, str) else None for source in scene.swatch_source]
    return scene


def unpacked_beside(path: Path) -> Path:
    """Unpack a bundle into a folder of its name in the working folder, over no other; the scene file in it.

    Raises:
        SceneError: as `unpack_bundle`.
    """
    stem = path.name.removesuffix(ZIP_SUFFIX)
    names = (stem, *(f"{stem}_{i}" for i in range(2, 10_000)))
    return unpack_bundle(path, next(Path(name) for name in names if not Path(name).exists()))
