"""glTF 2.0: a node for each body, a mesh for each swatch on it, a material for each swatch; GLB or one text file.

    W (turns z up into glTF's y up) → bodies, each at its pose → meshes, one for each swatch on the body

A material is called as its swatch; its base colour is the albedo. `extras`, which other programs show as custom
properties and keep, hold what makes a scene of it again: on W the version, on bodies name, two-sidedness and what is
painted finer than faces, on materials the swatch's numbers, the hash of its file, and its file as a text (see
`hapscene.exchange.swatch_payload`).

glTF has no float64: positions are rounded to float32.
"""

import base64
import io
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene import __version__
from hapscene.errors import SceneError
from hapscene.exchange.own_look import OwnLook, looks_of
from hapscene.exchange.swatch_payload import VERSION, Piece, cut_alike, digest_of, fine_told, pieces_of, text_of
from hapscene.files import write_whole
from hapscene.scene.body import Body
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import FRICTION_MAX, Swatch
from hapscene.view.palette import linear

# MPEG_material_haptic in glTF: a DRAFT of MPEG-I scene description, ISO/IEC 23090-14, that may still change.
#
# Fields and structure follow the public drafts among Khronos's vendor extensions: the one to CD Amendment 2 of 2023
# (`MPEG_material_haptic`), and the one to the DIS of the second edition of 2025, which has the same fields and calls it
# `MPEG_haptic_material`. Both names are written, so that readers of either find it. The published standard has not been
# compared.
#
# The file lists haptic materials; each mesh names one by its index. A material's properties are textures. A swatch is
# the same all over, so its textures have one pixel, 16 bits grey, and the meshes' texture coordinates are all zero (an
# accessor without data). How a pixel's value stands for stiffness is not in the drafts: here 65535 is `full_scale`, in
# the texture's `extras` beside the exact `value`. Static and dynamic friction are two textures of `friction`, told
# apart by `quantity` there. What the drafts have no field for (damping, and a vibration that depends on force and
# speed) stays in the `extras` of the glTF materials; `hapscene swatch export hjif` writes a vibration in MPEG's own
# format.


DRAFT_NAMES: Final = ("MPEG_material_haptic", "MPEG_haptic_material")
"""The extension's name in the draft of 2023, and in that of 2025."""

_PIXEL_MAX: Final = 65535


def add_haptics(writer: "_Writer") -> None:
    """Add the draft extension to the glTF tree of a writer that has all its meshes."""
    tree, worn = writer.tree, writer.swatch_of_mesh
    used = sorted(set(worn))
    stiffest_N_m = max(writer.scene.swatches[i].stiffness_N_m for i in used) or 1.0
    texture_of: dict[int, int] = {}  # pictures of one pixel, each grey once

    def pixel(swatch: Swatch, quantity: str, full_scale: float) -> dict[str, Any]:
        value = getattr(swatch, quantity)
        grey = round(min(value / full_scale, 1.0) * _PIXEL_MAX)
        if grey not in texture_of:
            texture_of[grey] = writer.add_picture(_png(grey))
        return {
            "texture": {"index": texture_of[grey]},
            "type": "Low_Resolution",
            "extras": {"quantity": quantity, "value": value, "full_scale": full_scale},
        }

    materials = []
    for swatch in (writer.scene.swatches[i] for i in used):
        stiffness = [pixel(swatch, "stiffness_N_m", stiffest_N_m)]
        friction = [pixel(swatch, quantity, FRICTION_MAX) for quantity in ("friction_static", "friction_dynamic")]
        materials.append({"name": swatch.name, "stiffness": stiffness, "friction": friction})
    note = "draft extension of ISO/IEC 23090-14, which may still change; 65535 stands for full_scale, in the unit named"
    tree["extensions"] = {name: {"materials": materials, "extras": {"note": note}} for name in DRAFT_NAMES}
    tree["extensionsUsed"] = list(DRAFT_NAMES)
    for mesh, swatch_index in zip(tree["meshes"], worn, strict=True):
        mesh["extensions"] = {name: {"hapticMaterialIndex": used.index(swatch_index)} for name in DRAFT_NAMES}
        for primitive in mesh["primitives"]:
            count = tree["accessors"][primitive["attributes"]["POSITION"]]["count"]
            accessor = {"componentType": FLOAT, "count": count, "type": "VEC2"}  # no data: all zero
            if "TEXCOORD_0" not in primitive["attributes"]:
                primitive["attributes"]["TEXCOORD_0"] = writer.add("accessors", accessor)


