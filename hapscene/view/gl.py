"""Frames and the window, drawn with pyrender. No other module imports pyrender."""

import sys
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.view.camera import facing, looks, pose_of
from hapscene.view.palette import EDGE, Theme, rgb
from hapscene.view.triangles import Drawing, Shown, Triangles, joined, moved, same

__all__ = ["render", "watch", "without_viewer"]

AMBIENT: Final = (0.32, 0.32, 0.32)
"""Light from everywhere."""

LIGHTS: Final = (((-0.5, 0.8, 1.0), 2.2), ((1.0, 0.1, 0.6), 0.9))
"""Lights that stand beside the camera: where, in its axes, and how strong."""

CAPTION_PT: Final = 18
"""Height of the window's text [pixels]."""

WINDOW_PX: Final = (1000, 750)
"""Size of the window [pixels]."""

VIEW_RAD: Final = np.radians(30.0)
"""Height of the window camera's view [rad]: little distortion, and still depth."""


def render(drawing: Drawing) -> Iterator[NDArray[np.uint8]]:
    """Draw on the platform of GL that PYOPENGL_PLATFORM names, without a screen.

    Yields:
        RGB pixels (height, width, 3) of each frame.
    """
    from PIL import Image

    pyrender = without_viewer()
    scene = _empty(pyrender, drawing.background)
    x_m, y_m, far_m = drawing.extent_m
    camera = scene.add(pyrender.OrthographicCamera(x_m, y_m, znear=far_m * 1e-4, zfar=far_m))
    lights = []
    for direction_C, strength in LIGHTS:  # one shines from +z to the origin
        light = scene.add(pyrender.DirectionalLight(color=np.ones(3), intensity=strength))
        lights.append((light, pose_of(facing(np.array(direction_C), (0.0, 1.0, 0.0)))))
    renderer = pyrender.OffscreenRenderer(*(n * drawing.oversampling for n in drawing.size))
    seen, node = None, None
    for frame in drawing.frames:
        if seen is None or not same(seen, frame.shown):
            # as one, since in software GL a call costs more than its triangles
            whole = joined([moved(drawing.parts[part], X_SP) for part, X_SP in frame.shown])
            if node is not None:
                scene.remove_node(node)
            seen, node = frame.shown, scene.add(_mesh(pyrender, whole))
        for fixed, X_CL in ((camera, np.eye(4)), *lights):
            scene.set_pose(fixed, frame.X_SC @ X_CL)
        pixels, _ = renderer.render(scene)
        yield np.asarray(Image.fromarray(np.ascontiguousarray(pixels[..., :3])).reduce(drawing.oversampling))


def without_viewer() -> Any:
    """Import pyrender without its viewer, which would load pyglet, and that libGL, libEGL or X11: OSMesa needs none."""
    stub = ModuleType("pyrender.viewer")
    stub.Viewer = None  # type: ignore[attr-defined]
    sys.modules.setdefault("pyrender.viewer", stub)
    import pyrender

    return pyrender


def watch(
    parts: Sequence[Triangles],
    points_m: NDArray[np.float64],
    legend: Sequence[tuple[str, str]],
    title: str,
    theme: Theme,
    now: Callable[[], tuple[Shown, str]],
) -> None:
    """Open a window, and return when it is closed.

    Args:
        parts: what can be seen.
        points_m: what the camera must hold (k, 3).
        legend: texts, each with the colour that it explains.
        title: of the window.
        theme: colours around the scene.
        now: returns what is shown in the next frame, and its caption.
    """
    import pyrender
    from OpenGL import GL

    scene = _empty(pyrender, theme.background)
    nodes = [scene.add(_mesh(pyrender, part)) if len(part.corner_m) else None for part in parts]
    (R_SC,) = looks([0.0])
    distance_m = 0.85 * float(np.linalg.norm(points_m, axis=1).max()) / np.sin(VIEW_RAD / 2)
    camera = pyrender.PerspectiveCamera(VIEW_RAD, znear=distance_m * 1e-2, zfar=10.0 * distance_m)
    scene.add(camera, pose=pose_of(R_SC, R_SC[:, 2] * distance_m))

    class Window(pyrender.Viewer):  # type: ignore[misc]
        due = False

        def draw(self, dt: float) -> None:
            """Called by pyglet's loop for a frame, which it then shows."""
            self.due = True
            super().draw(dt)

        def on_draw(self) -> None:
            if not self.due or self._renderer is None:
                return  # pyrender's own clock asks as well, for frames that would not be shown
            self.due = False
            shown, line = now()
            _arrange(scene, nodes, shown)
            super().on_draw()
            step = round(CAPTION_PT * 1.6)
            y = self.viewport_size[1] - step
            for text, colour in legend:
                self._fill(12, y, CAPTION_PT, CAPTION_PT, EDGE)  # or paper were lost on a light ground
                self._fill(13, y + 1, CAPTION_PT - 2, CAPTION_PT - 2, colour)
                self._write(text, 12 + CAPTION_PT + 10, y + 2)
                y -= step
            self._write(line, 12, 14)

        def _fill(self, x: int, y: int, width: int, height: int, colour: str) -> None:
            GL.glEnable(GL.GL_SCISSOR_TEST)
            GL.glScissor(x, y, width, height)
            GL.glClearColor(*rgb(colour), 1.0)
            GL.glClear(GL.GL_COLOR_BUFFER_BIT)
            GL.glDisable(GL.GL_SCISSOR_TEST)

        def _write(self, text: str, x: int, y: int) -> None:
            safe = text.encode("ascii", "replace").decode()  # pyrender has glyphs for no more
            self._renderer.render_text(safe, x, y, font_pt=CAPTION_PT, color=np.append(rgb(theme.ink), 1.0))

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


def _empty(pyrender: Any, background: str) -> Any:
    """A scene with nothing in it."""
    return pyrender.Scene(bg_color=(*rgb(background), 1.0), ambient_light=AMBIENT)


def _mesh(pyrender: Any, solid: Triangles) -> Any:
    """The triangles as pyrender takes them."""
    primitive = pyrender.Primitive(
        positions=solid.corner_m.astype(np.float32),
        normals=solid.normal.astype(np.float32),
        color_0=solid.colour.astype(np.float32),
        mode=4,
        material=pyrender.MetallicRoughnessMaterial(metallicFactor=0.0, roughnessFactor=0.85, doubleSided=True),
    )
    return pyrender.Mesh([primitive])


def _arrange(scene: Any, nodes: Sequence[Any], shown: Shown) -> None:
    """Show these parts, at these poses, and no others."""
    poses = dict(shown)
    for index, node in enumerate(nodes):
        if node is None:
            continue
        node.mesh.is_visible = index in poses
        if index in poses and not np.array_equal(node.matrix, poses[index]):
            scene.set_pose(node, poses[index])
