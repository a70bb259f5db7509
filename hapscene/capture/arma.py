"""Models with zeros (ARMA) as models without (AR), a numerical method of its own: textures hold the latter.

A filter C(z)/A(z) whose zeros lie within the unit circle is 1/(A/C): an AR model of infinite order. It is cut by a
least-squares fit (Makhoul 1975): the density |C/A|² gives the autocorrelation, that the filter, the power is kept.
Zeros of radius ρ need an order of about 8/(1−ρ) for 0.1 dB.

What the toolkit blends, frequencies of A and of C each by itself, an AR model blends differently: between very unlike
models by 2 dB. So each triangle is cut into n² smaller ones, whose corners are converted too; the error falls with n².
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.hatt_file import HattModels
from hapscene.capture.streams import Array
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.ar_filter import ar_from_lsf, lsf_from_ar, power_gain
from hapscene.surface.texture import Texture

ERROR_DB: Final = 0.1
"""Error of the spectrum that is aimed at, from 20 Hz to half the rate [dB]: at most, at the models; root mean square,
between them. The least change of level that is felt is 1.65 dB (Israr et al. 2006)."""

PEAK_DB: Final = 0.5
"""Largest error that is aimed at between the models [dB]: it stands in the notches."""

CUT_MAX: Final = 12
"""Most parts that the sides of a triangle are cut into [count]."""

NUMBER_MAX: Final = 120_000
"""Most coefficients of all models after the cut [count]: a file of about 2.5 MB, and up to 15 s to make it. The error
in sharp notches falls with this number; models without them reach what is aimed at below it."""

ORDERS: Final = (16, 24, 32, 48, 64, 96, 128, 192, 256)
"""Orders that are tried, the smallest that is good enough is taken."""

_MIDDLE: Final = ((1 / 3, 1 / 3, 1 / 3),)
_SIDES: Final = ((0.46, 0.46, 0.08), (0.46, 0.08, 0.46), (0.08, 0.46, 0.46))
"""Where a small triangle's error is looked at, by the shares of its corners: in the middle, and beside its sides."""

_BINS: Final = 1 << 13  # of a spectrum: at 1 kHz 0.12 Hz apart
_COARSE: Final = 1 << 10  # of the spectra that are compared between the models


@dataclass(frozen=True)
class Conversion:
    """A texture made of ARMA models, and how far its spectrum is from theirs: at the models, and between them.

    Between them it is measured at four places of every small triangle; at places drawn at random the largest error was
    at most 1.1 times as large.
    """

    texture: Texture
    error_at_models_dB: float
    error_rms_dB: float
    error_max_dB: float


def as_texture(models: HattModels) -> Conversion:
    """The texture of a file with zeros: see the module's text."""
    order, error_at_models_dB = _order(models)
    parts, most = 1, CUT_MAX
    while most > 1 and (len(models.triangles) * most**2 / 2 + len(models.force_N)) * order > NUMBER_MAX:
        most -= 1
    while True:
        texture = _cut(models, order, parts)
        rms, largest = _error(models, texture)
        excess = max(rms / ERROR_DB, largest / PEAK_DB)
        if excess <= 1.0 or parts == most:
            return Conversion(texture, error_at_models_dB, *_error(models, texture, _MIDDLE + _SIDES))
        parts = min(most, max(parts + 1, int(np.ceil(parts * np.sqrt(excess)))))


def ar_from_arma(density: Array, order: int) -> tuple[Array, float]:
    """The filter a (order+1,) and its excitation's variance for a two-sided density at _BINS/2 + 1 bins from 0 to π."""
    r = np.fft.irfft(density)[: order + 1]
    a = np.concatenate([[1.0], scipy.linalg.solve_toeplitz(r[:-1], -r[1:])])
    return a, float(r[0] / power_gain(a))


def _blended(models: HattModels, corner: NDArray[np.int32], weight: Array, bins: int) -> tuple[Array, Array]:
    """What the toolkit plays at blends (k, 3): density (k, bins/2 + 1) of unit excitation, and the excitation (k,)."""
    ar = ar_from_lsf(np.einsum("kc,kcp->kp", weight, models.ar_lsf_rad[corner]))
    ma = ar_from_lsf(np.einsum("kc,kcp->kp", weight, models.ma_lsf_rad[corner]))
    density = np.abs(np.fft.rfft(ma, bins)) ** 2 / np.abs(np.fft.rfft(ar, bins)) ** 2
    gain, variance = (np.sum(weight * values[corner], axis=1) for values in (models.gain, models.variance_m2_s4))
    return density, gain**2 * variance


