"""A canvas with its file: saved over nobody else's work, and not lost with the process."""

import os
from pathlib import Path
from typing import Final, Self

from hapscene.errors import SaveConflict, SceneError
from hapscene.paint.autosave import INTERVAL_S, Autosave, Recovery, Sight, find_recovery
from hapscene.paint.painting import Canvas
from hapscene.paint.save import check_unchanged, stamp_of
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.scene_file import SUFFIX, check_place

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
        self._stamp = stamp_of(path) if path is not None else None
        self._autosave: Autosave | None = None
        self._problem: str | None = None
        self._interval_s: float | None = None  # of the autosave, where one is wanted
        self._looks = 0

    @classmethod
    def open(cls, path: Path, accept_changed: bool = False) -> Self:
        """Load a scene file to paint it.

        Args:
            path: NAME.scene.json.
            accept_changed: as `hapscene.load_scene` has it; then there is something to save: the file knows the old
                meshes.

        Raises:
            SceneError, MeshError, SwatchError: as `hapscene.load_scene`.
        """
        real = path.resolve()
        if not path.is_symlink() or not real.name.endswith(SUFFIX):
            real = path
        stamp = stamp_of(path)  # before it is read: what changes meanwhile counts as changed
        session = cls(load_scene(path, accept_changed), real)  # a painter of a link is one of the file
        session._stamp = stamp
        if accept_changed:
            session._saved = (-1, 0)
        return session

    @property
    def dirty(self) -> bool:
        """Whether there is something to save: it was changed, or there is no file of it yet."""
        return self.changed or not self._stamp

    def save(self, path: Path | None = None, force: bool = False) -> Path:
        """Save the scene, to `path` from now on where one is given; its file.

        Args:
            path: NAME.scene.json; None for the one there is.
            force: write over a file that is not the one that was loaded.

        Raises:
            SaveConflict: the file changed since it was loaded; or another is there, or what a killed painter of it
                left: ask the user, then force.
            SceneError: no path, another suffix, it is open in another painter, or cannot be written.
        """
        with self.lock:
            self.settle()
            target = Path(path) if path is not None else self.path
            if target is None:
                raise SceneError("where shall the scene be saved? give a file NAME.scene.json")
            same = self.path is not None and target.resolve() == self.path.resolve()
            check_place(target)
            old = autosave = self._autosave
            if self._interval_s is not None and (old is None or not same):
                autosave = Autosave(target, self._look, self._interval_s)  # its lock first of all
            try:
                if not force:
                    self._check(target, same, autosave)
                self.scene.save(target)
            except BaseException:
                if autosave is not None and autosave is not old:
                    autosave.close()
                raise
            self.path, self._stamp, self._autosave = target, stamp_of(target), autosave
            self._problem = None
            self.mark_saved()
        if old is not None:
            old.write() if same else old.close()  # all is saved: it removes what it wrote
        return target

    def _check(self, target: Path, same: bool, autosave: Autosave | None) -> None:
        if not same and (find_recovery(target) if autosave is None else autosave.found):
            raise SaveConflict(
                f"{target}: was painted and not saved, for its painter was killed; open it to recover that, or save "
                "over it, which leaves that to be recovered"
            )
        check_unchanged(target, self._stamp if same else None)

    def recovery(self) -> Recovery | None:
        """What a killed painter of this scene left, the last of them; None without."""
        if self._autosave is not None:
            return self._autosave.found[0] if self._autosave.found else None
        return find_recovery(self.path) if self.path is not None else None

    def recover(self, recovery: Recovery) -> str:
        """Bring back what a killed painter left, as one step, which undo takes back; what it was.

        It is removed once it is autosaved here, and offered anew until then.

        Raises:
            HapsceneError: it cannot be loaded, or is of other bodies.
        """
        scene = recovery.load()
        try:
            what = self.take_painting(scene, "recovered painting")
        except SceneError as error:
            raise SceneError(f"{recovery.file}: {error}") from None
        if self._autosave is not None and self._autosave.write():
            recovery.discard()
        self._forget(recovery)
        return what

    def discard_recovery(self, recovery: Recovery) -> None:
        """Remove what a killed painter left."""
        recovery.discard()
        self._forget(recovery)

    def _forget(self, recovery: Recovery) -> None:
        if self._autosave is not None:
            self._autosave.found = [left for left in self._autosave.found if left != recovery]

    def start_autosave(self, interval_s: float = INTERVAL_S) -> None:
        """Write what is not saved beside the scene file from now on; what a killed painter left stays.

        Without a path nothing is written: there is no place for it. Nor is it in a folder that cannot be written, as
        `problem` then says, until the scene is saved elsewhere.

        Raises:
            SceneError: another painter is at that file.
        """
        self._interval_s = interval_s
        if self.path is None or self._autosave is not None:
            return
        folder = self.path.resolve().parent
        if os.access(folder, os.W_OK):
            self._autosave = Autosave(self.path, self._look, interval_s)
        else:
            self._problem = f"no autosave: nothing may be written into {folder}; save the scene elsewhere"

    @property
    def autosaves(self) -> bool:
        """Whether what is not saved is written beside the scene."""
        return self._autosave is not None

    @property
    def problem(self) -> str | None:
        """Why the last autosave failed, in a sentence; None where it did not."""
        return self._autosave.problem if self._autosave is not None else self._problem

    def close(self, keep: bool = False) -> bool:
        """Stop to autosave. What is not saved is lost; or (`keep`) it is written, and offered at the next start.

        Returns:
            Whether there is something to offer.
        """
        self._interval_s = None
        if self._autosave is None:
            return False
        kept = self._autosave.close(keep)
        self._problem, self._autosave = self._autosave.problem, None
        return kept

    def _look(self) -> Sight | None:
        """For the autosave: a copy of what is not saved; None while the scene is held for longer than `LOOK_S`."""
        if not self.lock.acquire(timeout=LOOK_S):
            return None
        try:
            self._looks += 1
            return Sight(self._looks, *((self.snapshot(), self.state) if self.changed else (None, None)))
        finally:
            self.lock.release()
