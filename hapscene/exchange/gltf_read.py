"""A scene from glTF that `hapscene.exchange.gltf` wrote, or that another program wrote from it with its extras.

Files come from strangers: nothing is made before the file is known to hold it, nodes may not run in circles, no other
file is opened.
"""

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError
from hapscene.exchange.carried import check_version, is_digest, known_swatch, lose, restore
from hapscene.exchange.gltf_file import parts_of, read_bounded
from hapscene.exchange.piece import Piece, join
from hapscene.scene.file import BODY_MAX
from hapscene.scene.mesh import FACE_MAX, Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import PLAIN, Swatch

_TYPES: Final = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS: Final = {"SCALAR": 1, "VEC3": 3}
_TRIANGLES: Final = 4


def read_gltf(path: Path) -> Scene | None:
    """The scene of a glTF file; None where it bears no mark of hapscene, and is a mesh like any other.

    Raises:
        SceneError: damaged, too large, compressed, or of a later version.
        MeshError, SwatchError: a mesh or a swatch in it is broken.
    """
    content = read_bounded(path)
    tree, blob = parts_of(path, content)
    reader = _Reader(path, tree, blob)
    bodies = reader.bodies()
    if not bodies:
        reader.check_counts(len(content))
        return None
    scene = Scene()
    for extras, X_WB, meshes in bodies:
        reader.add_body(scene, extras, X_WB, meshes)
    return scene


