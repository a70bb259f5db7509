"""The 3-D view in the browser: bodies, brush ring, tool and force, camera; rays from the eye through the pointer."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.exchange.gltf import look_glb, picture_glb
from hapscene.loop import ServoState
from hapscene.paint.model.display import ChunkKey, Display, ShownBody
from hapscene.paint.model.mesh import Hit, project_to_surface
from hapscene.paint.model.painting import Changes, Painting
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import parts
from hapscene.view.feel_layer import OPACITY, Show, grain_of
from hapscene.view.figure_parts import STYLUS, TOOL_LENGTH, TOOL_R_WT
from hapscene.view.palette import FORCE, LIGHT, OKABE_ITO, distinct_colours, linear, rgb
from hapscene.view.triangles import facing, lathe

if TYPE_CHECKING:
    import viser

__all__ = ["VIEWS", "Pointer", "SceneView", "ToolMarks", "rgb_bytes", "rotation"]

SHOWN: Final = 3.0
"""Diagonal of the scene in viser's units: suits viser's near plane and keyboard navigation."""

FOV_RAD: Final = float(np.radians(50.0))
"""Vertical field of view of the camera [rad]."""

ASPECT_MIN: Final = 0.1
"""Smallest aspect ratio of the canvas for which the camera distance is adapted [1]."""

GROWN: Final = 2.0
"""Factor by which the scene must grow or shrink before the view is rescaled [1]."""

RING_COUNT: Final = 64
"""Number of corners of the brush ring [count]."""

DASH: Final = 4
"""Number of consecutive dark, then bright sides of the ring [count]."""

ARROW_N: Final = 2.0
"""Force of an arrow with an eighth of the length of the scene's diagonal [N]: about the force of a firm stroke."""

VIEWS: Final[Mapping[str, tuple[float, float, float]]] = {
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, -1e-4, 1.0),
    "bottom": (0.0, -1e-4, -1.0),
    "perspective": (0.35, -0.8, 0.6),
}
"""Directions from the scene to the eye; slightly off the z axis for top and bottom, so that the front is below."""

ROOM: Final = 1.1
"""Distance of the eye from framed bodies, relative to the distance at which they would just fit [1]."""

Vector = NDArray[np.float64]
Camera: TypeAlias = "viser.CameraHandle | viser.InitialCameraConfig"


@dataclass(frozen=True)
class Pointer:
    """Position of the pointer on the canvas of a page, as fractions of its width and height in pixels."""

    client: int
    x: float
    y: float
    width: float
    height: float


class BodyFrame(NamedTuple):
    """Scene node of a body: viser's handle, its number, the display state, mesh handles by chunk and layer, and the
    handle of the textured mesh below the paint.
    """

    node: "viser.FrameHandle"
    number: int
    shown: ShownBody
    layers: dict[int, dict[tuple[int, int], "viser.MeshHandle"]]
    look: "viser.GlbHandle | None" = None


