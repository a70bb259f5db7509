"""The file of a painting, a part of every `Session`: saved over nobody else's work, and not lost with the process.

What is not saved yet lies beside the scene within a second, and is offered after a killed process. Beside
cup.scene.json a folder .cup.autosave holds a lock, which the system lets go of with the process, however that ends, and
a folder for each painter with the scene as it is painted, written as any scene file is. Saved or closed, the painter's
folder is gone; those that are not of the painter with the lock are of killed ones, and stay until it is decided what
becomes of them.
"""

import hashlib
import os
import shutil
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

from hapscene.errors import SaveConflict, SceneError
from hapscene.paint.painting import Painting
from hapscene.scene.mesh import Mesh
from hapscene.scene.ply import save_mesh
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.scene_file import SUFFIX, check_place, is_own

AUTOSAVE_INTERVAL_S: Final = 1.0
"""How often it is looked whether there is something to write [s]: with the time to write it, no more than two seconds
of work are lost."""

LOCK_WAIT_S: Final = 0.2
"""How long the autosave waits for a scene that is being changed [s], before it comes again: whoever holds the scene may
wait for the autosave in turn."""

LOCK: Final = "lock"


def stamp_of(path: Path) -> str:
    """What a file is, to see whether it has changed since: its SHA-256; "" where there is none.

    Raises:
        SceneError: it cannot be read.
    """
    try:
        if path.exists() and not path.is_file():
            raise SceneError(f"{path}: cannot be read: is no file")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None


def check_unchanged(path: Path, known: str | None) -> None:
    """Refuse to write over a file that has not the stamp known; None where none is.

    Raises:
        SaveConflict: it has another content, is gone, or is new.
    """
    now = stamp_of(path)
    if known is None:
        if now:
            raise SaveConflict(f"{path}: is there already; save over it, or under another name")
        return
    if now == known:
        return
    if not known:
        raise SaveConflict(f"{path}: was made by someone else meanwhile; save over it, or under another name")
    if not now:
        raise SaveConflict(f"{path}: was removed or renamed meanwhile; save it anew, or under another name")
    raise SaveConflict(
        f"{path}: was changed by someone else since it was opened; save over it, save under another name, or open "
        "it again and lose what was painted here"
    )


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

    def load(self) -> Scene:
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
        _remove_if_empty(autosave_folder(self.path))


def find_recovery(path: Path) -> Recovery | None:
    """What a killed painter of that scene file left last; None without, or while another painter is at it."""
    folder = autosave_folder(path)
    try:
        lock = _lock(folder) if folder.is_dir() else None
        if lock is None:
            return None
        found = _recoveries(path)
        lock.close()
    except OSError:
        return None  # of someone else's: not ours to offer
    _remove_if_empty(folder)
    return found[0] if found else None


def _recoveries(path: Path) -> list[Recovery]:
    """What killed painters of a scene file left, the last first; those that left nothing are cleared away."""
    found = []
    for folder in filter(Path.is_dir, autosave_folder(path).iterdir()):
        file = folder / path.name
        if file.is_file():
            found.append(Recovery(path, file, file.stat().st_mtime))
        else:
            shutil.rmtree(folder, ignore_errors=True)
    return sorted(found, key=lambda recovery: -recovery.saved_s)


def _remove_if_empty(folder: Path) -> None:
    """Remove the folder of autosaves if nothing is in it, and no painter."""
    with suppress(OSError):
        if any(file.name != LOCK for file in folder.iterdir()):
            return
        lock = _lock(folder)
        if lock is not None:
            lock.close()
            (folder / LOCK).unlink(missing_ok=True)
            folder.rmdir()


def _lock(folder: Path) -> IO[Any] | None:
    """The folder's lock, held until it is closed or the process ends; None where another process holds it."""
    file = (folder / LOCK).open("a+b")
    try:
        _lock_file(file)
    except OSError:
        file.close()
        return None
    return file


