"""Taps of a recording: a decaying sinusoid fitted to each impact, and the transient itself, over approach speed.

    a(t) = A exp(−βt) sin(2πft) from t = t0 (Okamura, Cutkosky & Dennerlein 2001)

The recording was high-passed at 20 Hz, without delay. That bends a tap: so the model is passed through the same filter
before it is compared, and A, β, f are those of the tap itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hapscene.capture.segment import InteractionState, Run, Segmentation
from hapscene.capture.streams import Array, Streams, high_pass_gain
from hapscene.surface.taps import TAP_ROWS, Taps

WAVE_S: Final = 0.1
"""Length of a stored transient [s]: as those of the Penn Haptic Texture Toolkit."""

LEAD_S: Final = 0.03
"""What is compared before an impact's onset [s]: the ripple of the high-pass tells where it began."""

ONSET_OFF_S: Final = 0.012
"""How far from where the segmentation puts it an impact's onset is searched [s]."""

FADE_S: Final = 0.0005, 0.02
"""Fades at the start and the end of a stored transient [s]."""

EXPLAINED_MIN: Final = 0.5
"""Least share of an impact's power that its sinusoid explains [1]; of less it is no measurement."""

SPEED_RATIO: Final = 1.15
"""Approach speeds up to this ratio are taken as one [1]: at 20 dB, taps at one speed were measured within ±4 %,
slow ones (50 mm/s) within ±6 %. Smaller tears repeated taps apart, larger pools taps that differ."""

SPEED_S: Final = (0.025, 0.006)
"""From when to when before the onset the approach speed is measured [s]; later the low-pass mixes in the contact."""

ASSUMED_APPROACH_M_S: Final = 0.1
"""Approach speed of taps whose own was not recorded [m/s]: that of a finger that drums."""

FITTED_MAX: Final = 40
"""Most impacts that are fitted [count]; of more, as many spread over the approach speeds."""

OUTLIER: Final = 4.0
"""Standard deviations from the median of its group at which one tap's number is left out [1]."""

NORMAL_95: Final = 1.96
"""Half-width of a 95 % interval, in standard errors [1]."""


@dataclass(frozen=True)
class MeasuredTap:
    """One impact: its sinusoid with standard errors, and its transient.

    Attributes:
        approach_m_s: speed of approach, NaN where it was not recorded.
        value: (3,) amplitude [m/s²], frequency [Hz], decay [1/s].
        error: (3,) their standard errors.
        explained: share of the power that the sinusoid explains.
        wave_m_s2: (m,) the transient from its onset, `WAVE_S` long.
    """

    approach_m_s: float
    value: Array
    error: Array
    explained: float
    wave_m_s2: Array


@dataclass(frozen=True)
class TapFit:
    """Taps over approach speed, or why there are none."""

    taps: Taps | None
    intervals: dict[str, tuple[float, float]]
    absent: dict[str, str]


def fit_taps(parts: Sequence[tuple[Streams, Segmentation]]) -> TapFit:
    """The taps of recordings of one surface, at one rate.

    Taps at approach speeds within `SPEED_RATIO` become one: the mean of each number weighted by its confidence, and the
    mean transient. The interval of each number is that of this mean, widened where single taps scatter more than their
    own errors say; its key is "taps.frequency_Hz[0]" for the first speed.
    """
    impacts = [(channels, run) for channels, states in parts for run in states.runs(InteractionState.TAP)]
    if not impacts:
        return TapFit(None, {}, {"taps": "no tap was found in the recording"})
    speeds = np.array([_approach(channels, run[0]) for channels, run in impacts])
    if len(impacts) > FITTED_MAX:
        order = np.argsort(speeds)  # unknown speeds stand last
        chosen = order[np.linspace(0, len(order) - 1, FITTED_MAX).round().astype(int)]
        impacts, speeds = [impacts[i] for i in chosen], speeds[chosen]
    measured = [measure_tap(channels, run, v) for (channels, run), v in zip(impacts, speeds, strict=True)]
    good = [tap for tap in measured if tap is not None and tap.explained >= EXPLAINED_MIN]
    if not good:
        reason = f"none of {len(impacts)} impacts is a decaying sinusoid for {100 * EXPLAINED_MIN:g} % of its power"
        return TapFit(None, {}, {"taps": reason})
    known = [tap for tap in good if np.isfinite(tap.approach_m_s)]
    assumed = f"the recording does not say how fast the tool came; {ASSUMED_APPROACH_M_S:g} m/s assumed"
    return _pooled(known or good, parts[0][0].rate_Hz, {} if known else {"taps.approach_m_s": assumed})


