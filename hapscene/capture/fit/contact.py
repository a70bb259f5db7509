"""Fits damping, adhesion, and the vibrations of leaving and of breakaway to force and depth of contacts.

Damping: F = K d + b ḋ (Kelvin–Voigt) or K d + χ d ḋ (Hunt & Crossley 1975) while the tool presses without sliding. A
numerical derivative of the depth would be too noisy, so both sides are integrated with window functions φ of length
`WINDOW_S`: by recordings, ∫φ ḋ = −∫φ' d and ∫φ d ḋ = −½∫φ' d² (modulating functions; Shinbrot 1957). Force and depth
have the same low-pass. The sample rate has little influence on the accuracy, noise has more: for 3 N·s/m and eight
presses at 10 to 60 mm/s, the error is 0.05 N·s/m with noise of 20 mN and 10 µm at 1 kHz, and 0.3 with ten times the
noise. If the force is delayed against the depth by τ, the fit has an offset of −K τ: 1 ms at 500 N/m is 0.5 N·s/m.

Adhesion: F = −A (g/δ) e^(1 − g/δ) at a distance g above the surface, while the tool leaves.

Leaving and breakaway: decaying sinusoids, fitted as for taps (`hapscene.capture.fit.taps`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import scipy

from hapscene.capture.fit.segment import IMPACT, InteractionState, Run, SegmentedRecording, noise, runs
from hapscene.capture.fit.stiffness import jackknife_half
from hapscene.capture.fit.taps import (
    EXPLAINED_MIN,
    FITTED_MAX,
    NORMAL_95,
    MeasuredTap,
    measure_tap,
    pooled_taps,
    weighted_mean,
)
from hapscene.capture.io.streams import HAND_CUTOFF_HZ, Array, Streams, filtered
from hapscene.surface.taps import Taps

__all__ = ["fit_contact"]

WINDOW_S: Final = 0.03
"""Length of a window function [s]: three periods of the cut-off frequency of the low-pass."""

SETTLE_S: Final = 0.01
"""Time that is omitted at both ends of a contact [s]; the low-pass mixes contact and free motion there."""

CONTACTS_MIN: Final = 4
"""Fewest contacts for a jackknife over whole contacts; parts of one contact are not independent."""

LEAVES_S: Final = (0.03, 0.15)
"""Time before and after the end of a contact to which adhesion is fitted [s]."""

PULL_MIN: Final = 6.0
"""Smallest pull that counts as adhesion, in standard deviations of the force noise [1]."""

UNEXPLAINED_MAX: Final = 0.05
"""Largest fraction of the power of the force that spring and adhesion may leave unexplained [1]."""

RANGE_MAX_M: Final = 0.02
"""Largest distance of the maximum of adhesion [m]; a larger one indicates a drift of the force."""

RINGS_S: Final = 0.06
"""Time after leaving or breakaway to which a vibration is fitted [s]."""

NEVER_LEAVES: Final = "the tool does not leave the surface in the recording"


@dataclass
class ContactFit:
    """Result: parameters of a swatch, 95 % intervals, reasons for missing parameters, and the vibration of leaving."""

    numbers: dict[str, float] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    absent: dict[str, str] = field(default_factory=dict)
    leaving: Taps | None = None

    def add(self, names: Sequence[str], values: Array, halves: Array) -> None:
        """Adds nonnegative parameters and the half-widths of their intervals."""
        for name, value, half in zip(names, values.tolist(), halves.tolist(), strict=True):
            self.numbers[name], self.intervals[name] = value, (max(0.0, value - half), value + half)


def fit_contact(recordings: Sequence[SegmentedRecording]) -> ContactFit:
    """Fits damping, adhesion, leaving and breakaway to recordings of one surface."""
    found = ContactFit()
    _fit_damping(recordings, found)
    _fit_adhesion(recordings, found)
    _fit_leaving(recordings, found)
    _fit_breakaway(recordings, found)
    return found


def _contacts(recordings: Sequence[SegmentedRecording]) -> list[tuple[Streams, Run]]:
    """Contacts in which the tool presses without sliding."""
    return [
        (channels, run)
        for channels, states in recordings
        if states.force_on_N is not None
        for run in runs((channels.force_N > states.force_on_N) & (states.states != InteractionState.SLIDING))
    ]


# Damping.


def _fit_damping(recordings: Sequence[SegmentedRecording], found: ContactFit) -> None:
    with_depth = [part for part in recordings if part[0].depth_m is not None]
    if not with_depth:
        found.absent["damping_Ns_m"] = "the depth was not recorded"
        return
    contacts = [rows for channels, run in _contacts(with_depth) if len(rows := _windows(channels, run)) > 2]
    if len(contacts) < CONTACTS_MIN:
        found.absent["damping_Ns_m"] = (
            f"{len(contacts)} presses without sliding for {2.0 * WINDOW_S + 2.0 * SETTLE_S:g} s (expected at least "
            f"{CONTACTS_MIN})"
        )
        return
    kinds = {"damping_Ns_m": (0, 1), "hunt_crossley_Ns_m2": (0, 2)}
    found_of = {name: _left_out(contacts, columns) for name, columns in kinds.items()}
    name, other = sorted(found_of, key=lambda name: float(found_of[name][1].sum()))
    without, errors = found_of[name]
    value, half = _solve(contacts, kinds[name]), jackknife_half(without)
    (_, low), (_, high) = value - half, value + half
    better = errors.sum() < _left_out(contacts, (0,))[1].sum()
    unit = "N·s/m" if name == "damping_Ns_m" else "N·s/m²"
    interval = f"95 % interval {low:.2g} to {high:.2g} {unit}"
    if high < 0.0 and better:
        delay_ms = -1e3 * float(np.divide(*_solve(contacts, (0, 1))[::-1]))
        delay = f"the force is delayed by {delay_ms:.1f} ms against the depth"
        found.absent["damping_Ns_m"] = f"the fit is negative ({interval}): {delay}"
    elif low <= 0.0 or not better:
        found.absent["damping_Ns_m"] = f"not significantly different from 0 ({interval})"
    elif not _is_smaller(errors, found_of[other][1]):
        kinds_text = "constant damping and damping proportional to the depth"
        found.absent["damping_Ns_m"] = f"{kinds_text} fit equally well: record more and faster presses to other depths"
        found.add(("stiffness_N_m",), value[:1], half[:1])
    else:
        found.add(("stiffness_N_m", name), value, half)
        if name != "damping_Ns_m":
            found.absent["damping_Ns_m"] = "proportional to the depth: see hunt_crossley_Ns_m2"


def _windows(channels: Streams, run: Run) -> Array:
    """Window averages (m, 4) over a contact: of force, depth d, ḋ and d ḋ.

    The zero of depth is where a spring that is fitted to the contact has no force.
    """
    assert channels.depth_m is not None
    rate = channels.rate_Hz
    edge, width = round(SETTLE_S * rate), round(WINDOW_S * rate) | 1
    first, last = run[0] + edge, run[1] - edge
    if last - first < 2 * width or channels.force_N[first:last].max() < 4.0 * channels.force_N[run[0]]:
        return np.zeros((0, 4))
    force, depth = channels.force_N[first:last], channels.depth_m[first:last]
    if np.ptp(depth) == 0.0:
        return np.zeros((0, 4))
    slope, offset = np.polyfit(depth, force, 1)
    depth = depth + offset / slope if slope > 0.0 else depth - depth.min()
    angle = 2.0 * np.pi * (np.arange(width) + 0.5) / width
    mean, change = (1.0 - np.cos(angle)) / width, -2.0 * np.pi * np.sin(angle) / width**2 * rate
    starts = np.arange(0, len(force) - width + 1, width // 2)
    cut = starts[:, None] + np.arange(width)
    return np.stack([force[cut] @ mean, depth[cut] @ mean, depth[cut] @ change, 0.5 * depth[cut] ** 2 @ change], axis=1)


def _centred(rows: Array, columns: Sequence[int]) -> tuple[Array, Array]:
    """Regressors (m, k) and forces (m,) of a contact, centred, since the zero of depth may differ between contacts."""
    about = rows - rows.mean(axis=0)
    return about[:, 1:][:, list(columns)], about[:, 0]


def _solve(contacts: Sequence[Array], columns: Sequence[int]) -> Array:
    """Least-squares coefficients (k,)."""
    x, y = (np.concatenate(part) for part in zip(*(_centred(rows, columns) for rows in contacts), strict=True))
    return np.asarray(np.linalg.lstsq(x, y, rcond=None)[0])


def _left_out(contacts: Sequence[Array], columns: Sequence[int]) -> tuple[Array, Array]:
    """Coefficients (n, k) without each contact, and the squared errors (n,) on the omitted contacts [N²]."""
    without = np.array([_solve([*contacts[:i], *contacts[i + 1 :]], columns) for i in range(len(contacts))])
    errors = []
    for rows, found in zip(contacts, without, strict=True):
        x, y = _centred(rows, columns)
        errors.append(float(((y - x @ found) ** 2).sum()))
    return without, np.array(errors)


def _is_smaller(first: Array, second: Array) -> bool:
    """Whether the errors of one model on omitted contacts (n,) are smaller than those of another: Student's t, 10 %."""
    gain = second - first
    least = float(scipy.stats.t.ppf(0.9, len(gain) - 1)) * float(gain.std(ddof=1)) / len(gain) ** 0.5
    return bool(gain.mean() > least)


