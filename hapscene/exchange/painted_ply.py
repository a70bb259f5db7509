"""Painted scenes as one binary PLY file in the world frame, with body and swatch indices on each face.

    comment hapscene scene 1
    comment unit m
    comment hapscene body INDEX TWO_SIDED POSE NAME            POSE: the 12 numbers of the upper rows of X_WB
    comment hapscene swatch INDEX NUMBERS RED GREEN BLUE SHA256 NAME

NUMBERS are stiffness [N/m], damping [N s/m], static and dynamic friction. Positions are float64; colours are those of
the swatches. Textures do not fit in comments; they are restored from the library by name and hash.
"""

import io
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import MeshError, SceneError
from hapscene.exchange.cut_faces import cut_faces
from hapscene.exchange.gltf_read import read_bounded
from hapscene.exchange.swatch_payload import VERSION, check_version, digest_of, is_digest, restore
from hapscene.io.files import write_whole
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh
from hapscene.scene.ply import HEADER_MAX_B, declared_counts
from hapscene.scene.scene import Scene
from hapscene.scene.scene_file import BODY_MAX
from hapscene.surface.swatch import BASIC_PARAMETERS, Swatch

__all__ = ["read_ply", "write_ply"]

_MARK: Final = "comment hapscene"
_END: Final = "end_header"
SWATCH_MAX: Final = 4096
"""Maximum number of swatches in a file [count]: each is looked up in the library."""


