"""Adhesion: force, energy of breaking free, and passivity."""

import numpy as np
import pytest

import hapscene
from hapscene.stability.rig import AT_M, sheet
from hapscene.surface.swatch import Swatch
from hapscene_plugins.effects.adhesion import EFFECT, REACH

PULL_N, RANGE_M = 0.8, 5e-4
TAR = Swatch("tar", adhesion_N=PULL_N, adhesion_range_m=RANGE_M)


def left_at_0(ticks, way_m, **fields):
    """A contact of a tick, then the tool (n, 3) in the air; it left at the origin."""
    rows = ticks(len(way_m) + 1, touching=0, **fields)
    rows["touching"][0] = rows["began"][0] = rows["ended"][1] = 1
    rows["p_WT_m"][1:] = way_m
    return rows


def pulled(bench, ticks, way_m, **fields):
    return bench(EFFECT, TAR).run(left_at_0(ticks, way_m, **fields))["f_W_N"][1:]


def upwards(height_m):
    return np.column_stack([np.zeros((len(height_m), 2)), height_m])


def test_force_and_energy_follow_the_formula(bench, ticks):
    z = np.linspace(0.0, 1.2 * REACH * RANGE_M, 20_001)
    f = pulled(bench, ticks, upwards(z))
    held = z <= REACH * RANGE_M
    expected = -PULL_N * z / RANGE_M * np.exp(1.0 - z / RANGE_M)
    np.testing.assert_allclose(f[held, 2], expected[held], atol=1e-12)
    assert not f[~held].any() and not f[:, :2].any()
    assert f[:, 2].min() == pytest.approx(-PULL_N, rel=1e-6)
    assert -np.trapezoid(f[:, 2], z) == pytest.approx(PULL_N * np.e * RANGE_M, rel=1e-5)


def test_the_pull_starts_without_a_step_and_only_after_leaving(bench, ticks):
    """Without contact there is no pull, and no step when a tool leaves sideways below the surface."""
    way = np.array([0.0, 0.0, -1e-3]) + upwards(np.linspace(0.0, 1e-3, 101))
    f = pulled(bench, ticks, way)
    assert not f[0].any() and np.abs(np.diff(f, axis=0)).max() < 0.06 * PULL_N
    assert not bench(EFFECT, TAR).run(ticks(50, touching=0, p_WT_m=way[:50]))["f_W_N"].any()
    assert not pulled(bench, ticks, way, inside=1).any()  # let in: it has not left


@pytest.mark.parametrize("seed", range(5))
def test_the_pull_is_conservative(bench, ticks, seed):
    """Random walks over a moving body: the work equals the change of the potential."""
    rng = np.random.default_rng(seed)
    way = np.cumsum(rng.normal(0.0, 0.01 * RANGE_M, (5000, 3)), axis=0)
    way -= way[0]
    swim = np.cumsum(rng.normal(0.0, 1e-4, (5001, 3)), axis=0)
    rows = left_at_0(ticks, way)
    rows["left_W_m"] = swim
    rows["p_WT_m"] += swim
    f = bench(EFFECT, TAR).run(rows)["f_W_N"][1:]
    work = -np.cumsum(0.5 * ((f[1:] + f[:-1]) * np.diff(way, axis=0)).sum(axis=1))
    far = np.linalg.norm(way[1:], axis=1) / RANGE_M
    stored = PULL_N * np.e * RANGE_M * (1.0 - (1.0 + far) * np.exp(-far))
    np.testing.assert_allclose(work, stored, atol=2e-3 * PULL_N * np.e * RANGE_M)


def test_a_new_contact_ends_the_pull_without_a_step(bench, ticks):
    rows = left_at_0(ticks, np.tile((RANGE_M, 0.0, 0.0), (60, 1)))
    rows["p_WT_m"][1, 0] = 0.0
    rows["touching"][10:40], rows["began"][10], rows["ended"][40] = 1, 1, 1
    rows["p_WT_m"][40:, 0] = RANGE_M * np.linspace(1.0, 2.0, 21)
    rows["left_W_m"][40:, 0] = RANGE_M  # held there now
    f = bench(EFFECT, TAR).run(rows)["f_W_N"][:, 0]
    assert f[9] == pytest.approx(-PULL_N)
    assert np.all(np.diff(f[9:40]) >= 0.0) and np.abs(np.diff(f[9:41])).max() < 0.4 * PULL_N
    assert f[39] == f[40] == 0.0 and f[60] == pytest.approx(-PULL_N)
    rows["touching"][12:40], rows["ended"][40], rows["ended"][12] = 0, 0, 1  # lifted while the old hold still pulls
    rows["left_W_m"][12:, 0] = RANGE_M
    f = bench(EFFECT, TAR).run(rows)["f_W_N"][:, 0]
    assert abs(f[12]) == pytest.approx(abs(f[11])) and abs(f[11]) > 0.2 * PULL_N


def test_the_pull_follows_the_body_and_acts_on_it():
    """The tool and a sheet rise together; then the sheet stops. At a distance δ the force is A on both."""
    renderer = hapscene.Renderer(sheet(TAR), ["wall", EFFECT], seed=0)

    def step(tool_m, sheet_m):
        X_WB = np.eye(4)
        X_WB[2, 3] = sheet_m
        renderer.step((*AT_M, tool_m), {"sheet": X_WB})
        memory = renderer.surface.memory[0]
        return memory.f_body_W_N.copy(), memory.f_W_N.copy()

    renderer.reset((*AT_M, 1e-3))
    for z in (5e-4, 0.0, -1e-4, -1e-4):
        step(z, 0.0)
    for i in range(6):
        on_body, on_hand = step(1e-6 + 1e-3 * i, 1e-3 * i)
    assert np.abs([on_hand, on_body]).max() < 1e-12
    on_body, on_hand = step(1e-6 + RANGE_M + 5e-3, 5e-3)
    assert on_hand == pytest.approx([0.0, 0.0, -PULL_N]) and on_body == pytest.approx([0.0, 0.0, PULL_N])


@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("gone", ["removed", "put elsewhere", "painted anew"])
def test_teleported_removed_or_repainted_bodies_do_not_pull(gone, held):
    """During the pull or during contact; a new contact starts without the old pull."""
    scene = sheet(TAR)
    renderer = hapscene.Renderer(scene, ["wall", EFFECT], seed=0)
    bound = renderer.moving_bodies(["sheet"])
    for z in (5e-4, -1e-4, -1e-4, 1e-6, RANGE_M)[: 5 if held else 3]:
        command = renderer.step((*AT_M, z), bound)
    assert bool(command.f_W_N[2] < -0.9 * PULL_N) == held
    if gone == "removed":
        renderer.remove("sheet")
        bound = None
        fading_N = [renderer.step((*AT_M, RANGE_M)).f_W_N[2] for _ in range(6)]
        assert np.diff(np.abs([command.f_W_N[2], *fading_N])).max() <= 0.0
    elif gone == "put elsewhere":
        bound.X_WB[0, 0, 3], bound.teleported[:] = 1e-4, 1  # so near that it would still be held to
    else:
        renderer.repaint(scene)
    for z in RANGE_M * np.linspace(1.0, 2.0, 5) if held or gone != "painted anew" else ():
        assert not renderer.step((*AT_M, z), bound).f_W_N.any()
    assert renderer.step((*AT_M, -1e-4), bound).f_W_N[2] >= 0.0
