"""Fine paint and blends of two swatches: borders, forces, spectra, states of effects."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from scipy.signal import freqz, welch

import hapscene
from hapscene.constants import BLEND_S
from hapscene.device.model import Limits
from hapscene.dsp.ar_filter import lsf_from_ar
from hapscene.flags import Flag
from hapscene.scene import Box, Sphere
from hapscene.scene.fine_paint import paint_region
from hapscene.surface.surface_arrays import build_surface, put_numbers
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

RATE_HZ, DEPTH_M, SPEED_M_S = 1e4, 0.001, 0.1
PLATE = trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]])
CENTRE, RADIUS_M = np.array([0.003, 0.0, 0.0]), 0.02


def resonance(frequency_Hz, level_m_s2, r=0.97):
    """Return an AR(2) model, and a texture with it at all forces and speeds."""
    a = np.array([1.0, -2 * r * np.cos(2 * np.pi * frequency_Hz / RATE_HZ), r * r])
    h = np.abs(freqz(1.0, a, 1 << 14, whole=True)[1]) ** 2
    variance = level_m_s2**2 / h.mean()
    corners = [0, 0, 2, 2], [0, 0.2, 0, 0.2], [[0, 1, 2], [1, 3, 2]]
    return a, variance, Texture(RATE_HZ, *corners, np.tile(lsf_from_ar(a), (4, 1)), np.full(4, variance))


A, B = resonance(150, 1.0), resonance(400, 2.0)
HARD = Swatch("hard", stiffness_N_m=800.0, texture=A[2], friction_dynamic=0.2, friction_static=0.2)
HALF = Box((0, -1, -1), (1, 1, 1))
SOFT = Swatch("soft", stiffness_N_m=200.0, texture=B[2], friction_dynamic=0.4, friction_static=0.4)


def scene_of(*painted, base=HARD, **more):
    scene = hapscene.Scene()
    scene.add(PLATE, name="plate", unit="m", swatch=base, **more)
    for swatch, region, falloff_m in painted:
        scene.paint("plate", swatch, region, falloff_m=falloff_m)
    return scene


def stroke(seconds, speed_m_s=SPEED_M_S, y_m=0.0013):
    n = round(seconds / 1e-3)
    path = np.column_stack([speed_m_s * 1e-3 * (np.arange(n) - n / 2), np.full(n, y_m), np.full(n, -DEPTH_M)])
    path[0, 2] = 0.001
    return path


def there_and_back(path):
    return np.concatenate([path, path[:0:-1]])


@pytest.mark.parametrize("weight", [0.25, 0.5, 0.8])
def test_the_spectrum_of_a_blend_is_the_sum_of_both_by_weight(weight):
    same = [Swatch(n, stiffness_N_m=500.0, texture=t[2]) for n, t in (("a", A), ("b", B))]
    scene = scene_of(base=same[0])
    paint_region(scene.bodies[0], Box((-1, -1, -1), (1, 1, 1)), scene.swatch_index(same[1]), opacity=weight)
    angle = SPEED_M_S * 1e-3 / 0.02 * np.arange(60_000)
    path = np.column_stack([0.02 * np.cos(angle), 0.02 * np.sin(angle), np.full(len(angle), -DEPTH_M)])
    path[0, 2] = 0.001
    samples = hapscene.Renderer(scene, ["lpc_texture"]).run(path).a_m_s2[500:].ravel()
    f, psd = welch(samples, RATE_HZ, nperseg=1024)
    want = sum(
        share * variance * np.abs(freqz(1.0, a, 2 * np.pi * f / RATE_HZ)[1]) ** 2 * 2 / RATE_HZ
        for share, (a, variance, _) in ((1 - weight, A), (weight, B))
    )
    edges = np.searchsorted(f, np.geomspace(40, 2500, 13))
    got, true = (np.array([s[i:j].sum() for i, j in pairwise(edges)]) for s in (psd, want))
    # 1,160 half-overlapping segments: 4 % a line at one standard deviation; and the weight in steps of 1/256
    np.testing.assert_allclose(got, true, rtol=0.1)
    assert samples.var() == pytest.approx((1 - weight) * 1.0 + weight * 4.0, rel=0.04)


def test_force_follows_the_weight_over_a_soft_border():
    falloff_m = 0.008
    renderer = hapscene.Renderer(scene_of((SOFT, HALF, falloff_m)), ["wall"])
    path = stroke(1.0, 0.05)
    recording = renderer.run(path)
    weight = np.clip(0.5 + path[:, 0] / falloff_m, 0, 1)
    stiffness = recording.f_W_N[5:, 2] / DEPTH_M
    lag = 0.05 * BLEND_S / falloff_m + 1 / 16  # relative to the weight, including border steps of 1/16
    np.testing.assert_allclose(stiffness, 800.0 - 600.0 * weight[5:], atol=600.0 * lag)
    assert stiffness[0] == pytest.approx(800.0) and stiffness[-1] == pytest.approx(200.0)
    assert np.abs(np.diff(stiffness)).max() <= 600.0 * 1e-3 / BLEND_S * 1.001
    assert set(recording.swatch[5:]) == {1, 2}


def test_soft_border_causes_no_click():
    """The largest change between samples is no larger than in one texture alone, at any speed."""
    quiet, slow = resonance(60, 1.0, 0.999)[2], resonance(90, 1.0, 0.999)[2]
    one, two = Swatch("one", texture=quiet), Swatch("two", texture=slow)
    path = there_and_back(stroke(0.2, 0.4))
    steps = []
    for falloff_m in (None, 0.004):
        scene = scene_of(*([] if falloff_m is None else [(two, HALF, falloff_m)]), base=one)
        renderer = hapscene.Renderer(scene, ["lpc_texture"])
        renderer.reset(path[0])
        samples = [renderer.run(path).a_m_s2.ravel() for _ in range(10)]
        steps.append(np.abs(np.diff(np.concatenate(samples)[1000:])).max())
        assert np.concatenate(samples).std() > 0.3
    assert steps[1] < 1.6 * steps[0]  # 90 Hz changes 1.5 times as fast as 60 Hz


def blend_of(renderer, path):
    rows = []
    for p in path:
        renderer.step(p)
        touch, memory = renderer.surface.touch[0], renderer.surface.memory[0]
        rows.append((touch.swatch, touch.other, touch.weight, touch.crossed, memory.other_crossed, memory.bank))
    return np.array(rows[1:]).T  # the first tick has no contact


def test_effects_keep_their_state_across_a_blend():
    renderer = hapscene.Renderer(scene_of((SOFT, HALF, 0.008)), ["wall"])
    swatch, other, weight, crossed, other_crossed, bank = blend_of(renderer, there_and_back(stroke(0.3))[:-1])
    n = len(swatch)
    assert crossed[0] == 1 and not crossed[1:].any()  # at the start of the contact only
    assert np.flatnonzero(other_crossed).size == 2  # each is added once, from the pure side of the other
    assert (swatch[0], swatch[n // 2], swatch[-1]) == (1, 2, 1)
    assert (bank[0], bank[n // 2], bank[-1]) == (0, 1, 0)
    assert (other[[0, n // 2, -1]] == -1).all() and weight.max() < 0.56
    share = np.where(swatch == 2, 1 - weight, weight)
    assert np.abs(np.diff(share)).max() <= 1e-3 / BLEND_S + 1e-9


def test_effects_of_the_scene_ignore_soft_borders():
    """Effects of the scene have one state, unlike effects of contact."""
    path = there_and_back(there_and_back(stroke(0.4)))
    scene = scene_of((SOFT, HALF, 0.01))
    pull = {"weight": {"mass_kg": 0.05, "gravity_z_m_s2": -10.0, "ease_s": 0.005}}
    bare = hapscene.Renderer(scene, ["wall"]).run(path)
    loaded = hapscene.Renderer(scene, ["wall", "weight"], settings=pull).run(path)
    np.testing.assert_allclose((loaded.f_W_N - bare.f_W_N)[200:, 2], -0.5, rtol=1e-9)


def test_third_swatch_and_hard_borders():
    third = Swatch("third", stiffness_N_m=300.0)
    scene = scene_of((SOFT, HALF, 0.02), (third, Box((-0.003, -1, -1), (0.004, 1, 1)), 0))
    swatch, other, weight, crossed, _, _ = blend_of(hapscene.Renderer(scene, ["wall"]), stroke(0.6))
    edge = np.flatnonzero(crossed)
    assert swatch[edge[1]] == 3 and 1 <= len(edge) <= 3
    middle = np.flatnonzero(swatch == 3)[-1]
    assert other[middle] == -1 and weight[middle] == 0.0  # the other swatch has faded out
    assert swatch[-1] == 2


def test_failed_effect_is_muted_on_both_swatches():
    renderer = hapscene.Renderer(scene_of((SOFT, HALF, 0.008)), ["wall", "lpc_texture"])
    put_numbers(renderer.surface, renderer._effects, 2, {(1, "texture_gain"): np.nan})
    recording = renderer.run(stroke(0.3))
    muted = (recording.flags & int(Flag.EFFECT_MUTED)) != 0
    first = int(np.argmax(muted))
    assert muted[first:].all() and recording.p_WT_m[first, 0] == pytest.approx(-0.004, abs=6e-4)
    assert recording.a_m_s2[first - 1].any() and not recording.a_m_s2[first + 1 :].any()
    assert recording.f_W_N[-1, 2] == pytest.approx(200.0 * DEPTH_M)


def turned(angle_rad):
    X = np.eye(4)
    X[:2, :2] = [[np.cos(angle_rad), -np.sin(angle_rad)], [np.sin(angle_rad), np.cos(angle_rad)]]
    X[:3, 3] = 0.01 * np.sin(3 * angle_rad), 0.02, 0.0
    return X


@pytest.mark.parametrize("kind", ["still", "two_sided", "moving"])
def test_border_inside_a_face_is_rendered_where_painted(kind):
    scene = scene_of((SOFT, Sphere(CENTRE, RADIUS_M), 0.0), two_sided=kind == "two_sided")
    assert scene.bodies[0].fine is not None and len(PLATE.faces) == 12
    rng = np.random.default_rng(5)
    path = np.column_stack([np.cumsum(rng.normal(scale=4e-4, size=(8000, 2)), axis=0), np.full(8000, -DEPTH_M)])
    path[:, :2] = 0.035 * np.sin(path[:, :2] / 0.012)
    path[0, 2] = 0.001
    X = np.array([turned(a) for a in 0.3 * np.sin(np.arange(8000) / 900)]) if kind == "moving" else None
    recording = hapscene.Renderer(scene, ["wall"]).run(path, None if X is None else {"plate": X})
    p = recording.p_WP_m
    if X is not None:
        p = np.einsum("nji,nj->ni", X[:, :3, :3], p - X[:, :3, 3])
    distance_m = np.linalg.norm(p[:, :2] - CENTRE[:2], axis=1) - RADIUS_M
    sure = recording.touching & (np.abs(distance_m) > 1e-4)
    assert sure.sum() > 7000 and 0.1 < (distance_m[sure] < 0).mean() < 0.6
    assert ((recording.swatch == 2) == (distance_m < 0))[sure].all()


def test_fine_paint_of_each_body():
    scene = scene_of((SOFT, Sphere(CENTRE, RADIUS_M), 0.0))
    first = build_surface(scene, [], 1e-3, 1e4, Limits())
    for name in ("other", "third"):
        scene.add(PLATE, name=name, unit="m", swatch=SOFT)
    scene.paint("other", HARD, Sphere(CENTRE, 0.5 * RADIUS_M))
    both, count, faces = build_surface(scene, [], 1e-3, 1e4, Limits()), len(first.leaf), len(first.paint)
    assert both.leaf[:count].tobytes() == first.leaf.tobytes() and both.leaf_start[-1] == len(both.leaf) > count
    fine = both.paint[faces : 2 * faces][both.paint[faces : 2 * faces] < 0]
    assert fine.tolist() == sorted(fine, reverse=True) and fine[0] == first.paint.min() - 1 == -len(first.leaf_start)
    assert both.paint[:faces].tolist() == first.paint.tolist() and both.leaf_start[-1 - fine[0]] == count
    assert set(both.leaf.paint[count:].tolist()) == {1, 2}


def test_fine_paint_follows_deformation():
    scene = scene_of((SOFT, Sphere(CENTRE, RADIUS_M), 0.0))
    renderer = hapscene.Renderer(scene, ["wall"])
    renderer.deform("plate", scene.bodies[0].mesh.vertices_m * (1.2, 1.2, 1.0))
    for _ in range(40):
        renderer.step((0.0, 0.0, 0.02))
    recording = renderer.run(stroke(0.8))
    distance_m = np.linalg.norm(recording.p_WP_m[:, :2] / 1.2 - CENTRE[:2], axis=1) - RADIUS_M
    sure = recording.touching & (np.abs(distance_m) > 1e-4)
    assert ((recording.swatch == 2) == (distance_m < 0))[sure].all() and sure.sum() > 600


def test_repainting_in_contact_uses_fine_paint():
    scene = scene_of()
    renderer = hapscene.Renderer(scene, ["wall"])
    path = stroke(0.4)
    assert set(renderer.run(path).swatch[1:]) == {1}
    scene.paint("plate", SOFT, Sphere(CENTRE, RADIUS_M))
    renderer.repaint(scene)
    assert set(renderer.run(path[:0:-1]).swatch) == {1, 2}
