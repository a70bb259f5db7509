"""Export of scenes to glTF 2.0, as GLB or text: a node for each body, a mesh for each swatch on it.

    W (rotates z up to the y up of glTF) → bodies at their poses → meshes, one for each swatch of a body

A material has the name of its swatch; its base colour is the albedo. The `extras`, which other programs preserve as
custom properties, contain the data to restore the scene: on W the format version; on bodies the name, `two_sided` and
the paint of subdivided faces; on materials the parameters of the swatch, the hash of its file, and the file itself (see
`hapscene.exchange.swatch_payload`).

glTF has no float64: positions are rounded to float32.
"""

import base64
import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene import __version__
from hapscene.errors import SceneError
from hapscene.exchange.swatch_payload import EMBEDDED_MAX, VERSION, Piece, digest_of, fine_to_json, pieces_of
from hapscene.io.files import write_whole
from hapscene.scene.body import Body
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import swatch_to_json
from hapscene.view.palette import linear

__all__ = ["Z_UP", "write_gltf"]

GLB_MAX_B: Final = 2**32 - 1
"""Maximum size of a GLB file [bytes]: the length field is a uint32."""

Z_UP: Final = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""Matrix of the node W by columns: it rotates z up to the y up of glTF."""

FLOAT, UINT32 = 5126, 5125  # component types of glTF
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963  # targets of glTF


def write_gltf(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as GLB or glTF, depending on the suffix.

    Args:
        scene: scene with at least one body.
        path: the file, .glb or .gltf.

    Raises:
        SceneError: the scene is too large for GLB, or the file cannot be written.
    """
    writer = _Writer(scene)
    for body in scene.bodies:
        writer.add_body(body)
    writer.add_unused()
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
    """Builds the JSON tree and the binary buffer."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.chunks: list[bytes] = []
        self.size = 0
        self.materials: dict[tuple[int, bool, bool], int] = {}
        self.meshes: dict[tuple[int, bytes, bool], list[tuple[int, str]]] = {}
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
        key = (id(body.mesh), body.face_swatch.tobytes(), body.two_sided)  # bodies with equal keys share glTF meshes
        if key not in self.meshes:
            self.meshes[key] = [self.add_mesh(body, piece) for piece in pieces_of(body)]
        pieces = [{"name": f"{body.name}/{swatch}", "mesh": mesh} for mesh, swatch in self.meshes[key]]
        children = [self.add("nodes", node) for node in pieces]
        extras: dict[str, Any] = {"hapscene_body": body.name, "two_sided": body.two_sided}
        if body.parent is not None:
            extras["parent"] = body.parent
        if (fine := fine_to_json(self.scene, body)) is not None:
            extras["fine"] = fine
        matrix = body.X_WB.T.ravel().tolist()
        node = {"name": body.name, "matrix": matrix, "children": children, "extras": extras}
        self.tree["nodes"][0]["children"].append(self.add("nodes", node))

    def add_mesh(self, body: Body, piece: Piece) -> tuple[int, str]:
        swatch = self.scene.swatches[piece.swatch]
        if piece.swatch == 0 and body.mesh.colour_rgb is not None:
            primitive = self.add_coloured(body, body.mesh.colour_rgb)
        else:
            material = self.add_material(piece.swatch, swatch, body.two_sided)
            primitive = self.add_faces(piece.vertices_m, piece.faces, material)
        return self.add("meshes", {"name": f"{body.name}/{swatch.name}", "primitives": [primitive]}), swatch.name

    def add_faces(self, vertices_m: NDArray[np.float64], faces: NDArray[np.int64], material: int) -> dict[str, Any]:
        attributes = {"POSITION": self.add_positions(vertices_m)}
        return {"attributes": attributes, "indices": self.add_indices(faces), "material": material}

    def add_coloured(self, body: Body, colour_rgb: NDArray[np.uint8]) -> dict[str, Any]:
        """Add the faces without a swatch, coloured as in the mesh file, with a vertex for each colour of its faces."""
        plain = body.face_swatch == 0
        corners = body.mesh.faces[plain].astype(np.int64)
        packed = colour_rgb[plain].astype(np.int64) @ (1 << 16, 1 << 8, 1)
        key, faces = np.unique(corners << 24 | packed[:, None], return_inverse=True)
        values = linear((key[:, None] >> (16, 8, 0) & 255) / 255).astype("<f4")
        material = self.add_material(0, self.scene.swatches[0], body.two_sided, own_colours=True)
        primitive = self.add_faces(body.mesh.vertices_m[key >> 24], faces.reshape(-1, 3), material)
        view = self.add_view(values.tobytes(), ARRAY_BUFFER)
        accessor = {"bufferView": view, "componentType": FLOAT, "count": len(values), "type": "VEC3"}
        primitive["attributes"]["COLOR_0"] = self.add("accessors", accessor)
        return primitive

    def add_material(self, index: int, swatch: Swatch, two_sided: bool, own_colours: bool = False) -> int:
        """Return the material of a swatch; white if its faces have the colours of the mesh file."""
        key = (index, two_sided, own_colours)
        if key not in self.materials:
            extras = {"hapscene_swatch": swatch.name, **swatch.own_numbers, "albedo_rgb": list(swatch.albedo_rgb)}
            extras["sha256"] = digest_of(swatch)
            if len(text := swatch_to_json(swatch)) <= EMBEDDED_MAX:
                extras["swatch_file"] = text
            colour = [1.0] * 4 if own_colours else [*linear(swatch.albedo_rgb).tolist(), 1.0]
            look = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.8}
            material = {"name": swatch.name, "pbrMetallicRoughness": look, "doubleSided": two_sided, "extras": extras}
            self.materials[key] = self.add("materials", material)
        return self.materials[key]

    def add_unused(self) -> None:
        """Add materials for unused swatches, except swatch 0, which every scene has."""
        used = {index for index, *_ in self.materials}
        for index, swatch in enumerate(self.scene.swatches):
            if index > 0 and index not in used:
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
