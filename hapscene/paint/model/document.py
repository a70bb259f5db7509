"""The scene file of a painting: save without overwriting the work of others, autosave, recovery after a crash.

Unsaved work is written beside the scene within a second, and offered after a crash. Beside cup.scene.json a folder
.cup.autosave holds a lock, which the system releases when the process ends, however it ends; and one folder for each
painter, with the scene as it is painted, in the format of any scene file. After saving or closing, the painter's folder
is removed. Folders that do not belong to the holder of the lock come from painters that were killed; they stay until
the user decides about them.
"""

import hashlib
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

from filelock import FileLock, Timeout

from hapscene.errors import SaveConflict, SceneError
from hapscene.paint.model.painting import Painting
from hapscene.scene.mesh import Mesh
from hapscene.scene.ply import save_mesh
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.scene_file import SUFFIX, check_scene_path, is_own

__all__ = ["Autosave", "Document", "Recovery", "autosave_folder", "earlier_words", "find_recovery", "stamp_of"]

AUTOSAVE_INTERVAL_S: Final = 1.0
"""Period of the autosave [s]: with the time to write, at most two seconds of work are lost."""

LOCK_WAIT_S: Final = 0.2
"""Longest wait of the autosave for a scene that is being changed [s]; it tries again in the next period."""

LOCK: Final = "lock"


def stamp_of(path: Path) -> str:
    """SHA-256 of a file, to detect changes; "" where there is no file.

    Raises:
        SceneError: it cannot be read.
    """
    try:
        if path.exists() and not path.is_file():
            raise SceneError(f"{path}: cannot be read: not a file")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None


def _check_unchanged(path: Path, known: str | None) -> None:
    """Raise SaveConflict if a file does not have the known stamp, or exists although no stamp is known."""
    now = stamp_of(path)
    if now == (known or ""):
        return
    if known is None:
        raise SaveConflict(f"{path}: is there already; save over it, or under another name")
    if not known:
        raise SaveConflict(f"{path}: was made by someone else meanwhile; save over it, or under another name")
    if not now:
        raise SaveConflict(f"{path}: was removed or renamed meanwhile; save it anew, or under another name")
    raise SaveConflict(
        f"{path}: was changed by someone else since it was opened; save over it, save under another name, or open "
        "it again and lose what was painted here"
    )


def autosave_folder(path: Path) -> Path:
    """Folder of the autosaves of a scene file."""
    return path.with_name(f".{path.name.removesuffix(SUFFIX)}.autosave")


