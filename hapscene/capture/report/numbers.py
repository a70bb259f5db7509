"""The figures of a report: a swatch's texture beside a recording, and a model of one half beside the other half."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hapscene.capture.fit import distance as metric
from hapscene.capture.fit.distance import Liveliness
from hapscene.capture.fit.order import OrderSearch, search_order
from hapscene.capture.fit.segment import InteractionState, Segmentation
from hapscene.capture.fit.swatch import FitOptions, fit_swatch
from hapscene.capture.fit.synthesis import synthesize
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import DURATION_MIN_S, Array, Streams, kept_share, part_of
from hapscene.errors import CaptureError
from hapscene.perception import BAND_DB
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

__all__ = ["FELT_DB", "HeldOut", "Judgement", "judge", "sliding", "spectrum_along"]

BLOCK_S: Final = 0.01
"""Time for which one filter is kept where a model is followed along a recording [s], as in `synthesize`."""

STRETCH_S: Final = 0.1
"""Shortest stretch of sliding that is judged [s]: a window of its spectrum."""

PLAYS: Final = 8
"""Repetitions of the synthesis from which the model's amplitude modulation is averaged [count]."""

FELT_DB: Final = BAND_DB
"""Difference of level, also in one band, that is felt [dB]."""


@dataclass(frozen=True)
class HeldOut:
    """A model of the first half of a recording, judged by the second half.

    Attributes:
        frequency_Hz: (k,) frequencies of the spectra below.
        fitted: (k,) power spectral density of the half that was fitted [(m/s²)²/Hz].
        held_out: (k,) of the other half.
        model: (k,) of the model along the force and speed of the other half, high-passed as the recording is.
        distance_dB: log-spectral distance of model and held-out half, of shape.
        floor_dB: of the two real halves.
        level_dB: power of the model over that of the held-out half, 20 to 1000 Hz.
        halves_dB: power of the half that was fitted over that of the held-out half.
        band_dB: (12,) level of the model over the held-out half in each band of `BAND_EDGES_HZ`.
        halves_band_dB: (12,) of the half that was fitted.
        centroid_ratio: spectral centroid of the model over that of the held-out half.
        halves_centroid_ratio: of the half that was fitted.
        goodness_of_fit: of model and held-out half.
        lively: amplitude modulation of the held-out half, of the model (mean), and of the half that was fitted.
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
    centroid_ratio: float
    halves_centroid_ratio: float
    goodness_of_fit: float
    lively: tuple[Liveliness, ...]


@dataclass(frozen=True)
class Judgement:
    """A swatch's texture beside a recording.

    Attributes:
        search: the results of each order.
        band_dB: (12,) level of the swatch over the recording in bands.
        spectrogram_error: of the swatch played along the recording [1].
        held_out: a model of one half judged by the other, or None.
        why_not: the reason for None.
    """

    search: OrderSearch
    band_dB: Array
    spectrogram_error: float
    held_out: HeldOut | None
    why_not: str = ""


def judge(swatch: Swatch, channels: Streams, states: Segmentation) -> Judgement:
    """Judge the texture of `swatch` by a cleaned recording and its states; only sliding counts.

    Raises:
        CaptureError: the swatch has no texture, or the recording is too short.
    """
    rate = channels.rate_Hz
    if swatch.texture is None:
        raise CaptureError(f"swatch {swatch.name!r} has no texture: there is nothing to judge")
    stroke = sliding(channels, states)
    synthetic = synthesize(swatch, channels.force_N, channels.speed_m_s, rate_Hz=rate)
    texture = swatch.texture.resampled(rate)
    search = search_order(stroke.acceleration_m_s2, rate, texture.warp)
    frequency, density = metric.spectrum(stroke.acceleration_m_s2, rate)
    expected = _expected(texture, stroke, frequency)
    band_dB = 10.0 * np.log10(metric.band_power(expected, frequency) / metric.band_power(density, frequency))
    held_out, why_not = None, ""
    try:
        held_out = _hold_out(swatch, stroke, search)
    except CaptureError as error:
        why_not = str(error)
    apart = metric.spectrogram_error(channels.acceleration_m_s2, synthetic, rate)
    return Judgement(search, band_dB, apart, held_out, why_not)


def sliding(channels: Streams, states: Segmentation) -> Streams:
    """The stretches of a recording in which the tool slides, one behind the other; short ones are left out.

    Raises:
        CaptureError: they are too short in all.
    """
    kept = np.zeros(len(channels.acceleration_m_s2), dtype=bool)
    for start, end in states.runs(InteractionState.SLIDING):
        kept[start:end] = end - start >= STRETCH_S * channels.rate_Hz
    if np.count_nonzero(kept) < DURATION_MIN_S * channels.rate_Hz:
        raise CaptureError(f"the tool slides for less than {DURATION_MIN_S:g} s: too short to judge a texture by")
    return part_of(channels, kept)


def spectrum_along(texture: Texture, force_N: Array, speed_m_s: Array) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz] and the expected power spectral density (k,) [(m/s²)²/Hz] of a texture along a stroke.

    The mean of its models' spectra, one each `BLOCK_S`, at the frequencies of `metric.spectrum`.
    """
    step = max(1, round(BLOCK_S * texture.rate_Hz))
    force, speed = force_N[step // 2 :: step], speed_m_s[step // 2 :: step]
    frequency = np.asarray(np.fft.rfftfreq(round(metric.WINDOW_S * texture.rate_Hz), 1.0 / texture.rate_Hz))
    total = np.zeros(len(frequency))
    for part in (slice(i, i + 256) for i in range(0, len(force), 256)):  # a minute's stroke has 6000 filters
        total += texture.density(force[part], speed[part], frequency_Hz=frequency).sum(axis=0)
    return frequency, total / len(force)


def _expected(texture: Texture, stroke: Streams, frequency_Hz: Array) -> Array:
    """`spectrum_along` a stroke at other frequencies (k,), high-passed as recordings are."""
    expected = np.interp(frequency_Hz, *spectrum_along(texture, stroke.force_N, stroke.speed_m_s))
    return np.asarray(expected * kept_share(frequency_Hz))


def _hold_out(swatch: Swatch, channels: Streams, search: OrderSearch) -> HeldOut:
    """Fit the first half, over noise where the whole needs it, and judge by the second."""
    assert swatch.texture is not None  # `judge` has refused it already
    rate, middle, order = channels.rate_Hz, len(channels.acceleration_m_s2) // 2, swatch.texture.order
    first, second = (part_of(channels, half) for half in (slice(middle), slice(middle, None)))
    options = FitOptions(order=order, domain="plain" if swatch.texture.warp == 0.0 else "warped")
    if search.noise is not None and search.chosen == order:
        options = replace(options, order="auto")
    half = fit_swatch(SurfaceRecording(rate, first.acceleration_m_s2, first.force_N, first.speed_m_s), options)
    if half.texture is None:
        raise CaptureError(f"the first half holds no texture: {half.absent.get('texture', 'it slides too little')}")
    (frequency, fitted), (_, held_out) = (metric.spectrum(half.acceleration_m_s2, rate) for half in (first, second))
    model = _expected(half.texture, second, frequency)
    distance_dB, floor_dB = (metric.log_spectral_distance(one, held_out, frequency) for one in (model, fitted))
    band, fitted_band, own_band = (metric.band_power(one, frequency) for one in (model, fitted, held_out))
    centroid, fitted_centroid, own_centroid = (
        metric.spectral_centroid_Hz(one, frequency) for one in (model, fitted, held_out)
    )
    played = np.array([synthesize(half, second.force_N, second.speed_m_s, seed=seed) for seed in range(PLAYS)])
    signals = second.acceleration_m_s2, played, first.acceleration_m_s2
    lively = [np.mean([metric.liveliness(y, rate) for y in np.atleast_2d(of)], axis=0) for of in signals]
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
        centroid_ratio=centroid / own_centroid,
        halves_centroid_ratio=fitted_centroid / own_centroid,
        goodness_of_fit=metric.goodness_of_fit(model, held_out, frequency),
        lively=tuple(Liveliness(*one) for one in lively),
    )
