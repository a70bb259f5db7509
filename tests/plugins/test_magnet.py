"""Magnets: strength, reach and potential."""

import numpy as np
import pytest

from hapscene.errors import EffectError
from hapscene_plugins.effects.magnet import EFFECT

POINTS = np.array([(0.0, 0.0, 0.0), (0.008, 0.0, 0.0), (0.0, 0.1, 0.0)])
F, R = 0.5, 0.01
K = F * 25.0 * np.sqrt(5.0) / (16.0 * R)


def forces(bench, ticks, p, points=POINTS):
    rows = ticks(len(p), p_WT_m=p, touching=0)
    rows["tick"] += 1000
    return bench(EFFECT, settings={"points_m": points}).run(rows)["f_W_N"]


def test_largest_force_and_reach(bench, ticks):
    d = np.linspace(0.0, 0.012, 1201)
    f = forces(bench, ticks, np.outer(d, (0.0, 0.6, 0.8)), POINTS[:1])
    pull_N = -f @ (0.0, 0.6, 0.8)
    np.testing.assert_allclose(pull_N, K * d * np.maximum(0.0, 1.0 - (d / R) ** 2) ** 2, atol=1e-15)
    assert pull_N.max() == pytest.approx(F, rel=1e-5) and d[pull_N.argmax()] == pytest.approx(R / np.sqrt(5), rel=2e-3)
    assert not pull_N[d > R].any()


def test_the_force_is_conservative(bench, ticks):
    """Random curved paths through the overlapping potentials of two magnets."""

    def potential_J(p):
        y = np.maximum(0.0, 1.0 - ((p - POINTS) ** 2).sum(axis=1) / R**2)
        return -(K * R**2 / 6.0 * y**3).sum()

    rng = np.random.default_rng(1)
    way = np.linspace(0.0, 1.0, 20_001)[:, None]
    for _ in range(5):
        a, b, bend = rng.normal((0.004, 0.0, 0.0), 0.005, (3, 3))
        p = a + way * (b - a) + np.sin(np.pi * way) * bend
        work_J = (forces(bench, ticks, 0.5 * (p[1:] + p[:-1])) * np.diff(p, axis=0)).sum()
        assert work_J == pytest.approx(potential_J(a) - potential_J(b), abs=1e-10)


def test_without_points_it_is_refused(bench):
    with pytest.raises(EffectError, match=r"'magnet' needs points_m, \(n, 3\)"):
        bench(EFFECT)
