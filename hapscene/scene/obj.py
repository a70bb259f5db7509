"""Reader of Wavefront OBJ files.

The reader of trimesh splits vertices at texture seams, sorts faces by material, and accepts indices past the end. This
one keeps shared positions and the order of the faces, and names the line of an error. Material files are read by
trimesh.
"""

# mypy: allow-untyped-calls

import io
from array import array
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import MeshError
from hapscene.scene.material import Material
from hapscene.scene.mesh import UNNAMED, Part, sample

if TYPE_CHECKING:
    from trimesh.visual.material import SimpleMaterial

    from hapscene.scene.mesh_file import FolderResources

__all__ = ["LINE_MAX", "read_obj"]


def read_obj(content: bytes, where: str, resolver: "FolderResources") -> Part:
    """Read the triangles of an OBJ file. Polygons are divided into fans from their first corner, as in trimesh.

    `resolver` returns the content of files beside it by name, as `trimesh.resolvers` do.

    Raises:
        MeshError: an invalid line, or an index out of range; `where` names the file.
    """
    reader = _Reader(where)
    for reader.line, tokens in _lines(content, where):
        if tokens and (read := _READ.get(tokens[0])):  # other statements are lines, points, and free-form geometry
            read(reader, tokens[1:])
    group = np.asarray(reader.group)
    uv = _uv(reader)
    materials = _materials(reader, resolver) if reader.f else {}
    part = Part(_rows(reader.v), _rows(reader.f), group, list(reader.names), _colours(reader, materials, uv), uv)
    if materials:
        made = {name: Material.of(material) for name, material in materials.items()}
        part.materials = [material for material in made.values() if material is not None]
        place = {name: part.materials.index(material) for name, material in made.items() if material is not None}
        part.material = np.array([place.get(name, -1) for name in reader.material_of], np.int16)[group]
    return part


LINE_MAX: Final = 1_000_000
"""Maximum length of a line [characters]: a face with 100,000 corners."""


