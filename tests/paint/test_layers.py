"""Look and feel in the 3-D view: which meshes are visible, how opaque, and in which colour."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import trimesh
from PIL import Image

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.paint.model.display import RAISED, Display
from hapscene.paint.model.session import Session
from hapscene.paint.web.view import SceneView, rgb_bytes
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene
from hapscene.view.feel_layer import OPACITY


class Meshes:
    """A server that keeps the meshes of its scene by name."""

    def __init__(self) -> None:
        self.named: dict[str, Any] = {}
        self.scene = MagicMock()
        self.scene.add_mesh_simple = lambda name, vertices, faces, **more: self._add(name, vertices=vertices, **more)
        self.scene.add_glb = lambda name, glb, **more: self._add(name, glb=glb, **more)

    def __getattr__(self, name: str) -> Any:
        return MagicMock()

    def _add(self, name: str, **more: Any) -> Any:
        self.named[name] = SimpleNamespace(remove=lambda: self.named.pop(name), **{"opacity": None} | more)
        return self.named[name]

    def of(self, swatch: int) -> list[Any]:
        """The layers of a swatch."""
        return [mesh for name, mesh in self.named.items() if name.startswith("/body/") and name.endswith(f"-{swatch}")]


def made(textured: bool) -> tuple[Meshes, SceneView, Scene]:
    cube = trimesh.creation.box((0.04, 0.04, 0.04))
    scene = Scene()
    if textured:
        corners = cube.triangles.reshape(-1, 3)
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.new("RGB", (4, 4), (0, 0, 255)))
        cube = trimesh.Trimesh(corners, np.arange(36).reshape(-1, 3), process=False)
        cube.visual = trimesh.visual.TextureVisuals(uv=corners[:, :2], material=material)
        scene.add(cube, name="cube", unit="m")
    else:
        blue = np.tile(np.array([0, 0, 255], np.uint8), (12, 1))
        scene.add(Mesh(np.asarray(cube.vertices), np.asarray(cube.faces, np.int32), colour_rgb=blue), name="cube")
    scene.paint("cube", "leather", Sphere((0.0, 0.0, 0.02), 0.01))
    painting, server = Session(scene).painting, Meshes()
    return server, SceneView(server, painting, Display(painting)), scene


def test_paint_over_a_texture() -> None:
    server, view, _ = made(textured=True)
    look = server.named["/body/0/look"]
    plain, leather = server.of(0), server.of(1)
    assert plain and leather and look.visible and not any(mesh.visible for mesh in plain)
    assert all(mesh.visible and mesh.opacity == OPACITY for mesh in leather)
    below = trimesh.load_scene(trimesh.util.wrap_as_stream(look.glb), file_type="glb").bounds
    above = np.concatenate([mesh.vertices for mesh in leather])[:, 2].max()
    assert above - below[1, 2] > 0.4 * RAISED * 0.04 * 3**0.5  # no surface in another
    view.show_layers("look")
    assert look.visible and not any(mesh.visible for mesh in plain + leather)
    view.show_layers("feel")
    assert not look.visible and all(mesh.visible for mesh in plain + leather)
    assert all(mesh.opacity is None for mesh in plain + leather)


def test_paint_over_colours() -> None:
    server, view, scene = made(textured=False)
    assert "/body/0/look" not in server.named and all(mesh.opacity is None for mesh in server.of(0) + server.of(1))
    paint = np.array(scene.swatches[1].albedo_rgb)
    mixed = (1 - OPACITY) * np.array([0, 0, 1.0]) + OPACITY * paint
    expected = {"both": (mixed, (0, 0, 1.0)), "look": ((0, 0, 1.0),) * 2, "feel": (paint, scene.swatches[0].albedo_rgb)}
    for show in ("both", "look", "feel"):
        view.show_layers(show)  # type: ignore[arg-type]
        for swatch, colour in zip((1, 0), expected[show], strict=True):
            assert np.abs(np.subtract([mesh.color for mesh in server.of(swatch)], rgb_bytes(colour))).max() <= 1


def test_grain_is_sent_once() -> None:
    server, view, _ = made(textured=False)
    assert [name for name in server.named if name.startswith("/grain/")] == ["/grain/1"]  # plain has none
    assert not server.named["/grain/1"].visible
    (texture,) = trimesh.load_scene(
        trimesh.util.wrap_as_stream(server.named["/grain/1"].glb), file_type="glb"
    ).geometry.values()
    assert np.asarray(texture.visual.material.baseColorTexture).std() > 5
    assert view.grain["tiles"] == {0: {1: 0.036}} and view.grain["gains"][1] > 1.0
