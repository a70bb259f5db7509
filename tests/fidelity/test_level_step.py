"""From level to level while a scene is touched: on the same side, without a jump in force, a click, or a tap."""

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device.model import Limits
from hapscene.errors import HapsceneError
from hapscene.fidelity.apply import apply_level
from hapscene.fidelity.fidelity import Fidelity, Level, SwatchFidelity
from hapscene.fidelity.level_step import HANDOVER_N
from hapscene.flags import Flag
from hapscene.renderer import EFFECTS

from .conftest import meshes, scene_of, stroke

KINDS = ("sphere", "box", "torus")


def winding(mesh, points):
    """How often a mesh goes round each point (n,): 0 outside, 1 inside (van Oosterom & Strackee 1983)."""
    a, b, c = (mesh.triangles_m[None, :, i] - points[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    dots = [(u * v).sum(axis=2) for u, v in ((a, b), (b, c), (c, a))]
    triple = (a * np.cross(b, c)).sum(axis=2)
    angle = np.arctan2(triple, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    return angle.sum(axis=1) / (2 * np.pi)


def walk(renderer, path, steps):
    """Step along a path, to the level `steps` says by tick; forces, offsets (n, 3), levels, flags, and the rows."""
    renderer.reset(path[0])
    kept = []
    for k, p in enumerate(path):
        if k in steps:
            renderer.level = steps[k]
        command = renderer.step(p)
        row, memory = renderer._row[0], renderer.surface.memory[0]
        place = (row.touching, row.began, row.face, row.p_WP_m.copy(), row.nhat_W.copy())
        kept.append((command.f_W_N, memory.offset_W_N.copy(), renderer.level, int(command.flags), *place))
    return [np.array(column) for column in zip(*kept, strict=True)]


@pytest.mark.parametrize("kind", KINDS)
def test_at_one_level_it_is_the_scene_at_that_level(kind, fidelity):
    scene, path = scene_of(kind), stroke(kind, 0)
    levels = fidelity(kind).levels
    want = hapscene.Renderer(apply_level(scene, levels[1])).run(path)
    got = hapscene.Renderer(scene, fidelity=Fidelity(levels[1:2])).run(path)
    for name in ("p_WP_m", "f_W_N", "a_m_s2", "face", "flags"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))
    several = hapscene.Renderer(scene, fidelity=Fidelity(levels[1:])).run(path)
    for name in ("p_WP_m", "f_W_N", "a_m_s2", "face", "flags"):
        np.testing.assert_array_equal(getattr(several, name), getattr(want, name))
    renderer = hapscene.Renderer(scene, fidelity=Fidelity((levels[0], levels[1])))
    renderer.level = 1
    second = renderer.run(path)  # with the skin of the first
    np.testing.assert_allclose(second.f_W_N, want.f_W_N, atol=1e-3)
    assert (second.flags & Flag.COARSER).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("effects", [("wall",), EFFECTS], ids=["wall", "all"])
def test_random_steps_along_random_strokes(kind, effects, fidelity):
    shapes = meshes(kind)
    renderer = hapscene.Renderer(scene_of(kind), effects, fidelity=fidelity(kind))
    for seed in range(3):
        rng, path = np.random.default_rng(seed), stroke(kind, seed)
        at = np.sort(rng.choice(np.arange(20, len(path)), 40, replace=False))
        renderer.level = 0
        f, offset, level, flags, touching, _, face, p_WP, nhat = walk(
            renderer, path, dict(zip(at, rng.integers(0, 3, 40), strict=True))
        )
        stepped = np.flatnonzero(np.diff(level)) + 1
        assert len(stepped) > 15 and touching[stepped].any()

        # the force goes on where it was, and what differs goes away by so much a tick
        np.testing.assert_allclose(f[stepped], f[stepped - 1], atol=1e-12)
        own = f - offset
        size = np.linalg.norm(offset, axis=1)
        others = np.setdiff1d(np.arange(1, len(f)), stepped)
        change, own_change = (np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (f, own))
        assert (change[others - 1] <= own_change[others - 1] + HANDOVER_N + 1e-12).all()
        np.testing.assert_allclose(size[others], np.maximum(size[others - 1] - HANDOVER_N, 0.0), atol=1e-12)
        assert (size[stepped] <= np.linalg.norm(f[stepped - 1] - own[stepped], axis=1) + 1e-12).all()
        np.testing.assert_array_equal((flags & Flag.COARSER) != 0, level > 0)

        # the proxy is on the surface, and the tool in the air is outside
        for k, mesh in enumerate(shapes):
            held = (level == k) & (touching == 1)
            rest = held & (flags & Flag.UNSETTLED == 0)
            found = trimesh.triangles.closest_point(mesh.triangles_m[face[rest]], p_WP[rest])
            np.testing.assert_allclose(found, p_WP[rest], atol=1e-6)  # a skin past an edge
            outside = np.where(held[:, None], p_WP + 2e-6 * nhat, path)[level == k][::5]
            assert np.abs(winding(mesh, outside)).max() < 0.5


def test_work_of_what_is_handed_over_is_bounded(fidelity):
    """At most o² v / (2 · 50 N/s), the speed v being the stroke's largest."""
    renderer = hapscene.Renderer(scene_of("sphere"), ["wall"], fidelity=fidelity("sphere"))
    path = stroke("sphere", 5)
    at = dict(zip(range(50, 1500, 50), [1, 2, 0] * 10, strict=False))
    _, offset, level, *_ = walk(renderer, path, at)
    way = np.diff(path, axis=0)
    work = np.abs((offset[:-1] * way).sum(axis=1))
    for k in np.flatnonzero(np.diff(level)) + 1:
        o = np.linalg.norm(offset[k])
        speed = 1000.0 * np.linalg.norm(way[k : k + 50], axis=1).max()
        assert work[k : k + 50].sum() <= o * o * speed / (2 * 50.0) + o * speed * 1e-3


def test_a_tool_over_which_the_surface_closes_is_pushed_out_gently_and_has_tapped_nothing(fidelity):
    """It hovers where the coarse sphere is not yet, and the fine one already is."""
    renderer = hapscene.Renderer(scene_of("sphere"), fidelity=fidelity("sphere"))
    middle = meshes("sphere")[2].triangles_m.mean(axis=1)[0]
    p = middle * (np.linalg.norm(middle) + 0.0002) / np.linalg.norm(middle)
    renderer.level = 2
    f, _, _, _, touching, began, _, _, nhat = walk(renderer, np.tile(p, (400, 1)), {100: 0})
    assert not touching[:100].any() and not f[:100].any()
    assert touching[100:].all() and not began.any()
    assert not f[100].any()
    size = np.linalg.norm(f, axis=1)
    assert size[-1] > 0.2 and (np.diff(size) <= HANDOVER_N + 1e-9).all()
    assert (np.einsum("ij,ij->i", f[101:], nhat[101:]) > 0.0).all()
    assert not renderer._samples.any()


def test_a_step_where_nothing_differs_makes_no_energy_also_with_a_coupling(fidelity):
    """The box is the same at all levels: what the passivity controller counts is what a slow press gives anyway."""
    limits = Limits(force_N=10.0, coupling_N_m=2000.0, guard_Ns_m=3.0)
    renderer = hapscene.Renderer(scene_of("box"), ["wall"], limits=limits, fidelity=fidelity("box"))
    press = np.concatenate((np.linspace(0.041, 0.039, 200), np.full(50, 0.039), np.linspace(0.039, 0.0385, 200)))
    made_J = []
    for k, z in enumerate(press):
        if k == 320:
            renderer.level = 2
        renderer.step((0.001, 0.002, z))
        made_J.append(float(renderer.surface.memory[0].made_J))
    assert max(made_J[320:340]) < max(made_J[200:320])


def test_a_filter_goes_on_playing_through_a_step(fidelity):
    """With the same noise: in the first 5 ms it is nearly the same signal as without."""
    t = np.arange(800) / 1000.0
    path = np.stack([0.02 * np.sin(4 * t), np.zeros(800), np.maximum(0.0395, 0.041 - 0.1 * t)], axis=1)
    kept = fidelity("box").levels
    levels = (kept[0], Level(swatches={"wood": SwatchFidelity(order=3)}))
    samples = []
    for to in (0, 1):
        renderer = hapscene.Renderer(scene_of("box"), fidelity=Fidelity(levels))
        before = renderer.run(path[:400]).a_m_s2
        renderer.level = to
        samples.append(np.concatenate([before, renderer.run(path[400:]).a_m_s2]).ravel())
    was, stepped = samples
    loud = np.std(was[2000:4000])
    assert loud > 0.0
    np.testing.assert_array_equal(stepped[:4000], was[:4000])
    assert np.abs((stepped - was)[4000:4050]).max() < 0.2 * loud
    assert np.std((stepped - was)[6000:]) > 0.2 * loud


def test_bodies_move_at_all_levels(fidelity):
    """The body rises into the tool, and steps meanwhile: its pose is that of the last tick at any level."""
    renderer = hapscene.Renderer(scene_of("sphere"), ["wall"], fidelity=fidelity("sphere"))
    still = hapscene.Renderer(apply_level(scene_of("sphere"), fidelity("sphere").levels[1]), ["wall"])
    X = np.tile(np.eye(4), (600, 1, 1))
    X[:, 2, 3] = np.minimum(1e-5 * np.arange(600), 0.003)
    p = np.array([0.001, 0.002, 0.0515])
    for k in range(600):
        if k in (250, 260, 280):
            renderer.level = {250: 1, 260: 2, 280: 1}[k]
        got, want = renderer.step(p, {"body": X[k]}), still.step(p, {"body": X[k]})
    assert np.linalg.norm(want.f_W_N) > 0.3
    np.testing.assert_allclose(got.f_W_N, want.f_W_N, atol=1e-3)
    np.testing.assert_allclose(renderer.impulse("body")[0][2], still.impulse("body")[0][2], rtol=0.1)


def test_what_is_tuned_and_painted_is_so_at_every_level(fidelity):
    scene, kept = scene_of("box"), fidelity("box")
    renderer = hapscene.Renderer(scene, fidelity=kept)
    p = np.tile([0.0, 0.0, 0.0395], (50, 1))
    renderer.run(np.linspace([0.0, 0.0, 0.041], p[0], 50))
    renderer.tune("wood", stiffness_N_m=300.0, friction_static=0.5)
    for level in (0, 1, 2):
        renderer.level = level
        assert renderer.run(p).f_W_N[-1, 2] == pytest.approx(300.0 * 0.0005, rel=1e-6)
    slid = renderer.run(np.linspace(p[0], p[0] + [0.01, 0, 0], 50)).f_W_N[-1]
    assert slid[0] == 0.0  # friction is left out at the last
    renderer.level = 1
    other = scene.copy()
    other.paint("body", "paper")
    renderer.repaint(other)
    assert renderer.level == 1 and renderer.run(p).swatch[-1] == other.swatches.index(hapscene.load_swatch("paper"))


def test_after_a_reset_the_level_is_the_same(fidelity):
    renderer = hapscene.Renderer(scene_of("sphere"), fidelity=fidelity("sphere"))
    renderer.level = 2
    first = renderer.run(stroke("sphere", 1))
    renderer.reset(stroke("sphere", 1)[0])
    second = renderer.run(stroke("sphere", 1))
    np.testing.assert_array_equal(second.f_W_N, first.f_W_N)
    assert renderer.level == 2 and (second.flags & Flag.COARSER).all()


def test_what_is_not_done_is_refused(fidelity):
    scene = scene_of("sphere")
    renderer = hapscene.Renderer(scene, fidelity=fidelity("sphere"))
    with pytest.raises(HapsceneError, match="levels 0 to 2"):
        renderer.level = 3
    with pytest.raises(HapsceneError, match="another shape"):
        renderer.deform("body", scene.bodies[0].mesh.vertices_m)
    more = scene.copy()
    more.add(meshes("box")[2], name="more")
    with pytest.raises(HapsceneError, match="no body is added"):
        renderer.repaint(more)
    with pytest.raises(HapsceneError, match="one level at least"):
        hapscene.Renderer(scene, fidelity=Fidelity(()))
    with pytest.raises(HapsceneError, match="budget_us"):
        hapscene.Renderer(scene, fidelity=fidelity("sphere"), budget_us=0.0)
    renderer.remove("body")
    renderer.level = 1
    assert not renderer.run(stroke("sphere", 0)).touching.any()
