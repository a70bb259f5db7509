"""OFF files: a reader of triangles that names the line of an error.

The reader of trimesh expects the counts and each face in one line, and ignores what follows the declared faces.
"""

import io
import re
from array import array
from typing import Final

import numpy as np

from hapscene.errors import MeshError
from hapscene.scene.mesh import UNNAMED, Part
from hapscene.scene.obj import LINE_MAX

__all__ = ["read_off"]

_KEYWORD: Final = re.compile(r"[A-Z]*OFF")
_COUNT: Final = re.compile(r"\d{1,18}")


def read_off(content: bytes, where: str) -> Part:
    """Read the triangles of an OFF file. Polygons are divided and ordered as in trimesh.

    Normals, colours and texture coordinates are ignored.

    Raises:
        MeshError: the file is damaged, truncated, or holds more than its header declares.
    """
    from trimesh.geometry import triangulate_quads

    reader = _Reader(content, where)
    vertices, faces = array("d"), list[list[int]]()
    vertex_count = face_count = 0
    try:
        vertex_count, face_count = reader.counts()
        for _ in range(vertex_count):
            vertices.extend(reader.vertex())
        faces.extend(reader.face(vertex_count) for _ in range(face_count))
    except EOFError:
        raise MeshError(
            f"{where}: truncated: the header declares {vertex_count:,} vertices and {face_count:,} faces, but the file "
            f"ends after {len(vertices) // 3:,} vertices and {len(faces):,} faces"
        ) from None
    if not reader.ended():
        raise reader.fail(f"more data than the {face_count:,} faces in the header; export the file again")
    corners = np.asarray(triangulate_quads(faces)).reshape(-1, 3)
    return Part(np.reshape(vertices, (-1, 3)), corners, np.zeros(len(corners), np.int16), [UNNAMED])


class _Reader:
    """Reads records, each of which begins in a new line."""

    def __init__(self, content: bytes, where: str) -> None:
        self._lines = enumerate(io.TextIOWrapper(io.BytesIO(content), "utf-8-sig", "replace"), 1)
        self._where, self._line = where, 0

    def counts(self) -> tuple[int, int]:
        """Read the keyword and return the numbers of vertices and faces; the number of edges is ignored."""
        keyword, *tokens = self._take(1)
        tokens = tokens or self._take(1)
        if len(tokens) == 1:
            tokens += self._take(2)
        if not _KEYWORD.fullmatch(keyword) or not all(map(_COUNT.fullmatch, tokens[:2])):
            raise self.fail("not a valid OFF file: expected OFF and the numbers of vertices and faces")
        return int(tokens[0]), int(tokens[1])

    def vertex(self) -> list[float]:
        tokens = self._take(3)[:3]
        try:
            return [float(token) for token in tokens]
        except ValueError:
            raise self.fail(f"expected three coordinates, not {' '.join(tokens)[:60]!r}") from None

    def face(self, vertex_count: int) -> list[int]:
        tokens = self._take(1)
        try:
            count = int(tokens[0])
            if count >= 3:
                if len(tokens) <= count:
                    tokens += self._take(count + 1 - len(tokens))
                corners = [int(token) for token in tokens[1 : count + 1]]
                if all(0 <= corner < vertex_count for corner in corners):
                    return corners
        except ValueError:
            pass
        raise self.fail(
            f"expected a number from 3 and as many indices of the {vertex_count:,} vertices, not "
            f"{' '.join(tokens)[:60]!r}"
        )

    def ended(self) -> bool:
        """Return whether no more data follows."""
        try:
            return not self._take(1)
        except EOFError:
            return True

    def fail(self, problem: str) -> MeshError:
        return MeshError(f"{self._where}, line {self._line}: {problem}")

    def _take(self, count: int) -> list[str]:
        """Return the tokens of as many lines as hold at least `count`, without comments.

        Raises:
            EOFError: the file ended.
        """
        tokens: list[str] = []
        while len(tokens) < count:
            self._line, line = next(self._lines, (self._line, ""))
            if not line:
                raise EOFError
            if len(line) > LINE_MAX:
                raise self.fail(f"longer than {LINE_MAX:,} characters")
            tokens += line.partition("#")[0].split()
        return tokens