class _Reader:
    """Items of the tree, each looked up with care."""

    def __init__(self, path: Path, tree: dict[str, Any], blob: bytes) -> None:
        self.path, self.tree, self.blob = path, tree, blob
        self.shapes: dict[tuple[int, ...], tuple[Mesh, NDArray[np.int64]]] = {}
        self.swatches: dict[int, Swatch | str] = {}
        self.made = 0  # faces and vertices so far

    def fail(self, problem: str) -> SceneError:
        return SceneError(f"{self.path}: {problem}")

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        items = self.tree.get(kind, [])
        if type(index) is not int or not isinstance(items, list) or not 0 <= index < len(items):
            raise self.fail(f"no {kind}[{str(index)[:20]}]")
        if not isinstance(items[index], dict):
            raise self.fail(f"{kind}[{index}] must be an object")
        return dict(items[index])

    def check_counts(self, size: int) -> None:
        """An accessor without data stands for zeros, as many as it says; the best compression has one in a few bits."""
        accessors = self.tree.get("accessors", [])
        for i, accessor in enumerate(accessors if isinstance(accessors, list) else []):
            if not isinstance(accessor, dict) or not _whole(accessor.get("count")) or accessor["count"] > 100 * size:
                raise self.fail(f"accessors[{i}] has a count that the file of {size:,} bytes cannot hold")

    def bodies(self) -> list[tuple[dict[str, Any], NDArray[np.float64], tuple[int, ...]]]:
        """Extras, pose in the scene and meshes of every node that is marked as a body."""
        tree = self.tree
        start = tree.get("scene", 0)
        roots = self.item("scenes", start).get("nodes", []) if tree.get("scenes") else []
        stack = [(node, np.eye(4)) for node in _indices(roots)[::-1]]
        seen: set[int] = set()
        found = []
        while stack:
            index, X = stack.pop()
            node = self.item("nodes", index)
            if index in seen:
                raise self.fail(f"nodes[{index}] hangs in two places, or within itself")
            seen.add(index)
            extras = _extras(node)
            X = X @ self.pose(node, index)
            if "hapscene_version" in extras:
                check_version(self.path, extras["hapscene_version"])
                X = np.eye(4)  # poses are those in the scene's own frame, whatever the file's axes
            children = _indices(node.get("children", []))
            if "hapscene_body" in extras:
                found.append((extras, X, self.meshes_below(index, node)))
                if len(found) > BODY_MAX:
                    raise self.fail(f"more than {BODY_MAX:,} bodies")
                continue
            stack += [(child, X) for child in children[::-1]]
        return found

    def meshes_below(self, index: int, node: dict[str, Any]) -> tuple[int, ...]:
        """Meshes of a body: its own and those of its children, which stay where the body is."""
        meshes = [node["mesh"]] if "mesh" in node else []
        for child in _indices(node.get("children", [])):
            below = self.item("nodes", child)
            if not np.array_equal(self.pose(below, child), np.eye(4)):
                raise self.fail(f"nodes[{child}] has been moved within its body, nodes[{index}]; move the body instead")
            if "mesh" in below:
                meshes.append(below["mesh"])
        if not all(type(mesh) is int for mesh in meshes):
            raise self.fail(f"nodes[{index}]: a mesh is named by its index")
        return tuple(meshes)

    def pose(self, node: dict[str, Any], index: int) -> NDArray[np.float64]:
        where = f"nodes[{index}]"
        if "matrix" in node:
            return self.numbers(node["matrix"], 16, f"{where}.matrix").reshape(4, 4).T
        X = np.eye(4)
        if "rotation" in node:
            X[:3, :3] = _rotation(self.numbers(node["rotation"], 4, f"{where}.rotation"))
        if "scale" in node:
            X[:3, :3] *= self.numbers(node["scale"], 3, f"{where}.scale")
        if "translation" in node:
            X[:3, 3] = self.numbers(node["translation"], 3, f"{where}.translation")
        return X

    def numbers(self, value: Any, count: int, where: str) -> NDArray[np.float64]:
        fits = isinstance(value, list) and len(value) == count
        if not fits or not all(type(x) in (int, float) and -1e100 < x < 1e100 for x in value):
            raise self.fail(f"{where} must be {count} finite numbers")
        return np.array(value, np.float64)

    def add_body(
        self, scene: Scene, extras: dict[str, Any], X_WB: NDArray[np.float64], meshes: tuple[int, ...]
    ) -> None:
        name, two_sided = extras["hapscene_body"], extras.get("two_sided", False)
        if not isinstance(name, str) or two_sided not in (False, True):  # 0 and 1 too: some programs know no bool
            raise self.fail("a body needs its name and two_sided, true or false, in its extras")
        if meshes not in self.shapes:
            pieces = [piece for mesh in meshes for piece in self.pieces(mesh)]
            if not pieces:
                raise self.fail(f"body {name[:60]!r} has no mesh")
            vertices, faces, material = join(pieces)
            self.shapes[meshes] = Mesh(vertices, faces.astype(np.int32)), material
        shape, material = self.shapes[meshes]
        self.count(len(material))
        body = scene.add(shape, name=name, pose=X_WB, two_sided=bool(two_sided))
        for index in np.unique(material):
            if index >= 0:
                body.face_swatch[material == index] = scene.swatch_index(self.swatch(int(index)))

    def pieces(self, mesh: int) -> list[Piece]:
        """One for each primitive; its `swatch` is the index of its material, −1 without."""
        pieces = []
        primitives = self.item("meshes", mesh).get("primitives", [])
        for primitive in primitives if isinstance(primitives, list) else []:
            if not isinstance(primitive, dict) or primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                raise self.fail(f"meshes[{mesh}]: only triangles can be touched")
            if packed := sorted(primitive.get("extensions") or {}):
                raise self.fail(f"meshes[{mesh}] is compressed ({packed[0][:60]}); export it without compression")
            attributes = primitive.get("attributes")
            corners = self.accessor(attributes.get("POSITION") if isinstance(attributes, dict) else None, "VEC3", "f")
            if "indices" in primitive:
                flat = self.accessor(primitive["indices"], "SCALAR", "u").astype(np.int64)
            else:
                flat = np.arange(len(corners))
            if flat.size % 3 or not flat.size or flat.max() >= len(corners):
                raise self.fail(f"meshes[{mesh}]: its indices do not make triangles of its {len(corners):,} vertices")
            material = primitive.get("material", -1)
            if type(material) is not int:
                raise self.fail(f"meshes[{mesh}]: a material is named by its index")
            self.count(len(flat) // 3 + len(corners))
            pieces.append(Piece(material, corners.astype(np.float64), flat.reshape(-1, 3)))
        return pieces

    def count(self, more: int) -> None:
        """A small file can name the same numbers over and over."""
        self.made += more
        if self.made > 2 * FACE_MAX:
            raise self.fail(f"more than {2 * FACE_MAX:,} faces and vertices")

    def accessor(self, index: Any, kind: str, sort: str) -> NDArray[Any]:
        """Numbers (n,) or (n, 3) of the buffer, which must hold them."""
        accessor = self.item("accessors", index)
        where = f"accessors[{index}]"
        dtype = _TYPES.get(accessor.get("componentType", 0)) if _whole(accessor.get("componentType", 0)) else None
        if accessor.get("type") != kind or dtype is None or np.dtype(dtype).kind != sort or "sparse" in accessor:
            raise self.fail(
                f"{where} must be {kind} of {'float32' if sort == 'f' else 'unsigned whole numbers'}, dense"
            )
        view = self.item("bufferViews", accessor.get("bufferView"))
        width = _WIDTHS[kind] * np.dtype(dtype).itemsize
        layout: list[Any] = [accessor.get("count"), view.get("byteStride", width)]
        layout += [view.get("byteOffset", 0), accessor.get("byteOffset", 0)]
        if not all(_whole(n) for n in layout) or layout[0] == 0 or layout[1] < width:
            raise self.fail(f"{where} has a count or offset that is no whole number")
        count, stride, *start = (int(n) for n in layout)
        first = sum(start)
        end = first + (count - 1) * stride + width
        if end > len(self.blob) or view.get("buffer", 0) != 0:
            raise self.fail(f"{where} reaches past the file's buffer of {len(self.blob):,} bytes: truncated?")
        if stride == width:
            rows = np.frombuffer(self.blob, dtype, count * _WIDTHS[kind], first)
        else:  # interleaved with other attributes
            rows = np.ndarray((count, _WIDTHS[kind]), dtype, self.blob, first, (stride, np.dtype(dtype).itemsize))
        return rows.reshape(count, 3) if kind == "VEC3" else rows.ravel()

    def swatch(self, index: int) -> Swatch | str:
        """The swatch of a material by its extras; where they are gone, the library's of its name; else plain."""
        if index not in self.swatches:
            self.swatches[index] = self.restored(self.item("materials", index))
        return self.swatches[index]

    def restored(self, material: dict[str, Any]) -> Swatch | str:
        extras = _extras(material)
        name, text = extras.get("hapscene_swatch"), extras.get("swatch_file")
        if isinstance(name, str) and is_digest(extras.get("sha256")):
            text = text if isinstance(text, str) else None
            return restore(self.path, name, extras, extras.get("albedo_rgb"), extras["sha256"], text)
        name = str(material.get("name", ""))
        if known_swatch(name) is not None:
            return name
        lose(f"{self.path}: material {name[:60]!r} is no swatch, in its extras or the library: its faces stay plain")
        return PLAIN


def _extras(item: dict[str, Any]) -> dict[str, Any]:
    extras = item.get("extras")
    return extras if isinstance(extras, dict) else {}


def _whole(value: Any) -> bool:
    return type(value) is int and 0 <= value < 1 << 40


def _indices(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list) else []


def _rotation(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrix (3, 3) of a quaternion x, y, z, w."""
    norm = math.sqrt(float(q @ q)) or 1.0
    x, y, z, w = (q / norm).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
