"""What a recording says about a swatch, as numbers: what the report shows and tells."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import scipy

from hapscene.capture import metric
from hapscene.capture.io.streams import DURATION_MIN_S, Array, Streams, kept_share, part_of
from hapscene.capture.metric import Liveliness, LjungBox, Similarity, st_sim
from hapscene.capture.order_search import OrderSearch, search_order
from hapscene.capture.segment import InteractionState, Segmentation
from hapscene.capture.swatch_fit import fit
from hapscene.capture.synthesis import synthesize
from hapscene.errors import CaptureError
from hapscene.perception import BAND_DB
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

BLOCK_S: Final = 0.01
"""How long one filter is kept where a model is followed along a recording [s], as in `synthesize`."""

STRETCH_S: Final = 0.1
"""Shortest stretch of sliding that is judged [s]: a window of its spectrum."""

MOVING: Final = 0.02
"""Share of the largest force and speed below which the tool does not count as sliding [1]."""

PLAYS: Final = 8
"""How often the model of a half is played to see how lively it is [count]: one time is lively by chance."""

FELT_DB: Final = BAND_DB
"""Difference of level, also in one band, that is felt [dB]."""


@dataclass(frozen=True)
class HeldOut:
    """A model of the first half of a recording, judged by the second half.

    Attributes:
        frequency_Hz: (k,) frequencies of the spectra below.
        fitted: (k,) power spectral density of the half that was fitted [(m/s²)²/Hz].
        held_out: (k,) that of the other half.
        model: (k,) what the model gives along the force and speed of the other half, as its high-pass would leave it.
        distance_dB: log-spectral distance of model and held-out half, of shape.
        floor_dB: the same between the two real halves.
        level_dB: power of the model over that of the held-out half, 20 to 1000 Hz.
        halves_dB: power of the half that was fitted over that of the held-out half.
        band_dB: (12,) that of the model in each band of `metric.BAND_EDGES_HZ`.
        halves_band_dB: (12,) that of the half that was fitted.
        centroid_ratio: spectral centroid of the model over that of the held-out half.
        goodness_of_fit: of the two.
        residual_ratio: power that the model leaves of the held-out half.
        residual: (n,) what it leaves, each sample over the model's own standard deviation there, scaled to variance 1.
        whiteness: whether that is white.
        kurtosis: excess kurtosis of it.
        rate_Hz: sample rate of the two below.
        recorded: (n,) the held-out half [m/s²].
        played: (`PLAYS`, n) the model played along it, each time with other noise [m/s²].
        lively: how lively the held-out half, the model (mean) and the half that was fitted are.
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
    goodness_of_fit: float
    residual_ratio: float
    residual: Array
    whiteness: LjungBox
    kurtosis: float
    rate_Hz: float
    recorded: Array
    played: Array
    lively: tuple[Liveliness, Liveliness, Liveliness]


@dataclass(frozen=True)
class Judgement:
    """A swatch's texture beside a recording.

    Attributes:
        channels: the cleaned recording, of which only what slides is held against the texture.
        search: what was found for each order.
        synthetic: (n,) the swatch played along the recording's force and speed [m/s²].
        band_dB: (b,) level of the swatch over the recording in bands.
        spectrogram_error: of `synthetic` [1].
        similarity: ST-SIM of `synthetic`.
        held_out: how a model of one half does on the other, or None: then `why_not` says why.
        why_not: the reason.
    """

    channels: Streams
    search: OrderSearch
    synthetic: Array
    band_dB: Array
    spectrogram_error: float
    similarity: Similarity
    held_out: HeldOut | None
    why_not: str = ""


def judge(swatch: Swatch, channels: Streams, states: Segmentation) -> Judgement:
    """Judges the texture of `swatch` by a cleaned recording and its states.

    Raises:
        CaptureError: the swatch has no texture, or the recording is too short.
    """
    acceleration, rate = channels.acceleration_m_s2, channels.rate_Hz
    if swatch.texture is None:
        raise CaptureError(f"swatch {swatch.name!r} has no texture: there is nothing to judge")
    stroke = sliding(channels, states)
    synthetic = synthesize(swatch, channels.force_N, channels.speed_m_s, rate_Hz=rate)
    texture = swatch.texture.resampled(rate)
    search = search_order(stroke.acceleration_m_s2, rate, texture.warp)
    frequency, density = metric.spectrum(stroke.acceleration_m_s2, rate)
    expected = np.interp(frequency, *_spectrum_of(texture, stroke)) * kept_share(frequency)
    band_dB = 10.0 * np.log10(metric.band_power(expected, frequency) / metric.band_power(density, frequency))
    held_out, why_not = None, ""
    try:
        held_out = _hold_out(swatch, stroke, search)
    except CaptureError as error:
        why_not = str(error)
    apart, similarity = metric.spectrogram_error(acceleration, synthetic, rate), st_sim(synthetic, acceleration, rate)
    return Judgement(channels, search, synthetic, band_dB, apart, similarity, held_out, why_not)


def _spectrum_of(texture: Texture, stroke: Streams) -> tuple[Array, Array]:
    """`spectrum_along` a recording's stroke."""
    return spectrum_along(texture, stroke.force_N, stroke.speed_m_s)


