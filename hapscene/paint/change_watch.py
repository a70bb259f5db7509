"""What changed in a painted scene, for those who show or feel it: each watches for itself."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Changes:
    """What is different since the last look.

    Attributes:
        faces: by index of the body, faces (n,) int64, ascending, whose swatch may be another one.
        swatches: indices of swatches whose numbers, name or colour are others, or that are new.
        shelf: whether the list of the scene's swatches is another one: some came, went, or were renamed.
        bodies: whether some bodies came, went, or have another mesh or name; then `faces` tells of none.
        poses: whether some are elsewhere, or hang on others.
    """

    faces: dict[int, NDArray[np.int64]]
    swatches: tuple[int, ...]
    shelf: bool
    bodies: bool = False
    poses: bool = False

    def __repr__(self) -> str:
        counts = {body: len(faces) for body, faces in self.faces.items()}
        more = "".join(f", the {name}" for name in ("shelf", "bodies", "poses") if getattr(self, name))
        return f"<Changes: faces by body {counts}, swatches {list(self.swatches)}{more}>"

    def __bool__(self) -> bool:
        return bool(self.faces or self.swatches or self.shelf or self.bodies or self.poses)


class Watch:
    """Gathers what changes until it is taken: a bit a face, however long nobody looks."""

    def __init__(self, face_counts: list[int]) -> None:
        self._faces = [np.zeros(count, np.bool_) for count in face_counts]
        self._touched: set[int] = set()
        self._swatches: set[int] = set()
        self._shelf = self._bodies = self._poses = False

    def note_bodies(self, face_counts: list[int]) -> None:
        """There are other bodies."""
        self._faces = [np.zeros(count, np.bool_) for count in face_counts]
        self._touched = set()
        self._bodies = True

    def note_poses(self) -> None:
        """Bodies are elsewhere."""
        self._poses = True

    def note_faces(self, body: int, faces: NDArray[np.integer]) -> None:
        """Faces (n,) of a body were painted."""
        if len(faces):
            self._faces[body][faces] = True
            self._touched.add(body)

    def note_swatch(self, swatch: int, shelf: bool) -> None:
        """A swatch has other numbers, or (`shelf`) is new, gone or renamed."""
        self._swatches.add(swatch)
        self._shelf |= shelf

    def take(self, swatch_count: int) -> Changes:
        """What was gathered; from now on anew."""
        faces = {body: np.flatnonzero(self._faces[body]) for body in sorted(self._touched)}
        for body in self._touched:
            self._faces[body][:] = False
        swatches = tuple(sorted(i for i in self._swatches if i < swatch_count))
        found = Changes(faces, swatches, self._shelf, self._bodies, self._poses)
        self._touched, self._swatches = set(), set()
        self._shelf = self._bodies = self._poses = False
        return found
