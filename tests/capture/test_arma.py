"""Models with zeros as models without: the spectrum against SciPy's, the cut triangles by counting."""

import numpy as np
import pytest
from scipy.signal import freqz

from hapscene.capture.arma import _BINS, CUT_MAX, ERROR_DB, PEAK_DB, _error, _lattice, ar_from_arma, as_texture
from hapscene.capture.hatt_file import HattModels
from hapscene.dsp.ar_filter import lsf_from_ar, power_gain, reflection_from_ar

POLES = np.convolve([1.0, -1.7, 0.9], [1.0, -0.6, 0.7])


def density(zeros: np.ndarray) -> np.ndarray:
    _, response = freqz(zeros, POLES, worN=_BINS // 2 + 1, include_nyquist=True)
    return np.asarray(np.abs(response) ** 2)


@pytest.mark.parametrize("radius", [0.3, 0.6, 0.8])
def test_zeros_are_met_by_an_order_of_8_over_their_distance_from_the_circle(radius: float) -> None:
    zeros = np.array([1.0, -2.0 * radius * np.cos(1.0), radius**2])
    wanted = density(zeros)
    a, variance = ar_from_arma(wanted, round(8.0 / (1.0 - radius)))
    _, response = freqz([1.0], a, worN=_BINS // 2 + 1, include_nyquist=True)
    assert np.abs(10.0 * np.log10(variance * np.abs(response) ** 2 / wanted)).max() < 0.1
    assert np.all(np.abs(reflection_from_ar(a)) < 1.0)
    power = np.trapezoid(wanted) / (len(wanted) - 1)
    assert variance * power_gain(a) == pytest.approx(power)


def test_without_zeros_it_is_exact() -> None:
    a, variance = ar_from_arma(2.5 * density(np.ones(1)), 6)
    np.testing.assert_allclose(a, np.append(POLES, [0.0, 0.0]), atol=1e-9)
    assert variance == pytest.approx(2.5)


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_triangles_are_cut_into_equal_parts_that_share_their_corners(parts: int) -> None:
    """Two triangles side by side: n² parts each, and (n+1)(n+2)/2 places each, of which n+1 are common."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.2, 1.1]])
    triangles = np.array([[0, 1, 2], [3, 2, 1]], dtype=np.int32)
    corner, weight, cut = _lattice(triangles, parts)
    assert len(cut) == 2 * parts**2 and len(corner) == (parts + 1) * (parts + 2) - (parts + 1)
    np.testing.assert_allclose(weight.sum(axis=1), 1.0)
    place = np.einsum("kc,kcx->kx", weight, corners[corner])
    assert len({tuple(p) for p in place.round(9)}) == len(place)
    (x, y), (u, v) = (np.moveaxis(place[cut[:, k]] - place[cut[:, 0]], 1, 0) for k in (1, 2))
    area = 0.5 * (x * v - y * u)
    whole = [0.5, 0.5 * abs(np.cross([*(corners[2] - corners[3]), 0.0], [*(corners[1] - corners[3]), 0.0])[2])]
    np.testing.assert_allclose(np.abs(area), np.repeat(whole, parts**2) / parts**2)
    for k in (0, 1):  # all turn as their large triangle does
        assert len(set(np.sign(area[k * parts**2 : (k + 1) * parts**2]))) == 1


def models(apart: float) -> HattModels:
    """Three models of poles and zeros whose frequencies differ by so many rad."""

    def pair(angle: float, radius: float) -> np.ndarray:
        return np.array([1.0, -2.0 * radius * np.cos(angle), radius**2])

    ar = [lsf_from_ar(np.convolve(pair(0.6 + apart * i, 0.8), pair(1.6, 0.7))) for i in range(3)]
    ma = [lsf_from_ar(pair(1.2 - 0.5 * apart * i, 0.5)) for i in range(3)]
    force, speed = np.array([1.0, 2.0, 1.0]), np.array([0.1, 0.1, 0.3])
    level = np.array([1.0, 2.0, 0.5])
    triangle = np.array([[0, 1, 2]], dtype=np.int32)
    return HattModels("made", 1000.0, None, force, speed, triangle, np.array(ar), np.array(ma), level, np.ones(3), ())


@pytest.mark.parametrize(("apart", "cut"), [(0.1, 1), (0.2, 2), (0.4, 3)])
def test_triangles_are_cut_until_what_is_played_between_the_models_is_right(apart: float, cut: int) -> None:
    made = as_texture(models(apart))
    rms, largest = _error(models(apart), made.texture)
    assert rms <= ERROR_DB and largest <= PEAK_DB and made.error_at_models_dB <= ERROR_DB
    assert np.sqrt(len(made.texture.triangles)) == cut < CUT_MAX
