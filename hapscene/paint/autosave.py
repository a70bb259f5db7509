"""Autosave: what is not saved yet lies beside the scene within a second, and is offered after a killed process.

Beside cup.scene.json a folder .cup.autosave holds a lock, which the system lets go of with the process, however that
ends, and a folder for each painter with the scene as it is painted, written as any scene file is. Saved or closed, the
painter's folder is gone; those that are not of the painter with the lock are of killed ones, and stay until it is
decided what becomes of them.
"""

import shutil
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple

from hapscene.errors import SceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.ply import write_mesh
from hapscene.scene.scene import load_scene
from hapscene.scene.scene_file import SUFFIX, is_own

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

INTERVAL_S: Final = 1.0
"""How often it is looked whether there is something to write [s]: with the time to write it, no more than two seconds
of work are lost."""

LOCK: Final = "lock"


def autosave_folder(path: Path) -> Path:
    """Where what is autosaved of a scene file lies."""
    return path.with_name(f".{path.name.removesuffix(SUFFIX)}.autosave")


@dataclass(frozen=True)
class Recovery:
    """What a killed painter left.

    Attributes:
        path: the scene file that it is of.
        file: the scene that was autosaved.
        saved_s: when, seconds since 1970.
    """

    path: Path
    file: Path
    saved_s: float

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

    def discard(self) -> None:
        """Remove it."""
        shutil.rmtree(self.file.parent, ignore_errors=True)
        _tidy(autosave_folder(self.path))


def find_recovery(path: Path) -> Recovery | None:
    """What a killed painter of that scene file left last; None without, or while another painter is at it."""
    folder = autosave_folder(path)
    try:
        lock = _lock(folder) if folder.is_dir() else None
        if lock is None:
            return None
        found = _left(path)
        lock.close()
    except OSError:
        return None  # of someone else's: not ours to offer
    _tidy(folder)
    return found[0] if found else None


def _left(path: Path) -> list[Recovery]:
    """What killed painters of a scene file left, the last first; those that left nothing are cleared away."""
    found = []
    for folder in filter(Path.is_dir, autosave_folder(path).iterdir()):
        file = folder / path.name
        if file.is_file():
            found.append(Recovery(path, file, file.stat().st_mtime))
        else:
            shutil.rmtree(folder, ignore_errors=True)
    return sorted(found, key=lambda recovery: -recovery.saved_s)


def _tidy(folder: Path) -> None:
    """Remove the folder of autosaves if nothing is in it, and no painter."""
    with suppress(OSError):
        if any(file.name != LOCK for file in folder.iterdir()):
            return
        lock = _lock(folder)
        if lock is not None:
            lock.close()
            (folder / LOCK).unlink(missing_ok=True)
            folder.rmdir()


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
        look: what to write, or None while the scene is busy: see `Sight`.
        interval_s: how often to look.

    Attributes:
        file: where it is written.
        found: what killed painters left before, the last first.
        problem: why the last attempt failed, in a sentence; None where it did not.

    Raises:
        SceneError: another painter is at that file, or the folder cannot be written.
    """

    def __init__(
        self,
        path: Path,
        look: "Callable[[], Sight | None]",
        interval_s: float = INTERVAL_S,
    ) -> None:
        self.path, self.interval_s = path, interval_s
        self.problem: str | None = None
        self._look = look
        self._meshes: dict[int, tuple[Mesh, Mesh]] = {}  # those in memory: themselves, and as they lie in the folder
        self._written: object = self  # as no state is: what lies there is from before
        self._number = -1
        self._busy = threading.Lock()
        folder = autosave_folder(path)
        lock = None
        try:
            folder.mkdir(exist_ok=True)
            lock = _lock(folder)
            if lock is None:
                raise SceneError(f"{path}: is open in another painter: close that one, or paint a copy")
            self.found = _left(path)
            self.file = Path(tempfile.mkdtemp(prefix="", dir=folder)) / path.name
        except OSError as error:
            if lock is not None:
                lock.close()
            raise SceneError(f"{folder}: no autosave: cannot be written: {error.strerror}") from None
        self._lock = lock
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hapscene autosave", daemon=True)
        self._thread.start()

    def close(self, keep: bool = False) -> bool:
        """Stop; whether something stays to be offered next time, which is for `keep` what is not saved."""
        self._end.set()
        self._thread.join()
        if keep:
            self.write()
        kept = keep and self.file.exists()
        if not kept:
            shutil.rmtree(self.file.parent, ignore_errors=True)
        self._lock.close()
        _tidy(autosave_folder(self.path))
        return kept

    def write(self) -> bool:
        """Write now, if there is something that is not written; whether nothing is any more."""
        sight = self._look()
        if sight is None:
            return False
        with self._busy:
            if sight.number < self._number or sight.state == self._written:
                return self.problem is None
            self._number = sight.number
            try:
                if sight.scene is None:
                    self.file.unlink(missing_ok=True)
                else:
                    self._keep_meshes(sight.scene)
                    sight.scene.save(self.file)
                self._written, self.problem = sight.state, None
            except Exception as error:  # whatever goes wrong: the next attempt may go right, and must come
                self.problem = f"no autosave: {error}"
            return self.problem is None

    def _run(self) -> None:
        while not self._end.wait(self.interval_s):
            self.write()

    def _keep_meshes(self, scene: "Scene") -> None:
        """Meshes that are in memory, or the scene's own, are written once, not with each autosave."""
        for body in scene.bodies:
            if body.mesh.path is None or is_own(body.mesh.path):
                if id(body.mesh) not in self._meshes:
                    file = self.file.with_name(f"mesh_{len(self._meshes)}.ply")
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
