"""Autosave: what is not saved yet lies beside the scene within a second, and is offered after a killed process.

Beside cup.scene.json a folder .cup.autosave holds the scene as it is painted, written as any scene file is, and a lock
that the system lets go of with the process, however that ends. Saved or closed, the folder is gone; where it is still
there and nobody holds its lock, its painter was killed.
"""

import json
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple

from hapscene.errors import SceneError
from hapscene.output import write_whole
from hapscene.scene.file import SUFFIX, load_scene
from hapscene.scene.mesh import Mesh
from hapscene.scene.ply import write_mesh

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

INTERVAL_S: Final = 1.0
"""How often it is looked whether there is something to write [s]: with the time to write it, no more than two seconds
of work are lost."""

FORMAT: Final = "hapscene autosave"
VERSION: Final = 1

ABOUT: Final = "about.json"
LOCK: Final = "lock"


def autosave_folder(path: Path) -> Path:
    """The folder of a scene file's autosave."""
    return path.with_name(f".{path.name.removesuffix(SUFFIX)}.autosave")


@dataclass(frozen=True)
class Recovery:
    """What a killed painter left.

    Attributes:
        path: the scene file that it is of.
        file: the scene that was autosaved.
        saved_s: when, seconds since 1970.
        base_sha256: of the scene file that it began with; "" where there was none, or it is not known.
    """

    path: Path
    file: Path
    saved_s: float
    base_sha256: str

    def load(self) -> "Scene":
        """The scene as it was painted, independent of the autosave's files.

        Raises:
            HapsceneError: it cannot be loaded.
        """
        scene = load_scene(self.file)
        folder = self.file.parent.resolve()
        own: dict[int, Mesh] = {}
        for body in scene.bodies:
            if body.mesh.path is not None and body.mesh.path.resolve().parent == folder:
                body.mesh = own.setdefault(id(body.mesh), replace(body.mesh, path=None))
        for i, source in enumerate(scene.swatch_source):
            if isinstance(source, Path) and source.resolve().parent == folder:
                scene.swatch_source[i] = None
        return scene


def find_recovery(path: Path) -> Recovery | None:
    """What a killed painter of that scene file left; None without, or while another painter is at it."""
    folder = autosave_folder(path)
    file = folder / path.name
    if not file.is_file():
        return None
    try:
        lock = _lock(folder)
    except OSError:
        return None  # of someone else's: not ours to offer
    if lock is None:
        return None
    lock.close()
    try:
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
        base = str(about["base_sha256"]) if about["format"] == FORMAT else ""
    except (OSError, ValueError, KeyError, TypeError):
        base = ""
    return Recovery(path, file, file.stat().st_mtime, base)


def discard(path: Path) -> None:
    """Remove what a killed painter left.

    Raises:
        SceneError: another painter is at it, or it is someone else's.
    """
    folder = autosave_folder(path)
    if folder.is_dir():
        try:
            lock = _lock(folder)
        except OSError as error:
            raise SceneError(f"{folder}: cannot be removed: {error.strerror}") from None
        if lock is None:
            raise SceneError(f"{path}: is open in another painter")
        lock.close()
        shutil.rmtree(folder, ignore_errors=True)


class Sight(NamedTuple):
    """What there is to write.

    Attributes:
        number: higher than of all looks before.
        scene: a copy; None where all is saved.
        state: another value whenever the scene is another.
    """

    number: int
    scene: "Scene | None"
    state: object


class Autosave:
    """Writes a scene beside its file while it is painted.

    Args:
        path: the scene file.
        base_sha256: of that file as it was loaded; "" where there is none.
        look: what to write, or None while the scene is busy: see `Sight`.
        interval_s: how often to look.

    Attributes:
        problem: why the last attempt failed, in a sentence; None where it did not.

    Raises:
        SceneError: another painter is at that file, or the folder cannot be written.
    """

    def __init__(
        self,
        path: Path,
        base_sha256: str,
        look: "Callable[[], Sight | None]",
        interval_s: float = INTERVAL_S,
    ) -> None:
        self.path = path
        self.problem: str | None = None
        self._folder, self._look, self._interval_s = autosave_folder(path), look, interval_s
        self._meshes: dict[int, tuple[Mesh, Mesh]] = {}  # those in memory: themselves, and as they lie in the folder
        self._written: object = self  # as no state is: what lies there is from before
        self._number = -1
        self._busy = threading.Lock()
        try:
            self._folder.mkdir(exist_ok=True)
            lock = _lock(self._folder)
        except OSError as error:
            raise SceneError(f"{self._folder}: no autosave: cannot be written: {error.strerror}") from None
        if lock is None:
            raise SceneError(f"{path}: is open in another painter: close that one, or paint a copy")
        self._lock = lock
        about = {"format": FORMAT, "version": VERSION, "scene": path.name, "base_sha256": base_sha256}
        write_whole(self._folder / ABOUT, json.dumps(about).encode(), SceneError)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hapscene autosave", daemon=True)
        self._thread.start()

    def close(self, keep: bool = False) -> None:
        """Stop. The folder goes, for all is saved or shall be lost; or it stays (`keep`), to be offered next time."""
        self._end.set()
        self._thread.join()
        if keep:
            self.write()
        self._lock.close()
        if not keep or not (self._folder / self.path.name).exists():
            shutil.rmtree(self._folder, ignore_errors=True)

    def write(self) -> None:
        """Write now, if there is something that is not written."""
        sight = self._look()
        if sight is None:
            return
        with self._busy:
            if sight.number < self._number or sight.state == self._written:
                return
            self._number = sight.number
            try:
                if sight.scene is None:
                    (self._folder / self.path.name).unlink(missing_ok=True)
                else:
                    self._keep_meshes(sight.scene)
                    sight.scene.save(self._folder / self.path.name)
                self._written, self.problem = sight.state, None
            except Exception as error:  # whatever goes wrong: the next attempt may go right, and must come
                self.problem = f"no autosave: {error}"

    def _run(self) -> None:
        while not self._end.wait(self._interval_s):
            self.write()

    def _keep_meshes(self, scene: "Scene") -> None:
        """Meshes in memory are written once, not with each autosave."""
        for body in scene.bodies:
            if body.mesh.path is None:
                if id(body.mesh) not in self._meshes:
                    file = self._folder / f"mesh_{len(self._meshes)}.ply"
                    write_mesh(body.mesh, file)
                    self._meshes[id(body.mesh)] = (body.mesh, replace(body.mesh, path=file, unit="m"))
                body.mesh = self._meshes[id(body.mesh)][1]


def _lock(folder: Path) -> IO[Any] | None:
    """The folder's lock, held until it is closed or the process ends; None where another process holds it."""
    file = (folder / LOCK).open("a+b")
    try:
        _hold(file)
    except OSError:
        file.close()
        return None
    return file


def _hold(file: IO[Any]) -> None:
    """Lock a file, or raise OSError where it is locked."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        file.seek(0)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