class SceneView:
    """The 3-D view, shared by all open pages.

    Args:
        server: viser server.
        painting: painted scene.
        display: display meshes of the painting.

    Attributes:
        diagonal_m: diagonal of the scene [m].
        scale: length of 1 m in viser's units.
        display: display meshes of the painting.
        colours: colours of the scene's swatches, "#rrggbb", changed where two would be similar.
        show: visible layers: look, the materials of the mesh files; feel, the paint; or both.
    """

    def __init__(self, server: "viser.ViserServer", painting: Painting, display: Display) -> None:
        self._server = server
        self._painting = painting
        self._measure()
        self.display = display
        self.colours = self._distinct()
        self.show: Show = "both"
        self._frames: dict[int, BodyFrame] = {}  # by id of the `ShownBody`
        self._frame_count = 0
        self._handles: viser.TransformControlsHandle | None = None
        self._grains: dict[int, tuple[object, viser.GlbHandle | None, float]] = {}  # appearance, picture, gain
        self._place_camera()
        self._light()
        self._make_marks()
        self._compose()
        self._show_grains()

    def _measure(self) -> None:
        bounds = np.array([body.bounds_W_m for body in self._painting.scene.bodies])
        low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
        self.middle_W_m: Vector = (low + high) / 2
        self.diagonal_m = float(np.linalg.norm(high - low))
        self.scale = SHOWN / self.diagonal_m

    # --- the bodies ---

    def update(self, changes: Changes) -> None:
        """Show changes; only changed chunks are sent."""
        if changes.swatches or changes.swatch_list:
            self.colours = self._distinct()
            self._show_grains()
        if changes.bodies:
            changed = self.display.compose()
            self._compose()
            self._draw(changed)
        elif changes.poses:
            self._place_bodies()
        self._draw(self.display.update(changes))
        if changes.swatches or changes.swatch_list:
            self._recolour()

    def _show_grains(self) -> None:
        """Send the pictures of grains that have changed; grain.js applies them."""
        for index, swatch in enumerate(self._painting.scene.swatches):
            known = self._grains.get(index, (None, None, 1.0))
            key = swatch.look, swatch.texture, swatch.parameter("lpc_texture", "texture_gain", 1.0)
            if known[0] == key:
                continue
            if known[1] is not None:
                known[1].remove()
            grain, handle, gain = grain_of(swatch), None, 1.0
            if not grain.flat:
                gain = grain.gain
                glb = picture_glb(grain.pattern / 255)
                handle = self._server.scene.add_glb(f"/grain/{index}", glb, visible=False, cast_shadow=False)
            self._grains[index] = key, handle, gain

    @property
    def grain(self) -> dict[str, dict[int, dict[int, float]] | dict[int, float]]:
        """Side of a grain's tile by number of the body and swatch [m], and the factor of each picture."""
        scene = self._painting.scene
        found = {i: gain for i, (_, handle, gain) in self._grains.items() if handle and i < len(scene.swatches)}
        grains, tiles = {i: grain_of(scene.swatches[i]) for i in found}, {}
        for body, shown in zip(scene.bodies, self.display.bodies, strict=False):
            if id(shown) in self._frames:
                number = self._frames[id(shown)].number
                tiles[number] = {i: grain.tile_m(body.mesh.diagonal_m) for i, grain in grains.items()}
        return {"tiles": tiles, "gains": found}

    def _compose(self) -> None:
        """Create, keep or remove the scene nodes so that there is one for each body."""
        bounds = np.array([body.bounds_W_m for body in self._painting.scene.bodies])
        size_m = float(np.linalg.norm(bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)))
        if not 1 / GROWN <= size_m / self.diagonal_m <= GROWN:
            self._measure()
            for layers in (layers for frame in self._frames.values() for layers in frame.layers.values()):
                for mesh in layers.values():
                    mesh.scale = self.scale
            for look in (known.look for known in self._frames.values() if known.look is not None):
                look.scale = self.scale
            for client in self._server.get_clients().values():
                self.look(client.camera)
        frames, self._frames, shown = self._frames, {}, self.display.bodies
        for key in frames.keys() - set(map(id, shown)):
            frames[key].node.remove()  # with its children
        fresh: set[int] = set()
        for index, body in enumerate(shown):
            frame = frames.get(id(body))
            if frame is None:
                node = self._server.scene.add_frame(f"/body/{self._frame_count}", show_axes=False)
                frame = BodyFrame(node, self._frame_count, body, {}, self._add_look(index, self._frame_count))
                self._frame_count += 1
                fresh.add(index)
            self._frames[id(body)] = frame
        self._place_bodies()
        self._draw([key for key in self.display.chunks() if key.body in fresh])

    def _place_bodies(self) -> None:
        """Update poses and visibility of the bodies."""
        for body, shown in zip(self._painting.scene.bodies, self.display.bodies, strict=True):
            node = self._frames[id(shown)].node
            node.wxyz, node.position = quaternion(body.X_WB[:3, :3]), self.to_view(body.X_WB[:3, 3])
            node.visible = body.name not in self._painting.hidden

    def _add_look(self, index: int, number: int) -> "viser.GlbHandle | None":
        """Add the textured mesh of a body to its frame; None if it has no textures."""
        shown = self.display.bodies[index]
        if not shown.textured:
            return None
        glb = look_glb(shown.look_mesh(), self._painting.scene.bodies[index].two_sided)
        seen, add = self.show != "feel", self._server.scene.add_glb
        return add(f"/body/{number}/look", glb, scale=self.scale, visible=seen, cast_shadow=False, receive_shadow=False)

    def show_layers(self, show: Show) -> None:
        """Show the materials of the mesh files, the paint, or both."""
        self.show = show
        self._recolour()

    @property
    def has_look(self) -> bool:
        """Whether the mesh file of any body has colours."""
        return any(body.file_colours is not None for body in self.display.bodies)

    def _recolour(self) -> None:
        for index, shown in enumerate(self.display.bodies):
            frame = self._frames.get(id(shown))
            if frame is None:
                continue
            if frame.look is not None:
                frame.look.visible = self.show != "feel"
            for layers in frame.layers.values():
                for kind, mesh in layers.items():
                    colour, opacity = self._colour(index, *kind)
                    visible = opacity != 0.0
                    if tuple(mesh.color) != colour:
                        mesh.color = colour
                    if visible and mesh.opacity != opacity:
                        mesh.opacity = opacity
                    if mesh.visible != visible:
                        mesh.visible = visible

    def _colour(self, body: int, paint: int, tint: int) -> tuple[tuple[int, int, int], float | None]:
        """Colour of a layer, its swatches mixed by weight; and its opacity over a textured mesh, None for opaque."""
        heavier, lighter, weight = (float(value) for value in parts(paint))
        opacity, swatches = None, [int(heavier), int(lighter)]
        if self.display.bodies[body].textured and self.show != "feel":
            default = self._painting.defaults[body]
            share = weight if swatches[0] == default else 1 - weight if swatches[1] == default and weight else 1.0
            opacity = OPACITY * share if self.show == "both" else 0.0
            if share < 1.0:  # a blend with the surface below is translucent
                swatches, weight = [s for s in swatches if s != default] * 2 or swatches, 0.0
        mixed = [self._swatch_colour(body, swatch, tint) for swatch in swatches]
        return rgb_bytes((1 - weight) * mixed[0] + weight * mixed[1]), opacity

    def _swatch_colour(self, body: int, swatch: int, tint: int) -> Vector:
        """Colour (3,) of a swatch, mixed with the file colour below it."""
        shown, colour = self.display.bodies[body], rgb(self.colours[swatch])
        if shown.file_colours is None or self.show == "feel":
            return colour
        below = np.asarray(shown.file_colours.rgb[tint])
        if self.show == "look" or swatch == self._painting.defaults[body]:
            return below
        return colour if shown.textured else (1 - OPACITY) * below + OPACITY * colour

    def _draw(self, keys: list[ChunkKey]) -> None:
        for key in keys:
            body = self._painting.scene.bodies[key.body]
            frame = self._frames[id(self.display.bodies[key.body])]
            old, new = frame.layers.get(key.chunk, {}), {}
            with self._server.atomic():
                for layer in self.display.layers(key):
                    kind = layer.paint, layer.tint
                    colour, opacity = self._colour(key.body, *kind)
                    new[kind] = self._server.scene.add_mesh_simple(
                        f"/body/{frame.number}/{key.chunk}/{layer.paint}-{layer.tint}-{layer.swatch}",
                        layer.vertices_m,
                        layer.faces,
                        color=colour,
                        opacity=opacity,
                        visible=opacity != 0.0,
                        flat_shading=True,
                        side="double" if body.two_sided else "front",
                        cast_shadow=False,
                        receive_shadow=False,
                        scale=self.scale,
                    )
                for kind in old.keys() - new.keys():
                    old[kind].remove()
            frame.layers[key.chunk] = new

    def _distinct(self) -> list[str]:
        swatches = self._painting.scene.swatches
        return distinct_colours(swatches, range(len(swatches)))

    # --- between W and the view ---

    def to_view(self, p_W_m: ArrayLike) -> Vector:
        """Points (…, 3) in W [m] in the coordinates of viser."""
        return np.asarray((np.asarray(p_W_m) - self.middle_W_m) * self.scale)

    def eye(self, pointer: Pointer) -> tuple[Vector, Vector] | None:
        """Pose (4, 4) of the eye of a page, and half the width and height (2,) of its picture at z = 1.

        The z axis of the pose points into the picture, the y axis down. None if the page is not connected.
        """
        client = self._server.get_clients().get(pointer.client)
        if client is None:
            return None
        camera = client.camera
        place = np.concatenate([np.ravel(camera.wxyz), np.ravel(camera.position), [camera.fov]])
        if place.shape != (8,) or not np.isfinite(place).all() or not 0.0 < camera.fov < np.pi or not place[:4].any():
            return None  # an invalid camera
        X_WE = np.eye(4)
        X_WE[:3, :3] = scipy.spatial.transform.Rotation.from_quat(place[:4], scalar_first=True).as_matrix()
        X_WE[:3, 3] = place[4:7] / self.scale + self.middle_W_m
        return X_WE, np.tan(camera.fov / 2) * np.array([pointer.width / pointer.height, 1.0])

    def ray(self, pointer: Pointer) -> tuple[Vector, Vector] | None:
        """Ray from the eye through the pointer: origin in W [m] and direction; None if the page is not connected."""
        eye = self.eye(pointer)
        if eye is None:
            return None
        X_WE, slope = eye
        direction = X_WE[:3, :3] @ np.array([*((2 * np.array([pointer.x, pointer.y]) - 1) * slope), 1.0])
        return X_WE[:3, 3], direction / np.linalg.norm(direction)

    # --- markers ---

    def show_touch(self, state: ServoState | None) -> None:
        """Show stylus, proxy and force of a touch; None hides them. Simulated devices have no orientation."""
        for mark in (self._tool, self._proxy, self._arrow):
            mark.visible = state is not None
        if state is None:
            return
        self._tool.position = self.to_view(state.p_WT_m)
        self._proxy.position = self.to_view(state.p_WP_m)
        size_N = float(np.linalg.norm(state.f_W_N))
        self._arrow.visible = size_N > 0.01
        if size_N > 0.01:
            length = SHOWN / 8 * size_N / ARROW_N
            self._arrow.position = self.to_view(state.p_WP_m)
            self._arrow.wxyz = quaternion(facing(state.f_W_N))
            self._arrow.scale = (1.0, 1.0, length)

    def show_handles(self, X_WG: NDArray[np.float64] | None, moved: Callable[[str, NDArray[np.float64]], None]) -> None:
        """Show the transform handles of a body; None hides them.

        Args:
            X_WG: (4, 4) pose of the handles.
            moved: called with the phase of a drag ("start", "update" or "end") and the pose of the handles.
        """
        if X_WG is None:
            if self._handles is not None:
                self._handles.remove()
            self._handles = None
            return
        if self._handles is None:
            size = SHOWN / 6
            self._handles = self._server.scene.add_transform_controls("/handles", size, depth_test=False)

            @self._handles.on_update  # type: ignore[untyped-decorator, unused-ignore]
            async def report(event: "viser.TransformControlsEvent") -> None:
                wxyz, X = np.asarray(event.target.wxyz), np.eye(4)
                if np.linalg.norm(wxyz) > 0.5:
                    X[:3, :3] = scipy.spatial.transform.Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
                    X[:3, 3] = np.asarray(event.target.position) / self.scale + self.middle_W_m
                    moved(event.phase, X)

        place, turn = self.to_view(X_WG[:3, 3]), quaternion(X_WG[:3, :3])
        if not np.allclose(place, self._handles.position, atol=1e-6):
            self._handles.position = place
        if not np.allclose(turn, self._handles.wxyz, atol=1e-6):
            self._handles.wxyz = turn

    # --- set-up ---

    def _place_camera(self) -> None:
        """Set the initial view."""
        self._server.scene.set_up_direction("+z")
        self._server.initial_camera.fov = FOV_RAD
        self.look(self._server.initial_camera)

    def look(self, camera: Camera, bodies: Sequence[Body] = (), aspect: float = 1.0, name: str = "perspective") -> None:
        """Move a camera so that bodies fit into the view.

        Args:
            camera: viser camera of a page.
            bodies: bodies to frame; empty for all that are not hidden.
            aspect: width divided by height of the canvas.
            name: one of `VIEWS`; for any other value the direction is kept.
        """
        every = self._painting.scene.bodies
        bodies = bodies or [body for body in every if body.name not in self._painting.hidden] or every
        bounds = np.array([body.bounds_W_m for body in bodies])
        low, high = self.to_view(bounds[:, 0].min(axis=0)), self.to_view(bounds[:, 1].max(axis=0))
        way = np.asarray(VIEWS[name]) if name in VIEWS else np.asarray(camera.position) - np.asarray(camera.look_at)
        away = ROOM * max(float(np.linalg.norm(high - low)), 1e-6) / (2 * np.tan(FOV_RAD / 2))
        away /= min(max(aspect, ASPECT_MIN), 1.0)
        camera.position = (low + high) / 2 + away * way / max(float(np.linalg.norm(way)), 1e-9)
        camera.look_at = (low + high) / 2  # after the position, which moves it along

    def _light(self) -> None:
        """Set up lights: diffuse light from all sides, a key light from the upper left, and a fill light."""
        scene = self._server.scene
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(150, 150, 160), intensity=1.6)
        scene.add_light_directional("/light/key", intensity=1.9, position=(-2.0, -3.0, 5.0))
        scene.add_light_directional("/light/fill", intensity=0.5, position=(4.0, 1.0, 1.0))

    def _make_marks(self) -> None:
        scene, size = self._server.scene, SHOWN / 120
        corners = lathe([(SHOWN * TOOL_LENGTH * r, SHOWN * TOOL_LENGTH * z) for r, z in STYLUS], LIGHT.tool).corner_m
        faces, grey = np.arange(len(corners)).reshape(-1, 3), _rgb(LIGHT.tool)
        self._tool = scene.add_mesh_simple(
            "/mark/tool", corners, faces, color=grey, wxyz=quaternion(TOOL_R_WT), cast_shadow=False
        )
        self._proxy = scene.add_icosphere("/mark/proxy", 0.75 * size, _rgb(OKABE_ITO["vermilion"]), cast_shadow=False)
        up = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
        force = rgb_bytes(linear(rgb(FORCE)))  # viser expects linear light for arrows
        self._arrow = scene.add_arrows(
            "/mark/force", up, force, shaft_radius=size / 4, head_radius=size / 1.6, head_length=0.25
        )
        for mark in (self._tool, self._proxy, self._arrow):
            mark.visible = False


