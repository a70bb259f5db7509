"""What is seen in the browser: the bodies in the colours of their swatches, brush, tool and force; the eye's rays."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.motion.look_from_above import bounds_of
from hapscene.paint.change_watch import Changes
from hapscene.paint.display import ChunkKey, Display
from hapscene.paint.paintable_mesh import Hit, project_to_surface
from hapscene.paint.painting import Painting
from hapscene.view.palette import FORCE, OKABE_ITO, distinct_colours, linear, rgb

SHOWN: Final = 3.0
"""How large a scene is shown, its diagonal in viser's units: what the browser's near plane and keys are made for."""

FOV_RAD: Final = float(np.radians(50.0))
"""Of the camera, from top to bottom [rad]."""

ASPECT_MIN: Final = 0.1
"""Narrowest canvas that the camera goes back for [1]."""

RING_COUNT: Final = 64
"""Corners of the brush's ring [count]."""

DASH: Final = 4
"""Sides of the ring that are dark, and then bright [count]."""

ARROW_N: Final = 2.0
"""Force that is shown as long as an eighth of the scene's diagonal [N]: a firm stroke is about as much."""

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Pointer:
    """Where the pointer is on a page's canvas: from left and top, in shares of its size in pixels."""

    client: int
    x: float
    y: float
    width: float
    height: float