def write_ply(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as one binary PLY.

    Raises:
        SceneError: more than `SWATCH_MAX` swatches, a name with the end mark of the header, or the file cannot be
            written.
    """
    for what, named in (("body", scene.bodies), ("swatch", scene.swatches)):
        for name in (one.name for one in named if _END in one.name):
            raise SceneError(
                f"{path}: the name of {what} {name!r} contains {_END}, the end mark of a PLY header: rename it, or "
                "export to .glb"
            )
    if len(scene.swatches) > SWATCH_MAX:
        raise SceneError(f"{path}: {len(scene.swatches):,} swatches, at most {SWATCH_MAX:,} fit in a PLY file")
    cut = [cut_faces(body) for body in scene.bodies]
    counts = [len(vertices_m) for vertices_m, *_ in cut]
    start = np.cumsum([0, *counts])
    colour = np.array([s.albedo_rgb for s in scene.swatches])
    layout: Any = [("count", "u1"), ("corners", "<i4", 3), ("body", "<i4"), ("swatch", "<i2"), ("rgb", "u1", 3)]
    faces = np.zeros(sum(len(corners) for _, corners, *_ in cut), layout)
    faces["count"] = 3
    at = 0
    for i, (_, corners, swatch, *_) in enumerate(cut):
        rows = faces[at : (at := at + len(corners))]
        rows["corners"], rows["body"], rows["swatch"] = corners + start[i], i, swatch
        rows["rgb"] = np.round(255 * colour[swatch])
    placed = zip(scene.bodies, cut, strict=True)
    vertices = np.concatenate([points @ body.X_WB[:3, :3].T + body.X_WB[:3, 3] for body, (points, *_) in placed])
    lines = ["ply", "format binary_little_endian 1.0", f"{_MARK} scene {VERSION}", "comment unit m"]
    lines += [_body_line(i, body) for i, body in enumerate(scene.bodies)]
    lines += [_swatch_line(i, swatch) for i, swatch in enumerate(scene.swatches)]
    lines += [f"element vertex {len(vertices)}", *(f"property double {axis}" for axis in "xyz")]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "property int body"]
    lines += ["property short swatch", *(f"property uchar {c}" for c in ("red", "green", "blue")), _END, ""]
    write_whole(path, "\n".join(lines).encode() + vertices.astype("<f8").tobytes() + faces.tobytes(), SceneError)
    return [path]


def _body_line(index: int, body: Body) -> str:
    pose = " ".join(map(repr, body.X_WB[:3].ravel().tolist()))
    return f"{_MARK} body {index} {int(body.two_sided)} {pose} {body.name}"


def _swatch_line(index: int, swatch: Swatch) -> str:
    numbers = " ".join(map(repr, (*(getattr(swatch, n) for n in BASIC_PARAMETERS), *swatch.albedo_rgb)))
    return f"{_MARK} swatch {index} {numbers} {digest_of(swatch)} {swatch.name}"


def read_ply(path: Path) -> Scene | None:
    """Read a scene from a PLY file; return None if hapscene did not write the file.

    Raises:
        SceneError: damaged, or of a later version.
        MeshError, SwatchError: a mesh or a swatch in the file is invalid.
    """
    content = read_bounded(path)
    header = content[: max(content.find(_END.encode(), 0, HEADER_MAX_B), 0)].decode("utf-8", errors="replace")
    lines = [line.rstrip("\r") for line in header.split("\n")]
    mark = next((line for line in lines if line.startswith(f"{_MARK} scene ")), None)
    if mark is None:
        return None
    number = mark.split()[-1]
    check_version(path, int(number) if number.isdecimal() and len(number) < 10 else number)
    of_body = [line for line in lines if line.startswith(f"{_MARK} body ")]
    of_swatch = [line for line in lines if line.startswith(f"{_MARK} swatch ")]
    if len(of_body) > BODY_MAX or len(of_swatch) > SWATCH_MAX:  # before the lookup
        raise SceneError(f"{path}: too many bodies or swatches; at most {BODY_MAX:,} and {SWATCH_MAX:,} are allowed")
    vertices, faces, body_of, swatch_of = _arrays(path, content)
    for what, values, count in (("body", body_of, len(of_body)), ("swatch", swatch_of, len(of_swatch))):
        if values.min() < 0 or values.max() >= count:
            raise SceneError(f"{path}: {what} index of a face out of range; expected 0 to {count - 1}")
    poses = [_rows(path, line, 13) for line in of_body]
    scene = Scene()
    index_of = [scene.swatch_index(_swatch(path, line)) for line in of_swatch]
    order = np.argsort(body_of, kind="stable")
    cut = np.searchsorted(body_of[order], np.arange(len(poses) + 1))
    for i, (numbers, name) in enumerate(poses):
        chosen = order[cut[i] : cut[i + 1]]
        if not len(chosen):
            raise SceneError(f"{path}: body {name[:60]!r} has no faces")
        X_WB = np.vstack([np.reshape(numbers[1:], (3, 4)), [0.0, 0.0, 0.0, 1.0]])
        used, corners = np.unique(faces[chosen], return_inverse=True)
        p_B = (vertices[used] - X_WB[:3, 3]) @ X_WB[:3, :3]
        body = scene.add(
            Mesh(p_B, corners.reshape(-1, 3).astype(np.int32)), name=name, pose=X_WB, two_sided=bool(numbers[0])
        )
        for index in np.unique(swatch_of[chosen]):
            body.face_swatch[swatch_of[chosen] == index] = index_of[index]
    return scene


def _rows(path: Path, line: str, count: int) -> tuple[list[float], str]:
    """Parse the numbers and the name in a comment line."""
    tokens = line.split(" ", 4 + count)[4:]
    try:
        numbers = [float(token) for token in tokens[:count]]
        if len(tokens) != count + 1 or not np.isfinite(numbers).all():
            raise ValueError
        return numbers, tokens[count]
    except ValueError:
        raise SceneError(f"{path}: {line[:60]!r}: expected {count} numbers and a name") from None


def _swatch(path: Path, line: str) -> Swatch | str:
    numbers, rest = _rows(path, line, 7)
    sha256, _, name = rest.partition(" ")
    if not is_digest(sha256):
        raise SceneError(f"{path}: {line[:60]!r}: expected the SHA-256 of the swatch")
    return restore(path, name, dict(zip(BASIC_PARAMETERS, numbers, strict=False)), numbers[4:], sha256)


def _arrays(path: Path, content: bytes) -> tuple[NDArray[np.float64], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return vertices (n, 3), faces (m, 3), and the body and swatch of each face (m,)."""
    import trimesh

    declared_counts(content, str(path))  # rejects counts that do not fit in the file
    try:
        loaded: Any = trimesh.load(io.BytesIO(content), file_type="ply", process=False)
        rows = loaded.metadata["_ply_raw"]["face"]["data"]
        body, swatch = (np.asarray(rows[key]).ravel().astype(np.int64) for key in ("body", "swatch"))
        vertices, faces = np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces, np.int64)
    except Exception as error:  # trimesh raises many classes for damaged files
        raise SceneError(f"{path}: not a valid PLY file with body and swatch on its faces: {error!s:.200}") from None
    if not len(faces) == len(body) == len(swatch) or not len(faces):
        raise SceneError(f"{path}: truncated: {len(faces):,} faces, but {len(swatch):,} swatches of faces")
    if faces.min() < 0 or faces.max() >= len(vertices) or faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"{path}: vertex index of a face out of range; expected 0 to {len(vertices) - 1}")
    return vertices, faces, body, swatch
