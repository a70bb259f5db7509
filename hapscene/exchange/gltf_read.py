"""A scene from glTF that `hapscene.exchange.gltf` wrote, or that another program wrote from it with its extras.

Files come from strangers: nothing is made before the file is known to hold it, nodes may not run in circles, and of
other files those alone are opened that lie beside it (`hapscene.scene.companion`).

What another program added is no less part of the scene: a node with a mesh that is no body's becomes a body.
"""

import itertools
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.exchange.carried import check_version, is_digest, known_swatch, lose, restore
from hapscene.exchange.gltf_file import parts_of, read_bounded
from hapscene.exchange.gltf_tree import Tree, extras_of
from hapscene.exchange.mark import OWN, mark_in
from hapscene.exchange.piece import Piece, join
from hapscene.scene.body import RIGID_TOLERANCE
from hapscene.scene.file import BODY_MAX
from hapscene.scene.mesh import FACE_MAX, Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import PLAIN, Swatch

_TRIANGLES: Final = 4


def read_gltf(path: Path) -> Scene | None:
    """The scene of a glTF file; None where it bears no mark of hapscene, and is a mesh like any other.

    Raises:
        SceneError: damaged, too large, compressed, or of a later version.
        MeshError, SwatchError: a mesh or a swatch in it is broken.
    """
    content = read_bounded(path)
    if mark_in(path.suffix, content) != OWN:
        return None  # not looked into further: what another program wrote need not please us
    tree, blobs = parts_of(path, content)
    reader = _Reader(path, tree, blobs)
    bodies = reader.bodies()
    if not bodies:
        return None
    reader.check_packing("the file", dict.fromkeys(reader.texts("extensionsRequired")))
    scene = Scene()
    for body in bodies:
        reader.add_body(scene, body)
    for swatch in reader.swatches_named():
        scene.swatch_index(swatch)
    return scene


@dataclass
class _Node:
    """A body as it was found: its pose, relative to W where it hangs in it, and its meshes by index.

    `marked` is whether hapscene made it; else another program did, and it may be scaled.
    """

    name: str
    X: NDArray[np.float64]
    in_W: bool
    two_sided: bool = False
    marked: bool = False
    meshes: list[int] = field(default_factory=list)