class SceneView:
    """The 3-D part of the page, shared by all who look.

    Args:
        server: viser's.
        painting: what is shown.

    Attributes:
        diagonal_m: of the scene [m].
        colours: of the scene's swatches, "#rrggbb": their own, but none like an earlier one's.
    """

    def __init__(self, server: Any, painting: Painting) -> None:
        self._server = server
        self._painting = painting
        bounds = np.array([bounds_of(body) for body in painting.scene.bodies])
        low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
        self.middle_W_m: Vector = (low + high) / 2
        self.diagonal_m = float(np.linalg.norm(high - low))
        self._scale = SHOWN / self.diagonal_m
        self._display = Display(painting)
        self.colours = self._distinct()
        self._layers: dict[ChunkKey, dict[int, Any]] = {}
        self._extent = (high - low) * self._scale
        self._place_camera()
        self._light()
        self._make_marks()
        self._draw(self._display.chunks())

    # --- the bodies ---

    def update(self, changes: Changes) -> None:
        """Show what changed: only chunks that look different are sent again."""
        if changes.swatches or changes.shelf:
            before, self.colours = self.colours, self._distinct()
            others = {i for i, pair in enumerate(zip(before, self.colours, strict=False)) if pair[0] != pair[1]}
            for layers in self._layers.values():
                for swatch in others & set(layers):
                    layers[swatch].color = _rgb(self.colours[swatch])
        self._draw(self._display.update(changes))

    def _draw(self, keys: list[ChunkKey]) -> None:
        for key in keys:
            body = self._painting.scene.bodies[key.body]
            old, new = self._layers.get(key, {}), {}
            with self._server.atomic():
                for layer in self._display.layers(key):
                    new[layer.swatch] = self._server.scene.add_mesh_simple(
                        f"/body/{key.body}/{key.chunk}/{layer.swatch}",
                        layer.vertices_m,
                        layer.faces,
                        color=_rgb(self.colours[layer.swatch]),
                        flat_shading=True,
                        side="double" if body.two_sided else "front",
                        cast_shadow=False,
                        receive_shadow=False,
                        scale=self._scale,
                        wxyz=_quaternion(body.X_WB[:3, :3]),
                        position=self.to_view(body.X_WB[:3, 3]),
                    )
                for swatch in old.keys() - new.keys():
                    old[swatch].remove()
            self._layers[key] = new

    def _distinct(self) -> list[str]:
        swatches = self._painting.scene.swatches
        return distinct_colours(swatches, range(len(swatches)))

    # --- between W and what is shown ---

    def to_view(self, p_W_m: Any) -> Vector:
        """Places (…, 3) in W [m] as viser has them."""
        return np.asarray((np.asarray(p_W_m) - self.middle_W_m) * self._scale)

    def ray(self, pointer: Pointer) -> tuple[Vector, Vector] | None:
        """From the eye through the pointer: a point in W [m] and a direction; None where that page is not there."""
        client = self._server.get_clients().get(pointer.client)
        if client is None:
            return None
        camera = client.camera
        place = np.concatenate([np.ravel(camera.wxyz), np.ravel(camera.position), [camera.fov]])
        if place.shape != (8,) or not np.isfinite(place).all() or not 0.0 < camera.fov < np.pi:
            return None  # a browser sends no such camera
        tangent = np.tan(camera.fov / 2)
        right = (2 * pointer.x - 1) * tangent * pointer.width / pointer.height
        down = (2 * pointer.y - 1) * tangent
        w, x, y, z = camera.wxyz
        forth = np.array([right, down, 1.0])
        axis = np.array([x, y, z])
        direction = forth + 2 * np.cross(axis, np.cross(axis, forth) + w * forth)
        origin = np.asarray(camera.position) / self._scale + self.middle_W_m
        return origin, direction / np.linalg.norm(direction)

    # --- marks ---

    def show_ring(self, hit: Hit | None, radius_m: float) -> None:
        """The brush's ring around a place, laid on the surface; None hides it."""
        self._ring.visible = hit is not None
        if hit is None:
            return
        side = np.cross(hit.nhat_W, np.eye(3)[np.argmin(np.abs(hit.nhat_W))])
        side /= np.linalg.norm(side)
        turn = np.linspace(0.0, 2 * np.pi, RING_COUNT, endpoint=False)[:, None]
        way = np.cos(turn) * side + np.sin(turn) * np.cross(hit.nhat_W, side)
        body, shape = self._painting.scene.bodies[hit.body], self._painting.shapes[hit.body]
        laid_W_m = project_to_surface(body, shape, hit, hit.p_W_m + radius_m * way, radius_m)
        laid = self.to_view(laid_W_m) + 0.004 * hit.nhat_W
        self._ring.points = np.stack([laid, np.roll(laid, -1, axis=0)], axis=1).astype(np.float32)

    def show_box(self, low_high_K_m: NDArray[np.float64] | None, X_WK: NDArray[np.float64] | None = None) -> None:
        """The edges of a box: its size (3,) [m] and pose; None hides it."""
        self._box.visible = low_high_K_m is not None
        if low_high_K_m is None or X_WK is None:
            return
        self._box.position = self.to_view(X_WK[:3, 3])
        self._box.wxyz = _quaternion(X_WK[:3, :3])
        self._box.scale = tuple((np.maximum(low_high_K_m, 1e-9) * self._scale).tolist())

    def show_sphere(self, centre_W_m: Vector | None, radius_m: float = 0.0) -> None:
        """A ball; None hides it."""
        self._sphere.visible = centre_W_m is not None
        if centre_W_m is not None:
            self._sphere.position = self.to_view(centre_W_m)
            self._sphere.scale = max(radius_m * self._scale, 1e-3)

    def show_touch(self, p_WT_m: Vector | None, p_WP_m: Vector | None = None, f_W_N: Vector | None = None) -> None:
        """Tool, proxy and force of a touch; None hides them."""
        for mark in (self._tool, self._proxy, self._arrow):
            mark.visible = p_WT_m is not None
        if p_WT_m is None or p_WP_m is None or f_W_N is None:
            return
        self._tool.position = self.to_view(p_WT_m)
        self._proxy.position = self.to_view(p_WP_m)
        size_N = float(np.linalg.norm(f_W_N))
        self._arrow.visible = size_N > 0.01
        if size_N > 0.01:
            length = SHOWN / 8 * size_N / ARROW_N
            self._arrow.position = self.to_view(p_WP_m)
            self._arrow.wxyz = _turn_to(f_W_N / size_N)
            self._arrow.scale = (1.0, 1.0, length)

    # --- how it is set up ---

    def _place_camera(self) -> None:
        """From the front, a little from the right and above, all in view."""
        self._server.scene.set_up_direction("+z")
        camera = self._server.initial_camera
        camera.fov = FOV_RAD
        camera.position = self._eye()
        camera.look_at = (0.0, 0.0, 0.0)

    def _eye(self, aspect: float = 1.0) -> Vector:
        """Where all is in view of a canvas `aspect` times as wide as high."""
        away = 1.1 * float(np.linalg.norm(self._extent)) / (2 * np.tan(FOV_RAD / 2)) / min(aspect, 1.0)
        direction = np.array([0.35, -0.8, 0.6])
        return np.asarray(away * direction / np.linalg.norm(direction))

    def frame(self, client: int, aspect: float) -> None:
        """Have all in view of a page that comes, and whose canvas is `aspect` times as wide as high."""
        page = self._server.get_clients().get(client)
        if page is not None and aspect < 1.0:
            page.camera.position = self._eye(max(aspect, ASPECT_MIN))
            page.camera.look_at = (0.0, 0.0, 0.0)  # which the other takes along

    def _light(self) -> None:
        """Soft from everywhere, and a key light from above left: every face is seen, and its shape."""
        scene = self._server.scene
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(150, 150, 160), intensity=1.6)
        scene.add_light_directional("/light/key", intensity=1.9, position=(-2.0, -3.0, 5.0))
        scene.add_light_directional("/light/fill", intensity=0.5, position=(4.0, 1.0, 1.0))

    def _make_marks(self) -> None:
        scene, ink = self._server.scene, _rgb(OKABE_ITO["purple"])
        dashes = np.where(np.arange(RING_COUNT) // DASH % 2, 255, 20).astype(np.uint8)  # seen on every colour
        line = {"thickness": 2.5, "thickness_units": "screen"}
        ring, colours = np.zeros((RING_COUNT, 2, 3), np.float32), np.repeat(dashes, 6).reshape(-1, 2, 3)
        self._ring = scene.add_line_segments("/mark/ring", ring, colours, **line)
        corner = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        edges = [(i, j) for i in range(8) for j in range(i) if np.count_nonzero(corner[i] != corner[j]) == 1]
        self._box = scene.add_line_segments("/mark/box", corner[np.array(edges)], ink, **line)
        self._sphere = scene.add_icosphere("/mark/sphere", 1.0, ink, opacity=0.3, cast_shadow=False)
        size = SHOWN / 120
        self._tool = scene.add_icosphere("/mark/tool", size, _rgb(OKABE_ITO["black"]), opacity=0.55, cast_shadow=False)
        self._proxy = scene.add_icosphere("/mark/proxy", 0.75 * size, _rgb(OKABE_ITO["vermilion"]), cast_shadow=False)
        up = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
        head = {"shaft_radius": size / 4, "head_radius": size / 1.6, "head_length": 0.25}
        self._arrow = scene.add_arrows("/mark/force", up, _linear(FORCE), **head)
        for mark in (self._ring, self._box, self._sphere, self._tool, self._proxy, self._arrow):
            mark.visible = False


def _rgb(colour: str) -> tuple[int, int, int]:
    """Of "#rrggbb"."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _linear(colour: str) -> tuple[int, int, int]:
    """Of "#rrggbb", for what viser takes in linear light: arrows."""
    red, green, blue = (round(255 * float(c)) for c in linear(rgb(colour)))
    return red, green, blue


def _turn_to(nhat: Vector) -> Vector:
    """Quaternion (w, x, y, z) that turns z to a unit vector, the shortest way."""
    w = 1.0 + float(nhat[2])
    if w < 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    turn = np.array([w, -nhat[1], nhat[0], 0.0])
    return np.asarray(turn / np.linalg.norm(turn))


def _quaternion(R: NDArray[np.float64]) -> Vector:
    """Quaternion (w, x, y, z) of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_quat(scalar_first=True))
