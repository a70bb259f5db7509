"""Taps of a recording: a decaying sinusoid fitted to each impact, and the transient itself, over approach speed.

    a(t) = A exp(−βt) sin(2πft) from t = t0 (Okamura, Cutkosky & Dennerlein 2001)

The recording was high-passed at 20 Hz, without delay. That bends a tap: so the model is passed through the same filter
before it is compared, and A, β, f are those of the tap itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy

from hapscene.capture.fit.segment import InteractionState, Part, Run, onset
from hapscene.capture.io.streams import Array, Streams, high_pass_gain
from hapscene.surface.taps import TAP_ROWS, Taps

__all__ = [
    "EXPLAINED_MIN",
    "FITTED_MAX",
    "NORMAL_95",
    "OUTLIER",
    "WAVE_S",
    "MeasuredTap",
    "fit_taps",
    "measure_tap",
    "pooled_taps",
    "weighted_mean",
]

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

RING_MIN: Final = 0.1
"""Least share of an impact's power that rings on after the contact [1] for the sinusoid to be that of the ring alone;
of less the contact itself is what is felt."""

CONTACTS_S: Final = (0.0015, 0.003, 0.006, 0.012)
"""Lengths of contact from which that of a bounce is searched [s]."""

CONTACT_WAVES: Final = 5
"""Quarter-waves, odd ones, that a contact's own course is made of [count]: in it a tool rings otherwise than after."""

CHOSEN: Final = 1.3
"""What the errors of a ring after a contact are raised by [1], for where the contact ends is chosen by the same data:
without, 83 to 94 % of the intervals of decay of simulated bounces hold the truth, with it 93 to 99 %."""

SEARCHES: Final = 3
"""Beginnings from which a ring after a contact is searched [count]: one alone may end at an onset too late."""

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


def fit_taps(parts: Sequence[Part]) -> TapFit:
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
        best = max((tap.explained for tap in measured if tap is not None), default=0.0)
        reason = (
            f"none of {len(impacts)} impacts is a decaying sinusoid for {100 * EXPLAINED_MIN:g} % of its power, the "
            f"nearest for {100 * max(0.0, best):.0f} %: harder taps, on a tool that is held still, would be"
        )
        return TapFit(None, {}, {"taps": reason})
    known = [tap for tap in good if np.isfinite(tap.approach_m_s)]
    assumed = f"the recording does not say how fast the tool came; {ASSUMED_APPROACH_M_S:g} m/s assumed"
    return pooled_taps(known or good, parts[0][0].rate_Hz, {} if known else {"taps.approach_m_s": assumed})


def pooled_taps(taps: list[MeasuredTap], rate_Hz: float, absent: dict[str, str]) -> TapFit:
    """One row for each group of like approach speeds."""
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
    """The sinusoid nearest to the impact whose ringing spans `run`; None where there is nothing to fit.

    A sinusoid from zero on is tried first. A damper in the contact makes it begin at another phase: that is taken where
    it is nearer (by Akaike's criterion). A tool that bounces off rings freely only when the contact is over: where a
    pulse and a ring from its end on are nearer still (by Schwarz's), and the ring is no mere trace, it is that ring.
    """
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
        nearer = count * np.log(found.left / ring.left) > (CONTACT_WAVES + 1) * np.log(count)
        if ring.share >= RING_MIN and (nearer or explained(found) < EXPLAINED_MIN):
            found = ring
    scaled = np.array([scale, 1.0, 1.0])
    wave = _wave(signal, start + round(found.onset_s * rate), rate)
    return MeasuredTap(approach_m_s, found.value * scaled, found.error * scaled, explained(found), wave)


@dataclass(frozen=True)
class _Fitted:
    """Amplitude, frequency, decay with standard errors (3,), the onset, the power left, the ring's share of it."""

    value: Array
    error: Array
    onset_s: float
    left: float
    share: float = 1.0


