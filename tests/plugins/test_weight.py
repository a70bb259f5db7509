"""Weight: m g without steps."""

import math

import numpy as np

from hapscene_plugins.effects.weight import EFFECT


def test_the_weight_follows_a_low_pass(bench, ticks):
    params = {"mass_kg": 0.2, "gravity_x_m_s2": 3.0, "gravity_y_m_s2": -2.0}
    f = bench(EFFECT, params=params).run(ticks(2000, touching=0))["f_W_N"]
    risen = 1.0 - np.exp(-1e-3 * np.arange(1, 2001) / 0.05)
    np.testing.assert_allclose(f, 0.2 * np.outer(risen, (3.0, -2.0, -9.81)), rtol=1e-12)


def test_a_changed_mass_causes_no_step(bench, ticks):
    one = bench(EFFECT, params={"mass_kg": 0.2})
    before = one.run(ticks(1000))["f_W_N"][-1]
    one.p["mass_kg"] = 0.5
    f = np.vstack([before, one.run(ticks(1000))["f_W_N"]])
    assert np.abs(np.diff(f[:, 2])).max() <= 0.3 * 9.81 * -math.expm1(-0.02) * (1.0 + 1e-6)
    np.testing.assert_allclose(f[-1], (0.0, 0.0, -0.5 * 9.81), rtol=1e-8)


def test_gravity_is_given_in_the_frame_of_the_body(bench, ticks):
    """A cabin rotated by 90° about y: its downward direction is −x of W."""
    one = bench(EFFECT, params={"mass_kg": 1.0, "gravity_y_m_s2": 1.0, "gravity_z_m_s2": -2.0, "ease_s": 1e-3})
    one.table[:9] = np.ravel([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    np.testing.assert_allclose(one.run(ticks(100))["f_W_N"][-1], (-2.0, 1.0, 0.0), atol=1e-12)
