"""Triangles and depths as pyrender takes and gives them, without OpenGL."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.view import gl
from hapscene.view.triangles import NOTHING, Triangles

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
