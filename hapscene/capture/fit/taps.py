"""Fits taps: a decaying sinusoid for each impact, and the recorded transient, over approach speed.

    a(t) = A exp(−βt) sin(2πft) from t = t0 (Okamura, Cutkosky & Dennerlein 2001)

The recording was high-passed at 20 Hz without delay, which distorts a tap. The model is passed through the same filter
before the comparison, so A, β and f are those of the undistorted tap.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy

from hapscene.capture.fit.segment import InteractionState, Run, SegmentedRecording, onset
from hapscene.capture.io.streams import Array, Streams, high_pass_gain
from hapscene.surface.taps import TAP_ROWS, Taps

__all__ = [
    "EXPLAINED_MIN",
    "FITTED_MAX",
    "NORMAL_95",
    "MeasuredTap",
    "fit_taps",
    "measure_tap",
    "pooled_taps",
    "weighted_mean",
]

WAVE_S: Final = 0.1
"""Length of a stored transient [s], as in the Penn Haptic Texture Toolkit."""

LEAD_S: Final = 0.03
"""Time before the onset of an impact that is included in the fit [s]; the pre-ripple of the high-pass helps to find
it."""

ONSET_OFF_S: Final = 0.012
"""Range about the segmentation's estimate in which the onset is searched [s]."""

FADE_S: Final = 0.0005, 0.02
"""Lengths of the fades at the start and the end of a stored transient [s]."""

EXPLAINED_MIN: Final = 0.5
"""Smallest fraction of the power of an impact that the sinusoid must explain [1]; otherwise it is discarded."""

RING_MIN: Final = 0.1
"""Smallest fraction of the power of an impact in the ringing after the contact at which only the ringing is fitted [1].
With less, the contact itself dominates."""

CONTACTS_S: Final = (0.0015, 0.003, 0.006, 0.012)
"""Initial values of the contact time of a bounce [s]."""

CONTACT_WAVES: Final = 5
"""Number of odd quarter-waves that model the acceleration during a contact, which differs from the free ringing."""

CHOSEN: Final = 1.3
"""Factor on the standard errors of ringing after a contact [1], since the end of the contact is fitted to the same
data. On simulated bounces the 95 % intervals of the decay contain the true value in 93 to 99 % of the cases, without
the factor in 83 to 94 %."""

SEARCHES: Final = 3
"""Number of initial values from which ringing after a contact is fitted; one alone may find a local minimum."""

SPEED_RATIO: Final = 1.15
"""Largest ratio of approach speeds that are pooled [1]. At an SNR of 20 dB, speeds are measured to ±4 %, slow ones
(50 mm/s) to ±6 %. A smaller ratio would separate repeated taps, a larger one pool different taps."""

SPEED_S: Final = (0.025, 0.006)
"""Start and end, before the onset, of the time in which the approach speed is measured [s]."""

ASSUMED_APPROACH_M_S: Final = 0.1
"""Assumed approach speed of taps without recorded speed [m/s]: the speed of drumming fingers."""

FITTED_MAX: Final = 40
"""Largest number of impacts that are fitted, evenly selected over approach speed."""

OUTLIER: Final = 4.0
"""Largest deviation from the median of a group, in standard deviations [1]; other values are omitted."""

NORMAL_95: Final = 1.96
"""Half-width of a 95 % interval in standard errors [1]."""


@dataclass(frozen=True)
class MeasuredTap:
    """Fit of one impact.

    Attributes:
        approach_m_s: approach speed; NaN if it was not recorded.
        value: (3,) amplitude [m/s²], frequency [Hz], decay [1/s] of the sinusoid.
        error: (3,) standard errors of `value`.
        explained: fraction of the power that the sinusoid explains.
        wave_m_s2: (m,) recorded transient from its onset, `WAVE_S` long.
    """

    approach_m_s: float
    value: Array
    error: Array
    explained: float
    wave_m_s2: Array