def spectrum_along(texture: Texture, force_N: Array, speed_m_s: Array) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz] and power spectral density (k,) [(m/s²)²/Hz] that a texture has along a stroke, expected.

    The mean of its models' spectra, one each `BLOCK_S`, at the frequencies of `metric.spectrum`.
    """
    step = max(1, round(BLOCK_S * texture.rate_Hz))
    force, speed = force_N[step // 2 :: step], speed_m_s[step // 2 :: step]
    frequency = np.asarray(np.fft.rfftfreq(round(metric.WINDOW_S * texture.rate_Hz), 1.0 / texture.rate_Hz))
    total = np.zeros(len(frequency))
    for part in (slice(i, i + 256) for i in range(0, len(force), 256)):  # a minute's stroke has 6000 filters
        total += texture.density(force[part], speed[part], frequency_Hz=frequency).sum(axis=0)
    return frequency, total / len(force)


def residual_along(texture: Texture, channels: Streams) -> tuple[Array, Array, Array]:
    """What a texture leaves of a recording: residual (n,) [m/s²], the texture's standard deviation for it (n,), and
    the acceleration (n,) [m/s²] of the same samples; those in which the tool does not slide are left out."""
    order, step = texture.order, max(1, round(BLOCK_S * texture.rate_Hz))
    y, force, speed = channels.acceleration_m_s2, channels.force_N, channels.speed_m_s
    start = np.arange(order, len(y) - step + 1, step)
    middle = start + step // 2
    sliding = (force[middle] > MOVING * force.max()) & (speed[middle] > MOVING * speed.max())
    a, variance = texture.models(force[middle], speed[middle])
    kept = np.flatnonzero(sliding & (variance > 0.0))
    if not len(kept):
        raise CaptureError("the texture is silent all along the recording: it leaves all of it")
    at = start[kept][:, None] + np.arange(step)
    left, past = np.zeros(at.shape), y
    for weight in a[kept].T:  # of the signal, then of what the allpass D, for plain models the delay, makes of it
        left += weight[:, None] * past[at]
        past = scipy.signal.lfilter([-texture.warp, 1.0], [1.0, -texture.warp], past)
    left /= (first := a[kept] @ (-texture.warp) ** np.arange(order + 1.0))[:, None]  # what is new in each sample
    return left.ravel(), np.repeat(np.sqrt(variance[kept]) / first, step), y[at].ravel()


def _hold_out(swatch: Swatch, channels: Streams, search: OrderSearch) -> HeldOut:
    """Fits the first half, over noise where the whole needs it, and judges by the second."""
    assert swatch.texture is not None  # `judge` has refused it already
    rate, middle = channels.rate_Hz, len(channels.acceleration_m_s2) // 2
    first, second = (part_of(channels, half) for half in (slice(middle), slice(middle, None)))
    order = swatch.texture.order
    chosen: int | Literal["auto"] = "auto" if search.noise is not None and search.chosen == order else order
    domain = "plain" if swatch.texture.warp == 0.0 else "warped"
    y, force, speed = first.acceleration_m_s2, first.force_N, first.speed_m_s
    half = fit(y, rate, force_N=force, speed_m_s=speed, order=chosen, domain=domain)
    texture = half.texture
    if texture is None:
        raise CaptureError(f"the first half holds no texture: {half.absent.get('texture', 'it slides too little')}")
    (frequency, fitted), (_, held_out) = (metric.spectrum(half.acceleration_m_s2, rate) for half in (first, second))
    grid, expected = _spectrum_of(texture, second)
    model = np.interp(frequency, grid, expected) * kept_share(frequency)
    distance_dB, floor_dB = (metric.log_spectral_distance(one, held_out, frequency) for one in (model, fitted))
    band, fitted_band, own_band = (metric.band_power(one, frequency) for one in (model, fitted, held_out))
    level_dB, halves_dB = (float(10.0 * np.log10(one.sum() / own_band.sum())) for one in (band, fitted_band))
    left, sigma, signal = residual_along(texture, second)
    residual = left / sigma
    residual = residual / residual.std()
    played = np.array([synthesize(half, second.force_N, second.speed_m_s, seed=seed) for seed in range(PLAYS)])
    signals = second.acceleration_m_s2, played, first.acceleration_m_s2
    lively = [np.mean([metric.liveliness(y, rate) for y in np.atleast_2d(of)], axis=0) for of in signals]
    spectra, apart_dB = (frequency, fitted, held_out, model), (distance_dB, floor_dB, level_dB, halves_dB)
    return HeldOut(
        *spectra,
        *apart_dB,
        10.0 * np.log10(band / own_band),
        10.0 * np.log10(fitted_band / own_band),
        metric.spectral_centroid_Hz(model, frequency) / metric.spectral_centroid_Hz(held_out, frequency),
        metric.goodness_of_fit(model, held_out, frequency),
        float(np.mean(left**2) / np.mean(signal**2)),
        residual,
        metric.ljung_box(residual),
        metric.excess_kurtosis(residual),
        rate,
        *signals[:2],
        (Liveliness(*lively[0]), Liveliness(*lively[1]), Liveliness(*lively[2])),
    )


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
