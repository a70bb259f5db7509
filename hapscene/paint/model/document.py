"""The scene file of a painting: saving without overwriting changes of others, autosave, recovery after a crash.

Unsaved work is written next to the scene file every second and offered for recovery after a crash. For cup.scene.json,
the folder .cup.autosave contains a lock file, which the operating system releases when the process ends for any reason,
and one folder per painter process with the present scene as an ordinary scene file. After saving or closing, the folder
of the process is removed. Folders of other processes were left by painters that were killed; they are kept until the
user recovers or discards them.
"""

import hashlib
import json
import os
import shutil
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

from filelock import FileLock, Timeout

from hapscene.errors import SaveConflict, SceneError
from hapscene.paint.model.history import Step, pack_steps, unpack_steps
from hapscene.paint.model.painting import Painting
from hapscene.scene.mesh import Mesh
from hapscene.scene.ply import save_mesh
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.scene_file import SUFFIX, check_scene_path, is_own

__all__ = ["Autosave", "Document", "Recovery", "autosave_folder", "describe_scene_file", "file_hash", "find_recovery"]

AUTOSAVE_INTERVAL_S: Final = 1.0
"""Period of the autosave [s]: including the time to write, at most two seconds of work are lost."""

LOCK_WAIT_S: Final = 0.2
"""Longest wait of the autosave for the lock of the scene [s]; it tries again in the next period."""

LOCK: Final = "lock"
STEPS: Final = "steps.json"
"""Names of files in the autosave folder, and in that of a process."""


def file_hash(path: Path) -> str:
    """SHA-256 of a file, to detect changes; "" if the file does not exist.

    Raises:
        SceneError: the file cannot be read.
    """
    try:
        if path.exists() and not path.is_file():
            raise SceneError(f"{path}: cannot be read: it is not a file; give the name of a scene file")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None


def _check_unchanged(path: Path, known: str | None) -> None:
    """Raise SaveConflict if a file does not have the known hash, or exists although none is known."""
    if file_hash(path) != (known or ""):
        what = "another program has changed or removed this file since it was opened" if known else "it already exists"
        raise SaveConflict(f"{path}: {what}; overwrite it or choose another name")


def autosave_folder(path: Path) -> Path:
    """Folder of the autosaves of a scene file."""
    return path.with_name(f".{path.name.removesuffix(SUFFIX)}.autosave")


@dataclass(frozen=True)
class Recovery:
    """Unsaved work of a painter that was killed.

    Attributes:
        path: scene file that was painted.
        file: autosaved scene.
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
        """Load the autosaved scene, without references to files in the autosave folder.

        Raises:
            HapsceneError: the scene cannot be loaded.
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

    def before(self, scene: Scene) -> tuple[Scene, list[Step]]:
        """The loaded scene before its last steps, and these steps; without steps if they belong to another state."""
        try:
            packed = json.loads((self.file.with_name(STEPS)).read_bytes())
            steps = unpack_steps(packed["steps"]) if packed["scene"] == file_hash(self.file) else []
            earlier = scene.copy()
            for delta in (delta for step in reversed(steps) for delta in reversed(step.faces)):
                delta.apply(earlier.bodies[delta.body], undo=True)
            return earlier, steps
        except (OSError, ValueError, TypeError, LookupError, zlib.error):
            return scene, []

    def discard(self) -> None:
        """Delete the autosaved scene."""
        shutil.rmtree(self.file.parent, ignore_errors=True)
        _remove_if_empty(autosave_folder(self.path))


def find_recovery(path: Path) -> Recovery | None:
    """The newest unsaved work on a scene file; None if it does not exist or another painter has the file open."""
    folder = autosave_folder(path)
    try:
        lock = _lock(folder) if folder.is_dir() else None
        if lock is None:
            return None
        found = _recoveries(path)
        lock.release()
    except OSError:
        return None  # the folder belongs to another user
    _remove_if_empty(folder)
    return found[0] if found else None


def describe_scene_file(path: Path) -> str:
    """A sentence on when a scene file was saved, and whether there is unsaved work or another painter has it open."""
    text = f"{path} was saved at {_when(path.stat().st_mtime)}"
    recovery = find_recovery(path)
    if recovery is not None:
        text += f"; there is unsaved work of {recovery.when} that you can recover"
    elif autosave_folder(path).exists():
        text += ", and is open in another painter"
    return f"{text}."


def _when(time_s: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(time_s))


def _recoveries(path: Path) -> list[Recovery]:
    """Unsaved work on a scene file, newest first; removes empty autosave folders."""
    found = []
    for folder in filter(Path.is_dir, autosave_folder(path).iterdir()):
        file = folder / path.name
        if file.is_file():
            found.append(Recovery(path, file, file.stat().st_mtime))
        else:
            shutil.rmtree(folder, ignore_errors=True)
    return sorted(found, key=lambda recovery: -recovery.saved_s)


