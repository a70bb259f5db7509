"""The tick: order of its phases, its row, and no memory allocation."""

import tracemalloc

import numpy as np
import pytest
import trimesh
from numba.core.errors import NumbaError

import hapscene
from hapscene.clock import LOOK_NS, VIRTUAL
from hapscene.compiled.native import INTERPRETED, native
from hapscene.device.model import Limits
from hapscene.flags import Flag
from hapscene.surface.effect import Effect


@pytest.fixture
def box() -> hapscene.Scene:
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]]), name="box", unit="m")
    return scene


def _watch(touch, p, table, s, out):
    """Outputs fields of the contact record as acceleration samples."""
    out.a_m_s2[0] = touch.tick
    out.a_m_s2[1] = touch.touching
    out.a_m_s2[2] = touch.depth_m
    out.a_m_s2[3] = touch.began
    out.a_m_s2[4] = touch.ended


WATCH = Effect("watch", "Outputs the contact record.", _watch)


def test_effects_see_the_contact_of_the_same_tick(box):
    z = [0.001, -0.001, -0.002, 0.001, 0.002]
    recording = hapscene.Renderer(box, [WATCH, "wall"]).run([[0, 0, h] for h in z])
    held = [False, True, True, False, False]
    assert recording.touching.tolist() == held
    seen = recording.a_m_s2
    first = int(np.flatnonzero(held)[0])
    assert seen[first:, 0].tolist() == list(range(first, 5))  # not called before the first contact
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


def test_tick_times_are_durations(box):
    """Three calls of a clock that advances by a fixed step per call."""
    renderer = hapscene.Renderer(box)
    path = np.tile([0.01, 0.0, -0.001], (500, 1))
    renderer.run(path)
    renderer.surface.clock[VIRTUAL] = 1
    recording = renderer.run(path)
    assert (recording.contact_ns == LOOK_NS).all() and (recording.tick_ns == 2 * LOOK_NS).all()


@pytest.mark.skipif(INTERPRETED, reason="nothing is compiled")
def test_native_code_cannot_allocate():
    """All functions of the tick are compiled by `native`, which rejects allocation."""

    @native
    def makes_an_array(n):
        return np.zeros(n).sum()

    with pytest.raises((NumbaError, RuntimeError)):
        makes_an_array(3)


def _grown_B(renderer, path):
    """Return the memory that steps along a path keep, without that of other threads: the least of three runs [B]."""
    ours = [tracemalloc.Filter(True, __file__, all_frames=True)]
    for p in path[:100]:
        renderer.step(p)
    grown = []
    tracemalloc.start(8)
    for _ in range(3):
        before = tracemalloc.take_snapshot().filter_traces(ours)
        for p in path:
            renderer.step(p)
        after = tracemalloc.take_snapshot().filter_traces(ours)
        grown.append(sum(trace.size for trace in after.traces) - sum(trace.size for trace in before.traces))
    tracemalloc.stop()
    return min(grown)


# --- stabilisers


STABILISED = Limits(passivity_Ns_m=5.0, coupling_N_m=900.0, coupling_Ns_m=0.2, delay_ticks=1, force_N=1.5)


def _fail(touch, p, table, s, out):
    out.f_W_N[0] = np.nan


def test_row_holds_the_force_after_guard_and_limits(box):
    """The passivity guard damps the sum, and the limits clip the result, which the next tick uses; flags add up."""
    fail = Effect("fail", "Returns NaN.", _fail, scope="scene")
    z = 1e-3 * np.sin(np.arange(400) / 3.0)
    path = np.column_stack((0.01 + 0 * z, 0 * z, z))
    guarded = Limits(passivity_Ns_m=50.0, force_N=0.3)
    recording = hapscene.Renderer(box, ["wall", fail], limits=guarded).run(path)
    assert (recording.flags & Flag.EFFECT_MUTED).all()
    damped, cut = ((recording.flags & flag) != 0 for flag in (Flag.ENERGY_DAMPED, Flag.FORCE_LIMITED))
    assert (damped & cut).any() and (damped & ~cut).any()
    assert np.linalg.norm(recording.f_W_N, axis=1).max() <= 0.3 * (1 + 1e-12)
    np.testing.assert_allclose(np.linalg.norm(recording.f_W_N[cut], axis=1), 0.3, rtol=1e-12)


@pytest.mark.skipif(INTERPRETED, reason="interpreted code makes objects")
@pytest.mark.parametrize("options", [{}, {"limits": STABILISED, "crease_rad": 0.5}], ids=["plain", "stabilised"])
def test_memory_does_not_grow(box, options):
    renderer = hapscene.Renderer(box, **options)
    path = np.c_[0.02 * np.sin(np.arange(2000) / 50), np.zeros(2000), 0.001 * np.sin(np.arange(2000) / 30)]
    assert _grown_B(renderer, path) < 10_000
