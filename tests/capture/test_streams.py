"""Streams cleaned: what the filters keep, take and shift, against sums and closed forms."""

import numpy as np
import pytest

from hapscene.capture.io.streams import Streams, clean, fill_missing, filtered, high_pass_gain, part_of, speed_of
from hapscene.errors import CaptureError

RATE_HZ = 2000.0
T_S = np.arange(8000) / RATE_HZ
NOISE = np.random.default_rng(0).standard_normal(len(T_S))


def gain(frequency_Hz: float, cutoff_Hz: float, kind: str) -> float:
    """What is left of a tone in the middle of a signal; it must not be shifted."""
    tone = np.sin(2.0 * np.pi * frequency_Hz * T_S)
    left = filtered(tone, RATE_HZ, cutoff_Hz, kind)[2000:6000]  # type: ignore[arg-type]
    found = left @ tone[2000:6000] / (tone[2000:6000] @ tone[2000:6000])
    assert np.abs(left - found * tone[2000:6000]).max() < 1e-3
    return float(found)


@pytest.mark.parametrize("cutoff_Hz", [20.0, 100.0])
@pytest.mark.parametrize("ratio", [0.5, 0.8, 1.0, 1.25, 2.0])
def test_butterworth_there_and_back(cutoff_Hz: float, ratio: float) -> None:
    """1/(1 + r⁸), twice the fourth order's √: a half at the cut-off; the bilinear transform bends r."""
    warped = np.tan(np.pi * ratio * cutoff_Hz / RATE_HZ) / np.tan(np.pi * cutoff_Hz / RATE_HZ)
    assert gain(ratio * cutoff_Hz, cutoff_Hz, "lowpass") == pytest.approx(1.0 / (1.0 + warped**8), abs=2e-3)
    assert gain(ratio * cutoff_Hz, cutoff_Hz, "highpass") == pytest.approx(1.0 / (1.0 + warped**-8), abs=2e-3)


def test_high_pass_gain_matches_the_filtered_acceleration() -> None:
    impulse = np.zeros(8192)
    impulse[4096] = 1.0
    cleaned = clean(impulse, RATE_HZ).acceleration_m_s2
    np.testing.assert_allclose(np.abs(np.fft.rfft(cleaned)), high_pass_gain(8192, RATE_HZ), atol=2e-3)
    assert len(high_pass_gain(8192, RATE_HZ)) == 4097


def test_missing_samples_are_interpolated() -> None:
    stream = np.array([np.nan, 1.0, np.nan, np.nan, 7.0, 2.0, np.nan])
    assert fill_missing(stream) == 4 and stream.tolist() == [1.0, 1.0, 3.0, 5.0, 7.0, 2.0, 2.0]


def test_speed_of_a_circle() -> None:
    """20 Hz at 2 kHz: all of it but sin(x)/x = 0.07 %, in every axis at once; the ends apart."""
    angle = 2.0 * np.pi * 20.0 * T_S
    speed = speed_of(0.01 * np.stack([np.cos(angle), np.sin(angle), np.ones_like(angle)]), RATE_HZ)
    assert speed[1000:-1000] == pytest.approx(0.01 * 2.0 * np.pi * 20.0, rel=1e-3) and speed.shape == T_S.shape


@pytest.mark.parametrize(("count", "rate_Hz", "fits"), [(200, 2000.0, True), (199, 2000.0, False), (200, 400.0, False)])
def test_speed_needs_enough_samples_and_motion(count: int, rate_Hz: float, fits: bool) -> None:
    if fits:
        assert speed_of(np.zeros((2, count)), rate_Hz).tolist() == [0.0] * count
    else:
        with pytest.raises(CaptureError, match="give no speed"):
            speed_of(np.zeros((2, count)), rate_Hz)


def test_constant_and_assumed_streams() -> None:
    streams = clean(NOISE + 9.81, RATE_HZ, speed_m_s=-0.2)
    assert np.all(streams.force_N == 1.0) and np.all(streams.speed_m_s == 0.2)
    assert streams.assumed == ("force_N",) and streams.depth_m is streams.tangential_force_N is None
    assert streams.acceleration_m_s2.mean() == pytest.approx(0.0, abs=1e-3)
    assert clean(NOISE, RATE_HZ, 2.0).assumed == ("speed_m_s",) and clean(NOISE, RATE_HZ, 1.0, 1.0).assumed == ()


def test_limits_of_length_and_level() -> None:
    assert len(clean(NOISE[:1000], RATE_HZ).force_N) == 1000
    with pytest.raises(CaptureError, match="999 samples"):
        clean(NOISE[:999], RATE_HZ)
    for level in (-1.0, 1.0):
        loud = NOISE.copy()
        loud[17] = level * 1e6
        clean(loud, RATE_HZ)
        loud[17] *= 1.001
        with pytest.raises(CaptureError, match="sample 17"):
            clean(loud, RATE_HZ)
        with pytest.raises(CaptureError, match="no vibration"):
            clean(level * (5e5 + 1e-6 * NOISE), RATE_HZ)  # rounding
    with pytest.raises(CaptureError, match="rate_Hz"):
        clean(NOISE, 400.0)


def test_a_part_contains_all_streams() -> None:
    whole = clean(NOISE, RATE_HZ, 1.0 + 0.1 * np.sin(T_S), None, None, 1e-3 * np.cos(T_S))
    chosen = np.arange(len(NOISE)) % 3 == 0
    for part in (slice(100, 300), chosen):
        cut = part_of(whole, part)
        assert isinstance(cut, Streams) and (cut.rate_Hz, cut.assumed) == (RATE_HZ, ("speed_m_s",))
        for name in ("acceleration_m_s2", "force_N", "speed_m_s", "depth_m"):
            assert np.array_equal(getattr(cut, name), getattr(whole, name)[part])
        assert cut.tangential_force_N is None


def test_the_contact_angle_is_a_magnitude_in_radians() -> None:
    tilt = 0.3 * np.sin(np.arange(len(NOISE)) / 300.0)
    streams = clean(NOISE, RATE_HZ, 1.0, 0.1, contact_angle_rad=tilt)
    assert streams.contact_angle_rad is not None
    np.testing.assert_allclose(streams.contact_angle_rad, np.abs(tilt), atol=0.01)
    with pytest.raises(CaptureError, match="contact angle"):
        clean(NOISE, RATE_HZ, 1.0, 0.1, contact_angle_rad=np.degrees(tilt))