def _remove_if_empty(folder: Path) -> None:
    """Remove the autosave folder if it is empty and not locked."""
    with suppress(OSError):
        if any(file.name != LOCK for file in folder.iterdir()):
            return
        lock = _lock(folder)
        if lock is not None:
            lock.release()
            (folder / LOCK).unlink(missing_ok=True)
            folder.rmdir()


def _lock(folder: Path) -> FileLock | None:
    """Lock a folder until the lock is released or the process ends; None if another painter holds the lock."""
    lock = FileLock(folder / LOCK, timeout=0, thread_local=False)
    try:
        lock.acquire()
    except Timeout:
        return None
    return lock


class Snapshot(NamedTuple):
    """A copy of the scene to autosave, None if everything is saved; a value for its state; the steps since saving."""

    scene: Scene | None
    state: object
    steps: Sequence[Step] = ()


class Autosave:
    """Periodically writes unsaved work to the autosave folder of a scene file.

    Args:
        path: the scene file.
        take_snapshot: returns the snapshot to write, or None while the scene is locked.
        interval_s: period [s].

    Attributes:
        file: the autosaved scene.
        recoveries: unsaved work of killed painters, newest first.
        problem: why the last attempt failed; None if it succeeded.

    Raises:
        SceneError: another painter has the file open, or the folder cannot be written.
    """

    def __init__(self, path: Path, take_snapshot: Callable[[], Snapshot | None], interval_s: float) -> None:
        self.path, self.interval_s = path, interval_s
        self.problem: str | None = None
        self._take_snapshot = take_snapshot
        self._meshes: dict[int, tuple[Mesh, Mesh]] = {}  # by id: mesh in memory, and its copy in the folder
        self._written: object = self  # differs from every state
        self._writing = threading.Lock()
        folder = autosave_folder(path)
        lock = None
        try:
            folder.mkdir(exist_ok=True)
            lock = _lock(folder)
            if lock is None:
                raise SceneError(f"{path}: the file is open in another painter: close that painter or paint a copy")
            self.recoveries = _recoveries(path)
            self.file = Path(tempfile.mkdtemp(prefix="", dir=folder)) / path.name
        except OSError as error:
            if lock is not None:
                lock.release()
            reason = f"{folder}: autosave failed: {error.strerror}; make the folder writable or save elsewhere"
            raise SceneError(reason) from None
        self._lock = lock
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hapscene autosave", daemon=True)
        self._thread.start()

    def close(self, keep: bool = False) -> bool:
        """Stop. With `keep`, unsaved work is kept for recovery; returns whether there is such work."""
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
        """Write now if the scene has changed; returns whether everything is written."""
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
                    steps = {"scene": file_hash(self.file), "steps": pack_steps(snapshot.steps)}
                    self.file.with_name(STEPS).write_text(json.dumps(steps), encoding="utf-8")
                self._written, self.problem = snapshot.state, None
            except Exception as error:  # any failure: the thread must survive to try again
                self.problem = f"autosave failed: {error}"
            return self.problem is None

    def _run(self) -> None:
        while not self._end.wait(self.interval_s):
            self.write()

    def _keep_meshes(self, scene: Scene) -> None:
        """Write meshes that have no file, or one that the scene owns, once instead of with every autosave."""
        for body in scene.bodies:
            if body.mesh.path is None or is_own(body.mesh.path):
                if id(body.mesh) not in self._meshes:
                    file = self.file.with_name(f"mesh_{len(self._meshes)}.ply")
                    save_mesh(body.mesh, file)
                    kept = replace(body.mesh, path=file, unit="m", up="z", scale=1.0)
                    self._meshes[id(body.mesh)] = body.mesh, kept
                body.mesh = self._meshes[id(body.mesh)][1]


