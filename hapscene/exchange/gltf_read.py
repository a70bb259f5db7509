"""Import of scenes from GLB files of `hapscene.exchange.gltf`, also after other programs have edited them.

This module reads bodies, poses and swatches; trimesh reads the faces with their look, from a copy of the file that has
one mesh for each primitive. Files are untrusted: sizes are checked before memory is allocated, and nodes may not form a
cycle. Meshes that another program added without a hapscene body become bodies. Materials, textures and colours are for
display only: where they are damaged, they are left out.
"""

import io
import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.errors import SceneError
from hapscene.exchange.gltf import SOURCE, glb_of
from hapscene.exchange.swatch_payload import (
    check_version,
    is_digest,
    known_swatch,
    restore,
    restore_fine,
    warn_of_loss,
)
from hapscene.geometry import RIGID_TOLERANCE, rotation_of
from hapscene.io.files import Json, read_bytes, refusing
from hapscene.scene.gltf_check import check_gltf, items_of, parse_gltf
from hapscene.scene.material import TEXTURES, Material
from hapscene.scene.mesh import FACE_MAX, OVERLAY, UNNAMED, Mesh, Part, merged, part_of
from hapscene.scene.mesh_file import FILE_MAX_B
from hapscene.scene.scene import Scene
from hapscene.scene.scene_file import BODY_MAX
from hapscene.scene.topology import weld
from hapscene.surface.swatch import PLAIN, Swatch

__all__ = ["read_gltf"]

_PACKED: Final = ("KHR_draco_mesh_compression", "KHR_meshopt_compression", "EXT_meshopt_compression")
_TRIANGLES: Final = 4
_SHOWN: Final = ("COLOR_0", "TEXCOORD_0")
_VALUES: Final = ("pbrMetallicRoughness", "emissiveFactor", "alphaMode", "alphaCutoff", "doubleSided", *TEXTURES)
"""Values of a glTF material that `hapscene.scene.material` keeps, beside its name."""


def read_gltf(path: Path) -> Scene | None:
    """Read a scene from a GLB file; return None if hapscene did not write the file. Raises SceneError: damaged, too
    large, compressed, or of a later version; MeshError, SwatchError: a mesh or a swatch in the file is invalid."""
    with refusing(SceneError):
        content = read_bytes(path, FILE_MAX_B, "mesh file")
    if not content:
        raise SceneError(f"{path}: the file is empty")
    if b'"hapscene_body"' not in content:
        return None  # files of other programs need not pass our checks
    with refusing(SceneError):
        tree, chunk = parse_gltf(content, True, str(path))
    reader = _Reader(path, tree)
    bodies = reader.bodies()
    if not bodies:
        return None
    reader.load_meshes(chunk)
    scene = Scene()
    for body in bodies:
        reader.add_body(scene, body)
    for swatch in reader.swatches_named():
        scene.swatch_index(swatch)
    for made, body in zip(scene.bodies, bodies, strict=True):
        try:
            scene.attach(made.name, None if body.parent is None else str(body.parent))
        except SceneError:
            warn_of_loss(f"{path}: body {made.name[:60]!r} is detached: parent {str(body.parent)[:60]!r} is invalid")
        if body.fine is not None:
            restore_fine(path, scene, made, body.fine)
    return scene


@dataclass
class _Node:
    """A body in the file: its name, pose, and meshes by index.

    `X` is relative to the node W if `in_W` is true, else to the file. `marked` is true for bodies that hapscene wrote;
    nodes of other programs may be scaled.
    """

    name: str
    X: NDArray[np.float64]
    in_W: bool
    two_sided: bool = False
    marked: bool = False
    meshes: list[int] = field(default_factory=list)
    fine: Json = None
    parent: Json = None