def _pooled(taps: list[MeasuredTap], rate_Hz: float, absent: dict[str, str]) -> TapFit:
    """One row for each group of like approach speeds."""
    taps = sorted(taps, key=lambda tap: tap.approach_m_s)
    groups: list[list[MeasuredTap]] = [[taps[0]]]
    for tap in taps[1:]:
        if tap.approach_m_s > SPEED_RATIO * groups[-1][0].approach_m_s:  # unknown speeds are one group
            groups.append([])
        groups[-1].append(tap)
    rows, speeds, intervals = [], [], {}
    for i, group in enumerate(groups):
        mean, error = _mean(np.array([tap.value for tap in group]), np.array([tap.error for tap in group]))
        rows.append(mean)
        speed = float(np.mean([tap.approach_m_s for tap in group]))
        speeds.append(speed if np.isfinite(speed) else ASSUMED_APPROACH_M_S)
        for name, value, half in zip(TAP_ROWS[1:], mean, NORMAL_95 * error, strict=True):
            intervals[f"taps.{name}[{i}]"] = (max(0.0, float(value - half)), float(value + half))
    amplitude, frequency, decay = np.array(rows).T
    waves = np.stack([np.mean([tap.wave_m_s2 for tap in group], axis=0) for group in groups])
    return TapFit(Taps(np.array(speeds), amplitude, frequency, decay, waves, rate_Hz), intervals, absent)


def _mean(values: Array, errors: Array) -> tuple[Array, Array]:
    """Mean (3,) of values (m, 3) and its standard error, without outliers.

    A value's variance is that of its own error and that of the scatter between taps (by the median); values more than
    `OUTLIER` of such deviations from the median are left out.
    """
    if len(values) == 1:
        return values[0], errors[0]
    middle = np.median(values, axis=0)
    scatter = 1.4826 * np.median(np.abs(values - middle), axis=0)
    variance = errors**2 + scatter**2 + (1e-6 * np.abs(middle) + 1e-12) ** 2
    weight = np.where((values - middle) ** 2 <= OUTLIER**2 * variance, 1.0 / variance, 0.0)
    total = weight.sum(axis=0)
    return (weight * values).sum(axis=0) / total, 1.0 / np.sqrt(total)