def _lines(content: bytes, where: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number and the tokens of each line; a backslash at the end joins lines.

    Raises:
        MeshError: a line is longer than `LINE_MAX`.
    """
    held: list[str] = []  # lines that end with a backslash
    number = length = 0
    for number, line in enumerate(io.TextIOWrapper(io.BytesIO(content), "utf-8", "replace"), 1):
        length += len(line)
        if length > LINE_MAX:
            raise MeshError(f"{where}, line {number}: longer than {LINE_MAX:,} characters")
        if line.endswith("\\\n"):
            held.append(line[:-2])
            continue
        yield number, " ".join([*held, line]).split()
        held, length = [], 0
    yield number, " ".join(held).split()


def _rows(numbers: "array[Any]", width: int = 3) -> NDArray[Any]:
    return np.asarray(numbers).reshape(-1, width)


class _Reader:
    """State of the reader: the data read so far and the current names."""

    def __init__(self, where: str) -> None:
        self.where, self.line = where, 0
        # flat arrays: 3 numbers per vertex, vertex colour and face, 2 per texture coordinate
        self.v, self.rgb, self.vt = array("d"), array("d"), array("d")
        self.f, self.f_vt = array("i"), array("i")  # −1 for faces without texture coordinates
        self.group = array("i")
        self.names: dict[str, int] = {}
        self.material_of: list[str | None] = []  # of each name in names
        self.object = self.part = self.material = ""
        self.mtllib: list[str] = []
        self.current: int | None = None

    def name(self) -> int:
        """Return the index of the group of the next face."""
        if self.current is None:
            parts = dict.fromkeys(part for part in (self.object, self.part, self.material) if part)
            full = "/".join(parts) or UNNAMED
            self.current = self.names.setdefault(full, len(self.names))
            if self.current == len(self.material_of):
                self.material_of.append(self.material or None)
        return self.current

    def numbers(self, tokens: list[str], start: int, end: int, expected: str) -> list[float]:
        """Parse the tokens from `start` to `end` of a line as numbers."""
        try:
            found = [float(word) for word in tokens[start:end]]
            if len(found) == end - start:
                return found
        except ValueError:
            pass
        raise self.fail(f"expected {expected}, not {' '.join(tokens)[:60]!r}")

    def pad(self) -> None:
        """Mark faces before the first texture coordinate as having none."""
        self.f_vt.extend(array("i", [-1]) * (len(self.f) - len(self.f_vt)))

    def fail(self, problem: str) -> MeshError:
        return MeshError(f"{self.where}, line {self.line}: {problem}")


def _vertex(reader: _Reader, tokens: list[str]) -> None:
    reader.v.extend(reader.numbers(tokens, 0, 3, "three numbers after 'v'"))
    if len(tokens) >= 6:
        reader.rgb.extend(reader.numbers(tokens, 3, 6, "a colour after the position"))


def _texture(reader: _Reader, tokens: list[str]) -> None:
    u, *v = reader.numbers(tokens, 0, 2 if len(tokens) > 1 else 1, "two numbers after 'vt'")
    reader.vt.extend([u, *v] if v else [u, 0.0])


def _normal(reader: _Reader, tokens: list[str]) -> None:
    """Check a vertex normal. Normals are not used, but an incomplete line shows that the file is truncated."""
    reader.numbers(tokens, 0, 3, "three numbers after 'vn'")


def _face(reader: _Reader, tokens: list[str]) -> None:
    if len(tokens) < 3:
        raise reader.fail(f"expected a face with at least three corners, not {' '.join(tokens)[:60]!r}")
    corners, textures = [], []
    vertex_count, texture_count = len(reader.v) // 3, len(reader.vt) // 2
    for word in tokens:
        fields = word.split("/")
        corners.append(_index(reader, fields[0], vertex_count, "vertex"))
        has_texture = len(fields) > 1 and fields[1] and reader.vt
        textures.append(_index(reader, fields[1], texture_count, "texture coordinate") if has_texture else -1)
    group = reader.name()
    if reader.vt:  # the file has texture coordinates
        reader.pad()
        for i in range(1, len(tokens) - 1):
            reader.f_vt.extend((textures[0], textures[i], textures[i + 1]))
    for i in range(1, len(tokens) - 1):
        reader.f.extend((corners[0], corners[i], corners[i + 1]))
        reader.group.append(group)


def _index(reader: _Reader, word: str, count: int, what: str) -> int:
    """Convert an OBJ index, which counts from 1, or backwards from −1, to a zero-based index."""
    try:
        number = int(word)
    except ValueError:
        raise reader.fail(f"expected the index of a {what}, not {word[:60]!r}") from None
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise reader.fail(f"{what} index {number} out of range; {count} are defined so far")
    return index


def _named(attribute: str) -> Callable[[_Reader, list[str]], None]:
    def read(reader: _Reader, tokens: list[str]) -> None:
        setattr(reader, attribute, " ".join(tokens))
        reader.current = None

    return read


def _library(reader: _Reader, tokens: list[str]) -> None:
    reader.mtllib.append(" ".join(tokens))


_READ = {
    "v": _vertex,
    "vt": _texture,
    "vn": _normal,
    "f": _face,
    "o": _named("object"),
    "g": _named("part"),
    "usemtl": _named("material"),
    "mtllib": _library,
}


def _uv(reader: _Reader) -> NDArray[np.float32] | None:
    """Return texture coordinates of the corners of every face (m, 3, 2), NaN for faces without, or None."""
    if not reader.vt or not reader.f:
        return None
    reader.pad()
    f_vt = _rows(reader.f_vt)
    uv = _rows(reader.vt, 2).astype(np.float32)[f_vt]
    uv[(f_vt < 0).any(axis=1)] = np.nan
    return np.asarray(uv)


def _colours(
    reader: _Reader, materials: "dict[str | None, SimpleMaterial]", corners: NDArray[np.float32] | None
) -> NDArray[np.uint8] | None:
    """Return the colour of every face (m, 3) from its material, else from its vertices, else None."""
    if not reader.f:
        return None
    if not materials:
        if len(reader.rgb) != len(reader.v):
            return None
        mean = _rows(reader.rgb)[_rows(reader.f)].mean(axis=1)
        return np.asarray(np.clip(np.nan_to_num(mean) * 255, 0, 255).round().astype(np.uint8))
    group, uv = np.asarray(reader.group), None
    if corners is not None:
        uv = np.nan_to_num(corners).mean(axis=1)
    colour = np.full((len(group), 3), 160, np.uint8)
    for index, name in enumerate(reader.material_of):
        chosen = group == index
        if name in materials and chosen.any():
            colour[chosen] = sample(materials[name], None if uv is None else uv[chosen], int(chosen.sum()))
    return colour


def _materials(reader: _Reader, resolver: "FolderResources") -> "dict[str | None, SimpleMaterial]":
    from trimesh.exchange.obj import parse_mtl
    from trimesh.visual.material import SimpleMaterial

    materials: dict[str | None, SimpleMaterial] = {}
    for library in reader.mtllib:
        with suppress(Exception):  # colours are for display only
            parsed = parse_mtl(resolver[library], resolver=resolver)
            materials.update({name: SimpleMaterial(**values) for name, values in parsed.items()})
    return materials
