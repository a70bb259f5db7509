"""Import of scenes from glTF files of `hapscene.exchange.gltf`, also after other programs have edited them.

Files are untrusted: sizes are checked before memory is allocated, nodes may not form a cycle, and only files in the
same folder are opened (`hapscene.scene.resource_resolver`). Meshes that another program added without a hapscene body
become bodies. Materials, textures and colours are for display only: what is damaged is left out.
"""

import base64
import binascii
import contextlib
import itertools
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.errors import SceneError
from hapscene.exchange.gltf import SOURCE
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
from hapscene.scene.gltf_check import items_of, parse_gltf
from hapscene.scene.material import TEXTURES, Material, open_picture
from hapscene.scene.mesh import FACE_MAX, OVERLAY, UNNAMED, Mesh, Part, merged, part_of
from hapscene.scene.mesh_file import FILE_MAX_B
from hapscene.scene.resource_resolver import FolderResources
from hapscene.scene.scene import Scene
from hapscene.scene.scene_file import BODY_MAX
from hapscene.scene.topology import weld
from hapscene.surface.swatch import PLAIN, Swatch

__all__ = ["read_bounded", "read_gltf"]

_TYPES: Final = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_PACKED: Final = ("KHR_draco_mesh_compression", "KHR_meshopt_compression", "EXT_meshopt_compression")
_TRIANGLES: Final = 4
_VALUES: Final = (
    *("name", "baseColorFactor", "metallicFactor", "roughnessFactor"),
    *("emissiveFactor", "alphaMode", "alphaCutoff", "doubleSided"),
)
"""Values of a glTF material that `hapscene.scene.material` keeps."""


def read_gltf(path: Path) -> Scene | None:
    """Read a scene from a glTF file; return None if hapscene did not write the file.

    Raises:
        SceneError: damaged, too large, compressed, or of a later version.
        MeshError, SwatchError: a mesh or a swatch in the file is invalid.
    """
    content = read_bounded(path)
    if b'"hapscene_body"' not in content:
        return None  # files of other programs need not pass our checks
    tree, blobs = parts_of(path, content)
    reader = _Reader(path, tree, blobs)
    bodies = reader.bodies()
    if not bodies:
        return None
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


def read_bounded(path: Path) -> bytes:
    """Read a file of at most `FILE_MAX_B`.

    Raises:
        SceneError: the file is missing, empty, too large, or cannot be read.
    """
    with refusing(SceneError):
        content = read_bytes(path, FILE_MAX_B, "mesh file")
    if not content:
        raise SceneError(f"{path}: the file is empty")
    return content


def parts_of(path: Path, content: bytes) -> tuple[dict[str, Json], list[bytes]]:
    """Return the JSON tree and the content of each buffer; a buffer without URI is the chunk of a GLB, or empty.

    Raises:
        SceneError: damaged, truncated, too large, or a file that it refers to is missing.
    """
    with refusing(SceneError):
        tree, chunk = parse_gltf(content, path.suffix.lower() == ".glb", str(path))
        found = items_of(tree, "buffers", str(path))
    files = FolderResources(path, FILE_MAX_B, SceneError)
    read: dict[Json, bytes] = {}  # by URI, since a small file can refer to a large one many times
    blobs = []
    for index, buffer in enumerate(found):
        uri = buffer.get("uri")
        if uri is None:
            blobs.append(chunk if index == 0 else b"")
            continue
        if not isinstance(uri, str):
            raise SceneError(f"{path}: buffers[{index}].uri must be a string")
        if uri not in read:
            read[uri] = _embedded(path, uri) if uri.startswith("data:") else files.get(uri)
        blobs.append(read[uri])
    return tree, blobs