class _Reader:
    """Reads bodies and swatches from a parsed glTF file; invalid data raises `SceneError`."""

    def __init__(self, path: Path, tree: dict[str, Json]) -> None:
        self.path, self.tree = path, tree
        self.face_count = 0  # of the bodies so far
        self.pieces: dict[int, list[tuple[int, Part]]] = {}  # by mesh: material or −1, and faces of each primitive
        self.shapes: dict[tuple[int, ...], tuple[Mesh, NDArray[np.int64]]] = {}
        self.swatches: dict[int, Swatch | str] = {}
        self.names: set[str] = set()

    def fail(self, problem: str) -> SceneError:
        return SceneError(f"{self.path}: {problem}")

    def item(self, kind: str, index: object) -> dict[str, Json]:
        items = self.tree.get(kind, [])
        if type(index) is not int or not isinstance(items, list) or not 0 <= index < len(items):
            raise self.fail(f"{kind}[{str(index)[:20]}] does not exist")
        if not isinstance(items[index], dict):
            raise self.fail(f"{kind}[{index}] must be an object")
        return dict(items[index])

    def numbers(self, value: Json, count: int, where: str) -> NDArray[np.float64]:
        fits = isinstance(value, list) and len(value) == count
        if not fits or not all(type(x) in (int, float) and -1e100 < x < 1e100 for x in value):
            raise self.fail(f"{where} must be {count} finite numbers")
        return np.array(value, np.float64)

    def bodies(self) -> list[_Node]:
        """Return the nodes that are marked as bodies, with all meshes below them, and all other nodes with meshes.

        Poses are in the frame of the scene, whatever the axes of the file. Empty if no node is marked as a body.
        """
        start = self.tree.get("scene", 0)
        roots = self.item("scenes", start).get("nodes", []) if self.tree.get("scenes") else []
        stack: list[tuple[Json, NDArray[np.float64], bool, _Node | None]]
        stack = [(node, np.eye(4), False, None) for node in _indices(roots)[::-1]]
        seen: set[int] = set()
        found: list[_Node] = []
        X_W = np.eye(4)  # pose of W in the file
        while stack:
            index, X, in_W, body = stack.pop()
            node = self.item("nodes", index)
            if index in seen:
                raise self.fail(f"nodes[{index}] has two parents or is its own ancestor")
            seen.add(index)
            extras, own = extras_of(node), self.pose(node, index)
            X = X @ own
            if "hapscene_version" in extras:
                check_version(self.path, extras["hapscene_version"])
                X_W, X, in_W = X, np.eye(4), True
            if "hapscene_body" in extras:
                found.append(body := self.body(extras, X, in_W))
            elif body is not None and not np.array_equal(own, np.eye(4)):
                raise self.fail(f"nodes[{index}] was moved within its body {body.name[:60]!r}; move the body instead")
            if "mesh" in node:
                if type(node["mesh"]) is not int:
                    raise self.fail(f"nodes[{index}]: mesh must be an index")
                if body is not None:
                    body.meshes.append(node["mesh"])
                elif not all(map(self.is_overlay, self.primitives(node["mesh"]))):
                    found.append(_Node(_printable(node.get("name")), X, in_W, meshes=[node["mesh"]]))
            stack += [(child, X, in_W, body) for child in _indices(node.get("children", []))[::-1]]
        if not any(body.marked for body in found):
            return []
        if len(found) > BODY_MAX:
            raise self.fail(f"more than {BODY_MAX:,} bodies")
        for body in found:
            body.X = body.X if body.in_W else self.solved(X_W, body.X)
        return found

    def body(self, extras: dict[str, Json], X: NDArray[np.float64], in_W: bool) -> _Node:
        """Return a body from the extras that hapscene wrote."""
        name, two_sided = extras["hapscene_body"], extras.get("two_sided", False)
        if not isinstance(name, str) or two_sided not in (False, True):  # 0 and 1 too: some programs have no bool
            raise self.fail("the extras of a body need hapscene_body, a string, and two_sided, true or false")
        return _Node(name, X, in_W, bool(two_sided), True, fine=extras.get("fine"), parent=extras.get("parent"))

    def solved(self, X_FW: NDArray[np.float64], X_FB: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert a pose in the file to a pose in W."""
        try:
            return np.asarray(np.linalg.solve(X_FW, X_FB))
        except np.linalg.LinAlgError:
            raise self.fail("the node with hapscene_version has a singular matrix") from None

    def pose(self, node: dict[str, Json], index: int) -> NDArray[np.float64]:
        where = f"nodes[{index}]"
        if "matrix" in node:
            return self.numbers(node["matrix"], 16, f"{where}.matrix").reshape(4, 4).T
        X = np.eye(4)
        if "rotation" in node:
            X[:3, :3] = rotation_of(self.numbers(node["rotation"], 4, f"{where}.rotation"))
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
        self.face_count += len(material)
        if self.face_count > FACE_MAX:  # a small file can refer to the same mesh often
            raise self.fail(f"more than {FACE_MAX:,} faces")
        names = itertools.chain([found.name], (f"{found.name}_{i}" for i in itertools.count(2)))
        name = next(name for name in names if name not in self.names)  # copies made in other programs have equal names
        self.names.add(name)
        body = scene.add(mesh, name=name, pose=X_WB, two_sided=found.two_sided)
        for index in np.unique(material):
            if index >= 0:
                body.face_swatch[material == index] = scene.swatch_index(self.swatch(int(index)))

    def shape(self, found: _Node) -> tuple[Mesh, NDArray[np.int64]]:
        """Return the mesh of a body and the material of each face; shared by bodies with the same meshes."""
        meshes = tuple(found.meshes)
        if meshes not in self.shapes:
            pieces = [piece for mesh in meshes for piece in self.pieces.get(mesh, [])]
            if not pieces:
                raise self.fail(f"body {found.name[:60]!r} has no mesh")
            material = np.repeat([index for index, _ in pieces], [len(part.faces) for _, part in pieces])
            whole = merged([part for _, part in pieces], self.path)
            kept, place = np.unique(weld(whole.vertices), return_inverse=True)  # so that the pieces are connected again
            self.shapes[meshes] = (
                Mesh(
                    whole.vertices[kept],
                    place[whole.faces].astype(np.int32),
                    colour_rgb=whole.colour_rgb,
                    uv=whole.uv,
                    materials=tuple(whole.materials),
                    material=whole.material,
                ),
                material,
            )
        return self.shapes[meshes]

    def unscaled(self, mesh: Mesh, found: _Node) -> tuple[Mesh, NDArray[np.float64]]:
        """Apply scale, shear and reflection of a pose to the mesh; return it with the remaining rigid pose."""
        if not np.isfinite(found.X).all():
            raise self.fail(f"object {found.name[:60]!r} has a pose that is not finite")
        R, S = scipy.linalg.polar(found.X[:3, :3])
        mirrors = np.linalg.det(R) < 0.0
        R, S = (-R, -S) if mirrors else (R, S)
        X_WB = np.eye(4)
        X_WB[:3, :3], X_WB[:3, 3] = R, found.X[:3, 3]
        if np.abs(S - np.eye(3)).max() < RIGID_TOLERANCE:
            return mesh, X_WB
        way = slice(None, None, -1 if mirrors else 1)
        uv = None if mesh.uv is None else mesh.uv[:, way]
        return replace(mesh, vertices_m=mesh.vertices_m @ S.T, faces=mesh.faces[:, way], uv=uv), X_WB

    def primitives(self, mesh: int) -> list[Any]:
        primitives = self.item("meshes", mesh).get("primitives", [])
        return primitives if isinstance(primitives, list) else []

    def is_overlay(self, primitive: object) -> bool:
        """Return whether a primitive only shows the feel of other faces."""
        material = primitive.get("material") if isinstance(primitive, dict) else None
        return type(material) is int and material >= 0 and OVERLAY in extras_of(self.item("materials", material))

    def load_meshes(self, chunk: bytes) -> None:
        """Read the faces of all meshes, with their look unless it is damaged."""
        if any(map(_is_packed, items_of(self.tree, "bufferViews", str(self.path)))):
            raise self.fail("it is compressed, which is not supported; export it without compression")
        if any("sparse" in accessor for accessor in items_of(self.tree, "accessors", str(self.path))):
            raise self.fail("sparse accessors are not supported")
        primitives: list[tuple[int, int, dict[str, Json]]] = []
        for mesh in range(len(items_of(self.tree, "meshes", str(self.path)))):
            for primitive in self.primitives(mesh):
                if self.is_overlay(primitive):
                    continue
                if not isinstance(primitive, dict) or primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                    raise self.fail(f"meshes[{mesh}]: only triangles are supported")
                if _is_packed(primitive):
                    raise self.fail(f"meshes[{mesh}] is compressed, which is not supported")
                material = primitive.get("material", -1)
                if type(material) is not int or material < -1:
                    raise self.fail(f"meshes[{mesh}]: material must be an index")
                primitives.append((mesh, material, primitive))
        try:
            parts = self.parts([one for *_, one in primitives], chunk, True)
        except Exception:  # trimesh raises many classes for damaged data
            parts = self.parts([one for *_, one in primitives], chunk, False)
        for (mesh, material, _), part in zip(primitives, parts, strict=True):
            self.pieces.setdefault(mesh, []).append((material, part))

    def parts(self, primitives: list[dict[str, Json]], chunk: bytes, shown: bool) -> list[Part]:
        """Return the faces of primitives, with their look if it is `shown`, as `hapscene.load_mesh` does."""
        import trimesh

        looks: list[dict[str, Json]] = []
        meshes: list[dict[str, Json]] = []
        for number, primitive in enumerate(primitives):
            attributes, look = primitive.get("attributes"), self.look(primitive.get("material", -1))
            kept = ("POSITION", *_SHOWN) if shown and look is not None else ("POSITION",)
            attributes = {key: value for key, value in dict(attributes or {}).items() if key in kept}
            made = {"attributes": attributes} | {key: primitive[key] for key in ("indices",) if key in primitive}
            if shown and look is not None:
                made["material"] = len(looks)
                looks.append(look)
            meshes.append({"name": str(number), "primitives": [made]})
        kept = ("asset", "accessors", "bufferViews", *(("images", "textures") if shown else ()))
        tree = {key: self.tree[key] for key in kept if key in self.tree} | {"meshes": meshes, "materials": looks}
        nodes = [{"mesh": number} for number in range(len(meshes))]
        tree |= {"nodes": nodes, "scenes": [{"nodes": list(range(len(nodes)))}], "scene": 0}
        try:
            content = glb_of(tree, chunk, self.path)
            with refusing(SceneError):
                check_gltf(content, True, str(self.path), FILE_MAX_B)
            loaded = trimesh.load_scene(io.BytesIO(content), file_type="glb", process=False)
            found: list[Any] = [loaded.geometry[str(number)] for number in range(len(meshes))]
            parts = [part_of(mesh, [UNNAMED], None, {}) for mesh in found]
        except (MemoryError, SceneError):
            raise
        except Exception as error:
            raise self.fail(f"truncated or damaged: {str(error)[:200] or type(error).__name__}") from None
        known: dict[object, Material] = {}  # a material of the mesh file is written again for each swatch on it
        for part in parts:
            keys = [(str(one.numbers), *map(id, one.textures.values())) for one in part.materials]
            part.materials = [known.setdefault(key, one) for key, one in zip(keys, part.materials, strict=True)]
        return parts

    def look(self, index: int) -> dict[str, Json] | None:
        """Return the material of the mesh file; None for faces that wear the look of their swatch."""
        found = self.item("materials", index) if index >= 0 else {}
        extras = extras_of(found)
        if index < 0 or ("hapscene_swatch" in extras and SOURCE not in extras):
            return None
        name = extras.get(SOURCE, found.get("name"))
        return {"name": name} | {key: found[key] for key in _VALUES if key in found}

    def swatches_named(self) -> list[Swatch | str]:
        """Return all swatches that hapscene wrote, including unused ones."""
        materials = self.tree.get("materials", [])
        named = [i for i, m in enumerate(materials) if isinstance(m, dict) and "hapscene_swatch" in extras_of(m)]
        return [self.swatch(index) for index in named]

    def swatch(self, index: int) -> Swatch | str:
        """Return the swatch of a material from its extras, else the library swatch with its name, else plain."""
        if index not in self.swatches:
            self.swatches[index] = self.restored(self.item("materials", index))
        return self.swatches[index]

    def restored(self, material: dict[str, Json]) -> Swatch | str:
        extras = extras_of(material)
        name, text = extras.get("hapscene_swatch"), extras.get("swatch_file")
        if isinstance(name, str) and is_digest(extras.get("sha256")):
            text = text if isinstance(text, str) else None
            return restore(self.path, name, extras["sha256"], text)
        if not isinstance(name, str):
            name = str(material.get("name", "")).rpartition("/")[2]  # after the material of the mesh file
        if known_swatch(name) is not None:
            return name
        warn_of_loss(f"{self.path}: material {name[:60]!r} is not a swatch of the library; its faces stay plain")
        return PLAIN


def extras_of(item: dict[str, Json]) -> dict[str, Json]:
    """Return the extras of an item; empty if they are missing or not an object."""
    extras = item.get("extras")
    return extras if isinstance(extras, dict) else {}


def _is_packed(item: dict[str, Json]) -> bool:
    """Return whether an item has compressed data; other extensions do not change the geometry."""
    extensions = item.get("extensions")
    return isinstance(extensions, dict) and any(name in extensions for name in _PACKED)


def _printable(name: object) -> str:
    """Return a valid name of a body for any name."""
    return "".join(c for c in str(name or "") if c.isprintable()).strip() or "object"


def _indices(value: object) -> list[Json]:
    return list(value) if isinstance(value, list) else []
