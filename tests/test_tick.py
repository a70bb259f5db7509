"""The tick: its order, its row, and that it allocates nothing."""

import tracemalloc

import numpy as np
import pytest
import trimesh
from numba.core.errors import NumbaError

import hapscene
from hapscene.native import INTERPRETED, native
from hapscene.surface.effect import Effect


@pytest.fixture
def box() -> hapscene.Scene:
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]]), name="box", unit="m")
    return scene


def _watch(touch, p, table, s, out):
    """Sends what it is shown as samples of acceleration."""
    out.a_m_s2[0] = touch.tick
    out.a_m_s2[1] = touch.touching
    out.a_m_s2[2] = touch.depth_m
    out.a_m_s2[3] = touch.began
    out.a_m_s2[4] = touch.ended


WATCH = Effect("watch", "Shows what it is shown.", _watch)


def test_effects_see_the_contact_of_the_same_tick(box):
    z = [0.001, -0.001, -0.002, 0.001, 0.002]
    recording = hapscene.Renderer(box, [WATCH, "wall"]).run([[0, 0, h] for h in z])
    held = [False, True, True, False, False]
    assert recording.touching.tolist() == held
    seen = recording.a_m_s2
    first = int(np.flatnonzero(held)[0])
    assert seen[first:, 0].tolist() == list(range(first, 5))  # not called before anything was touched
    assert seen[:, 1].tolist() == [0, 1, 1, 0, 0]
    np.testing.assert_allclose(seen[:, 2], [0, 0.001, 0.002, 0, 0], atol=1e-12)
    assert seen[:, 3].tolist() == [0, 1, 0, 0, 0]
    assert seen[:, 4].tolist() == [0, 0, 0, 1, 0]
    np.testing.assert_allclose(recording.f_W_N[:, 2], [0, 0.5, 1.0, 0, 0], atol=1e-9)


def test_row_of_a_tick(box):
    recording = hapscene.Renderer(box, ["wall"]).run([[0.01, 0.02, 0.001], [0.01, 0.02, -0.002]])
    np.testing.assert_array_equal(recording.p_WT_m[1], [0.01, 0.02, -0.002])
    np.testing.assert_allclose(recording.p_WP_m, [[0.01, 0.02, 0.001], [0.01, 0.02, 0]], atol=1e-15)
    np.testing.assert_array_equal(recording.nhat_W[1], [0, 0, 1])
    assert recording.body.tolist() == [-1, 0]
    assert recording.swatch.tolist() == [-1, 0]
    assert recording.face[0] == -1
    touched = box.bodies[0].mesh
    np.testing.assert_array_equal(touched.vertices_m[touched.faces[recording.face[1]]][:, 2], 0)
    assert recording.normal_force_N.tolist() == pytest.approx([0, 1.0])
    assert (recording.tick_ns > 0).all()
    assert (recording.contact_ns <= recording.tick_ns).all()


def test_bodies_appear_at_their_first_pose_without_moving_there(box):
    """In the first tick nothing has a velocity: a body far from where the scene has it sweeps nothing along."""
    X = np.tile(np.eye(4), (3, 1, 1))
    X[:, 2, 3] = 0.5
    recording = hapscene.Renderer(box, ["wall"]).run(np.tile([0, 0, 0.3], (3, 1)), poses={"box": X})
    assert not recording.touching.any()


@pytest.mark.skipif(INTERPRETED, reason="nothing is compiled")
def test_compiled_code_that_would_allocate_is_refused():
    """Every function of the tick is compiled by `native`: what it refuses, no tick does."""

    @native
    def makes_an_array(n):
        return np.zeros(n).sum()

    with pytest.raises((NumbaError, RuntimeError)):
        makes_an_array(3)


@pytest.mark.skipif(INTERPRETED, reason="interpreted code makes objects")
def test_memory_does_not_grow_with_ticks(box):
    renderer = hapscene.Renderer(box)
    path = np.c_[0.02 * np.sin(np.arange(2000) / 50), np.zeros(2000), 0.001 * np.sin(np.arange(2000) / 30)]
    for p in path[:100]:
        renderer.step(p)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for p in path:
        renderer.step(p)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 10_000