def _lock_file(file: IO[Any]) -> None:
    """Lock a file, or raise OSError where it is locked."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        file.seek(0)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


class Snapshot(NamedTuple):
    """What there is to write: a copy, None where all is saved; and another value whenever the scene is another."""

    scene: Scene | None
    state: object


class Autosave:
    """Writes a scene beside its file while it is painted.

    Args:
        path: the scene file.
        take_snapshot: what to write; None while the scene is busy.
        interval_s: how often to look whether there is something.

    Attributes:
        file: where it is written.
        recoveries: what killed painters left before, the last first.
        problem: why the last attempt failed, in a sentence; None where it did not.

    Raises:
        SceneError: another painter is at that file, or the folder cannot be written.
    """

    def __init__(self, path: Path, take_snapshot: Callable[[], Snapshot | None], interval_s: float) -> None:
        self.path, self.interval_s = path, interval_s
        self.problem: str | None = None
        self._take_snapshot = take_snapshot
        self._meshes: dict[int, tuple[Mesh, Mesh]] = {}  # those in memory: themselves, and as they lie in the folder
        self._written: object = self  # as no state is: what lies there is from before
        self._writing = threading.Lock()
        folder = autosave_folder(path)
        lock = None
        try:
            folder.mkdir(exist_ok=True)
            lock = _lock(folder)
            if lock is None:
                raise SceneError(f"{path}: is open in another painter: close that one, or paint a copy")
            self.recoveries = _recoveries(path)
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
        _remove_if_empty(autosave_folder(self.path))
        return kept

    def write(self) -> bool:
        """Write now, if there is something that is not written; whether nothing is any more."""
        with self._writing:
            snapshot = self._take_snapshot()
            if snapshot is None:
                return False
            if snapshot.state == self._written and (snapshot.scene is None or self.file.exists()):
                return self.problem is None
            try:
                if snapshot.scene is None:
                    self.file.unlink(missing_ok=True)
                else:
                    self._keep_meshes(snapshot.scene)
                    snapshot.scene.save(self.file)
                self._written, self.problem = snapshot.state, None
            except Exception as error:  # whatever goes wrong: the next attempt may go right, and must come
                self.problem = f"no autosave: {error}"
            return self.problem is None

    def forget(self, recovery: Recovery) -> None:
        """It was decided what becomes of that one."""
        self.recoveries = [left for left in self.recoveries if left != recovery]

    def _run(self) -> None:
        while not self._end.wait(self.interval_s):
            self.write()

    def _keep_meshes(self, scene: Scene) -> None:
        """Meshes that are in memory, or the scene's own, are written once, not with each autosave."""
        for body in scene.bodies:
            if body.mesh.path is None or is_own(body.mesh.path):
                if id(body.mesh) not in self._meshes:
                    file = self.file.with_name(f"mesh_{len(self._meshes)}.ply")
                    save_mesh(body.mesh, file)
                    self._meshes[id(body.mesh)] = (
                        body.mesh,
                        replace(body.mesh, path=file, unit="m", up="z", scale=1.0),
                    )
                body.mesh = self._meshes[id(body.mesh)][1]


