"""Level law: exponents and extrapolation."""

import numpy as np
import pytest

from hapscene.capture import load_recording, synthesize
from hapscene.capture.fit import distance as spectral
from hapscene.capture.fit.windows import AnalysisWindows, cut, fit_level, pooled
from hapscene.capture.io.streams import Streams, clean
from hapscene.errors import CaptureError

from ..signals import fit


def pieces(force_N, speed_m_s, power, seed=0):
    rng = np.random.default_rng(seed)
    signal = rng.standard_normal((len(force_N), 500)) * np.sqrt(power)[:, None]
    return AnalysisWindows(signal, force_N, speed_m_s, np.arange(len(force_N)))


def test_windows_are_cut_from_the_middle_of_each_run():
    """Windows of 0.1 s; windows of two runs are not adjacent, and the rest is omitted at both ends."""
    rows = np.random.default_rng(0).standard_normal(1000)
    streams = Streams(1e3, rows, np.ones(1000), np.linspace(0.1, 0.2, 1000), None)
    found = cut(streams, [(0, 250), (300, 730), (800, 850)])
    first = [25, 125, 315, 415, 515, 615]
    np.testing.assert_array_equal(found.acceleration_m_s2, [rows[i : i + 100] for i in first])
    np.testing.assert_allclose(found.speed_m_s, [streams.speed_m_s[i : i + 100].mean() for i in first])
    assert found.start.tolist() == [0, 1, 3, 4, 5, 6]
    both = pooled([found, found[2:]])
    assert len(both) == 10 and both.start.tolist()[6:] == [11, 12, 13, 14]
    longer = cut(streams, [(10, 960)])  # one run is used up to less than one sample per window
    np.testing.assert_array_equal(longer.acceleration_m_s2, rows[12:957].reshape(9, 105))
    assert len(pooled([found, longer]).acceleration_m_s2[0]) == 100
    with pytest.raises(CaptureError):
        cut(streams, [(100, 199)])


def test_windows_without_contact_and_outliers_are_omitted():
    rows, force, speed = np.tile([1.0, -1.0], 1500), np.ones(3000), np.full(3000, 0.1)
    force[:100], speed[100:200] = 0.01, 0.001
    rows[200:300] *= 10.0 ** (9.0 / 20.0)  # 9 dB, and 11 dB: an outlier
    rows[300:400] *= 10.0 ** (11.0 / 20.0)
    force[400:], speed[400:] = np.repeat([0.5, 1.0], 1300), np.tile(np.repeat([0.05, 0.1], 100), 13)
    rows[400:] *= force[400:] * speed[400:] * 10.0  # as force and speed demand
    found = cut(Streams(1e3, rows, force, speed, None))
    assert found.start.tolist() == [2, *range(4, 30)]


@pytest.mark.parametrize("exponent", [(0.0, 0.0), (1.0, 2.0), (0.5, 1.5)])
def test_known_exponents_are_found(exponent):
    rng = np.random.default_rng(1)
    force, speed = rng.uniform(0.3, 3.0, 300), rng.uniform(0.03, 0.3, 300)
    law = fit_level(pieces(force, speed, force ** exponent[0] * speed ** exponent[1]))
    for i, change in enumerate(((2.0, 1.0), (1.0, 2.0))):
        one, two = (law(np.array([f]), np.array([v]))[0] for f, v in ((1.0, 0.1), (1.0 * change[0], 0.1 * change[1])))
        assert np.log2(two / one) == pytest.approx(exponent[i], abs=0.05)


def test_small_variations_leave_the_prior():
    """With a scatter of 3 dB over speeds of ±5 %, the exponents stay near the prior."""
    rng = np.random.default_rng(2)
    for seed in range(20):
        force, speed = rng.uniform(1.9, 2.1, 10), rng.uniform(0.095, 0.105, 10)
        law = fit_level(pieces(force, speed, 10 ** rng.normal(0.0, 0.3, 10), seed))
        assert law(np.array([2.2]), np.array([0.1]))[0] / law(np.array([2.0]), np.array([0.1]))[0] < 1.2


def test_the_mean_power_is_preserved():
    part = pieces(np.linspace(1, 2, 30), np.linspace(0.2, 0.1, 30), np.linspace(1, 5, 30))
    assert fit_level(part)(part.force_N, part.speed_m_s).mean() == pytest.approx(np.mean(part.acceleration_m_s2**2))


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["leather", "paper", "wood"])
def test_power_on_the_held_out_half(name, shared):
    """Both directions; the halves of wood differ by 0.9 dB because of force and speed."""
    path = shared / "data" / "recordings" / f"cdp_{name}.csv"
    units = {"acceleration": "m/s2", "force": "N", "speed": "mm/s"}
    recording = load_recording(path, 10_000.0, columns={"acceleration": "accel"}, units=units)
    middle = len(recording.force_N) // 2
    first, second = slice(0, middle), slice(middle, None)
    force, speed = recording.force_N, recording.speed_m_s
    whole = clean(recording.acceleration_m_s2, 10_000.0).acceleration_m_s2
    for train, test in ((first, second), (second, first)):
        swatch = fit(recording.acceleration_m_s2[train], 10_000.0, force_N=force[train], speed_m_s=speed[train])
        count = -(-200_000 // len(whole[test]))  # long enough that the noise does not decide
        made = synthesize(swatch, np.tile(force[test], count), np.tile(speed[test], count), modulation=0.0)
        assert abs(spectral.level_difference_dB(made, whole[test])) < 0.5
