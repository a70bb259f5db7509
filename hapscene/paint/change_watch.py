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
    """

    faces: dict[int, NDArray[np.int64]]
    swatches: tuple[int, ...]
    shelf: bool

    def __repr__(self) -> str:
        counts = {body: len(faces) for body, faces in self.faces.items()}
        return f"<Changes: faces by body {counts}, swatches {list(self.swatches)}{', the shelf' if self.shelf else ''}>"

    def __bool__(self) -> bool:
        return bool(self.faces or self.swatches or self.shelf)


class Watch:
    """Gathers what changes until it is taken: a bit a face, however long nobody looks."""

    def __init__(self, face_counts: list[int]) -> None:
        self._faces = [np.zeros(count, np.bool_) for count in face_counts]
        self._touched: set[int] = set()
        self._swatches: set[int] = set()
        self._shelf = False

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
        found = Changes(faces, swatches, self._shelf)
        self._touched, self._swatches, self._shelf = set(), set(), False
        return found
