"""Export of scenes to glTF 2.0, as GLB: a node for each body, a mesh for each swatch on it.

    W (rotates z up to the y up of glTF) → bodies at their poses → meshes, one for each swatch of a body

The meshes have the faces of the body, with the materials, textures and texture coordinates of its file; faces without a
material in the file wear the look of their swatch. Over them lies the feel: separate meshes of the painted parts, cut
at the borders of the paint (see `hapscene.view.feel_layer`). They are for other programs, and are ignored on import.

The `extras`, which other programs preserve as custom properties, contain the data to restore the scene: on W the format
version; on bodies the name, `two_sided` and the paint of subdivided faces; on materials the parameters of the swatch,
the hash of its file, and the file itself (see `hapscene.exchange.swatch_payload`); and the name of the material of the
mesh file, which is missing where a face wears the look of its swatch.

glTF has no float64: positions are rounded to float32.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene import __version__
from hapscene.errors import SceneError
from hapscene.exchange.cut_faces import cut_faces
from hapscene.exchange.swatch_payload import VERSION, digest_of, fine_to_json, groups_of
from hapscene.io.files import Json, write_whole
from hapscene.scene.body import Body
from hapscene.scene.material import Material, picture_file
from hapscene.scene.mesh import OVERLAY, Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import swatch_to_json
from hapscene.view.feel_layer import OPACITY, Show, box_uv, corner_normals, feel_layer, grain_of, has_look
from hapscene.view.palette import linear

__all__ = ["SOURCE", "glb_of", "look_glb", "picture_glb", "write_gltf"]

GLB_MAX_B: Final = 2**32 - 1
"""Maximum size of a GLB file [bytes]: the length field is a uint32."""

SOURCE: Final = "source_material"
"""Key in the extras of glTF materials with the appearance of a material of the mesh file: its name."""

Z_UP: Final = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""Matrix of the node W by columns: it rotates z up to the y up of glTF."""

_COLOURED: Final = Material()
"""Material of faces with the colours of the mesh file, which multiply its white."""

FLOAT, UINT32 = 5126, 5125  # component types of glTF
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963  # targets of glTF


def write_gltf(scene: Scene, path: Path, show: Show = "both", cut: bool = False) -> list[Path]:
    """Write a scene as GLB, as `export_scene`. Raises SceneError: too large for GLB, or the file cannot be written."""
    writer = _Writer(scene, "look" if cut else show)
    for body in scene.bodies:
        writer.add_body(_cut(body) if cut else body)
    writer.add_unused()
    write_whole(path, glb_of(writer.tree, b"".join(writer.chunks), path), SceneError)
    return [path]


def _cut(body: Body) -> Body:
    """Return a body whose faces are cut at the borders of its paint, so that each has one swatch."""
    if body.fine is None:
        return body
    cut, mesh = cut_faces(body), body.mesh
    look: dict[str, Json] = {
        "colour_rgb": None if mesh.colour_rgb is None else mesh.colour_rgb[cut.face],
        "uv": None if mesh.uv is None else cut.corners(mesh.uv, np.arange(len(cut.face))),
        "materials": mesh.materials,
        "material": None if mesh.material is None else mesh.material[cut.face],
    }
    pieces = Mesh(cut.vertices_m, cut.faces.astype(np.int32), **look)
    return replace(body, mesh=pieces, face_swatch=cut.swatch.astype(np.int16), fine=None)


def look_glb(mesh: Mesh, two_sided: bool) -> bytes:
    """Return a mesh with its materials as GLB, in its own frame. Raises SceneError: the mesh is too large for GLB."""
    writer = _Writer(Scene(), "look")
    face_swatch = np.zeros(len(mesh.faces), np.int16)
    writer.tree["nodes"] = writer.add_surface(Body("look", mesh, np.eye(4), two_sided, face_swatch))
    return glb_of(writer.tree, b"".join(writer.chunks), Path("look.glb"))


def picture_glb(pixels: NDArray[np.float64]) -> bytes:
    """Return a triangle with a picture (h, w, 3), 0 to 1, as GLB."""
    writer = _Writer(Scene(), "look")
    look = {"baseColorTexture": writer.add_pixels("picture", pixels)}
    material = writer.add("materials", {"pbrMetallicRoughness": look})
    corners = np.eye(3)[None]
    primitive = writer.add_triangles(corners, material, TEXCOORD_0=corners[..., :2])
    writer.tree["nodes"] = [{"mesh": writer.add("meshes", {"primitives": [primitive]})}]
    return glb_of(writer.tree, b"".join(writer.chunks), Path("picture.glb"))


