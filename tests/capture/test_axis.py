"""DFT321 where the answer is known."""

import numpy as np
import pytest

from hapscene.capture.axis import dft321, one_axis
from hapscene.capture.channel import clean
from hapscene.errors import CaptureError

RATE_HZ = 10_000.0
AXES = np.random.default_rng(0).standard_normal((3, 20_000))


@pytest.mark.parametrize("count", [1000, 1001])
def test_the_power_of_the_axes_is_kept_at_each_frequency(count):
    axes = AXES[:, :count]
    together = np.abs(np.fft.rfft(dft321(axes))) ** 2
    apart = (np.abs(np.fft.rfft(axes)) ** 2).sum(axis=0)
    np.testing.assert_allclose(together, apart, rtol=1e-9, atol=1e-9)
    assert (dft321(axes) ** 2).sum() == pytest.approx((axes**2).sum(), rel=1e-12)


def test_one_direction_comes_back():
    """A vibration along a direction u is one signal: its length times that, up to the sign of the sum of u."""
    for u in ([1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.6, 0.0, -0.8]):
        want = np.sign(np.sum(u)) * np.linalg.norm(u) * AXES[0]
        np.testing.assert_allclose(dft321(np.outer(u, AXES[0])), want, atol=1e-10)
    np.testing.assert_allclose(dft321(np.stack([AXES[0]] * 3)), np.sqrt(3) * AXES[0], atol=1e-10)


def test_axes_that_cancel_are_not_lost():
    opposed = np.stack([AXES[0], -AXES[0]])
    assert (dft321(opposed) ** 2).sum() == pytest.approx((opposed**2).sum(), rel=1e-9)
    assert not dft321(np.zeros((3, 100))).any()


def test_over_time_the_power_stays_where_it_was():
    """What a transform of the whole recording would spread: silence stays silent, a burst stays a burst."""
    axes = AXES.copy()
    axes[:, :10_000] = 0.0
    y = one_axis(axes, RATE_HZ)
    assert np.abs(y[:8500]).max() < 0.01 * y.std()
    assert (y[10_000:] ** 2).sum() == pytest.approx((AXES[:, 10_000:] ** 2).sum(), rel=0.04)


def test_gravity_that_turns_with_the_hand_is_not_heard():
    t_s = np.arange(20_000) / RATE_HZ
    turn = 9.81 * np.stack([np.sin(3 * t_s), np.cos(3 * t_s), 0.0 * t_s])
    still, turned = (clean(one_axis(0.1 * AXES + by, RATE_HZ), RATE_HZ).acceleration_m_s2 for by in (0.0, turn))
    assert np.std((turned - still)[2000:-2000]) < 0.02 * np.std(still)


def test_one_axis_passes_and_four_do_not():
    np.testing.assert_array_equal(one_axis(AXES[:1], RATE_HZ), AXES[0])
    for bad in (np.zeros((4, 100)), np.zeros((0, 100))):
        with pytest.raises(CaptureError, match="one to three axes"):
            one_axis(bad, RATE_HZ)
