"""Rendering of frames with pyrender. No other module imports pyrender."""

import sys
from collections.abc import Iterator, Sequence
from functools import reduce
from importlib import import_module
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.view.palette import rgb
from hapscene.view.shadows import SUN, ZENITH, DepthPicture, Shadows
from hapscene.view.triangles import Drawing, Shown, Triangles, facing, fit_cameras, joined, moved, pose_of, same

__all__ = ["render", "without_viewer"]

AMBIENT: Final = (0.32, 0.32, 0.32)
"""Ambient light."""

SUN_INTENSITY: Final = 2.4

FILL: Final = ((1.0, 0.1, 0.6), 0.7)
"""Second light, which is fixed to the camera: direction to the light in the camera frame, and intensity."""

NEAR: Final = 1e-4
"""Nearest visible depth of an orthographic camera, relative to the farthest [1]."""


def render(drawing: Drawing) -> Iterator[NDArray[np.uint8]]:
    """Render a drawing without a screen, on the GL platform in PYOPENGL_PLATFORM.

    Yields:
        RGB pixels (height, width, 3) of each frame.
    """
    from PIL import Image

    pyrender = without_viewer()
    scene = _empty(pyrender, drawing.background)
    x_m, _, far_m = drawing.extent_m
    camera = scene.add(_camera(pyrender, drawing.extent_m))
    scene.add(pyrender.DirectionalLight(np.ones(3), SUN_INTENSITY), pose=_toward(SUN))
    fill = scene.add(pyrender.DirectionalLight(np.ones(3), FILL[1]))
    renderer = pyrender.OffscreenRenderer(*(n * drawing.oversampling for n in drawing.size))
    shadows = _shadows(pyrender, drawing)
    seen: Shown | None = None
    node = None
    for frame in drawing.frames:
        if seen is None or not same(seen, frame.shown):
            seen = frame.shown
            placed = [moved(drawing.parts[part], X_SP) for part, X_SP in seen]
            # one mesh where possible: in software GL a draw call costs more than its triangles
            solids = [joined([one for one in placed if one.simple]), *(one for one in placed if not one.simple)]
            if node is not None:
                scene.remove_node(node)
            node = scene.add(_mesh(pyrender, solids))
        scene.set_pose(camera, frame.X_SC)
        scene.set_pose(fill, frame.X_SC @ _toward(FILL[0]))
        pixels, depth = renderer.render(scene)
        n = drawing.oversampling
        small = np.asarray(Image.fromarray(np.ascontiguousarray(pixels[..., :3])).reduce(n))
        if shadows is not None:
            small = shadows.cast(small, _distance(depth, far_m, n), frame.X_SC, 2 * x_m / small.shape[1])
        yield small


def _shadows(pyrender: ModuleType, drawing: Drawing) -> Shadows | None:
    """Draw the depth of the parts that cast shadows, as seen from the sun and from the zenith."""
    parts = [drawing.parts[part] for part in drawing.casters]
    solid = joined([part._replace(colour=part.normal) for part in parts])
    corner_m = solid.corner_m
    if not len(corner_m):
        return None
    scene = _empty(pyrender, drawing.background)
    scene.add(_mesh(pyrender, [solid]))
    renderer, found = pyrender.OffscreenRenderer(*drawing.size), list[DepthPicture]()
    for direction in (SUN, ZENITH):
        (X_SC,), extent_m, pixel_m = fit_cameras(corner_m, [_toward(direction)[:3, :3]], drawing.size)
        node = scene.add(_camera(pyrender, extent_m), pose=X_SC)
        depth = renderer.render(scene, pyrender.RenderFlags.DEPTH_ONLY)
        found.append(DepthPicture(_distance(depth, extent_m[2]), X_SC, pixel_m))
        scene.remove_node(node)
    low_m, high_m = corner_m.min(axis=0), corner_m.max(axis=0)
    return Shadows(found[0], found[1], float(low_m[2]), float(np.linalg.norm(high_m - low_m)))


def _toward(direction: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the pose of a light or a camera in this direction, which looks along its −z axis."""
    return pose_of(facing(np.array(direction), (0.0, 1.0, 0.0)))


def _camera(pyrender: ModuleType, extent_m: tuple[float, float, float]) -> Any:
    return pyrender.OrthographicCamera(*extent_m[:2], znear=extent_m[2] * NEAR, zfar=extent_m[2])


def _distance(depth: NDArray[np.float32], far_m: float, n: int = 1) -> NDArray[np.float32]:
    """Return the depth seen by `_camera` [m], infinite without a surface.

    Of n × n pixels it is the farthest: the ground at edges of bodies. pyrender converts the depth as if the camera had
    a perspective; this is converted back.
    """
    depth = np.where(depth > 0, depth, np.float32(np.inf))
    depth = reduce(np.maximum, (depth[row::n] for row in range(n)))
    depth = reduce(np.maximum, (depth[:, column::n] for column in range(n)))
    share = (1 + NEAR - 2 * NEAR * far_m / depth) / (1 - NEAR)
    return np.where(np.isinf(depth), np.inf, far_m * (NEAR + (share + 1) / 2 * (1 - NEAR))).astype(np.float32)


def without_viewer() -> ModuleType:
    """Import pyrender without its viewer, which would load pyglet and with it libGL, libEGL or X11."""
    stub = ModuleType("pyrender.viewer")
    stub.Viewer = None  # type: ignore[attr-defined]
    sys.modules.setdefault("pyrender.viewer", stub)
    return import_module("pyrender")


def _empty(pyrender: ModuleType, background: str) -> Any:
    """Return an empty scene."""
    return pyrender.Scene(bg_color=(*rgb(background), 1.0), ambient_light=AMBIENT)


def _mesh(pyrender: ModuleType, solids: Sequence[Triangles]) -> Any:
    """Convert triangles to one pyrender mesh, translucent ones last: pyrender draws several in any order."""
    solids = sorted((solid for solid in solids if len(solid.corner_m)), key=_is_translucent)
    return pyrender.Mesh([_primitive(pyrender, solid) for solid in solids])


def _is_translucent(solid: Triangles) -> bool:
    return solid.colour.shape[1] == 4 or (solid.picture is not None and solid.picture.shape[2] == 4)


def _primitive(pyrender: ModuleType, solid: Triangles) -> Any:
    look: dict[str, Any] = {}
    if solid.picture is not None:
        look["baseColorTexture"] = pyrender.Texture(
            source=solid.picture, source_channels="RGBA"[: solid.picture.shape[2]]
        )
    if _is_translucent(solid):
        look["alphaMode"] = "BLEND"
    return pyrender.Primitive(
        positions=solid.corner_m.astype(np.float32),
        normals=solid.normal.astype(np.float32),
        color_0=solid.colour.astype(np.float32),
        texcoord_0=None if solid.uv is None else solid.uv.astype(np.float32),
        mode=4,
        material=pyrender.MetallicRoughnessMaterial(
            metallicFactor=0.0, roughnessFactor=solid.roughness, doubleSided=True, **look
        ),
    )
