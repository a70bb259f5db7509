"""A canvas with its file: saved over nobody else's work, and not lost with the process."""

from pathlib import Path
from typing import Final, Self

from hapscene.errors import SceneError
from hapscene.paint.autosave import INTERVAL_S, Autosave, Recovery, Sight, discard, find_recovery
from hapscene.paint.canvas import Canvas
from hapscene.paint.save import Stamp, check_unchanged, stamp_of
from hapscene.scene.file import load_scene
from hapscene.scene.scene import Scene

LOOK_S: Final = 0.2
"""How long the autosave waits for a scene that is being changed [s], before it comes again: whoever holds the scene may
wait for the autosave in turn."""


class Kept(Canvas):
    """A canvas that is saved to a file, and autosaved beside it.

    Attributes:
        path: where `save` writes; None where that is not known yet.
    """

    def __init__(self, scene: Scene, path: Path | None) -> None:
        super().__init__(scene)
        self.path = path
        self._stamp: Stamp | None = stamp_of(path) if path is not None else None
        self._autosave: Autosave | None = None
        self._looks = 0

    @classmethod
    def open(cls, path: Path) -> Self:
        """Load a scene file to paint it.

        Raises:
            SceneError, MeshError, SwatchError: as `hapscene.load_scene`.
        """
        stamp = stamp_of(path)  # before it is read: what changes meanwhile counts as changed
        session = cls(load_scene(path), path)
        session._stamp = stamp
        return session

    def save(self, path: Path | None = None, force: bool = False) -> Path:
        """Save the scene, to `path` from now on where one is given; its file.

        Args:
            path: NAME.scene.json; None for the one there is.
            force: write over a file that is not the one that was loaded.

        Raises:
            SaveConflict: the file changed since it was loaded, or another is there: ask the user, then force.
            SceneError: no path, another suffix, it is open in another painter, or cannot be written.
        """
        with self.lock:
            self.settle()
            target = Path(path) if path is not None else self.path
            if target is None:
                raise SceneError("where shall the scene be saved? give a file NAME.scene.json")
            same = self.path is not None and target.resolve() == self.path.resolve()
            if not force:
                check_unchanged(target, self._stamp if same else None)
            self.scene.save(target)
            self.path, self._stamp = target, stamp_of(target)
            self.mark_saved()
        if self._autosave is not None:
            if same:
                self._autosave.write()  # all is saved: it removes what it wrote
            else:
                self.close()
                self.start_autosave()
        return target

    def recovery(self) -> Recovery | None:
        """What a killed painter of this scene left: to be asked for before `start_autosave`; None without."""
        return find_recovery(self.path) if self.path is not None else None

    def recover(self, recovery: Recovery) -> str:
        """Bring back what a killed painter left, as one step, which undo takes back; what it was.

        Raises:
            HapsceneError: it cannot be loaded, or is of other bodies.
        """
        return self.take_painting(recovery.load(), "recovered painting")

    def discard_recovery(self) -> None:
        """Remove what a killed painter left.

        Raises:
            SceneError: another painter is at it.
        """
        if self.path is not None:
            discard(self.path)

    def start_autosave(self, interval_s: float = INTERVAL_S) -> None:
        """Write what is not saved beside the scene file from now on, over what a killed painter left there.

        Without a path nothing is written: there is no place for it.

        Raises:
            SceneError: another painter is at that file, or the folder cannot be written.
        """
        if self.path is not None and self._autosave is None:
            base = self._stamp.sha256 if self._stamp is not None else ""
            self._autosave = Autosave(self.path, base, self._look, interval_s)

    @property
    def problem(self) -> str | None:
        """Why the last autosave failed, in a sentence; None where it did not."""
        return self._autosave.problem if self._autosave is not None else None

    def close(self, keep: bool = False) -> None:
        """Stop to autosave. What is not saved is lost; or (`keep`) it is written, and offered at the next start."""
        if self._autosave is not None:
            self._autosave.close(keep)
            self._autosave = None

    def _look(self) -> Sight | None:
        """For the autosave: a copy of what is not saved; None while the scene is held for longer than `LOOK_S`."""
        if not self.lock.acquire(timeout=LOOK_S):
            return None
        try:
            self._looks += 1
            return Sight(self._looks, *((self.snapshot(), self.state) if self.dirty else (None, None)))
        finally:
            self.lock.release()