class _Reader(Tree):
    """What was made of the tree so far."""

    def __init__(self, path: Path, tree: dict[str, Any], blobs: list[bytes]) -> None:
        super().__init__(path, tree, blobs)
        self.shapes: dict[tuple[int, ...], tuple[Mesh, NDArray[np.int64]]] = {}
        self.swatches: dict[int, Swatch | str] = {}
        self.names: set[str] = set()
        self.made = 0  # faces and vertices so far

    def bodies(self) -> list[_Node]:
        """Every node that is marked as a body, with all meshes below it, and every other that has a mesh.

        Poses are in the scene's own frame, whatever the file's axes. None at all where no node is marked.
        """
        start = self.tree.get("scene", 0)
        roots = self.item("scenes", start).get("nodes", []) if self.tree.get("scenes") else []
        stack: list[tuple[Any, NDArray[np.float64], bool, _Node | None]]
        stack = [(node, np.eye(4), False, None) for node in _indices(roots)[::-1]]
        seen: set[int] = set()
        found: list[_Node] = []
        X_W = np.eye(4)  # of W in the file
        while stack:
            index, X, in_W, body = stack.pop()
            node = self.item("nodes", index)
            if index in seen:
                raise self.fail(f"nodes[{index}] hangs in two places, or within itself")
            seen.add(index)
            extras, own = extras_of(node), self.pose(node, index)
            X = X @ own
            if "hapscene_version" in extras:
                check_version(self.path, extras["hapscene_version"])
                X_W, X, in_W = X, np.eye(4), True
            if "hapscene_body" in extras:
                found.append(body := self.body(extras, X, in_W))
            elif body is not None and not np.array_equal(own, np.eye(4)):
                raise self.fail(f"nodes[{index}] has been moved within its body, {body.name[:60]!r}; move that instead")
            if "mesh" in node:
                if type(node["mesh"]) is not int:
                    raise self.fail(f"nodes[{index}]: a mesh is named by its index")
                if body is None:
                    found.append(_Node(_printable(node.get("name")), X, in_W, meshes=[node["mesh"]]))
                else:
                    body.meshes.append(node["mesh"])
            stack += [(child, X, in_W, body) for child in _indices(node.get("children", []))[::-1]]
        if not any(body.marked for body in found):
            return []
        if len(found) > BODY_MAX:
            raise self.fail(f"more than {BODY_MAX:,} bodies")
        for body in found:
            body.X = body.X if body.in_W else self.solved(X_W, body.X)
        return found

    def body(self, extras: dict[str, Any], X: NDArray[np.float64], in_W: bool) -> _Node:
        """A body of ours, by its extras."""
        name, two_sided = extras["hapscene_body"], extras.get("two_sided", False)
        if not isinstance(name, str) or two_sided not in (False, True):  # 0 and 1 too: some programs know no bool
            raise self.fail("a body needs its name and two_sided, true or false, in its extras")
        return _Node(name, X, in_W, bool(two_sided), marked=True)

    def solved(self, X_FW: NDArray[np.float64], X_FB: NDArray[np.float64]) -> NDArray[np.float64]:
        """A pose in the file as one in W."""
        try:
            return np.asarray(np.linalg.solve(X_FW, X_FB))
        except np.linalg.LinAlgError:
            raise self.fail("the node with hapscene_version is scaled to nothing") from None

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

    def add_body(self, scene: Scene, found: _Node) -> None:
        mesh, material = self.shape(found)
        X_WB = found.X
        if not found.marked:
            mesh, X_WB = self.unscaled(mesh, found)
        self.count(len(material))
        names = itertools.chain([found.name], (f"{found.name}_{i}" for i in itertools.count(2)))
        name = next(name for name in names if name not in self.names)  # copies made elsewhere have one name
        self.names.add(name)
        body = scene.add(mesh, name=name, pose=X_WB, two_sided=found.two_sided)
        for index in np.unique(material):
            if index >= 0:
                body.face_swatch[material == index] = scene.swatch_index(self.swatch(int(index)))

    def shape(self, found: _Node) -> tuple[Mesh, NDArray[np.int64]]:
        """The mesh of a body, and the material of each face; the same for bodies of the same meshes."""
        meshes = tuple(found.meshes)
        if meshes not in self.shapes:
            pieces = [piece for mesh in meshes for piece in self.pieces(mesh)]
            if not pieces:
                raise self.fail(f"body {found.name[:60]!r} has no mesh")
            vertices, faces, material = join(pieces)
            self.shapes[meshes] = Mesh(vertices, faces.astype(np.int32)), material
        return self.shapes[meshes]

    def unscaled(self, mesh: Mesh, found: _Node) -> tuple[Mesh, NDArray[np.float64]]:
        """A mesh that has taken up what its pose scales, shears or mirrors, and the rigid pose that is left."""
        from scipy.linalg import polar

        if not np.isfinite(found.X).all():
            raise self.fail(f"object {found.name[:60]!r} is at a place that is not finite")
        R, S = polar(found.X[:3, :3])
        mirrors = np.linalg.det(R) < 0.0
        R, S = (-R, -S) if mirrors else (R, S)
        X_WB = np.eye(4)
        X_WB[:3, :3], X_WB[:3, 3] = R, found.X[:3, 3]
        if np.abs(S - np.eye(3)).max() < RIGID_TOLERANCE:
            return mesh, X_WB
        return Mesh(mesh.vertices_m @ S.T, mesh.faces[:, ::-1] if mirrors else mesh.faces), X_WB

    def pieces(self, mesh: int) -> list[Piece]:
        """One for each primitive; its `swatch` is the index of its material, −1 without."""
        pieces = []
        primitives = self.item("meshes", mesh).get("primitives", [])
        for primitive in primitives if isinstance(primitives, list) else []:
            if not isinstance(primitive, dict) or primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                raise self.fail(f"meshes[{mesh}]: only triangles can be touched")
            self.check_packing(f"meshes[{mesh}]", primitive.get("extensions", {}))
            attributes = primitive.get("attributes")
            corners = self.accessor(attributes.get("POSITION") if isinstance(attributes, dict) else None, "VEC3", "f")
            if "indices" in primitive:
                flat = self.accessor(primitive["indices"], "SCALAR", "u").astype(np.int64)
            else:
                flat = np.arange(len(corners))
            if flat.size % 3 or not flat.size or flat.max() >= len(corners):
                raise self.fail(f"meshes[{mesh}]: its indices do not make triangles of its {len(corners):,} vertices")
            material = primitive.get("material", -1)
            if type(material) is not int or material < -1:
                raise self.fail(f"meshes[{mesh}]: a material is named by its index")
            self.count(len(flat) // 3 + len(corners))
            pieces.append(Piece(material, corners.astype(np.float64), flat.reshape(-1, 3)))
        return pieces

    def count(self, more: int) -> None:
        """A small file can name the same numbers over and over."""
        self.made += more
        if self.made > 2 * FACE_MAX:
            raise self.fail(f"more than {2 * FACE_MAX:,} faces and vertices")

    def swatches_named(self) -> list[Swatch | str]:
        """The swatches that hapscene wrote, those that no face wears among them."""
        materials = self.tree.get("materials", [])
        named = [i for i, m in enumerate(materials) if isinstance(m, dict) and "hapscene_swatch" in extras_of(m)]
        return [self.swatch(index) for index in named]

    def swatch(self, index: int) -> Swatch | str:
        """The swatch of a material by its extras; where they are gone, the library's of its name; else plain."""
        if index not in self.swatches:
            self.swatches[index] = self.restored(self.item("materials", index))
        return self.swatches[index]

    def restored(self, material: dict[str, Any]) -> Swatch | str:
        extras = extras_of(material)
        name, text = extras.get("hapscene_swatch"), extras.get("swatch_file")
        if isinstance(name, str) and is_digest(extras.get("sha256")):
            text = text if isinstance(text, str) else None
            return restore(self.path, name, extras, extras.get("albedo_rgb"), extras["sha256"], text)
        name = str(material.get("name", ""))
        if known_swatch(name) is not None:
            return name
        lose(f"{self.path}: material {name[:60]!r} is no swatch, in its extras or the library: its faces stay plain")
        return PLAIN


def _printable(name: Any) -> str:
    """A name that a body may have, of any."""
    return "".join(c for c in str(name or "") if c.isprintable()).strip() or "object"


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
