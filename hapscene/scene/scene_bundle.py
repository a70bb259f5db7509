"""Scene bundles, NAME.scene.zip: a scene file with its meshes, their materials, and its swatches in one archive.

Bundles are untrusted: their unpacked size is limited, all members must stay in the target folder, and the scene may not
refer to files outside.
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
from typing import TYPE_CHECKING, Final

from hapscene.constants import BUNDLE_SUFFIX as ZIP_SUFFIX
from hapscene.errors import FormatError, SceneError
from hapscene.io.files import Json, check_memory, open_zip, refusing, whole_file
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import files_of
from hapscene.scene.scene_file import BYTES_MAX, SUFFIX, save_scene

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["ZIP_SUFFIX", "read_bundle", "save_bundle", "unpacked_beside"]

UNPACKED_MAX_B: Final = 2_000_000_000
"""Maximum unpacked size of a bundle [bytes]."""

MEMBER_MAX: Final = 5_000
"""Maximum number of files in a bundle [count]."""

LIST_B: Final = 64
"""Maximum memory of a number or an empty list of JSON [bytes]: twenty times its text."""

_NAME: Final = re.compile(r"[^/\\:\0-\x1f.][^/\\:\0-\x1f]{0,199}")  # a folder or file name that is not hidden


def save_bundle(scene: "Scene", path: Path) -> None:
    """Write a scene with all files that it needs as one archive, completely or not at all.

    Raises:
        SceneError: the suffix is not .scene.zip, or a file cannot be read or written.
    """
    if not path.name.endswith(ZIP_SUFFIX) or path.name == ZIP_SUFFIX:
        raise SceneError(f"{path}: the name of a scene bundle must end in {ZIP_SUFFIX}")
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
    """Copy a mesh file and the files it refers to into a new folder; return the copy."""
    home = mesh.resolve().parent
    for file in (mesh.resolve(), *files_of(mesh)):
        target = folder / file.relative_to(home)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    return folder / mesh.resolve().name


def unpack_bundle(path: Path, folder: Path) -> Path:
    """Unpack an untrusted bundle into a new folder; return the scene file in it.

    Raises:
        SceneError: not a bundle, damaged or too large, a member would be outside the folder, or the folder exists.
    """
    with refusing(SceneError, path):
        try:
            with path.open("rb") as file, open_zip(file, UNPACKED_MAX_B, "use separate mesh files") as archive:
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
        except Exception as error:  # zipfile raises many classes for damaged or encrypted archives
            raise SceneError(f"not a valid zip archive: {error}") from None
    return folder / scene


def _checked(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Return the files of a bundle by path, after checking their names."""
    members: dict[str, zipfile.ZipInfo] = {}
    seen: set[str] = set()
    for member in archive.infolist():
        name = member.filename
        kind = stat.S_IFMT(member.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise SceneError(f"member {name[:60]!r} is a link or a device; expected only files")
        if not all(_NAME.fullmatch(step) for step in name.removesuffix("/").split("/")):
            raise SceneError(f"member {name[:60]!r} would be outside the folder or hidden; expected a relative path")
        if member.is_dir():
            continue
        if name.lower() in seen:
            raise SceneError(f"member {name[:60]!r} occurs twice")
        seen.add(name.lower())
        members[name] = member
    if len(members) > MEMBER_MAX:
        raise SceneError(f"{len(members):,} files, at most {MEMBER_MAX:,} are allowed")
    return members


def _scene_of(archive: zipfile.ZipFile, members: dict[str, zipfile.ZipInfo]) -> str:
    """Return the name of the scene file, which may refer only to files in the archive."""
    found = [name for name in members if name.endswith(SUFFIX) and "/" not in name]
    if len(found) != 1:
        raise SceneError(f"expected one scene file NAME{SUFFIX} at the top level, found {len(found)}")
    if members[found[0]].file_size > BYTES_MAX:
        raise SceneError(f"member {found[0]} is larger than {BYTES_MAX:,} bytes")
    try:
        data = archive.read(members[found[0]])
        needed_B = LIST_B * sum(data.count(sign) for sign in (b"[", b"{", b","))
        check_memory(needed_B, len(data), found[0], "use a scene file with separate mesh files")
        content = json.loads(data)
        named: list[Json] = [mesh["path"] for mesh in content["meshes"]]
        named += [swatch for swatch in content["swatches"] if swatch.endswith(".swatch")]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise SceneError(f"member {found[0]} is not a scene file, or damaged") from None
    for name in named:
        if not isinstance(name, str) or PurePosixPath(name).as_posix() not in members:
            raise SceneError(f"member {found[0]} refers to {str(name)[:60]!r}, which is not in the bundle")
    return found[0]


def read_bundle(path: Path, load: Callable[[Path], "Scene"]) -> "Scene":
    """Load the scene of a bundle into memory; its meshes and swatches have no files.

    Args:
        path: the bundle.
        load: function that loads a scene file.

    Raises:
        SceneError: as in `unpack_bundle`.
    """
    with tempfile.TemporaryDirectory() as name:
        scene = load(unpack_bundle(path, Path(name) / "scene"))
        kept: dict[int, Mesh] = {}
        for body in scene.bodies:
            body.mesh = kept.setdefault(id(body.mesh), replace(body.mesh, path=None))
    scene.swatch_source[:] = [source if isinstance(source, str) else None for source in scene.swatch_source]
    return scene


def unpacked_beside(path: Path) -> Path:
    """Unpack a bundle into a new folder with its name in the working folder; return the scene file in it.

    Raises:
        SceneError: as in `unpack_bundle`.
    """
    stem = path.name.removesuffix(ZIP_SUFFIX)
    names = (stem, *(f"{stem}_{i}" for i in range(2, 10_000)))
    return unpack_bundle(path, next(Path(name) for name in names if not Path(name).exists()))