class ToolMarks:
    """Marks of the tools in the view of one page: the ring of the brush, and a sphere.

    Args:
        scene: scene of the page's viser client.
        view: the view.
        painting: painted scene.
    """

    def __init__(self, scene: "viser.SceneApi", view: SceneView, painting: Painting) -> None:
        self._view, self._painting = view, painting
        dashes = np.where(np.arange(RING_COUNT) // DASH % 2, 255, 20).astype(np.uint8)  # visible on every colour
        ring, colours = np.zeros((RING_COUNT, 2, 3), np.float32), np.repeat(dashes, 6).reshape(-1, 2, 3)
        self._ring = scene.add_line_segments("/mark/ring", ring, colours, thickness=2.5, thickness_units="screen")
        self._sphere = scene.add_icosphere(
            "/mark/sphere", 1.0, _rgb(OKABE_ITO["purple"]), opacity=0.3, cast_shadow=False
        )
        for mark in (self._ring, self._sphere):
            mark.visible = False

    def show_ring(self, hit: Hit | None, radius_m: float) -> None:
        """Show the ring of the brush, projected onto the surface; None hides it."""
        self._ring.visible = hit is not None
        if hit is None:
            return
        side = np.cross(hit.nhat_W, np.eye(3)[np.argmin(np.abs(hit.nhat_W))])
        side /= np.linalg.norm(side)
        turn = np.linspace(0.0, 2 * np.pi, RING_COUNT, endpoint=False)[:, None]
        way = np.cos(turn) * side + np.sin(turn) * np.cross(hit.nhat_W, side)
        body, shape = self._painting.scene.bodies[hit.body], self._painting.shapes[hit.body]
        laid_W_m = project_to_surface(body, shape, hit, hit.p_W_m + radius_m * way, radius_m)
        laid = self._view.to_view(laid_W_m) + 0.004 * hit.nhat_W
        self._ring.points = np.stack([laid, np.roll(laid, -1, axis=0)], axis=1).astype(np.float32)

    def show_sphere(self, centre_W_m: Vector | None, radius_m: float = 0.0) -> None:
        """Show a sphere; None hides it."""
        self._sphere.visible = centre_W_m is not None
        if centre_W_m is not None:
            self._sphere.position = self._view.to_view(centre_W_m)
            self._sphere.scale = max(radius_m * self._view.scale, 1e-3)


def rgb_bytes(colour: Iterable[float]) -> tuple[int, int, int]:
    """Three channels from 0 to 1 as bytes."""
    red, green, blue = (round(255 * float(c)) for c in colour)
    return red, green, blue


def _rgb(colour: str) -> tuple[int, int, int]:
    """A colour "#rrggbb" as bytes."""
    return rgb_bytes(rgb(colour))


def rotation(angles_deg: Vector) -> NDArray[np.float64]:
    """Rotation matrix (3, 3) for rotations about x, then y, then z [°]."""
    return np.asarray(scipy.spatial.transform.Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix())


def quaternion(R: NDArray[np.float64]) -> Vector:
    """Quaternion (w, x, y, z) of a rotation matrix (3, 3)."""
    from viser.transforms import SO3  # imported already; SciPy's module takes 0.1 s to import

    return np.asarray(SO3.from_matrix(R).wxyz)