def _ends(recordings: Sequence[SegmentedRecording]) -> list[tuple[Streams, Run]]:
    """Contacts that end in the recording, at most `FITTED_MAX` of them, evenly selected."""
    found = [
        (channels, run)
        for channels, states in recordings
        if states.force_on_N is not None
        for run in runs(channels.force_N > states.force_on_N)
        if run[0] > 0 and run[1] + round(LEAVES_S[1] * channels.rate_Hz) < len(channels.force_N)
    ]
    return found[:: -(-len(found) // FITTED_MAX)] if found else []


# Adhesion.


def _fit_adhesion(recordings: Sequence[SegmentedRecording], found: ContactFit) -> None:
    values, errors, ends, pulls = [], [], _ends(recordings), False
    for channels, (start, end) in ends:
        before, after = (round(s * channels.rate_Hz) for s in LEAVES_S)
        again = np.flatnonzero(channels.force_N[end : end + after] > 4.0 * channels.force_N[end - 1])
        part = slice(max(start, end - before), end + int([*again, after][0]))
        if channels.force_N[end : part.stop].min(initial=0.0) > -PULL_MIN * noise(channels.force_N, channels.rate_Hz):
            continue
        pulls = True
        if part.stop - part.start < before:
            continue  # too short for the low-pass of the model
        depth = _depth_of_leaving(channels, part, end)
        fitted = None if depth is None else _pull(channels.force_N[part], depth, channels.rate_Hz, found.numbers)
        if fitted is not None:
            values.append(fitted[0])
            errors.append(fitted[1])
    if len(values) < max(1, 0.5 * len(ends)):
        reason = "the force is negative as the tool leaves, but depth or speed is missing or the curve is not adhesion"
        found.absent["adhesion_N"] = reason if pulls else "no pull as the tool leaves" if ends else NEVER_LEAVES
        return
    mean, error = weighted_mean(np.array(values), np.array(errors))
    found.add(("adhesion_N", "adhesion_range_m"), mean, NORMAL_95 * error)


def _depth_of_leaving(channels: Streams, part: slice, end: int) -> Array | None:
    """Depth (m,) while the tool leaves: recorded, or integrated from the speed; None if neither was recorded."""
    if channels.depth_m is not None:
        return channels.depth_m[part]
    moving = channels.speed_m_s[part]
    if np.ptp(moving) == 0.0:
        return None
    distance = np.cumsum(moving) / channels.rate_Hz
    return np.asarray(distance[end - part.start] - distance)


def _pull(force: Array, depth: Array, rate_Hz: float, damping: Mapping[str, float]) -> tuple[Array, Array] | None:
    """Adhesion and its range (2,) for one end of a contact, with standard errors; None if the model does not fit.

    Stiffness and zero of depth are fitted as well. The force of the model is low-passed as the recorded force is.
    """
    low = int(force.argmin())
    zero = float(np.interp(0.0, force[low::-1], depth[low::-1])) if low > 1 else float(depth[0])
    size, far = -float(force[low]), float(np.clip(zero - depth[low], 1e-5, RANGE_MAX_M))
    stiff = max(float(force[0]) / max(float(depth[0]) - zero, 1e-6), 1.0)
    begin = np.array([size, far, stiff, zero])
    rate_m_s = np.gradient(depth) * rate_Hz
    own_Ns_m, deep_Ns_m2 = (damping.get(name, 0.0) for name in ("damping_Ns_m", "hunt_crossley_Ns_m2"))

    def residual_of(p: Array) -> Array:
        most_N, range_m, stiffness_N_m, zero_m = p * scale
        into = np.maximum(depth - zero_m, 0.0)
        beyond = np.maximum(zero_m - depth, 0.0) / range_m
        press = stiffness_N_m * into + np.where(into > 0.0, own_Ns_m + deep_Ns_m2 * into, 0.0) * rate_m_s
        model = np.maximum(press, 0.0) - most_N * beyond * np.exp(1.0 - beyond)
        return np.asarray((filtered(model, rate_Hz, HAND_CUTOFF_HZ, "lowpass") - force)[edge:-edge])

    edge = min(round(SETTLE_S * rate_Hz), len(force) // 8)
    scale = np.array([size, far, stiff, far])
    bounds = [0.0, 1e-2, 1e-2, -np.inf], [10.0, RANGE_MAX_M / far, 1e2, np.inf]
    start = np.clip(begin / scale, *bounds)
    made: Any = scipy.optimize.least_squares(residual_of, start, bounds=bounds, max_nfev=100)
    residual = np.asarray(made.fun)
    # independent samples after the low-pass, minus parameters
    count = max(1.0, len(residual) * 2.0 * HAND_CUTOFF_HZ / rate_Hz - 4.0)
    inverse = np.linalg.pinv(made.jac.T @ made.jac)
    variance = np.diag(inverse) * (residual**2).sum() / count
    left = force[edge:-edge]
    if (residual**2).sum() > min(
        (1.0 - EXPLAINED_MIN) * (left[left < 0.0] ** 2).sum(), UNEXPLAINED_MAX * (left**2).sum()
    ):
        return None  # not adhesion, for example a sliding tool without recorded depth
    value, error = made.x * scale, np.sqrt(np.maximum(variance, 0.0)) * scale
    return value[:2], error[:2]


# Leaving and breakaway.


def _fit_leaving(recordings: Sequence[SegmentedRecording], found: ContactFit) -> None:
    bursts = [
        _burst(channels, start, end, _leaving_speed(channels, end)) for channels, (start, end) in _ends(recordings)
    ]
    taps = [tap for tap in bursts if tap is not None]
    known = [tap for tap in taps if np.isfinite(tap.approach_m_s)]
    if not known:
        reason = "the speed of leaving was not recorded" if taps else "no vibration as the tool leaves"
        found.absent["leaving"] = reason if bursts else NEVER_LEAVES
        return
    fitted = pooled_taps(known, recordings[0][0].rate_Hz, {})
    found.leaving = fitted.taps
    found.intervals |= {name.replace("taps.", "leaving."): pair for name, pair in fitted.intervals.items()}


def _leaving_speed(channels: Streams, end: int) -> float:
    """Speed at which the tool leaves [m/s]; NaN if neither depth nor speed was recorded."""
    part = slice(end, end + round(0.02 * channels.rate_Hz))
    if channels.depth_m is not None:
        speed = -float(np.polyfit(np.arange(part.stop - part.start) / channels.rate_Hz, channels.depth_m[part], 1)[0])
    else:
        speed = float(np.median(channels.speed_m_s[part])) if np.ptp(channels.speed_m_s) > 0.0 else 0.0
    return speed if speed > 0.0 else float("nan")


def _burst(channels: Streams, first: int, at: int, speed_m_s: float) -> MeasuredTap | None:
    """Decaying sinusoid that starts near a sample; None if the vibration there is not stronger than around it."""
    rate = channels.rate_Hz
    near, length = round(0.02 * rate), round(RINGS_S * rate)
    size = np.abs(channels.acceleration_m_s2)
    reach = slice(max(first, at - near), at + near)
    before, after = size[max(0, reach.start - near) : reach.start], size[at + length : at + length + near]
    calm = max((float(np.sqrt(np.mean(part**2))) for part in (before, after) if len(part)), default=0.0)
    peak = float(size[reach].max(initial=0.0))
    if peak < IMPACT * calm or peak == 0.0:
        return None
    onset = reach.start + int(np.argmax(size[reach] >= 0.25 * peak))
    tap = measure_tap(channels, (onset, onset + length), speed_m_s)
    return tap if tap is not None and tap.explained >= EXPLAINED_MIN else None


def _fit_breakaway(recordings: Sequence[SegmentedRecording], found: ContactFit) -> None:
    values, errors = [], []
    for channels, states in recordings:
        pull = channels.tangential_force_N
        if pull is None:
            continue
        length = round(RINGS_S * channels.rate_Hz)
        for start, end in runs(states.states == InteractionState.STILL):
            if end + length >= len(pull) or states.states[end] != InteractionState.SLIDING:
                continue
            peak = slice(max(start, end - length // 2), end + length // 2)
            released_N = float(pull[peak].max() - np.median(pull[end + length // 2 : end + length]))
            tap = _burst(channels, start, peak.start + int(pull[peak].argmax()), float("nan"))
            if tap is not None and released_N > PULL_MIN * noise(pull, channels.rate_Hz):
                values.append(tap.value / [released_N, 1.0, 1.0])
                errors.append(tap.error / [released_N, 1.0, 1.0])
    if not values:
        recorded = any(channels.tangential_force_N is not None for channels, _ in recordings)
        reason = "no vibration at the transition from stick to slip"
        found.absent["breakaway_1_kg"] = reason if recorded else "the tangential force was not recorded"
        return
    mean, error = weighted_mean(np.array(values), np.array(errors))
    found.add(("breakaway_1_kg", "breakaway_Hz", "breakaway_decay_1_s"), mean, NORMAL_95 * error)