@dataclass(frozen=True)
class TapFit:
    """Taps over approach speed with 95 % intervals, or the reason why there are no taps."""

    taps: Taps | None
    intervals: dict[str, tuple[float, float]]
    absent: dict[str, str]


def fit_taps(recordings: Sequence[SegmentedRecording]) -> TapFit:
    """Fits taps to recordings of one surface with equal sample rates.

    Taps at similar approach speeds (`SPEED_RATIO`) are pooled: the parameters by a mean weighted with their errors, the
    transients by a mean. The intervals of the means include the scatter between taps; their keys are
    "taps.frequency_Hz[0]" etc., with the index of the approach speed.
    """
    impacts = [(channels, run) for channels, states in recordings for run in states.runs(InteractionState.TAP)]
    if not impacts:
        return TapFit(None, {}, {"taps": "no tap was found in the recording"})
    speeds = np.array([_approach(channels, run[0]) for channels, run in impacts])
    if len(impacts) > FITTED_MAX:
        order = np.argsort(speeds)  # unknown speeds (NaN) are last
        chosen = order[np.linspace(0, len(order) - 1, FITTED_MAX).round().astype(int)]
        impacts, speeds = [impacts[i] for i in chosen], speeds[chosen]
    measured = [measure_tap(channels, run, v) for (channels, run), v in zip(impacts, speeds, strict=True)]
    good = [tap for tap in measured if tap is not None and tap.explained >= EXPLAINED_MIN]
    if not good:
        best = max((tap.explained for tap in measured if tap is not None), default=0.0)
        reason = (
            f"a decaying sinusoid explains at most {100 * max(0.0, best):.0f} % of the power of {len(impacts)} impacts "
            f"(expected {100 * EXPLAINED_MIN:g} %): record harder taps and hold the tool still"
        )
        return TapFit(None, {}, {"taps": reason})
    known = [tap for tap in good if np.isfinite(tap.approach_m_s)]
    assumed = f"the approach speed was not recorded; {ASSUMED_APPROACH_M_S:g} m/s is assumed"
    return pooled_taps(known or good, recordings[0][0].rate_Hz, {} if known else {"taps.approach_m_s": assumed})


def pooled_taps(taps: list[MeasuredTap], rate_Hz: float, absent: dict[str, str]) -> TapFit:
    """Pools taps with similar approach speeds."""
    taps = sorted(taps, key=lambda tap: tap.approach_m_s)
    groups: list[list[MeasuredTap]] = [[taps[0]]]
    for tap in taps[1:]:
        if tap.approach_m_s > SPEED_RATIO * groups[-1][0].approach_m_s:  # unknown speeds are one group
            groups.append([])
        groups[-1].append(tap)
    rows, speeds, intervals = [], [], {}
    for i, group in enumerate(groups):
        mean, error = weighted_mean(np.array([tap.value for tap in group]), np.array([tap.error for tap in group]))
        rows.append(mean)
        speed = float(np.mean([tap.approach_m_s for tap in group]))
        speeds.append(speed if np.isfinite(speed) else ASSUMED_APPROACH_M_S)
        for name, value, half in zip(TAP_ROWS[1:], mean, NORMAL_95 * error, strict=True):
            intervals[f"taps.{name}[{i}]"] = (max(0.0, float(value - half)), float(value + half))
    amplitude, frequency, decay = np.array(rows).T
    waves = np.stack([np.mean([tap.wave_m_s2 for tap in group], axis=0) for group in groups])
    return TapFit(Taps(np.array(speeds), amplitude, frequency, decay, waves, rate_Hz), intervals, absent)


