"""Compares the texture of a swatch with a recording, and a model of one half of the recording with the other half."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import lfilter

from hapscene.capture.fit import distance as spectral
from hapscene.capture.fit.order import OrderSearch, search_order
from hapscene.capture.fit.segment import InteractionState, Segmentation
from hapscene.capture.fit.swatch import FitOptions, fit_swatch
from hapscene.capture.fit.synthesis import synthesize
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import DURATION_MIN_S, Array, Streams, kept_share, part_of
from hapscene.dsp.linear_prediction import autocorrelation, solve, tapered
from hapscene.errors import CaptureError
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

__all__ = ["Comparison", "HeldOut", "compare_with_recording"]

BLOCK_S: Final = 0.01
"""Interval at which the model follows force and speed of a recording [s], as in `synthesize`."""

RUN_S: Final = 0.1
"""Shortest run of sliding that is used [s]: a window of the spectrum."""

REPETITIONS: Final = 8
"""Number of syntheses from which the amplitude modulation of the model is averaged, and of stationary signals."""

LAGS: Final = 100
"""Lags of the residual that are tested [count]."""

WHITE_ORDER: Final = 120
"""Order at which the residual is tested [1]: that of the haptography paper, which leaves no spectral line."""


@dataclass(frozen=True)
class HeldOut:
    """Comparison of a model of the first half of a recording with the second half.

    Attributes:
        frequency_Hz: (k,) frequencies of the spectra. fitted: (k,) power spectral density of the first half
        [(m/s²)²/Hz]. held_out: (k,) power spectral density of the second half. model: (k,) expected density of the
        model for force and speed of the second half, with the high-pass of recordings. distance_dB: log-spectral
        distance of model and second half, without level. floor_dB: log-spectral distance of the two halves. level_dB:
        power of the model over that of the second half, 20 to 1000 Hz. halves_dB: power of the first half over that of
        the second. band_dB: (12,) level of the model over the second half in the bands of `BAND_EDGES_HZ`.
        halves_band_dB: (12,) level of the first half over the second half. modulation: depth of the amplitude
        modulation of second half, model (mean) and first half [1]. correlated: lags of the residual outside the 95 %
        bounds, and the most of `REPETITIONS` stationary signals (`correlated_lags`).
    """

    frequency_Hz: Array
    fitted: Array
    held_out: Array
    model: Array
    distance_dB: float
    floor_dB: float
    level_dB: float
    halves_dB: float
    band_dB: Array
    halves_band_dB: Array
    modulation: tuple[float, float, float]
    correlated: tuple[int, int]


@dataclass(frozen=True)
class Comparison:
    """Comparison of the texture of a swatch with a recording.

    Attributes:
        search: results for each model order.
        band_dB: (12,) level of the swatch over the recording in bands.
        held_out: comparison of a model of one half with the other half, or None.
        reason: why `held_out` is None.
    """

    search: OrderSearch
    band_dB: Array
    held_out: HeldOut | None
    reason: str = ""


def compare_with_recording(swatch: Swatch, channels: Streams, states: Segmentation) -> Comparison:
    """Compares the texture of a swatch with the sliding of a filtered recording.

    Raises:
        CaptureError: the swatch has no texture, or the recording contains too little sliding.
    """
    rate = channels.rate_Hz
    if swatch.texture is None:
        raise CaptureError(f"swatch {swatch.name!r} has no texture")
    stroke = sliding(channels, states)
    texture = swatch.texture.resampled(rate)
    search = search_order(stroke.acceleration_m_s2, rate, texture.warp)
    frequency, density = spectral.spectrum(stroke.acceleration_m_s2, rate)
    expected = _expected(texture, stroke, frequency)
    band_dB = 10.0 * np.log10(spectral.band_power(expected, frequency) / spectral.band_power(density, frequency))
    held_out, reason = None, ""
    try:
        held_out = _hold_out(swatch, stroke, search)
    except CaptureError as error:
        reason = str(error)
    return Comparison(search, band_dB, held_out, reason)


def sliding(channels: Streams, states: Segmentation) -> Streams:
    """All runs of sliding of a recording, concatenated, without short ones.

    Raises:
        CaptureError: the total time is too short.
    """
    kept = np.zeros(len(channels.acceleration_m_s2), dtype=bool)
    for start, end in states.runs(InteractionState.SLIDING):
        kept[start:end] = end - start >= RUN_S * channels.rate_Hz
    if np.count_nonzero(kept) < DURATION_MIN_S * channels.rate_Hz:
        raise CaptureError(f"the tool slides for less than {DURATION_MIN_S:g} s: record longer strokes")
    return part_of(channels, kept)


def spectrum_along(texture: Texture, force_N: Array, speed_m_s: Array) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz] and expected power spectral density (k,) [(m/s²)²/Hz] of a texture along a stroke.

    This is the mean spectrum of the models, at intervals of `BLOCK_S`, at the frequencies of `spectral.spectrum`.
    """
    step = max(1, round(BLOCK_S * texture.rate_Hz))
    force, speed = force_N[step // 2 :: step], speed_m_s[step // 2 :: step]
    frequency = np.asarray(np.fft.rfftfreq(round(spectral.WINDOW_S * texture.rate_Hz), 1.0 / texture.rate_Hz))
    total = np.zeros(len(frequency))
    for part in (slice(i, i + 256) for i in range(0, len(force), 256)):  # limits the memory: 6000 models per minute
        total += texture.density(force[part], speed[part], frequency_Hz=frequency).sum(axis=0)
    return frequency, total / len(force)


def _expected(texture: Texture, stroke: Streams, frequency_Hz: Array) -> Array:
    """`spectrum_along` a stroke at other frequencies (k,), with the high-pass of recordings."""
    expected = np.interp(frequency_Hz, *spectrum_along(texture, stroke.force_N, stroke.speed_m_s))
    return np.asarray(expected * kept_share(frequency_Hz))


def _hold_out(swatch: Swatch, channels: Streams, search: OrderSearch) -> HeldOut:
    """Fits the first half with the options of the swatch, and compares it with the second half."""
    assert swatch.texture is not None
    rate, middle, order = channels.rate_Hz, len(channels.acceleration_m_s2) // 2, swatch.texture.order
    first, second = (part_of(channels, half) for half in (slice(middle), slice(middle, None)))
    options = FitOptions(order=order, domain="plain" if swatch.texture.warp == 0.0 else "warped")
    if search.noise is not None and search.chosen == order:  # the order is sufficient only with sensor noise
        options = replace(options, order="auto")
    half = fit_swatch(SurfaceRecording(rate, first.acceleration_m_s2, first.force_N, first.speed_m_s), options)
    if half.texture is None:
        raise CaptureError(f"no texture in the first half: {half.absent.get('texture', 'too little sliding')}")
    (frequency, fitted), (_, held_out) = (spectral.spectrum(part.acceleration_m_s2, rate) for part in (first, second))
    model = _expected(half.texture, second, frequency)
    distance_dB, floor_dB = (spectral.log_spectral_distance(one, held_out, frequency) for one in (model, fitted))
    band, fitted_band, own_band = (spectral.band_power(one, frequency) for one in (model, fitted, held_out))
    made = [synthesize(half, second.force_N, second.speed_m_s, seed=seed) for seed in range(REPETITIONS)]
    recorded_depth, fitted_depth = (spectral.modulation_depth(part.acceleration_m_s2, rate) for part in (second, first))
    model_depth = float(np.mean([spectral.modulation_depth(y, rate) for y in made]))
    return HeldOut(
        frequency,
        fitted,
        held_out,
        model,
        distance_dB,
        floor_dB,
        level_dB=float(10.0 * np.log10(band.sum() / own_band.sum())),
        halves_dB=float(10.0 * np.log10(fitted_band.sum() / own_band.sum())),
        band_dB=10.0 * np.log10(band / own_band),
        halves_band_dB=10.0 * np.log10(fitted_band / own_band),
        modulation=(recorded_depth, model_depth, fitted_depth),
        correlated=_correlated(channels.acceleration_m_s2, rate),
    )


def _correlated(signal: Array, rate_Hz: float) -> tuple[int, int]:
    """`correlated_lags` of a signal, and the most of stationary signals of its length with the model of its half."""
    found, a = correlated_lags(signal, rate_Hz)
    noise = (np.random.default_rng(seed).standard_normal(len(signal)) for seed in range(REPETITIONS))
    return found, max(correlated_lags(lfilter([1.0], a, e), rate_Hz)[0] for e in noise)


def correlated_lags(signal: Array, rate_Hz: float) -> tuple[int, Array]:
    """Lags, of the first `LAGS`, at which the second half of a signal is predictable, and the predictor (p + 1,).

    The AR model of the first half filters the second half. White noise has 95 % of its autocorrelations within
    ±1.96/√n (Box & Jenkins 1970). More are outside because the first half determines the model with an error, and
    because the halves differ.
    """
    middle, order = len(signal) // 2, min(WHITE_ORDER, len(signal) // 16)
    a = solve(autocorrelation(tapered(signal[:middle], rate_Hz), order))
    residual = lfilter(a, [1.0], signal[middle:])[order:]
    r = autocorrelation(residual, LAGS)
    return int(np.count_nonzero(np.abs(r[1:]) > 1.96 / np.sqrt(len(residual)) * r[0])), a