def _order(models: HattModels) -> tuple[int, float]:
    """The smallest order at which every model of the file is right to ERROR_DB, and the largest error left."""
    own = np.repeat(np.arange(len(models.force_N), dtype=np.int32)[:, None], 3, axis=1)
    density, _ = _blended(models, own, np.full(own.shape, 1 / 3), _BINS)
    band = np.linspace(0.0, 0.5 * models.rate_Hz, density.shape[1]) >= ACCELERATION_BAND_HZ[0]
    worst = np.inf
    for order in ORDERS:
        worst = 0.0
        for one in density:
            a, variance = ar_from_arma(one, order)
            difference = 10.0 * np.log10(variance / np.abs(np.fft.rfft(a, _BINS)) ** 2 / one)
            worst = max(worst, float(np.abs(difference[band]).max()))
            if worst > ERROR_DB and order < ORDERS[-1]:
                break
        if worst <= ERROR_DB:
            break
    return order, worst


def _lattice(triangles: NDArray[np.int32], parts: int) -> tuple[NDArray[np.int32], Array, NDArray[np.int32]]:
    """Triangles cut into parts² each: corners (k, 3) and weights (k, 3) of the places, and the triangles (t parts², 3).

    A place on a side that two triangles share is one place.
    """
    places: dict[tuple[tuple[int, int], ...], int] = {}
    corner: list[NDArray[np.int32]] = []
    weight: list[tuple[int, int, int]] = []
    cut: list[tuple[int, int, int]] = []
    for triangle in triangles:
        at: dict[tuple[int, int], int] = {}
        for i in range(parts + 1):
            for j in range(parts + 1 - i):
                share = (i, j, parts - i - j)
                key = tuple(sorted((int(m), s) for m, s in zip(triangle, share, strict=True) if s))
                if key not in places:
                    places[key] = len(places)
                    corner.append(triangle)
                    weight.append(share)
                at[i, j] = places[key]
        for i, j in at:
            if i + j < parts:
                cut.append((at[i, j], at[i + 1, j], at[i, j + 1]))
            if i + j < parts - 1:
                cut.append((at[i + 1, j + 1], at[i, j + 1], at[i + 1, j]))
    return np.array(corner), np.array(weight) / parts, np.array(cut, dtype=np.int32)


def _cut(models: HattModels, order: int, parts: int) -> Texture:
    """The texture of the models and of the places between them."""
    corner, weight, triangles = _lattice(models.triangles, parts)
    density, excitation = _blended(models, corner, weight, _BINS)
    filters = [ar_from_arma(one, order) for one in density]
    lsf = np.stack([lsf_from_ar(a) for a, _ in filters])
    force, speed = (np.sum(weight * values[corner], axis=1) for values in (models.force_N, models.speed_m_s))
    variance = excitation * np.array([v for _, v in filters])
    return Texture(models.rate_Hz, force, speed, triangles, lsf, variance, interpolation="hatt")


def _error(
    models: HattModels, texture: Texture, places: tuple[tuple[float, float, float], ...] = _MIDDLE
) -> tuple[float, float]:
    """Root mean square and largest error of level and shape [dB] at places of all small triangles that sound."""
    triangles = texture.triangles
    # a place in a small triangle, as a blend of the corners of its large one
    large = np.repeat(models.triangles, len(triangles) // len(models.triangles), axis=0)
    matrix = np.stack([models.force_N[large], models.speed_m_s[large], np.ones(large.shape)], axis=1)
    squares, count, largest = 0.0, 0, 0.0
    for corners in np.array(places):
        point = np.stack([texture.force_N[triangles] @ corners, texture.speed_m_s[triangles] @ corners])
        share = np.linalg.solve(matrix, np.stack([*point, np.ones(len(large))], axis=1)[..., None])[..., 0]
        density, excitation = _blended(models, large, share, _COARSE)
        a, variance = texture.models(*point)
        band = np.linspace(0.0, 0.5 * models.rate_Hz, density.shape[1]) >= ACCELERATION_BAND_HZ[0]
        heard = excitation > 0.0
        ours = (variance[:, None] / np.abs(np.fft.rfft(a, _COARSE)) ** 2)[np.ix_(heard, band)]
        theirs = (excitation[:, None] * density)[np.ix_(heard, band)]
        difference = 10.0 * np.log10(ours / theirs)
        squares, count = squares + float(np.sum(difference**2)), count + difference.size
        largest = max(largest, float(np.abs(difference).max(initial=0.0)))
    return float(np.sqrt(squares / max(count, 1))), largest