class Document:
    """The scene file of a painting, and its autosave.

    Args:
        painting: the painting to save.
        path: scene file that it was loaded from or will be saved to; None if not known yet.
        loaded_hash: `file_hash` of the file when it was loaded; None for its present hash.
        changed: whether the painting already differs from the file.

    Attributes:
        path: file that `save` writes.
        autosave: the running autosave; None while it is off.
    """

    def __init__(
        self, painting: Painting, path: Path | None = None, loaded_hash: str | None = None, changed: bool = False
    ) -> None:
        self.path = path
        self._painting = painting
        self._hash = file_hash(path) if loaded_hash is None and path is not None else loaded_hash
        self._saved = (-1, 0) if changed else painting.state
        self.autosave: Autosave | None = None
        self._problem: str | None = None
        self._interval_s: float | None = None  # period of the autosave; None while it is off

    @property
    def changed(self) -> bool:
        """Whether the painting differs from when it was loaded or saved."""
        return self._painting.state != self._saved

    @property
    def dirty(self) -> bool:
        """Whether there is something to save: the painting was changed, or has no file yet."""
        return self.changed or not self._hash

    def save(self, path: str | Path | None = None, force: bool = False) -> Path:
        """Save the scene; returns the file.

        Args:
            path: NAME.scene.json or NAME, which becomes the file of the document; None for the present file.
            force: overwrite a file that was not loaded here, or was changed by another program.

        Raises:
            SaveConflict: the file was changed since it was loaded, another file exists, or there is unsaved work on it.
                Ask the user, then use `force`.
            SceneError: there is no path, the suffix is invalid, the file is open in another painter, or it cannot be
                written.
        """
        with self._painting.lock:
            self._painting.end_step()
            target = Path(path) if path is not None else self.path
            if target is None:
                raise SceneError("the scene has no file: give a file name, such as NAME.scene.json")
            if target.name and not target.suffix:
                target = target.with_name(target.name + SUFFIX)
            same = self.path is not None and target.resolve() == self.path.resolve()
            check_scene_path(target)
            old = autosave = self.autosave
            if self._interval_s is not None and (old is None or not same):
                # locks the target before it is written
                autosave = Autosave(target, self._take_snapshot, self._interval_s)
            try:
                if not force:
                    self._check_target(target, same, autosave)
                self._painting.scene.save(target)
            except BaseException:
                if autosave is not None and autosave is not old:
                    autosave.close()
                raise
            self.path, self._hash, self.autosave = target, file_hash(target), autosave
            self._saved, self._problem = self._painting.state, None
        if old is not None:
            old.write() if same else old.close()  # removes its files, since everything is saved
        return target

    def _check_target(self, target: Path, same: bool, autosave: Autosave | None) -> None:
        if not same and (find_recovery(target) if autosave is None else autosave.recoveries):
            raise SaveConflict(
                f"{target}: there is unsaved work on this file from a painter that was killed; open the file to "
                "recover the work, or overwrite the file and recover it later"
            )
        _check_unchanged(target, self._hash if same else None)

    def recovery(self) -> Recovery | None:
        """The newest unsaved work of a killed painter on this scene; None if it does not exist."""
        if self.autosave is not None:
            return self.autosave.recoveries[0] if self.autosave.recoveries else None
        return find_recovery(self.path) if self.path is not None else None

    def recover(self, recovery: Recovery) -> str:
        """Restore unsaved work in one step, followed by its last steps; all can be undone. Returns a description.

        The recovered files are removed once the work is autosaved here; until then it is offered again.

        Raises:
            HapsceneError: the work cannot be loaded, or has different bodies.
        """
        scene = recovery.load()
        try:
            earlier, steps = recovery.before(scene)
            what = self._painting.take_painting(earlier, "recovered painting")
            self._painting.replay(steps)
            self._painting.take_painting(scene, what)  # also what an unfinished stroke had painted
        except SceneError as error:
            raise SceneError(f"{recovery.file}: {error}") from None
        if self.autosave is not None and self.autosave.write():
            recovery.discard()
        self._forget(recovery)
        return what

    def discard_recovery(self, recovery: Recovery) -> None:
        """Delete unsaved work of a killed painter."""
        recovery.discard()
        self._forget(recovery)

    def _forget(self, recovery: Recovery) -> None:
        if self.autosave is not None:
            self.autosave.recoveries = [left for left in self.autosave.recoveries if left != recovery]

    def start_autosave(self, interval_s: float = AUTOSAVE_INTERVAL_S) -> None:
        """Start the autosave.

        It is inactive while the document has no path. If the folder is not writable, `problem` reports it until the
        scene is saved elsewhere.

        Raises:
            SceneError: another painter has the file open.
        """
        self._interval_s = interval_s
        if self.path is None or self.autosave is not None:
            return
        folder = self.path.resolve().parent
        if os.access(folder, os.W_OK):
            self.autosave = Autosave(self.path, self._take_snapshot, interval_s)
        else:
            self._problem = f"autosave is off: {folder} is not writable; save the scene elsewhere"

    @property
    def problem(self) -> str | None:
        """Why the last autosave failed; None if it succeeded."""
        return self.autosave.problem if self.autosave is not None else self._problem

    def close(self, keep: bool = False) -> bool:
        """Stop the autosave. With `keep`, unsaved work is kept for recovery; else it is deleted.

        Returns:
            Whether there is work to recover.
        """
        self._interval_s = None
        if self.autosave is None:
            return False
        kept = self.autosave.close(keep)
        self._problem, self.autosave = self.autosave.problem, None
        return kept

    def _take_snapshot(self) -> Snapshot | None:
        """Snapshot for the autosave; None if the scene stays locked for `LOCK_WAIT_S`."""
        if not self._painting.lock.acquire(timeout=LOCK_WAIT_S):  # no endless wait: the holder may wait for us
            return None
        try:
            if not self.changed:
                return Snapshot(None, None)
            steps = [step for step in self._painting.history.done if step.number > self._saved[0]]
            return Snapshot(self._painting.snapshot(), self._painting.state, steps)
        finally:
            self._painting.lock.release()
