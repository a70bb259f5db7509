"""Triangles and depths as pyrender takes and gives them, without OpenGL."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.view import gl
from hapscene.view.shadows import SUN, ZENITH
from hapscene.view.triangles import NOTHING, Drawing, Triangles

FAKE: Any = SimpleNamespace(
    Mesh=list, Primitive=SimpleNamespace, Texture=SimpleNamespace, MetallicRoughnessMaterial=SimpleNamespace
)
"""Stands in for pyrender."""


def test_translucent_triangles_are_blended_and_drawn_last() -> None:
    corners, uv = np.arange(9.0).reshape(3, 3), np.zeros((3, 2))
    glass, paint = (Triangles(corners, corners, np.ones((3, channels))) for channels in (4, 3))
    photo, film = (Triangles(corners, corners, np.ones((3, 3)), uv, np.zeros((2, 2, n), np.uint8)) for n in (3, 4))
    made = gl._mesh(FAKE, [glass, film, NOTHING, paint, photo._replace(roughness=0.2)])
    looks = [one.material for one in made]
    assert [getattr(look, "alphaMode", "OPAQUE") for look in looks] == ["OPAQUE"] * 2 + ["BLEND"] * 2
    assert [one.texcoord_0 is None for one in made] == [True, False, True, False]
    channels = [look.baseColorTexture.source_channels for look in looks if hasattr(look, "baseColorTexture")]
    assert channels == ["RGB", "RGBA"] and looks[1].roughnessFactor == 0.2
    assert made[0].positions.dtype == np.float32 and made[0].mode == 4


class Scene:
    """Stands in for a scene and for a renderer that sees nothing."""

    def __init__(self, *size: int, **look: Any) -> None:
        self.size, self.there = size, list[Any]()

    def add(self, what: Any, pose: Any = None) -> Any:
        self.there.append(what)
        return what

    def remove_node(self, node: Any) -> None:
        self.there.remove(node)

    def render(self, scene: "Scene", flags: Any) -> np.ndarray:
        assert len(scene.there) == 2  # the bodies, and one camera
        return np.zeros(self.size[::-1], np.float32)


def test_shadows_know_the_ground_and_the_size_of_the_bodies() -> None:
    more = {"OrthographicCamera": lambda *size, **depth: size, "RenderFlags": SimpleNamespace(DEPTH_ONLY=1)}
    fake: Any = SimpleNamespace(**vars(FAKE) | more, Scene=Scene, OffscreenRenderer=Scene)
    corner_m = np.array([(1.0, 2.0, -0.5), (4.0, 2.0, 0.0), (1.0, 6.0, 11.5)])
    bodies = [Triangles(corner_m, corner_m, np.ones((3, 4))), Triangles(9.0 * corner_m, corner_m, np.ones((3, 3)))]
    drawing = Drawing(bodies, [], (1.0, 1.0, 1.0), (8, 6), "#ffffff", 1, casters=[0])
    found = gl._shadows(fake, drawing)
    assert found is not None and (found.low_m, found.size_m) == (-0.5, 13.0)
    for picture, direction in ((found.sun, SUN), (found.sky, ZENITH)):
        assert picture.depth_m.shape == (6, 8) and np.isinf(picture.depth_m).all()
        np.testing.assert_allclose(picture.X_SC[:3, 2], np.array(direction) / np.linalg.norm(direction))
    assert gl._shadows(fake, replace(drawing, casters=())) is None


@pytest.mark.parametrize("oversampling", [1, 2])
def test_depth_is_the_distance_of_the_farthest_of_the_oversampled_pixels(oversampling: int) -> None:
    """pyrender converts the depth buffer, 0 to 1, as if the camera had a perspective."""
    far_m, expected = 2.0, np.array([[0.1, 1.0], [1.9, np.inf]])
    near_m = gl.NEAR * far_m
    buffer = np.where(np.isinf(expected), 1.0, (expected - near_m) / (far_m - near_m))
    depth = 2.0 * near_m * far_m / (far_m + near_m - (2.0 * buffer - 1.0) * (far_m - near_m))
    depth[np.isinf(expected)] = 0.0  # no surface
    fine = np.repeat(np.repeat(depth, oversampling, 0), oversampling, 1)
    fine[:: max(oversampling, 2), ::2] *= 1.0 if oversampling == 1 else 0.9
    np.testing.assert_allclose(gl._distance(fine.astype(np.float32), far_m, oversampling), expected, rtol=1e-3)
