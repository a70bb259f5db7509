"""Fits of recordings by equations of motion: what was planted comes back, each of it with an interval that holds it."""

import numpy as np
import pytest

from hapscene.capture.fit.segment import segment
from hapscene.capture.fit.taps import fit_taps
from hapscene.capture.io.streams import clean

from ..signals import fit
from ..simulated_tool import noisy, pulled, tapped

pytestmark = pytest.mark.nightly

RATE_HZ = 5000.0
SPEEDS_M_S = (0.05, 0.08, 0.12, 0.18, 0.27, 0.4)


def dragged(drive_m_s, static, kinetic, seed=0, **tool):
    """Streams of a tool that is pulled, 1.5 N, its speed a size: noise of 20 dB in all."""
    rng = np.random.default_rng(seed)
    normal = 1.5 + 0.2 * np.sin(2.1 * np.arange(len(drive_m_s)) / RATE_HZ)
    speed, friction = pulled(drive_m_s, normal, static, kinetic, RATE_HZ, **tool)
    return {
        "acceleration_m_s2": rng.standard_normal(len(speed)) * (0.02 + 20.0 * speed),
        "rate_Hz": RATE_HZ,
        "force_N": noisy(normal, rng),
        "speed_m_s": np.abs(noisy(speed, rng)),
        "tangential_force_N": noisy(friction, rng),
    }


@pytest.fixture(scope="module")
def slipping():
    """37 ms of rest, 23 of a slip."""
    return dragged(np.full(12_500, 0.0115), 0.45, lambda v: 0.3, damping_Ns_m=1.0)


def test_stick_slip_gives_friction_and_no_texture(slipping):
    swatch = fit(**slipping)
    assert swatch.friction_static == pytest.approx(0.45, rel=0.06)
    assert swatch.friction_dynamic == pytest.approx(0.30, rel=0.03)
    for name, planted in (("friction_static", 0.45), ("friction_dynamic", 0.3)):
        low, high = swatch.intervals[name]
        assert low <= planted <= high and high - low < 0.1
    assert swatch.texture is None and "stick–slip" in swatch.absent["texture"]


TAPS = {
    "hertz": ({"force": lambda x, v: 3e6 * x**1.5 * (1.0 + 0.3 * v)}, 180.0, 70.0),
    "soft": (
        {"force": lambda x, v: 5e3 * x + 6.6 * v, "ring": (1500.0, 800.0), "masses_kg": (0.09, 0.01), "stays_N": 1.0},
        np.sqrt(5e3 / 0.1 - 33.0**2) / (2.0 * np.pi),
        33.0,
    ),
}


@pytest.fixture(scope="module", params=TAPS)
def tapping(request):
    tool, frequency, decay = TAPS[request.param]
    return tapped(SPEEDS_M_S, rate_Hz=RATE_HZ, **tool), frequency, decay


def of_taps(streams, seed):
    """The taps that are found in streams with noise 20 dB below six taps' 60 ms."""
    acceleration, force, depth = streams
    rng = np.random.default_rng(seed)
    taps = [acceleration[i * 5000 : i * 5000 + 300] for i in range(1, 7)]
    channels = clean(
        acceleration + 0.1 * np.sqrt(np.mean(np.square(taps))) * rng.standard_normal(len(force)),
        RATE_HZ,
        noisy(force, rng),
        None,
        None,
        depth + 1e-5 * rng.standard_normal(len(depth)),
    )
    return fit_taps([(channels, segment(channels))])


def test_taps_of_six_speeds_are_recovered(tapping):
    streams, frequency, decay = tapping
    found = of_taps(streams, 0)
    np.testing.assert_allclose(found.taps.approach_m_s, SPEEDS_M_S, rtol=0.05)
    np.testing.assert_allclose(found.taps.frequency_Hz[2:], frequency, rtol=0.02)
    np.testing.assert_allclose(found.taps.decay_1_s[2:], decay, rtol=0.15)