def _embedded(path: Path, uri: str) -> bytes:
    _, mark, data = uri.partition(";base64,")
    try:
        if not mark:
            raise ValueError
        return base64.b64decode(data, validate=True)
    except (binascii.Error, ValueError):
        raise SceneError(f"{path}: an embedded buffer is damaged: not base64") from None


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

    def __init__(self, path: Path, tree: dict[str, Json], blobs: list[bytes]) -> None:
        self.path, self.tree, self.blobs = path, tree, blobs
        self.made = 0  # number of faces and vertices so far
        self.shapes: dict[tuple[int, ...], tuple[Mesh, NDArray[np.int64]]] = {}
        self.swatches: dict[int, Swatch | str] = {}
        self.looks: dict[str, Json] = {}  # materials of trimesh by their JSON
        self.materials: dict[int, Material | None] = {}  # by the id of the material of trimesh
        self.pictures: dict[int, Any] = {}
        self.files: Any = FolderResources(path, FILE_MAX_B, SceneError)
        self.names: set[str] = set()

    def fail(self, problem: str) -> SceneError:
        return SceneError(f"{self.path}: {problem}")

    def count(self, more: int) -> None:
        """Add to the number of faces and vertices, which is limited: a small file can refer to the same data often."""
        self.made += more
        if self.made > 2 * FACE_MAX:
            raise self.fail(f"more than {2 * FACE_MAX:,} faces and vertices")

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

    def check_packing(self, where: str, extensions: object) -> None:
        """Reject compressed data. Other extensions do not change the geometry."""
        if not isinstance(extensions, dict):
            raise self.fail(f"{where}: extensions must be an object")
        if packed := [name for name in _PACKED if name in extensions]:
            raise self.fail(
                f"{where} is compressed ({packed[0]}), which is not supported; export it without compression"
            )

    def accessor(self, index: object, kind: str, sort: str) -> NDArray[Any]:
        """Return the numbers (n,) or (n, 3) of an accessor, which must lie within its buffer."""
        accessor = self.item("accessors", index)
        where = f"accessors[{index}]"
        dtype = _TYPES.get(accessor.get("componentType", 0)) if _is_size(accessor.get("componentType", 0)) else None
        if accessor.get("type") != kind or dtype is None or np.dtype(dtype).kind not in sort or "sparse" in accessor:
            raise self.fail(f"{where} must be dense {kind} of {'float32' if sort == 'f' else 'unsigned integers'}")
        view = self.item("bufferViews", accessor.get("bufferView"))
        self.check_packing(where, view.get("extensions", {}))
        width = _WIDTHS[kind] * np.dtype(dtype).itemsize
        layout: list[Json] = [accessor.get("count"), view.get("byteStride", width)]
        layout += [view.get("byteOffset", 0), accessor.get("byteOffset", 0)]
        if not all(_is_size(n) for n in layout) or layout[0] == 0 or layout[1] < width:
            raise self.fail(f"{where} has an invalid count, stride or offset")
        count, stride, *start = (int(n) for n in layout)
        first = sum(start)
        end = first + (count - 1) * stride + width
        buffer = view.get("buffer", 0)
        if not _is_size(buffer) or buffer >= len(self.blobs):
            raise self.fail(f"{where} refers to a missing buffer; the file has {len(self.blobs)}")
        blob = self.blobs[buffer]
        if end > len(blob):
            raise self.fail(f"{where} exceeds its buffer of {len(blob):,} bytes: the file is truncated or damaged")
        rows = np.ndarray((count, _WIDTHS[kind]), dtype, blob, first, (stride, np.dtype(dtype).itemsize))
        return rows.ravel() if kind == "SCALAR" else rows

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
        self.count(len(material))
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
            pieces = [piece for mesh in meshes for piece in self.pieces(mesh)]
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

    def pieces(self, mesh: int) -> list[tuple[int, Part]]:
        """Return the material index, or −1 without a material, and the faces of each primitive."""
        pieces = []
        for primitive in self.primitives(mesh):
            if self.is_overlay(primitive):
                continue
            if not isinstance(primitive, dict) or primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                raise self.fail(f"meshes[{mesh}]: only triangles are supported")
            self.check_packing(f"meshes[{mesh}]", primitive.get("extensions", {}))
            attributes = primitive.get("attributes")
            attributes = attributes if isinstance(attributes, dict) else {}
            corners = self.accessor(attributes.get("POSITION"), "VEC3", "f")
            if "indices" in primitive:
                flat = self.accessor(primitive["indices"], "SCALAR", "u").astype(np.int64)
            else:
                flat = np.arange(len(corners))
            if flat.size % 3 or not flat.size or flat.max() >= len(corners):
                raise self.fail(f"meshes[{mesh}]: its indices are not triangles of its {len(corners):,} vertices")
            material = primitive.get("material", -1)
            if type(material) is not int or material < -1:
                raise self.fail(f"meshes[{mesh}]: material must be an index")
            self.count(len(flat) // 3 + len(corners))
            pieces.append((material, self.part(material, attributes, corners, flat.reshape(-1, 3))))
        return pieces

    def part(self, material: int, attributes: dict[str, Json], corners: NDArray[Any], faces: NDArray[np.int64]) -> Part:
        """Return the faces of a primitive with their look, as `hapscene.load_mesh` does for files of other programs."""
        import trimesh

        visuals: Any = trimesh.visual.TextureVisuals
        mesh: Any = trimesh.Trimesh(corners.astype(np.float64), faces, process=False)
        if (look := self.look(material)) is not None:
            uv, colour = (self.shown(attributes, name, len(corners)) for name in ("TEXCOORD_0", "COLOR_0"))
            uv = None if uv is None or uv.shape[1] != 2 else _as_share(uv) * (1.0, -1.0) + (0.0, 1.0)  # v upward
            mesh.visual = visuals(uv, look)
            if colour is not None:
                mesh.visual.vertex_attributes["color"] = colour
        return part_of(mesh, [UNNAMED], None, self.materials)

    def shown(self, attributes: dict[str, Json], name: str, count: int) -> NDArray[Any] | None:
        """Return the values (count, c) of an attribute that is for display; None if it is missing or unsupported."""
        with contextlib.suppress(SceneError):
            kind = str(self.item("accessors", attributes.get(name)).get("type"))
            rows = self.accessor(attributes.get(name), kind, "fu")
            return rows if rows.shape[:1] == (count,) and rows.ndim == 2 else None
        return None

    def look(self, index: int) -> Any:
        """Return the material of the mesh file as one of trimesh; None for faces that wear the look of their swatch."""
        from trimesh.visual.material import PBRMaterial

        found = self.item("materials", index) if index >= 0 else {}
        extras = extras_of(found)
        if index < 0 or ("hapscene_swatch" in extras and SOURCE not in extras):
            return None
        base = found.get("pbrMetallicRoughness")
        found |= {"name": extras.get(SOURCE, found.get("name"))} | (base if isinstance(base, dict) else {})
        values = {name: value for name, value in found.items() if name in _VALUES}
        pictures = {name: self.picture(found.get(name)) for name in TEXTURES}
        key = json.dumps([values, list(map(id, pictures.values()))], sort_keys=True)  # once for all swatches
        if key not in self.looks:
            made: Any = PBRMaterial
            self.looks[key] = None
            with contextlib.suppress(Exception):  # numbers from an untrusted file
                self.looks[key] = made(**values, **pictures)
        return self.looks[key]

    def picture(self, texture: Any) -> Any:
        """Return the picture (PIL image, not yet decoded) of a texture; None if it is missing or damaged."""
        try:
            index = self.item("textures", texture["index"])["source"]
            if index not in self.pictures:
                self.pictures[index] = open_picture(self.picture_file(self.item("images", index)))
            return self.pictures[index]
        except Exception:  # PIL raises many classes for damaged pictures
            return None

    def picture_file(self, image: dict[str, Json]) -> bytes:
        if "bufferView" not in image:
            uri: str = image["uri"]
            return _embedded(self.path, uri) if uri.startswith("data:") else bytes(self.files.get(uri))
        view = self.item("bufferViews", image["bufferView"])
        start, blob = view.get("byteOffset", 0), self.blobs[view.get("buffer", 0)]
        return bytes(blob[start : start + view["byteLength"]])

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
            return restore(self.path, name, extras, extras.get("albedo_rgb"), extras["sha256"], text)
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


def _as_share(values: NDArray[Any]) -> NDArray[np.float64]:
    """Return numbers from 0 to 1, which may be stored as integers."""
    return values / (np.iinfo(values.dtype).max if values.dtype.kind == "u" else 1.0)


def _is_size(value: object) -> bool:
    return type(value) is int and 0 <= value < 1 << 40


def _printable(name: object) -> str:
    """Return a valid name of a body for any name."""
    return "".join(c for c in str(name or "") if c.isprintable()).strip() or "object"


def _indices(value: object) -> list[Json]:
    return list(value) if isinstance(value, list) else []
