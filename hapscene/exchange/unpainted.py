"""Export to formats without scenes: PLY and OBJ, which keep swatch names. World frame, metres."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError
from hapscene.exchange.cut_faces import cut_faces
from hapscene.exchange.swatch_payload import known_swatch
from hapscene.io.files import whole_file, write_whole
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh
from hapscene.scene.ply import mesh_to_ply
from hapscene.scene.scene import Scene

__all__ = ["read_named", "write_obj", "write_ply"]


def write_obj(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as OBJ with an object for each body and a material for each swatch, and its MTL file.

    Raises:
        SceneError: a file cannot be written.
    """
    library = path.with_suffix(".mtl")
    try:
        with whole_file(library) as colours, whole_file(path) as shapes:
            with colours.open("w", encoding="utf-8", newline="\n") as out:
                for swatch in scene.swatches:
                    out.write(f"newmtl {_line(swatch.name)}\nKd {' '.join(map(repr, swatch.albedo_rgb))}\n\n")
            with shapes.open("w", encoding="utf-8", newline="\n") as out:
                out.write(f"# in metres, z up\nmtllib {library.name}\n")
                out.writelines(_obj_lines(scene))
    except OSError as error:
        raise SceneError(f"{path}: cannot be written: {error.strerror or error}") from None
    return [path, library]


def _obj_lines(scene: Scene) -> Iterator[str]:
    start = 1
    for body in scene.bodies:
        vertices_m, faces, face_swatch, *_ = cut_faces(body)
        yield f"o {_line(body.name)}\n"
        for x, y, z in _world(body, vertices_m).tolist():
            yield f"v {x!r} {y!r} {z!r}\n"
        for index in np.unique(face_swatch):
            yield f"usemtl {_line(scene.swatches[index].name)}\n"
            for a, b, c in (faces[face_swatch == index] + start).tolist():
                yield f"f {a} {b} {c}\n"
        start += len(vertices_m)


def _line(name: str) -> str:
    """Return a name for an OBJ line, in which a backslash would continue the line."""
    return name.replace("\\", "_")


def write_ply(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as one binary PLY: faces with the number and the colour of their swatch, whose names are comments.

    Raises:
        SceneError: the file cannot be written.
    """
    cut = [cut_faces(body) for body in scene.bodies]
    start = np.cumsum([0, *(len(one.vertices_m) for one in cut)])
    swatch = np.concatenate([one.swatch for one in cut]).astype(np.int16)
    colours = np.rint(255 * np.array([swatch.albedo_rgb for swatch in scene.swatches])).astype(np.uint8)
    mesh = Mesh(
        np.concatenate([_world(body, one.vertices_m) for body, one in zip(scene.bodies, cut, strict=True)]),
        np.concatenate([one.faces + at for one, at in zip(cut, start[:-1], strict=True)]).astype(np.int32),
        swatch,
        tuple(swatch.name for swatch in scene.swatches),
        colours[swatch],
    )
    write_whole(path, mesh_to_ply(mesh), SceneError)
    return [path]


def _world(body: Body, vertices_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vertices (n, 3) of a body in the world frame [m]."""
    return np.asarray(vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3])


def read_named(path: Path, unit: str | None, up: str | None = None, scale: float = 1.0) -> Scene:
    """Read a scene from any mesh file; faces with the name of a library swatch are painted.

    Raises:
        MeshError: the mesh cannot be loaded.
        SwatchError: a swatch of the library is invalid.
    """
    scene = Scene()
    body = scene.add(scene.mesh_of(path, unit, up=up, scale=scale))
    for index, full in enumerate(body.mesh.group_names):
        # The last part is the material name, which takes precedence over the object name.
        known = next((name for name in full.split("/")[::-1] if known_swatch(name) is not None), None)
        if known is not None:
            body.face_swatch[body.mesh.group == index] = scene.swatch_index(known)
    return scene
