"""Rendering of frames and of the window with pyrender. No other module imports pyrender."""

import sys
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.view.camera import facing, orbit, pose_of
from hapscene.view.palette import Theme, rgb
from hapscene.view.triangles import Drawing, Shown, Triangles, joined, moved, same

__all__ = ["render", "watch", "without_viewer"]

AMBIENT: Final = (0.32, 0.32, 0.32)
"""Ambient light."""

LIGHTS: Final = (((-0.5, 0.8, 1.0), 2.2), ((1.0, 0.1, 0.6), 0.9))
"""Directional lights that are fixed to the camera: direction to the light in the camera frame, and intensity."""

CAPTION_PT: Final = 18
"""Text size of the window [pixels]."""

WINDOW_PX: Final = (1000, 750)
"""Size of the window [pixels]."""

VIEW_RAD: Final = np.radians(30.0)
"""Vertical field of view of the window [rad]: little distortion, but still perspective."""


def render(drawing: Drawing) -> Iterator[NDArray[np.uint8]]:
    """Render a drawing without a screen, on the GL platform in PYOPENGL_PLATFORM.

    Yields:
        RGB pixels (height, width, 3) of each frame.
    """
    from PIL import Image

    pyrender = without_viewer()
    scene = _empty(pyrender, drawing.background)
    x_m, y_m, far_m = drawing.extent_m
    camera = scene.add(pyrender.OrthographicCamera(x_m, y_m, znear=far_m * 1e-4, zfar=far_m))
    lights = []
    for direction_C, strength in LIGHTS:  # a pyrender light shines along its −z axis
        light = scene.add(pyrender.DirectionalLight(color=np.ones(3), intensity=strength))
        lights.append((light, pose_of(facing(np.array(direction_C), (0.0, 1.0, 0.0)))))
    renderer = pyrender.OffscreenRenderer(*(n * drawing.oversampling for n in drawing.size))
    seen: Shown | None = None
    nodes: list[Any] = []
    for frame in drawing.frames:
        if seen is None or not same(seen, frame.shown):
            seen = frame.shown
            placed = [moved(drawing.parts[part], X_SP) for part, X_SP in seen]
            # one mesh where possible: in software GL a draw call costs more than its triangles
            solids = [joined([one for one in placed if one.simple]), *(one for one in placed if not one.simple)]
            for node in nodes:
                scene.remove_node(node)
            nodes = [scene.add(_mesh(pyrender, solid)) for solid in solids if len(solid.corner_m)]
        for fixed, X_CL in ((camera, np.eye(4)), *lights):
            scene.set_pose(fixed, frame.X_SC @ X_CL)
        pixels, _ = renderer.render(scene)
        yield np.asarray(Image.fromarray(np.ascontiguousarray(pixels[..., :3])).reduce(drawing.oversampling))


def without_viewer() -> ModuleType:
    """Import pyrender without its viewer, which would load pyglet and with it libGL, libEGL or X11."""
    stub = ModuleType("pyrender.viewer")
    stub.Viewer = None  # type: ignore[attr-defined]
    sys.modules.setdefault("pyrender.viewer", stub)
    return import_module("pyrender")


def watch(
    parts: Sequence[Triangles],
    points_m: NDArray[np.float64],
    title: str,
    theme: Theme,
    now: Callable[[], tuple[Shown, str]],
) -> None:
    """Open a window and return when it is closed.

    Args:
        parts: parts that can be shown.
        points_m: points that must be visible (k, 3) [m].
        title: title of the window.
        theme: colours of background and text.
        now: returns the visible parts of the next frame and its caption.
    """
    import pyrender

    scene = _empty(pyrender, theme.background)
    nodes = [scene.add(_mesh(pyrender, part)) if len(part.corner_m) else None for part in parts]
    (R_SC,) = orbit([0.0])
    distance_m = 0.85 * float(np.linalg.norm(points_m, axis=1).max()) / np.sin(VIEW_RAD / 2)
    camera = pyrender.PerspectiveCamera(VIEW_RAD, znear=distance_m * 1e-2, zfar=10.0 * distance_m)
    scene.add(camera, pose=pose_of(R_SC, R_SC[:, 2] * distance_m))

    class Window(pyrender.Viewer):  # type: ignore[misc]
        due = False

        def draw(self, dt: float) -> None:
            """Called by the event loop of pyglet for each frame that is shown."""
            self.due = True
            super().draw(dt)

        def on_draw(self) -> None:
            if not self.due or self._renderer is None:
                return  # pyrender's timer also requests frames, which would not be shown
            self.due = False
            shown, line = now()
            _arrange(scene, nodes, shown)
            text = line.encode("ascii", "replace").decode()  # pyrender has only ASCII glyphs
            ink = np.append(rgb(theme.ink), 1.0)
            style = {"font_name": "OpenSans-Regular", "font_pt": CAPTION_PT, "color": ink, "scale": 1.0}
            where = pyrender.constants.TextAlign.BOTTOM_LEFT
            self.viewer_flags["caption"] = [{"text": text, "location": where, **style}]
            super().on_draw()

    window = Window(
        scene,
        viewport_size=WINDOW_PX,
        auto_start=False,
        use_raymond_lighting=True,
        cull_faces=False,
        window_title=title,
        view_center=np.zeros(3),
    )
    try:
        window.start()
    except KeyboardInterrupt:
        window.on_close()


def _empty(pyrender: ModuleType, background: str) -> Any:
    """Return an empty scene."""
    return pyrender.Scene(bg_color=(*rgb(background), 1.0), ambient_light=AMBIENT)


def _mesh(pyrender: ModuleType, solid: Triangles) -> Any:
    """Convert triangles to a pyrender mesh."""
    look: dict[str, Any] = {}
    if solid.picture is not None:
        look["baseColorTexture"] = pyrender.Texture(
            source=solid.picture, source_channels="RGBA"[: solid.picture.shape[2]]
        )
    if solid.colour.shape[1] == 4 or (solid.picture is not None and solid.picture.shape[2] == 4):
        look["alphaMode"] = "BLEND"
    primitive = pyrender.Primitive(
        positions=solid.corner_m.astype(np.float32),
        normals=solid.normal.astype(np.float32),
        color_0=solid.colour.astype(np.float32),
        texcoord_0=None if solid.uv is None else solid.uv.astype(np.float32),
        mode=4,
        material=pyrender.MetallicRoughnessMaterial(metallicFactor=0.0, roughnessFactor=0.85, doubleSided=True, **look),
    )
    return pyrender.Mesh([primitive])


def _arrange(scene: Any, nodes: Sequence[Any], shown: Shown) -> None:
    """Show exactly these parts at their poses."""
    poses = dict(shown)
    for index, node in enumerate(nodes):
        if node is None:
            continue
        node.mesh.is_visible = index in poses
        if index in poses and not np.array_equal(node.matrix, poses[index]):
            scene.set_pose(node, poses[index])