class _Impact:
    """The samples (n,) about one impact, of largest size 1, and models of it, high-passed as it is."""

    def __init__(self, data: Array, lead: int, rate: float) -> None:
        self.data, self.lead, self.rate = data, lead, rate
        ripple = round(0.2 * rate)  # the filter's has room to fade
        self.size = scipy.fft.next_fast_len(len(data) + ripple, real=True)
        self.gain = high_pass_gain(self.size, rate)
        self.t_s = (np.arange(len(data) + round(LEAD_S * rate)) - lead) / rate  # what comes later is not heard before

    def heard(self, model: Array) -> Array:
        """Models (k, n + LEAD_S) through the filter, (k, n)."""
        passed = np.fft.irfft(self.gain * np.fft.rfft(model, self.size, axis=1), self.size, axis=1)
        return np.asarray(passed[:, : len(self.data)])

    def rings(self, frequency: float, decay: Array, onset_s: Array) -> Array:
        """Sinusoids (k, n) that begin at their onsets."""
        since = np.maximum(self.t_s - onset_s[:, None], 0.0)
        return self.heard(np.exp(-decay[:, None] * since) * np.sin(2.0 * np.pi * frequency * since))

    def sinusoid(self) -> _Fitted:
        """One sinusoid from the onset on."""
        rate = self.rate
        # Onsets half a period off fit nearly as well: of all of them the best begins the search.
        frequency = self.loudest_after(0.0)
        onsets_s = np.arange(-ONSET_OFF_S, ONSET_OFF_S, min(5e-4, 0.125 / frequency))
        decay, onset_s = (grid.ravel() for grid in np.meshgrid([30.0, 100.0, 300.0], onsets_s))
        models = self.rings(frequency, decay, onset_s)
        match, power = models @ self.data, np.maximum((models**2).sum(axis=1), 1e-12)
        best = int(np.argmax(match**2 / power))
        begin: Any = [match[best] / power[best], frequency, decay[best], onset_s[best]]
        low, high = np.array([-50.0, 10.0, 1.0, -0.02]), np.array([50.0, 0.45 * rate, 0.25 * rate, 0.02])
        begin, scales = np.clip(begin, low, high), [1.0, 0.1 * frequency, 50.0, 0.002]

        def off(p: Array) -> Array:
            return np.asarray(p[0] * self.rings(p[1], p[2:3], p[3:4])[0] - self.data)

        fitted = scipy.optimize.least_squares(off, begin, bounds=(low, high), x_scale=scales, max_nfev=60)
        error = _errors(np.asarray(fitted.jac), np.asarray(fitted.fun))
        value = np.array([abs(fitted.x[0]), *fitted.x[1:3]])
        return _Fitted(value, error[:3], float(fitted.x[3]), 2.0 * float(fitted.cost))

    def contact_and_ring(self, waves: int, p: Array) -> Array:
        """What a contact may do (from nothing to anything), and a ring from its end on at two phases (waves + 2, n).

        `p` is (frequency, decay, onset, length of the contact); without waves there is no contact, and no length. The
        ring's size is that at its onset; after a contact, whose ends are hardly told, that where the impact began.
        """
        frequency, decay, onset_s = p[:3]
        contact_s = p[3] if waves else 0.0
        since = self.t_s - onset_s - contact_s
        rung_s = np.maximum(self.t_s if waves else since, -ONSET_OFF_S)
        turn = np.where(since >= 0.0, np.exp((2j * np.pi * frequency - decay) * rung_s), 0.0)
        share = np.where(since < 0.0, np.maximum(self.t_s - onset_s, 0.0), 0.0) / max(contact_s, 1e-9)
        return self.heard(np.stack([*(np.sin(np.pi * (k + 0.5) * share) for k in range(waves)), turn.imag, turn.real]))

    def loudest_after(self, since_s: float) -> float:
        """Frequency [Hz] of the strongest line from that time on."""
        tail = self.data[min(self.lead + max(0, round(since_s * self.rate)), len(self.data) - 8) :]
        size = 1 << (4 * len(tail)).bit_length()
        line = max(1, int(np.abs(np.fft.rfft(tail, size)).argmax()))
        return float(np.clip(line * self.rate / size, 12.0, 0.4 * self.rate))

    def ring(self, plain: _Fitted, waves: int) -> _Fitted:
        """A ring of any phase after a contact of so many waves; the linear is solved for at each step of the search."""

        def solved(p: Array) -> tuple[Array, Array]:
            models = self.contact_and_ring(waves, p)
            weight = np.linalg.lstsq(models @ models.T, models @ self.data, rcond=1e-12)[0]
            return weight.astype(np.float64), np.asarray(weight @ models - self.data)

        def off(p: Array) -> Array:
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
        begins.sort(key=lambda p: float((off(p) ** 2).sum()))
        low, high = np.array([10.0, 1.0, -0.04, 5e-4]), np.array([0.45 * self.rate, 0.25 * self.rate, 0.04, 0.04])
        low, high, scales = low[:count], high[:count], np.array([0.1 * begins[0][0], 50.0, 0.002, 0.002])[:count]
        options: Any = {"bounds": (low, high), "x_scale": scales, "max_nfev": 25, "ftol": 1e-5, "xtol": 1e-5}
        fits = (scipy.optimize.least_squares(off, np.clip(p, low, high), **options) for p in begins[:SEARCHES])
        fitted = min(fits, key=lambda fit: float(fit.cost))
        weight, residual = solved(fitted.x)
        models = self.contact_and_ring(waves, fitted.x)
        heard = weight @ models
        steps = np.diag(1e-4 * scales)
        slopes = [(weight @ self.contact_and_ring(waves, fitted.x + by) - heard) / by.max() for by in steps]
        error = (CHOSEN if waves else 1.0) * _errors(np.stack([*slopes, *models], axis=1), residual)
        amplitude = float(np.hypot(*weight[-2:]))
        of_amplitude = float(np.abs(weight[-2:]) @ error[-2:]) / max(amplitude, 1e-12)
        rung = float(((weight[-2:] @ models[-2:]) ** 2).sum()) / float((self.data**2).sum())
        value = np.array([amplitude, *fitted.x[:2]])
        left = float((residual**2).sum())
        return _Fitted(value, np.array([of_amplitude, *error[:2]]), float(fitted.x[2]), left, rung)


def _errors(jacobian: Array, residual: Array) -> Array:
    """Standard errors of a fit's numbers; the residual is no white noise, which its lag-1 correlation corrects for."""
    power = float((residual**2).sum())
    if power == 0.0:
        return np.zeros(jacobian.shape[1])
    rho = min(max(float((residual[1:] * residual[:-1]).sum()) / power, 0.0), 0.95)
    variance = power / max(1, len(residual) - jacobian.shape[1]) * (1.0 + rho) / (1.0 - rho)
    size = np.sqrt((jacobian**2).sum(axis=0)) + 1e-300  # numbers of seconds and of hertz: else rounding decides
    unit = jacobian / size
    return np.asarray(np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(unit.T @ unit)), 0.0)) / size)


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