class Document:
    """The file that a painting is saved to, and autosaved beside.

    Args:
        painting: what is saved.
        path: the scene file it was loaded from, or shall be saved to; None where that is not known yet.
        stamp: of the file as it was loaded, of `stamp_of`; None for as it is now.
        changed: whether it counts as changed already.

    Attributes:
        path: where `save` writes.
        autosave: writes what is not saved beside the scene; None while nothing does.
    """

    def __init__(
        self, painting: Painting, path: Path | None = None, stamp: str | None = None, changed: bool = False
    ) -> None:
        self.path = path
        self._painting = painting
        self._stamp = stamp_of(path) if stamp is None and path is not None else stamp
        self._saved = (-1, 0) if changed else painting.state
        self.autosave: Autosave | None = None
        self._problem: str | None = None
        self._interval_s: float | None = None  # of the autosave, where one is wanted

    def __repr__(self) -> str:
        kept = ", autosaved" if self.autosave is not None else ""
        return f"<Document {self.path or 'without a file'}: {'not saved' if self.dirty else 'saved'}{kept}>"

    @property
    def changed(self) -> bool:
        """Whether the painting is another than it was at first, or saved."""
        return self._painting.state != self._saved

    @property
    def dirty(self) -> bool:
        """Whether there is something to save: it was changed, or there is no file of it yet."""
        return self.changed or not self._stamp

    def save(self, path: str | Path | None = None, force: bool = False) -> Path:
        """Save the scene, to `path` from now on where one is given; its file.

        Args:
            path: NAME.scene.json, or NAME alone; None for the one there is.
            force: write over a file that is not the one that was loaded.

        Raises:
            SaveConflict: the file changed since it was loaded; or another is there, or what a killed painter of it
                left: ask the user, then force.
            SceneError: no path, another suffix, it is open in another painter, or cannot be written.
        """
        with self._painting.lock:
            self._painting.end_step()
            target = Path(path) if path is not None else self.path
            if target is None:
                raise SceneError("where shall the scene be saved? give a file NAME.scene.json")
            if target.name and not target.suffix:
                target = target.with_name(target.name + SUFFIX)
            same = self.path is not None and target.resolve() == self.path.resolve()
            check_place(target)
            old = autosave = self.autosave
            if self._interval_s is not None and (old is None or not same):
                autosave = Autosave(target, self._take_snapshot, self._interval_s)  # its lock first of all
            try:
                if not force:
                    self._check(target, same, autosave)
                self._painting.scene.save(target)
            except BaseException:
                if autosave is not None and autosave is not old:
                    autosave.close()
                raise
            self.path, self._stamp, self.autosave = target, stamp_of(target), autosave
            self._saved, self._problem = self._painting.state, None
        if old is not None:
            old.write() if same else old.close()  # all is saved: it removes what it wrote
        return target

    def _check(self, target: Path, same: bool, autosave: Autosave | None) -> None:
        if not same and (find_recovery(target) if autosave is None else autosave.recoveries):
            raise SaveConflict(
                f"{target}: was painted and not saved, for its painter was killed; open it to recover that, or save "
                "over it, which leaves that to be recovered"
            )
        check_unchanged(target, self._stamp if same else None)

    def recovery(self) -> Recovery | None:
        """What a killed painter of this scene left, the last of them; None without."""
        if self.autosave is not None:
            return self.autosave.recoveries[0] if self.autosave.recoveries else None
        return find_recovery(self.path) if self.path is not None else None

    def recover(self, recovery: Recovery) -> str:
        """Bring back what a killed painter left, as one step, which undo takes back; what it was.

        It is removed once it is autosaved here, and offered anew until then.

        Raises:
            HapsceneError: it cannot be loaded, or is of other bodies.
        """
        scene = recovery.load()
        try:
            what = self._painting.take_painting(scene, "recovered painting", composed=True)
        except SceneError as error:
            raise SceneError(f"{recovery.file}: {error}") from None
        if self.autosave is not None and self.autosave.write():
            recovery.discard()
        self._forget(recovery)
        return what

    def discard_recovery(self, recovery: Recovery) -> None:
        """Remove what a killed painter left."""
        recovery.discard()
        self._forget(recovery)

    def _forget(self, recovery: Recovery) -> None:
        if self.autosave is not None:
            self.autosave.forget(recovery)

    def start_autosave(self, interval_s: float = AUTOSAVE_INTERVAL_S) -> None:
        """Write what is not saved beside the scene file from now on; what a killed painter left stays.

        Without a path nothing is written: there is no place for it. Nor is it in a folder that cannot be written, as
        `problem` then says, until the scene is saved elsewhere.

        Raises:
            SceneError: another painter is at that file.
        """
        self._interval_s = interval_s
        if self.path is None or self.autosave is not None:
            return
        folder = self.path.resolve().parent
        if os.access(folder, os.W_OK):
            self.autosave = Autosave(self.path, self._take_snapshot, interval_s)
        else:
            self._problem = f"no autosave: nothing may be written into {folder}; save the scene elsewhere"

    @property
    def problem(self) -> str | None:
        """Why the last autosave failed, in a sentence; None where it did not."""
        return self.autosave.problem if self.autosave is not None else self._problem

    def close(self, keep: bool = False) -> bool:
        """Stop to autosave. What is not saved is lost; or (`keep`) it is written, and offered at the next start.

        Returns:
            Whether there is something to offer.
        """
        self._interval_s = None
        if self.autosave is None:
            return False
        kept = self.autosave.close(keep)
        self._problem, self.autosave = self.autosave.problem, None
        return kept

    def _take_snapshot(self) -> Snapshot | None:
        """For the autosave: what is not saved; None while the scene is held for longer than `LOCK_WAIT_S`."""
        if not self._painting.lock.acquire(timeout=LOCK_WAIT_S):
            return None
        try:
            if not self.changed:
                return Snapshot(None, None)
            return Snapshot(self._painting.snapshot(), self._painting.state)
        finally:
            self._painting.lock.release()
