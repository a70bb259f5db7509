"""Guides: forces, potentials, and the nearest point of a polyline."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.errors import EffectError
from hapscene_plugins.effects.guide import EFFECT, nearest_on_polyline

POINT = {"points_m": (0.0, 0.0, 0.0)}
LINE = {"points_m": [(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}
PLANE = {"points_m": (0.0, 0.0, 0.0), "normal": (0.0, 0.0, 2.0)}
BENT = {"points_m": [(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), (0.03, 0.03, 0.01), (0.03, 0.03, 0.01)]}
K, R = 200.0, 0.01


def forces(bench, ticks, p, **setting):
    """Forces (n, 3) at positions (n, 3), long after the reset."""
    rows = ticks(len(p), p_WT_m=p, touching=0)
    rows["tick"] += 1000
    return bench(EFFECT, settings=setting).run(rows)["f_W_N"]


def test_attraction_within_the_reach(bench, ticks):
    d = np.linspace(0.0, 0.012, 49)
    want = K * d * np.maximum(0.0, 1.0 - (d / R) ** 2) ** 2
    for setting, out in ((POINT, (0.6, 0.0, 0.8)), (LINE, (0.0, 0.6, 0.8)), (PLANE, (0.0, 0.0, -1.0))):
        f = forces(bench, ticks, np.outer(d, out), **setting)
        np.testing.assert_allclose(f, -np.outer(want, out), atol=1e-14)
    assert want.max() == pytest.approx(0.286 * K * R, rel=5e-3)


def test_repulsion(bench, ticks):
    d = np.linspace(0.0, 0.012, 49)
    want = K * np.maximum(0.0, R - d) * np.minimum(1.0, 4.0 * d / R)
    for setting, out in ((POINT, (0.6, 0.0, 0.8)), (LINE, (0.0, 0.6, 0.8))):
        f = forces(bench, ticks, np.outer(d, out), repelling=1.0, **setting)
        np.testing.assert_allclose(f, np.outer(want, out), atol=1e-14)
    s = np.linspace(-0.05, 0.012, 63)
    f = forces(bench, ticks, np.outer(s, (0.0, 0.0, 1.0)), repelling=1.0, **PLANE)
    np.testing.assert_allclose(f[:, 2], K * np.maximum(0.0, R - s), atol=1e-12)


def test_an_inclined_plane(bench, ticks):
    n, at = np.array([1.0, -2.0, 2.0]) / 3.0, np.array([0.1, 0.2, 0.3])
    s = np.array([-0.02, -0.006, -0.001, 0.0, 0.004, 0.011])
    p = at + np.outer(s, n) + np.outer(np.arange(6), (2.0, 1.0, 0.0))  # and along the plane
    plane = {"points_m": at, "normal": 5.0 * n}
    pull = -K * s * np.maximum(0.0, 1.0 - (s / R) ** 2) ** 2
    np.testing.assert_allclose(forces(bench, ticks, p, **plane), np.outer(pull, n), atol=1e-12)
    push = K * np.maximum(0.0, R - s)
    np.testing.assert_allclose(forces(bench, ticks, p, repelling=0.5, **plane), np.outer(push, n), atol=1e-12)


@pytest.mark.parametrize("repelling", [0.0, 1.0])
@pytest.mark.parametrize("setting", [POINT, LINE, PLANE, BENT], ids=["point", "line", "plane", "polyline"])
def test_the_force_is_conservative_and_continuous(bench, ticks, setting, repelling):
    """A closed path through the border; the error of the midpoint rule is of second order."""
    turn = np.linspace(0.0, 2.0 * np.pi, 100_001)[:, None]
    rng = np.random.default_rng(3)
    p = sum(0.007 / k * np.sin(k * turn + rng.uniform(0, 6, 3)) for k in (1, 2, 5))
    p += np.array([0.004, 0.002, 0.001])
    f = forces(bench, ticks, 0.5 * (p[1:] + p[:-1]), repelling=repelling, **setting)
    felt = (f * np.diff(p, axis=0)).sum(axis=1)
    assert np.abs(felt).sum() > 1e-3 > 1e-7 > abs(felt.sum())
    assert np.abs(np.diff(f, axis=0)).max() < 5.0 * K * np.abs(np.diff(p, axis=0)).max()


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_the_nearest_point_of_a_polyline_is_exact(seed, count):
    """No point of the polyline is nearer, and the connection is perpendicular to a segment or ends at a corner."""
    rng = np.random.default_rng(seed)
    points, p = rng.normal(size=(count, 3)), rng.normal(0.0, 2.0, 3)
    got = np.array(nearest_on_polyline(points.ravel(), 0, count, tuple(p)))
    best = np.linalg.norm(p - points, axis=1).min()
    for a, b in pairwise(points):
        share = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = min(best, np.linalg.norm(p - a - share * (b - a)))
        dense = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
        assert np.linalg.norm(p - got) <= np.linalg.norm(p - dense, axis=1).min() + 1e-12
    assert np.linalg.norm(p - got) == pytest.approx(best, abs=1e-12)


def test_the_effect_moves_with_its_body(bench, ticks):
    one = bench(EFFECT, settings=LINE)
    one.table[:12] = [0, -1, 0, 1, 0, 0, 0, 0, 1, 0.5, 0.0, 0.1]  # its line is along y of W, at x = 0.5, z = 0.1
    rows = ticks(1, p_WT_m=(0.502, 0.3, 0.1))
    rows["tick"] = 1000
    np.testing.assert_allclose(one.run(rows)["f_W_N"][0], (-K * 0.002 * 0.96**2, 0.0, 0.0), atol=1e-12)


def test_the_first_named_body_is_the_frame(bench, ticks):
    one = bench(EFFECT, settings=LINE)
    poses = np.tile(one.table[:12], (2, 1))
    poses[:, 9:] = (0.5, 0.0, 0.0), (9.0, 9.0, 9.0)
    one.table = np.concatenate((poses.ravel(), one.table[12:]))
    rows = ticks(1, p_WT_m=(0.5, 0.002, 0.0))
    rows["tick"] = 1000
    np.testing.assert_allclose(one.run(rows)["f_W_N"][0], (0.0, -K * 0.002 * 0.96**2, 0.0), atol=1e-12)


def test_the_force_increases_gradually_after_a_reset(bench, ticks):
    f = bench(EFFECT, settings=POINT).run(ticks(100, p_WT_m=(0.001, 0.0, 0.0)))["f_W_N"][:, 0]
    np.testing.assert_allclose(f, -K * 0.001 * 0.99**2 * np.minimum(1.0, np.arange(100) / 50.0), atol=1e-15)


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ({}, "points_m"),
        ({"points_m": []}, "needs points_m"),
        ({"points_m": [[1, 2], [3]]}, "needs points_m"),
        ({"points_m": [[0, 0, np.nan]]}, "needs points_m"),
        ({"points_m": np.zeros((1001, 3))}, "1,001"),
        (LINE | {"normal": (0, 0, 1)}, "normal"),
        (POINT | {"normal": (0, 0, 0)}, "normal"),
        (POINT | {"normal": (0, 1)}, "needs normal, of a plane"),
    ],
)
def test_invalid_shapes_are_refused(bench, setting, says):
    with pytest.raises(EffectError, match=says):
        bench(EFFECT, settings=setting)
