"""Simplified scenes: painting, spectrum and power are kept."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.linalg import solve_toeplitz

import hapscene
from hapscene.dsp.ar_filter import ar_from_lsf, power_gain
from hapscene.errors import HapsceneError
from hapscene.fidelity.tune import Simplification, simplified
from hapscene.scene.mesh import Mesh


def sphere(subdivisions, radius_m=0.05):
    return Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m), "m")


@pytest.fixture(scope="module")
def scene():
    scene = hapscene.Scene()
    scene.add(sphere(4), name="ball", swatch="wood", pose=np.diag([1.0, -1.0, -1.0, 1.0]))
    scene.add(sphere(1), name="other", swatch="paper")
    scene.paint("ball", "leather", sphere(4).triangles_m.mean(axis=1)[:, 2] > 0.01)
    return scene


def test_without_simplification_nothing_changes(scene):
    at = simplified(scene, Simplification())
    assert at.swatches == scene.swatches
    for ours, theirs in zip(at.bodies, scene.bodies, strict=True):
        assert ours.mesh is theirs.mesh and ours.name == theirs.name
        np.testing.assert_array_equal(ours.face_swatch, theirs.face_swatch)


def test_painting_of_a_coarser_mesh(scene):
    names = tuple(swatch.name for swatch in scene.swatches)
    coarse, plain = sphere(2), sphere(0)
    group = (coarse.triangles_m.mean(axis=1)[:, 2] > 0.01) * np.int16(names.index("leather"))
    coarse = replace(coarse, group=group, group_names=names)
    at = simplified(scene, Simplification({"ball": coarse, "other": plain}))
    ball, other = at.body("ball"), at.body("other")
    assert ball.mesh is coarse and np.array_equal(ball.face_swatch, group)
    assert other.mesh is plain and set(other.face_swatch) == {names.index("paper")}
    np.testing.assert_array_equal(ball.X_WB, scene.body("ball").X_WB)
    assert len(scene.body("ball").face_swatch) == len(scene.body("ball").mesh.faces)  # the scene stays as it is


@pytest.mark.parametrize("name", ["wood", "epoxy"])
def test_a_truncated_model_is_the_best_of_its_order(name):
    """Against a fit of that order to the autocorrelation of the signal."""
    texture = hapscene.load_swatch(name).texture
    short = texture.truncated(5)
    assert short.order == 5
    np.testing.assert_allclose(short.model_power_m2_s4, texture.model_power_m2_s4, rtol=1e-9)
    rows = np.unique(texture.lsf_rad, axis=0, return_index=True)[1][:6]
    a, variance = ar_from_lsf(texture.lsf_rad[rows]), texture.variance_m2_s4[rows]
    for one, v, got, left in zip(a, variance, short.lsf_rad[rows], short.variance_m2_s4[rows], strict=True):
        r = np.fft.irfft(1.0 / np.abs(np.fft.rfft(one, 1 << 20)) ** 2)[:6]
        want = np.concatenate([[1.0], solve_toeplitz(r[:-1], -r[1:])])
        np.testing.assert_allclose(ar_from_lsf(got), want, atol=1e-6)
        assert left == pytest.approx(v * power_gain(one, texture.warp) / power_gain(want, texture.warp), rel=1e-6)


def test_a_texture_of_that_order_is_unchanged():
    texture = hapscene.load_swatch("paper").texture
    assert texture.truncated(texture.order) is texture


@pytest.mark.parametrize(
    ("what", "expected"),
    [(Simplification({"ball": sphere(2)}), "no painting"), (Simplification(orders={"wood": 0}), "order")],
)
def test_invalid_simplifications(scene, what, expected):
    with pytest.raises(HapsceneError, match=expected):
        simplified(scene, what)


def test_a_simplified_scene_is_saved_and_felt_as_it_is(scene, tmp_path):
    made = simplified(scene, Simplification({"other": sphere(0)}, {"wood": 5, "leather": 3}))
    made.save(tmp_path / "x.scene.json")
    read = hapscene.load_scene(tmp_path / "x.scene.json")
    assert read.swatches == made.swatches
    path = np.linspace((0.01, 0.0, 0.052), (0.0, 0.01, 0.0485), 200)
    want, got = hapscene.Renderer(made).run(path), hapscene.Renderer(read).run(path)
    assert got.touching.any()
    np.testing.assert_array_equal(got.f_W_N, want.f_W_N)
    np.testing.assert_array_equal(got.a_m_s2, want.a_m_s2)