def _png(grey: int) -> bytes:
    """A picture of one pixel, 16 bits grey."""
    from PIL import Image

    buffer = io.BytesIO()
    picture = Image.new("I;16", (1, 1))
    picture.putpixel((0, 0), grey)
    picture.save(buffer, "PNG")
    return buffer.getvalue()


GLB_MAX_B: Final = 2**32 - 1
"""Largest GLB file [bytes]: its length is a uint32."""

Z_UP: Final = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""Matrix of the node W, by columns: hapscene's z is up, glTF's y."""

FLOAT, UINT32 = 5126, 5125  # component types of glTF
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963  # targets of glTF


def write_gltf(scene: Scene, path: Path, draft: bool = False) -> list[Path]:
    """Write a scene as GLB or glTF, by the suffix of the path.

    Args:
        scene: with a body at least.
        path: the file, .glb or .gltf.
        draft: add the draft extension MPEG_material_haptic: see `hapscene.exchange.gltf`.

    Raises:
        SceneError: too large for GLB, or the file cannot be written.
    """
    writer = _Writer(scene)
    for body in scene.bodies:
        writer.add_body(body)
    writer.add_unworn()
    if draft:
        add_haptics(writer)
    blob = b"".join(writer.chunks)
    if path.suffix.lower() == ".glb":
        content = _glb(writer.tree, blob, path)
    else:
        uri = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        writer.tree["buffers"] = [{"byteLength": len(blob), "uri": uri}]
        content = json.dumps(writer.tree, ensure_ascii=False, allow_nan=False).encode()
    write_whole(path, content, SceneError)
    return [path]


class _Writer:
    """The JSON tree and the binary buffer, as they grow."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.chunks: list[bytes] = []
        self.size = 0
        self.materials: dict[tuple[int, bool, bytes, bool], int] = {}
        self.meshes: dict[tuple[int, bytes, bool], list[tuple[int, str]]] = {}
        self.swatch_of_mesh: list[int] = []
        root = {"name": "W", "matrix": list(Z_UP), "children": [], "extras": {"hapscene_version": VERSION}}
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": f"hapscene {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [root],
            **{key: [] for key in ("meshes", "materials", "accessors", "bufferViews")},
        }

    def add(self, kind: str, item: dict[str, Any]) -> int:
        self.tree[kind].append(item)
        return len(self.tree[kind]) - 1

    def add_body(self, body: Body) -> None:
        key = (*cut_alike(body), body.two_sided)
        if key not in self.meshes:
            self.meshes[key] = [self.add_mesh(body, piece) for piece in pieces_of(body)]
        worn = [{"name": f"{body.name}/{swatch}", "mesh": mesh} for mesh, swatch in self.meshes[key]]
        children = [self.add("nodes", node) for node in worn]
        extras: dict[str, Any] = {"hapscene_body": body.name, "two_sided": body.two_sided}
        if body.parent is not None:
            extras["parent"] = body.parent
        if (fine := fine_told(self.scene, body)) is not None:
            extras["fine"] = fine
        matrix = body.X_WB.T.ravel().tolist()
        node = {"name": body.name, "matrix": matrix, "children": children, "extras": extras}
        self.tree["nodes"][0]["children"].append(self.add("nodes", node))

    def add_mesh(self, body: Body, piece: Piece) -> tuple[int, str]:
        swatch = self.scene.swatches[piece.swatch]
        if piece.swatch == 0 and body.mesh.colour_rgb is not None:
            looks = looks_of(body.mesh, np.flatnonzero(body.face_swatch == 0))
            primitives = [self.add_look(body, look) for look in looks]
        else:
            material = self.add_material(piece.swatch, swatch, body.two_sided)
            primitives = [self.add_faces(piece.vertices_m, piece.faces, material)]
        self.swatch_of_mesh.append(piece.swatch)
        return self.add("meshes", {"name": f"{body.name}/{swatch.name}", "primitives": primitives}), swatch.name

    def add_faces(self, vertices_m: NDArray[np.float64], faces: NDArray[np.int64], material: int) -> dict[str, Any]:
        attributes = {"POSITION": self.add_positions(vertices_m)}
        return {"attributes": attributes, "indices": self.add_indices(faces), "material": material}

    def add_look(self, body: Body, look: OwnLook) -> dict[str, Any]:
        """Faces that wear no swatch, as they look in the mesh's own file."""
        colour_rgb = body.mesh.colour_rgb
        assert colour_rgb is not None
        corners = body.mesh.faces[look.faces].astype(np.int64)
        if look.uv is not None:
            used, faces = np.unique(corners, return_inverse=True)
            kind, values = "VEC2", look.uv[used].astype("<f4")
        else:  # a vertex for each colour that its faces have
            packed = colour_rgb[look.faces].astype(np.int64) @ (1 << 16, 1 << 8, 1)
            key, faces = np.unique(corners << 24 | packed[:, None], return_inverse=True)
            used = key >> 24
            kind, values = "VEC3", linear((key[:, None] >> (16, 8, 0) & 255) / 255).astype("<f4")
        material = self.add_material(0, self.scene.swatches[0], body.two_sided, look.picture, True)
        primitive = self.add_faces(body.mesh.vertices_m[used], faces.reshape(-1, 3), material)
        view = self.add_view(values.tobytes(), ARRAY_BUFFER)
        accessor = {"bufferView": view, "componentType": FLOAT, "count": len(values), "type": kind}
        primitive["attributes"]["TEXCOORD_0" if kind == "VEC2" else "COLOR_0"] = self.add("accessors", accessor)
        return primitive

    def add_material(
        self, index: int, swatch: Swatch, two_sided: bool, picture: bytes = b"", is_own: bool = False
    ) -> int:
        """The material of a swatch; with the look of the mesh's file, where it `is_own`, a picture or colours."""
        key = (index, two_sided, picture, is_own)
        if key not in self.materials:
            extras = {"hapscene_swatch": swatch.name, **swatch.own_numbers, "albedo_rgb": list(swatch.albedo_rgb)}
            extras["sha256"] = digest_of(swatch)
            if (text := text_of(swatch)) is not None:
                extras["swatch_file"] = text
            colour = [*linear(swatch.albedo_rgb).tolist(), 1.0]
            if is_own:
                colour = [1.0] * 4
            look: dict[str, Any] = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.8}
            if picture:
                look["baseColorTexture"] = {"index": self.add_picture(picture)}
            material = {"name": swatch.name, "pbrMetallicRoughness": look, "doubleSided": two_sided, "extras": extras}
            self.materials[key] = self.add("materials", material)
        return self.materials[key]

    def add_picture(self, content: bytes) -> int:
        for kind in ("images", "textures"):
            self.tree.setdefault(kind, [])
        image = self.add("images", {"bufferView": self.add_view(content), "mimeType": "image/png"})
        return self.add("textures", {"source": image})

    def add_unworn(self) -> None:
        """Materials of the swatches that no face wears. Number 0, plain, is in every scene."""
        worn = {index for index, *_ in self.materials}
        for index, swatch in enumerate(self.scene.swatches):
            if index > 0 and index not in worn:
                self.add_material(index, swatch, two_sided=False)

    def add_positions(self, vertices_m: NDArray[np.float64]) -> int:
        rounded = vertices_m.astype("<f4")
        view = self.add_view(rounded.tobytes(), ARRAY_BUFFER)
        accessor = {"bufferView": view, "componentType": FLOAT, "count": len(rounded), "type": "VEC3"}
        extent = {"min": rounded.min(axis=0).tolist(), "max": rounded.max(axis=0).tolist()}
        return self.add("accessors", accessor | extent)

    def add_indices(self, faces: NDArray[np.int64]) -> int:
        view = self.add_view(faces.astype("<u4").tobytes(), ELEMENT_ARRAY_BUFFER)
        accessor = {"bufferView": view, "componentType": UINT32, "count": faces.size, "type": "SCALAR"}
        return self.add("accessors", accessor)

    def add_view(self, data: bytes, target: int | None = None) -> int:
        view: dict[str, Any] = {"buffer": 0, "byteOffset": self.size, "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        self.chunks += [data, bytes(-len(data) % 4)]
        self.size += len(data) + -len(data) % 4
        return self.add("bufferViews", view)


def _glb(tree: dict[str, Any], blob: bytes, path: Path) -> bytes:
    """A binary glTF: header, a chunk of JSON, a chunk of the buffer."""
    tree["buffers"] = [{"byteLength": len(blob)}]
    text = json.dumps(tree, ensure_ascii=False, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(blob)
    if size > GLB_MAX_B:
        raise SceneError(
            f"{path}: {size:,} bytes; a GLB file has at most {GLB_MAX_B:,}: reduce the meshes, or use .ply"
        )
    header = b"glTF" + np.array([2, size, len(text)], "<u4").tobytes() + b"JSON"
    return b"".join([header, text, np.array([len(blob)], "<u4").tobytes(), b"BIN\0", blob])
