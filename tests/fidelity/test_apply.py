"""A level is the same scene with less in it: painting, spectrum and power are carried over."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.linalg import solve_toeplitz

import hapscene
from hapscene.dsp.ar_filter import ar_from_lsf, power_gain
from hapscene.errors import HapsceneError
from hapscene.fidelity.apply import apply_level, nearest_faces
from hapscene.fidelity.fidelity import BodyFidelity, Level, SwatchFidelity
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import nearest_face


def sphere(subdivisions, radius_m=0.05):
    return Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m), "m")


@pytest.fixture(scope="module")
def scene():
    scene = hapscene.Scene()
    scene.add(sphere(4), name="ball", swatch="wood", pose=np.diag([1.0, -1.0, -1.0, 1.0]))
    scene.add(sphere(1), name="other", swatch="paper")
    scene.paint("ball", "leather", sphere(4).triangles_m.mean(axis=1)[:, 2] > 0.01)
    return scene


def test_nothing_named_is_the_scene_itself(scene):
    at = apply_level(scene, Level())
    assert at.swatches == scene.swatches
    for ours, theirs in zip(at.bodies, scene.bodies, strict=True):
        assert ours.mesh is theirs.mesh and ours.name == theirs.name
        np.testing.assert_array_equal(ours.face_swatch, theirs.face_swatch)


def test_a_coarser_mesh_is_painted_as_the_fine_one_is_there(scene):
    coarse = sphere(2)
    at = apply_level(scene, Level(bodies={"ball": BodyFidelity(coarse)}))
    ball, was = at.body("ball"), scene.body("ball")
    assert ball.mesh is coarse and at.body("other").mesh is scene.body("other").mesh
    np.testing.assert_array_equal(ball.X_WB, was.X_WB)
    high = coarse.triangles_m.mean(axis=1)[:, 2]
    leather = [swatch.name for swatch in at.swatches].index("leather")
    clear = abs(high - 0.01) > 0.003  # as far as a fine face reaches
    np.testing.assert_array_equal((ball.face_swatch == leather)[clear], (high > 0.01)[clear])
    assert len(was.face_swatch) == len(was.mesh.faces)  # the scene stays as it is


def test_nearest_faces_are_the_nearest_also_among_faces_of_all_sizes():
    fine, coarse = trimesh.creation.icosphere(subdivisions=3), trimesh.creation.box((1.9, 1.7, 1.3)).subdivide()
    fine = trimesh.util.concatenate(fine, trimesh.creation.box((0.1, 3.0, 3.0)))
    fine, coarse = Mesh.from_trimesh(fine, "m"), Mesh.from_trimesh(coarse, "m")
    want = [nearest_face(fine, p) for p in coarse.triangles_m.mean(axis=1)]
    distance = trimesh.triangles.closest_point(
        np.stack([fine.triangles_m[want], fine.triangles_m[nearest_faces(fine, coarse)]]).reshape(-1, 3, 3),
        np.tile(coarse.triangles_m.mean(axis=1), (2, 1)),
    ) - np.tile(coarse.triangles_m.mean(axis=1), (2, 1))
    first, second = np.linalg.norm(distance, axis=1).reshape(2, -1)
    np.testing.assert_allclose(second, first, atol=1e-12)


def test_the_same_faces_are_painted_each_as_its_own_where_they_lie_on_each_other():
    mesh = sphere(1)
    twice = Mesh(np.tile(mesh.vertices_m, (2, 1)), np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices_m)]))
    again = Mesh(twice.vertices_m, twice.faces)
    np.testing.assert_array_equal(nearest_faces(twice, again), np.arange(len(twice.faces)))


@pytest.mark.parametrize("name", ["wood", "paper", "epoxy"])
def test_a_shorter_filter_is_the_best_of_its_order_for_the_same_signal(name):
    """Against a fit of that order to the signal's autocorrelation on its own axis, taken from its spectrum."""
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


def test_a_texture_no_longer_than_asked_stays_itself():
    texture = hapscene.load_swatch("paper").texture
    assert texture.truncated(texture.order) is texture


def test_what_is_left_out_is_not_there(scene):
    fidelity = SwatchFidelity(order=8, left_out=("lpc_texture", "tap", "friction"))
    silent = apply_level(scene, Level(swatches={"wood": fidelity}))
    wood, was = silent.swatches[1], scene.swatches[1]
    assert wood.texture is None and wood.taps is None and wood.friction_static == wood.friction_dynamic == 0.0
    assert (wood.name, wood.stiffness_N_m, wood.damping_Ns_m) == (was.name, was.stiffness_N_m, was.damping_Ns_m)
    assert silent.swatches[2:] == scene.swatches[2:]


def test_friction_that_a_swatch_gives_to_the_effect_itself_is_left_out_too(scene):
    at = scene.copy()
    at.swatches[1] = replace(at.swatches[1], effects={"friction": {"friction_static": 0.8, "friction_dynamic": 0.5}})
    wood = apply_level(at, Level(swatches={"wood": SwatchFidelity(left_out=("friction",))})).swatches[1]
    assert wood.parameter("friction", "friction_static", 1.0) == 0.0
    assert wood.parameter("friction", "friction_dynamic", 1.0) == 0.0


@pytest.mark.parametrize(
    ("level", "said"),
    [
        (Level(bodies={"bal": BodyFidelity()}), "no body 'bal'"),
        (Level(swatches={"oka": SwatchFidelity()}), "no swatch 'oka'"),
        (Level(swatches={"wood": SwatchFidelity(left_out=("wall",))}), "effect 'wall' cannot be left out"),
        (Level(swatches={"wood": SwatchFidelity(order=0)}), "1 or more, not 0"),
    ],
)
def test_what_the_scene_has_not_is_refused(scene, level, said):
    with pytest.raises(HapsceneError, match=said):
        apply_level(scene, level)