def weighted_mean(values: Array, errors: Array) -> tuple[Array, Array]:
    """Weighted mean (3,) of values (m, 3) and its standard error, without outliers.

    The variance of a value is the sum of that of its error and that between taps (estimated from the median deviation).
    Values more than `OUTLIER` standard deviations from the median are omitted.
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
    """Fits a decaying sinusoid to the impact in `run`; None if the run is too short or without vibration.

    Three models are compared. The first is a sinusoid of phase 0. Damping in the contact changes the phase, so the
    second has a free phase; it is used if it is better by the Akaike criterion. A tool that bounces rings freely only
    after the contact, so the third is an acceleration during the contact followed by free ringing; it is used if it is
    better by the Schwarz criterion and the ringing is strong enough."""
    rate, signal = channels.rate_Hz, channels.acceleration_m_s2
    calm = signal[max(0, run[0] - round((LEAD_S + 0.05) * rate)) : max(0, run[0] - round(LEAD_S * rate))]
    quiet = float(np.sqrt(np.mean(calm**2))) if len(calm) else 0.0
    start = run[0] + onset(signal[run[0] : run[1]], quiet, rate)
    lead = min(round(LEAD_S * rate), start)
    first, last = start - lead, min(run[1] + round(0.01 * rate), len(signal))
    data = signal[first:last]
    scale = float(np.abs(data).max())
    if last - start < 8 or scale == 0.0:
        return None
    noise = len(data) * (quiet / scale) ** 2
    impact = _Impact(data / scale, lead, rate)
    plain = impact.sinusoid()
    power = float((impact.data**2).sum())

    def explained(fitted: _Fitted) -> float:
        return 1.0 - max(0.0, fitted.left - noise) / max(power - noise, 0.1 * power)

    found, count = plain, len(data)
    phased = impact.ring(plain, 0)
    if count * np.log(plain.left / phased.left) > 2.0:
        found = phased
    if found.left > 1.2 * noise + 1e-9 * power:
        ring = impact.ring(plain, CONTACT_WAVES)
        better = count * np.log(found.left / ring.left) > (CONTACT_WAVES + 1) * np.log(count)
        if ring.share >= RING_MIN and (better or explained(found) < EXPLAINED_MIN):
            found = ring
    scaled = np.array([scale, 1.0, 1.0])
    wave = _wave(signal, start + round(found.onset_s * rate), rate)
    return MeasuredTap(approach_m_s, found.value * scaled, found.error * scaled, explained(found), wave)


@dataclass(frozen=True)
class _Fitted:
    """Amplitude, frequency and decay (3,) with standard errors, onset, residual power, fraction of the ringing."""

    value: Array
    error: Array
    onset_s: float
    left: float
    share: float = 1.0


class _Impact:
    """Samples (n,) of an impact, scaled to a peak of 1, and models with the same high-pass."""

    def __init__(self, data: Array, lead: int, rate: float) -> None:
        self.data, self.lead, self.rate = data, lead, rate
        ripple = round(0.2 * rate)  # space for the response of the filter
        self.size = scipy.fft.next_fast_len(len(data) + ripple, real=True)
        self.gain = high_pass_gain(self.size, rate)
        self.t_s = (
            np.arange(len(data) + round(LEAD_S * rate)) - lead
        ) / rate  # extended, because the filter is not causal

    def high_passed(self, model: Array) -> Array:
        """Filters models (k, n + LEAD_S) with the high-pass and returns (k, n) samples."""
        passed = np.fft.irfft(self.gain * np.fft.rfft(model, self.size, axis=1), self.size, axis=1)
        return np.asarray(passed[:, : len(self.data)])

    def rings(self, frequency: float, decay: Array, onset_s: Array) -> Array:
        """Decaying sinusoids (k, n) of phase 0 that start at their onsets."""
        since = np.maximum(self.t_s - onset_s[:, None], 0.0)
        return self.high_passed(np.exp(-decay[:, None] * since) * np.sin(2.0 * np.pi * frequency * since))

    def sinusoid(self) -> _Fitted:
        """Fits a sinusoid of phase 0."""
        rate = self.rate
        # Onsets that differ by half a period fit almost equally, so the search starts from the best of a grid.
        frequency = self.loudest_after(0.0)
        onsets_s = np.arange(-ONSET_OFF_S, ONSET_OFF_S, min(5e-4, 0.125 / frequency))
        decay, onset_s = (grid.ravel() for grid in np.meshgrid([30.0, 100.0, 300.0], onsets_s))
        models = self.rings(frequency, decay, onset_s)
        match, power = models @ self.data, np.maximum((models**2).sum(axis=1), 1e-12)
        best = int(np.argmax(match**2 / power))
        begin: Any = [match[best] / power[best], frequency, decay[best], onset_s[best]]
        low, high = np.array([-50.0, 10.0, 1.0, -0.02]), np.array([50.0, 0.45 * rate, 0.25 * rate, 0.02])
        begin, scales = np.clip(begin, low, high), [1.0, 0.1 * frequency, 50.0, 0.002]

        def residual_of(p: Array) -> Array:
            return np.asarray(p[0] * self.rings(p[1], p[2:3], p[3:4])[0] - self.data)

        fitted = scipy.optimize.least_squares(residual_of, begin, bounds=(low, high), x_scale=scales, max_nfev=60)
        error = _errors(np.asarray(fitted.jac), np.asarray(fitted.fun))
        value = np.array([abs(fitted.x[0]), *fitted.x[1:3]])
        return _Fitted(value, error[:3], float(fitted.x[3]), 2.0 * float(fitted.cost))

    def contact_and_ring(self, waves: int, p: Array) -> Array:
        """Basis functions (waves + 2, n): quarter-waves during the contact, then ringing in two phases.

        `p` is (frequency, decay, onset, contact time). Without waves there is no contact and no contact time. The
        amplitude of the ringing is that at its onset, or at the onset of the impact if there is a contact, because the
        end of the contact is uncertain."""
        frequency, decay, onset_s = p[:3]
        contact_s = p[3] if waves else 0.0
        since = self.t_s - onset_s - contact_s
        rung_s = np.maximum(self.t_s if waves else since, -ONSET_OFF_S)
        turn = np.where(since >= 0.0, np.exp((2j * np.pi * frequency - decay) * rung_s), 0.0)
        share = np.where(since < 0.0, np.maximum(self.t_s - onset_s, 0.0), 0.0) / max(contact_s, 1e-9)
        return self.high_passed(
            np.stack([*(np.sin(np.pi * (k + 0.5) * share) for k in range(waves)), turn.imag, turn.real])
        )

    def loudest_after(self, since_s: float) -> float:
        """Frequency [Hz] of the strongest spectral line after a time."""
        tail = self.data[min(self.lead + max(0, round(since_s * self.rate)), len(self.data) - 8) :]
        size = 1 << (4 * len(tail)).bit_length()
        line = max(1, int(np.abs(np.fft.rfft(tail, size)).argmax()))
        return float(np.clip(line * self.rate / size, 12.0, 0.4 * self.rate))

    def ring(self, plain: _Fitted, waves: int) -> _Fitted:
        """Fits ringing of any phase after a contact with `waves` basis functions, by variable projection."""

        def solved(p: Array) -> tuple[Array, Array]:
            models = self.contact_and_ring(waves, p)
            weight = np.linalg.lstsq(models @ models.T, models @ self.data, rcond=1e-12)[0]
            return weight.astype(np.float64), np.asarray(weight @ models - self.data)

        def residual_of(p: Array) -> Array:
            return solved(p)[1]

        frequency, decay, begun_s = *plain.value[1:], plain.onset_s
        onsets_s = begun_s + np.arange(-0.003, 0.0031, 0.001)
        if waves:
            begins = [
                np.array([self.loudest_after(begun_s + contact_s), decay, onset_s, contact_s])
                for contact_s in CONTACTS_S
                for decay in (40.0, 160.0)
                for onset_s in onsets_s[::2]
            ]
        else:
            begins = [np.array([frequency, decay, onset_s]) for onset_s in onsets_s]
        count = len(begins[0])
        begins.sort(key=lambda p: float((residual_of(p) ** 2).sum()))
        low, high = np.array([10.0, 1.0, -0.04, 5e-4]), np.array([0.45 * self.rate, 0.25 * self.rate, 0.04, 0.04])
        low, high, scales = low[:count], high[:count], np.array([0.1 * begins[0][0], 50.0, 0.002, 0.002])[:count]
        options: Any = {"bounds": (low, high), "x_scale": scales, "max_nfev": 25, "ftol": 1e-5, "xtol": 1e-5}
        fits = (scipy.optimize.least_squares(residual_of, np.clip(p, low, high), **options) for p in begins[:SEARCHES])
        fitted = min(fits, key=lambda fit: float(fit.cost))
        weight, residual = solved(fitted.x)
        models = self.contact_and_ring(waves, fitted.x)
        output = weight @ models
        steps = np.diag(1e-4 * scales)
        slopes = [(weight @ self.contact_and_ring(waves, fitted.x + by) - output) / by.max() for by in steps]
        error = (CHOSEN if waves else 1.0) * _errors(np.stack([*slopes, *models], axis=1), residual)
        amplitude = float(np.hypot(*weight[-2:]))
        of_amplitude = float(np.abs(weight[-2:]) @ error[-2:]) / max(amplitude, 1e-12)
        rung = float(((weight[-2:] @ models[-2:]) ** 2).sum()) / float((self.data**2).sum())
        value = np.array([amplitude, *fitted.x[:2]])
        left = float((residual**2).sum())
        return _Fitted(value, np.array([of_amplitude, *error[:2]]), float(fitted.x[2]), left, rung)


def _errors(jacobian: Array, residual: Array) -> Array:
    """Standard errors of fitted parameters, corrected for the lag-1 correlation of the residual."""
    power = float((residual**2).sum())
    if power == 0.0:
        return np.zeros(jacobian.shape[1])
    rho = min(max(float((residual[1:] * residual[:-1]).sum()) / power, 0.0), 0.95)
    variance = power / max(1, len(residual) - jacobian.shape[1]) * (1.0 + rho) / (1.0 - rho)
    size = np.sqrt((jacobian**2).sum(axis=0)) + 1e-300  # scales the columns, whose units differ, against rounding
    unit = jacobian / size
    return np.asarray(np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(unit.T @ unit)), 0.0)) / size)


def _approach(channels: Streams, onset: int) -> float:
    """Approach speed [m/s] from the slope of the depth, or else from the speed; NaN if neither was recorded."""
    first, last = (max(0, onset - round(s * channels.rate_Hz)) for s in SPEED_S)
    if last - first < 3:
        return float("nan")
    if channels.depth_m is not None:
        slope = np.polyfit(np.arange(last - first) / channels.rate_Hz, channels.depth_m[first:last], 1)[0]
        return float(slope) if slope > 0.0 else float("nan")
    speed = float(np.median(channels.speed_m_s[first:last]))
    recorded = np.ptp(channels.speed_m_s) > 0.0 and speed > 0.1 * float(channels.speed_m_s.max())
    return speed if recorded else float("nan")


def _wave(signal: Array, onset: int, rate: float) -> Array:
    """Recorded transient from its onset, faded at both ends."""
    count = round(WAVE_S * rate)
    wave = np.zeros(count)
    onset = max(onset, 0)
    part = signal[onset : onset + count]
    wave[: len(part)] = part
    rise, fall = (max(1, round(s * rate)) for s in FADE_S)
    wave[:rise] *= (np.arange(rise) + 0.5) / rise
    wave[-fall:] *= 0.5 + 0.5 * np.cos(np.pi * (np.arange(fall) + 0.5) / fall)
    return wave
