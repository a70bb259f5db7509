"""Wall: force along the normal, K·d + b·ḋ, never negative."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.surface.effect import load_effect
from hapscene.surface.swatch import Swatch

WALL = load_effect("wall")


def force(bench, ticks, damping_Ns_m, **fields):
    return bench(WALL, Swatch("wall", damping_Ns_m=damping_Ns_m)).run(ticks(1, **fields))["f_W_N"][0]


def test_spring_and_damper_add_along_the_normal(bench, ticks):
    nhat = np.array([2.0, -1.0, 2.0]) / 3.0
    f = force(bench, ticks, 3.0, nhat_W=nhat, normal_force_N=1.05, depth_rate_m_s=0.1)
    np.testing.assert_allclose(f, (1.05 + 0.3) * nhat, rtol=1e-15)


def test_plate_pushes_outward(bench, ticks):
    """G3: at a depth of 2.1 mm and K = 500 N/m, 1.050 N outward."""
    f = force(bench, ticks, 0.0, normal_force_N=500.0 * 2.1e-3)
    np.testing.assert_allclose(f, [0.0, 0.0, 1.05], rtol=1e-15)


def test_no_force_without_contact(bench, ticks):
    assert not force(bench, ticks, 3.0, touching=0, normal_force_N=1.0, depth_rate_m_s=1.0).any()


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 20), st.floats(-10, 10), st.floats(0, 100))
def test_never_pulls(bench, ticks, press_N, rate_m_s, damping_Ns_m):
    f = force(bench, ticks, damping_Ns_m, normal_force_N=press_N, depth_rate_m_s=rate_m_s)
    assert f[2] == pytest.approx(max(0.0, press_N + damping_Ns_m * rate_m_s))


def test_damping_that_grows_with_the_depth(bench, ticks):
    """f = K d + (b + χ d) ḋ (Hunt & Crossley 1975), never negative."""
    sponge = Swatch("sponge", damping_Ns_m=1.0, hunt_crossley_Ns_m2=300.0)
    rate = np.array([0.2, -0.1, -2.0])
    f = bench(WALL, sponge).run(ticks(3, normal_force_N=1.0, depth_m=2e-3, depth_rate_m_s=rate))["f_W_N"][:, 2]
    np.testing.assert_allclose(f, np.maximum(0.0, 1.0 + (1.0 + 0.6) * rate), rtol=1e-15)