@dataclass(frozen=True)
class Recovery:
    """Unsaved work of a painter that was killed.

    Attributes:
        path: its scene file.
        file: the scene that was autosaved.
        saved_s: time of the autosave, seconds since 1970.
    """

    path: Path
    file: Path
    saved_s: float

    @property
    def when(self) -> str:
        """Time of the autosave, as text."""
        return _when(self.saved_s)

    def load(self) -> Scene:
        """Load the scene, independent of the autosave's files.

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
    """The newest unsaved work on a scene file; None without, or while another painter has the file open."""
    folder = autosave_folder(path)
    try:
        lock = _lock(folder) if folder.is_dir() else None
        if lock is None:
            return None
        found = _recoveries(path)
        lock.release()
    except OSError:
        return None  # of another user
    _remove_if_empty(folder)
    return found[0] if found else None


def earlier_words(path: Path) -> str:
    """State of a scene file that was painted before, in a sentence."""
    told = f"{path} was saved at {_when(path.stat().st_mtime)}"
    left = find_recovery(path)
    if left is not None:
        told += f"; a session of it ended without saving, and its work up to {left.when} is still there"
    elif autosave_folder(path).exists():
        told += ", and is open in another painter"
    return f"{told}."


def _when(time_s: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(time_s))


def _recoveries(path: Path) -> list[Recovery]:
    """Unsaved work on a scene file, the newest first; empty folders of painters are removed."""
    found = []
    for folder in filter(Path.is_dir, autosave_folder(path).iterdir()):
        file = folder / path.name
        if file.is_file():
            found.append(Recovery(path, file, file.stat().st_mtime))
        else:
            shutil.rmtree(folder, ignore_errors=True)
    return sorted(found, key=lambda recovery: -recovery.saved_s)


def _remove_if_empty(folder: Path) -> None:
    """Remove the folder of autosaves if it is empty and no painter has it."""
    with suppress(OSError):
        if any(file.name != LOCK for file in folder.iterdir()):
            return
        lock = _lock(folder)
        if lock is not None:
            lock.release()
            (folder / LOCK).unlink(missing_ok=True)
            folder.rmdir()


def _lock(folder: Path) -> FileLock | None:
    """Lock a folder until the lock is released or the process ends; None where another painter holds it."""
    lock = FileLock(folder / LOCK, timeout=0, thread_local=False)
    try:
        lock.acquire()
    except Timeout:
        return None
    return lock


class Snapshot(NamedTuple):
    """What there is to write: a copy of the scene, None where all is saved; and a value that identifies its state."""

    scene: Scene | None
    state: object


class Autosave:
    """Writes a scene beside its file while it is painted.

    Args:
        path: the scene file.
        take_snapshot: what to write; None while the scene is busy.
        interval_s: period.

    Attributes:
        file: where it is written.
        recoveries: unsaved work of killed painters, the newest first.
        problem: why the last attempt failed, in a sentence; None where it did not.

    Raises:
        SceneError: another painter has that file open, or the folder cannot be written.
    """

    def __init__(self, path: Path, take_snapshot: Callable[[], Snapshot | None], interval_s: float) -> None:
        self.path, self.interval_s = path, interval_s
        self.problem: str | None = None
        self._take_snapshot = take_snapshot
        self._meshes: dict[int, tuple[Mesh, Mesh]] = {}  # by id: meshes in memory, and as they are in the folder
        self._written: object = self  # equal to no state
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
                lock.release()
            raise SceneError(f"{folder}: no autosave: cannot be written: {error.strerror}") from None
        self._lock = lock
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hapscene autosave", daemon=True)
        self._thread.start()

    def close(self, keep: bool = False) -> bool:
        """Stop; with `keep`, unsaved work stays to be offered next time. Returns whether there is such work."""
        self._end.set()
        self._thread.join()
        if keep:
            self.write()
        kept = keep and self.file.exists()
        if not kept:
            shutil.rmtree(self.file.parent, ignore_errors=True)
        self._lock.release()
        _remove_if_empty(autosave_folder(self.path))
        return kept

    def write(self) -> bool:
        """Write now, if something has changed; returns whether everything is written."""
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
            except Exception as error:  # whatever fails: the next attempt may succeed, and must come
                self.problem = f"no autosave: {error}"
            return self.problem is None

    def _run(self) -> None:
        while not self._end.wait(self.interval_s):
            self.write()

    def _keep_meshes(self, scene: Scene) -> None:
        """Write meshes without a file, or with one that the scene owns, once, not with each autosave."""
        for body in scene.bodies:
            if body.mesh.path is None or is_own(body.mesh.path):
                if id(body.mesh) not in self._meshes:
                    file = self.file.with_name(f"mesh_{len(self._meshes)}.ply")
                    save_mesh(body.mesh, file)
                    kept = replace(body.mesh, path=file, unit="m", up="z", scale=1.0)
                    self._meshes[id(body.mesh)] = body.mesh, kept
                body.mesh = self._meshes[id(body.mesh)][1]


class Document:
    """The file that a painting is saved to, and its autosave.

    Args:
        painting: what is saved.
        path: the scene file it was loaded from, or will be saved to; None where that is not known yet.
        stamp: stamp of the file when it was loaded, from `stamp_of`; None for its stamp now.
        changed: whether it counts as changed already.

    Attributes:
        path: where `save` writes.
        autosave: writes unsaved work beside the scene; None while it is off.
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
        """Whether the painting differs from when it was loaded or saved."""
        return self._painting.state != self._saved

    @property
    def dirty(self) -> bool:
        """Whether there is something to save: it was changed, or it has no file yet."""
        return self.changed or not self._stamp

    def save(self, path: str | Path | None = None, force: bool = False) -> Path:
        """Save the scene, to `path` from now on if it is given; returns the file.

        Args:
            path: NAME.scene.json, or NAME alone; None for the present one.
            force: overwrite a file that is not the one that was loaded.

        Raises:
            SaveConflict: the file changed since it was loaded; or another is there, or unsaved work of a killed
                painter of it: ask the user, then force.
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
            check_scene_path(target)
            old = autosave = self.autosave
            if self._interval_s is not None and (old is None or not same):
                autosave = Autosave(target, self._take_snapshot, self._interval_s)  # its lock first
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
            old.write() if same else old.close()  # all is saved: it removes its files
        return target

    def _check(self, target: Path, same: bool, autosave: Autosave | None) -> None:
        if not same and (find_recovery(target) if autosave is None else autosave.recoveries):
            raise SaveConflict(
                f"{target}: was painted and not saved, for its painter was killed; open it to recover that, or save "
                "over it, which leaves that to be recovered"
            )
        _check_unchanged(target, self._stamp if same else None)

    def recovery(self) -> Recovery | None:
        """The newest unsaved work of a killed painter of this scene; None without."""
        if self.autosave is not None:
            return self.autosave.recoveries[0] if self.autosave.recoveries else None
        return find_recovery(self.path) if self.path is not None else None

    def recover(self, recovery: Recovery) -> str:
        """Bring unsaved work back, as one step that can be undone; returns its name.

        It is removed once it is autosaved here, and offered again until then.

        Raises:
            HapsceneError: it cannot be loaded, or has other bodies.
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
        """Remove unsaved work of a killed painter."""
        recovery.discard()
        self._forget(recovery)

    def _forget(self, recovery: Recovery) -> None:
        if self.autosave is not None:
            self.autosave.recoveries = [left for left in self.autosave.recoveries if left != recovery]

    def start_autosave(self, interval_s: float = AUTOSAVE_INTERVAL_S) -> None:
        """Write unsaved work beside the scene file from now on.

        Nothing is written without a path, nor in a folder that cannot be written, which `problem` reports, until the
        scene is saved elsewhere.

        Raises:
            SceneError: another painter has that file open.
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
        """Stop the autosave. Unsaved work is lost; or (`keep`) it is written, and offered at the next start.

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
        """Unsaved work for the autosave; None while the scene is held for longer than `LOCK_WAIT_S`."""
        if not self._painting.lock.acquire(timeout=LOCK_WAIT_S):  # its holder may wait for the autosave
            return None
        try:
            if not self.changed:
                return Snapshot(None, None)
            return Snapshot(self._painting.snapshot(), self._painting.state)
        finally:
            self._painting.lock.release()