class _Writer:
    """Builds the JSON tree and the binary buffer."""

    def __init__(self, scene: Scene, show: Show) -> None:
        self.scene, self.show = scene, show
        self.chunks: list[bytes] = []
        self.size = 0
        self.materials: dict[object, int] = {}
        self.used: set[int] = set()  # swatches with a material
        self.textures: dict[object, int] = {}
        self.meshes: dict[object, list[dict[str, Json]]] = {}
        self.normals: dict[int, NDArray[np.float64]] = {}  # by id of the mesh
        root = {"name": "W", "matrix": list(Z_UP), "children": [], "extras": {"hapscene_version": VERSION}}
        self.tree: dict[str, Json] = {
            "asset": {"version": "2.0", "generator": f"hapscene {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [root],
            **{key: [] for key in ("meshes", "materials", "accessors", "bufferViews")},
        }

    def add(self, kind: str, item: dict[str, Json]) -> int:
        items = self.tree.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def add_body(self, body: Body) -> None:
        key = (id(body.mesh), body.face_swatch.tobytes(), body.two_sided)  # bodies with equal keys share glTF meshes
        if key not in self.meshes:
            self.meshes[key] = self.add_surface(body)
        over = *key, id(body.fine), body.made_of
        if over not in self.meshes:
            self.meshes[over] = self.add_feel(body)
        pieces = self.meshes[key] + self.meshes[over]
        children = [self.add("nodes", piece | {"name": f"{body.name}/{piece['name']}"}) for piece in pieces]
        extras: dict[str, Json] = {"hapscene_body": body.name, "two_sided": body.two_sided}
        if body.parent is not None:
            extras["parent"] = body.parent
        if (fine := fine_to_json(self.scene, body)) is not None:
            extras["fine"] = fine
        matrix = body.X_WB.T.ravel().tolist()
        node = {"name": body.name, "matrix": matrix, "children": children, "extras": extras}
        self.tree["nodes"][0]["children"].append(self.add("nodes", node))

    def add_surface(self, body: Body) -> list[dict[str, Json]]:
        """Add the faces of a body, a mesh for each swatch with a primitive for each material; return its nodes."""
        primitives: dict[int, list[dict[str, Json]]] = {}
        for swatch, material, rows in groups_of(body):
            primitives.setdefault(swatch, []).append(self.add_faces(body, swatch, material, rows))
        return [self.add_mesh(body, self.scene.swatches[swatch].name, made) for swatch, made in primitives.items()]

    def add_mesh(self, body: Body, name: str, primitives: list[dict[str, Json]]) -> dict[str, Json]:
        return {"name": name, "mesh": self.add("meshes", {"name": f"{body.name}/{name}", "primitives": primitives})}

    def add_faces(self, body: Body, swatch: int, material: int, rows: NDArray[np.int64]) -> dict[str, Json]:
        """Add some faces of a body with their material in the file, else with their colours, else with their swatch."""
        mesh = body.mesh
        corner_m, normal = mesh.vertices_m[mesh.faces[rows]], self.normals_of(body)[rows]
        if mesh.colour_rgb is None or self.show == "feel":
            return self.add_worn(body, swatch, corner_m, normal)
        if material < 0:
            colour = linear(mesh.colour_rgb[rows] / 255)
            made = self.add_material(swatch, body.two_sided, _COLOURED)
            return self.add_triangles(corner_m, made, NORMAL=normal, COLOR_0=np.repeat(colour[:, None], 3, axis=1))
        made = self.add_material(swatch, body.two_sided, mesh.materials[material])
        if not mesh.materials[material].textures:
            return self.add_triangles(corner_m, made, NORMAL=normal)
        uv = np.zeros((len(rows), 3, 2)) if mesh.uv is None else np.nan_to_num(mesh.uv[rows]).astype(np.float64)
        return self.add_triangles(corner_m, made, NORMAL=normal, TEXCOORD_0=uv * (1.0, -1.0) + (0.0, 1.0))

    def add_worn(
        self,
        body: Body,
        swatch: int,
        corner_m: NDArray[np.float64],
        normal: NDArray[np.float64],
        overlay: float = 0.0,
        share: NDArray[np.float64] | None = None,
    ) -> dict[str, Json]:
        """Add triangles (k, 3, 3) that wear the look of a swatch.

        Triangles of an overlay have an opacity above 0, of which each has a share (k,).
        """
        grain, more = grain_of(self.scene.swatches[swatch]), {}
        if share is not None and (share >= 1.0).all():
            share = None
        if share is not None:
            more["COLOR_0"] = np.repeat(np.column_stack([np.ones((len(share), 3)), share])[:, None], 3, axis=1)
        made = self.add_material(swatch, body.two_sided, overlay=overlay, soft=share is not None)
        if grain.flat:
            return self.add_triangles(corner_m, made, NORMAL=normal, **more)
        uv, way = box_uv(corner_m, grain.tile_m(body.mesh.diagonal_m))
        tangent = way[:, None] - (normal @ way[:, :, None]) * normal
        tangent /= np.maximum(np.linalg.norm(tangent, axis=2, keepdims=True), 1e-9)
        tangent = np.concatenate([tangent, np.ones((*tangent.shape[:2], 1))], axis=2)
        return self.add_triangles(corner_m, made, NORMAL=normal, TANGENT=tangent, TEXCOORD_0=uv * (1.0, -1.0), **more)

    def add_feel(self, body: Body) -> list[dict[str, Json]]:
        """Add the parts of the feel that differ from the surface, a mesh for each swatch; return its nodes."""
        over_look = has_look(body) and self.show != "feel"
        if over_look and self.show == "look":
            return []
        layer = feel_layer(body, self.normals_of(body), "materials" if over_look else "faces")
        nodes = []
        for swatch in np.unique(layer.swatch).tolist():
            rows = layer.swatch == swatch
            overlay = OPACITY if over_look else 1.0
            triangles = layer.corner_m[rows], layer.normal[rows]
            primitive = self.add_worn(body, swatch, *triangles, overlay, layer.opacity[rows])
            node = self.add_mesh(body, f"feel: {self.scene.swatches[swatch].name}", [primitive])
            self.tree["meshes"][node["mesh"]]["extras"] = {OVERLAY: self.scene.swatches[swatch].name}
            nodes.append(node)
        return nodes

    def normals_of(self, body: Body) -> NDArray[np.float64]:
        """Return unit normals at the corners of all faces of a body (M, 3, 3)."""
        key = id(body.mesh)
        if key not in self.normals:
            normal = corner_normals(body.mesh).reshape(-1, 3, 3)
            normal[np.linalg.norm(normal, axis=2) < 0.5] = (0.0, 0.0, 1.0)  # glTF has no zero normals
            self.normals[key] = normal
        return self.normals[key]

    def add_material(
        self, index: int, two_sided: bool, source: Material | None = None, overlay: float = 0.0, soft: bool = False
    ) -> int:
        """Return the material of a swatch, with the appearance of a material of the mesh file if it is given."""
        key = (index, two_sided, source, overlay, soft)
        if key in self.materials:
            return self.materials[key]
        swatch = self.scene.swatches[index]
        found = self.worn(swatch, overlay or 1.0) if source is None else self.source(source)
        name = swatch.name if source is None or not source.name else f"{source.name}/{swatch.name}"
        extras: dict[str, Json] = {OVERLAY: swatch.name}  # on the material too: other programs join meshes
        if not overlay:
            self.used.add(index)
            extras = {"hapscene_swatch": swatch.name, **swatch.own_numbers, "albedo_rgb": list(swatch.albedo_rgb)}
            extras["sha256"] = digest_of(swatch)
            if source is not None:
                extras[SOURCE] = source.name
            extras["swatch_file"] = swatch_to_json(swatch)
        elif overlay < 1.0 or soft:
            found["alphaMode"] = "BLEND"
        found |= {"doubleSided": two_sided or (source is not None and source.two_sided), "extras": extras}
        self.materials[key] = self.add("materials", {"name": f"feel: {name}" if overlay else name} | found)
        return self.materials[key]

    def worn(self, swatch: Swatch, opacity: float) -> dict[str, Json]:
        """Return the appearance of a swatch."""
        grain = grain_of(swatch)
        look: dict[str, Json] = {"metallicFactor": 0.0, "roughnessFactor": grain.roughness}
        found: dict[str, Json] = {"pbrMetallicRoughness": look}
        if grain.flat:
            look["baseColorFactor"] = [*linear(swatch.albedo_rgb).tolist(), opacity]
        else:
            look["baseColorFactor"] = [1.0, 1.0, 1.0, opacity]
            base = swatch.albedo_rgb if grain.albedo is None else grain.albedo
            look["baseColorTexture"] = self.add_pixels((swatch, "colour"), np.multiply(base, grain.shade[..., None]))
            found["normalTexture"] = self.add_pixels((swatch, "normal"), grain.normal / 2 + 0.5)
        return found

    def source(self, material: Material) -> dict[str, Json]:
        """Return the appearance of a material of the mesh file."""
        look: dict[str, Json] = {"baseColorFactor": list(material.colour)}
        look |= {"metallicFactor": material.metallic, "roughnessFactor": material.roughness}
        found: dict[str, Json] = {"pbrMetallicRoughness": look}
        for key, picture in material.textures.items():
            try:
                texture = self.add_texture(id(picture), partial(picture_file, picture))
            except Exception:  # a damaged picture must not prevent the export
                continue
            (look if key in ("baseColorTexture", "metallicRoughnessTexture") else found)[key] = texture
        if any(material.emissive):
            found["emissiveFactor"] = list(material.emissive)
        if material.alpha != "OPAQUE":
            found["alphaMode"] = material.alpha
        return found | ({"alphaCutoff": material.cutoff} if material.alpha == "MASK" else {})

    def add_pixels(self, key: object, pixels: NDArray[np.float64]) -> dict[str, int]:
        """Return a texture with pixels (h, w, 3), 0 to 1."""
        from PIL import Image

        picture = Image.fromarray(np.rint(255 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8))
        return self.add_texture(key, partial(picture_file, picture, "JPEG"))

    def add_texture(self, key: object, encoded: Callable[[], tuple[bytes, str]]) -> dict[str, int]:
        if key not in self.textures:
            content, kind = encoded()
            image = self.add("images", {"bufferView": self.add_view(content), "mimeType": f"image/{kind.lower()}"})
            self.textures[key] = self.add("textures", {"source": image})
        return {"index": self.textures[key]}

    def add_unused(self) -> None:
        """Add materials for unused swatches, except swatch 0, which every scene has."""
        for index in range(1, len(self.scene.swatches)):
            if index not in self.used:
                self.add_material(index, two_sided=False)

    def add_triangles(
        self, corner_m: NDArray[np.float64], material: int, **values: NDArray[np.float64]
    ) -> dict[str, Json]:
        """Add triangles (k, 3, 3) with attributes of their corners (k, 3, c); equal corners share a vertex."""
        columns = {"POSITION": corner_m} | values
        rows = np.concatenate([column.reshape(3 * len(corner_m), -1) for column in columns.values()], axis=1)
        rows = rows.astype("<f4") + np.float32(0.0)  # −0.0 equals 0.0
        key = np.zeros(len(rows), np.uint64)
        for column in rows.view("<u4").T:  # a hash; a collision among 12 million rows happens in one of 250,000 files
            key = (key ^ column) * np.uint64(0x9E3779B97F4A7C15)
            key ^= key >> np.uint64(29)
        _, first, index = np.unique(key, return_index=True, return_inverse=True)
        place = np.argsort(np.argsort(first))  # in the order of the corners
        rows, attributes, start = rows[np.sort(first)], {}, 0
        for name, column in columns.items():
            width = column.shape[2]
            attributes[name] = self.add_accessor(rows[:, start : start + width], f"VEC{width}", name == "POSITION")
            start += width
        indices = self.add_indices(place[index.reshape(-1)])
        return {"attributes": attributes, "indices": indices, "material": material}

    def add_accessor(self, rows: NDArray[np.float32], kind: str, bounds: bool) -> int:
        view = self.add_view(np.ascontiguousarray(rows).tobytes(), ARRAY_BUFFER)
        accessor = {"bufferView": view, "componentType": FLOAT, "count": len(rows), "type": kind}
        extent = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()} if bounds else {}
        return self.add("accessors", accessor | extent)

    def add_indices(self, faces: NDArray[np.int64]) -> int:
        view = self.add_view(faces.astype("<u4").tobytes(), ELEMENT_ARRAY_BUFFER)
        accessor = {"bufferView": view, "componentType": UINT32, "count": faces.size, "type": "SCALAR"}
        return self.add("accessors", accessor)

    def add_view(self, data: bytes, target: int | None = None) -> int:
        view: dict[str, Json] = {"buffer": 0, "byteOffset": self.size, "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        self.chunks += [data, bytes(-len(data) % 4)]
        self.size += len(data) + -len(data) % 4
        return self.add("bufferViews", view)


def glb_of(tree: dict[str, Json], blob: bytes, path: Path) -> bytes:
    """Return a GLB file: header, JSON chunk, binary chunk."""
    tree["buffers"] = [{"byteLength": len(blob)}]
    text = json.dumps(tree, ensure_ascii=False, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(blob)
    if size > GLB_MAX_B:
        raise SceneError(
            f"{path}: {size:,} bytes, at most {GLB_MAX_B:,} fit in a GLB file: simplify the meshes, or use .ply"
        )
    header = b"glTF" + np.array([2, size, len(text)], "<u4").tobytes() + b"JSON"
    return b"".join([header, text, np.array([len(blob)], "<u4").tobytes(), b"BIN\0", blob])