def measure_tap(channels: Streams, run: Run, approach_m_s: float) -> MeasuredTap | None:
    """The sinusoid nearest to the impact whose ringing spans `run`; None where there is nothing to fit."""
    from scipy.optimize import least_squares

    rate = channels.rate_Hz
    signal = channels.acceleration_m_s2
    lead = min(round(LEAD_S * rate), run[0])
    first, last = run[0] - lead, min(run[1] + round(0.01 * rate), len(signal))
    data = signal[first:last]
    scale = float(np.abs(data).max())
    if last - run[0] < 8 or scale == 0.0:
        return None
    size = 1 << (len(data) + round(0.2 * rate)).bit_length()  # the filter's ripple has room to fade
    gain = high_pass_gain(size, rate)
    t_s = np.arange(size) / rate - lead / rate

    def played(frequency: float, decay: Array, onset_s: Array) -> Array:
        since = np.maximum(t_s - onset_s[:, None], 0.0)
        model = np.exp(-decay[:, None] * since) * np.sin(2.0 * np.pi * frequency * since)
        return np.asarray(np.fft.irfft(gain * np.fft.rfft(model, axis=1), size, axis=1)[:, : len(data)])

    def off(p: Array) -> Array:
        return np.asarray(p[0] * played(p[1], p[2:3], p[3:4])[0] - data / scale)

    # Onsets half a period off fit nearly as well: of all of them the best begins the search.
    frequency = float(np.clip(_loudest(data[lead:], rate), 12.0, 0.4 * rate))
    step_s = min(5e-4, 0.125 / frequency)
    onsets_s = np.arange(-ONSET_OFF_S, ONSET_OFF_S, step_s)
    decay, onset_s = (grid.ravel() for grid in np.meshgrid([30.0, 100.0, 300.0], onsets_s))
    models = played(frequency, decay, onset_s)
    match, power = models @ data / scale, np.maximum((models**2).sum(axis=1), 1e-12)
    best = int(np.argmax(match**2 / power))
    begin: Any = [match[best] / power[best], frequency, decay[best], onset_s[best]]
    low, high = np.array([-50.0, 10.0, 1.0, -0.02]), np.array([50.0, 0.45 * rate, 0.25 * rate, 0.02])
    begin, scales = np.clip(begin, low, high), [1.0, 0.1 * frequency, 50.0, 0.002]
    fitted = least_squares(off, begin, bounds=(low, high), x_scale=scales, max_nfev=60)
    amplitude, frequency, ring_1_s, late_s = (float(number) for number in fitted.x)
    error = _errors(np.asarray(fitted.jac), np.asarray(fitted.fun)) * np.array([scale, 1.0, 1.0, 1.0])
    explained = 1.0 - 2.0 * float(fitted.cost) * scale**2 / float((data**2).sum())
    value = np.array([scale * abs(amplitude), frequency, ring_1_s])
    return MeasuredTap(approach_m_s, value, error[:3], explained, _wave(signal, run[0] + round(late_s * rate), rate))


def _errors(jacobian: Array, residual: Array) -> Array:
    """Standard errors of a fit's numbers; the residual is no white noise, which its lag-1 correlation corrects for."""
    power = float((residual**2).sum())
    if power == 0.0:
        return np.zeros(jacobian.shape[1])
    rho = min(max(float((residual[1:] * residual[:-1]).sum()) / power, 0.0), 0.95)
    variance = power / max(1, len(residual) - jacobian.shape[1]) * (1.0 + rho) / (1.0 - rho)
    return np.asarray(np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(jacobian.T @ jacobian)), 0.0)))


def _loudest(data: Array, rate: float) -> float:
    """Frequency [Hz] of the strongest line."""
    size = 1 << (4 * len(data)).bit_length()
    density = np.abs(np.fft.rfft(data, size))
    return float(max(1, int(density.argmax()))) * rate / size


def _approach(channels: Streams, onset: int) -> float:
    """Speed [m/s] at which the tool came: the slope of its depth, else its speed; NaN where neither was recorded."""
    first, last = (max(0, onset - round(s * channels.rate_Hz)) for s in SPEED_S)
    if last - first < 3:
        return float("nan")
    if channels.depth_m is not None:
        slope = np.polyfit(np.arange(last - first) / channels.rate_Hz, channels.depth_m[first:last], 1)[0]
        return float(slope) if slope > 0.0 else float("nan")
    speed = float(np.median(channels.speed_m_s[first:last]))
    told = np.ptp(channels.speed_m_s) > 0.0 and speed > 0.1 * float(channels.speed_m_s.max())
    return speed if told else float("nan")


def _wave(signal: Array, onset: int, rate: float) -> Array:
    """The transient from its onset, faded at both ends."""
    count = round(WAVE_S * rate)
    wave = np.zeros(count)
    onset = max(onset, 0)
    part = signal[onset : onset + count]
    wave[: len(part)] = part
    rise, fall = (max(1, round(s * rate)) for s in FADE_S)
    wave[:rise] *= (np.arange(rise) + 0.5) / rise
    wave[-fall:] *= 0.5 + 0.5 * np.cos(np.pi * (np.arange(fall) + 0.5) / fall)
    return wave
