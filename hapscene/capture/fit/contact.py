"""A fit of its own: what a contact is beside its stiffness, from the force and the depth of presses and releases.

Damping: while it presses without sliding, F = K d + b ḋ (Kelvin and Voigt) or K d + χ d ḋ (Hunt & Crossley 1975), over
loadings and unloadings. A depth that is derived is noise: so both sides are averaged over windows φ of `WINDOW_S`
instead, by parts ∫φ ḋ = −∫φ' d and ∫φ d ḋ = −½∫φ' d² (modulating functions; Shinbrot 1957), of streams whose low-pass
is the same. The rate of the recording matters little, its noise does: of 3 N·s/m, eight presses at 10 to 60 mm/s tell
0.05 with noise of 20 mN and 10 µm at 1 kHz, and 0.3 with ten times that; a force that comes later than the depth by τ
looks like a damping of −K τ: 1 ms at 500 N/m is 0.5 N·s/m.

Adhesion: F = −A (g/δ) e^(1 − g/δ) at a distance g beyond the surface, as the tool leaves.

Leaving and breaking loose: their vibration, by the sinusoids that taps are fitted by (`hapscene.capture.fit.taps`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import scipy

from hapscene.capture.fit.segment import IMPACT, InteractionState, Part, Run, noise, runs
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
"""Width of a window [s]: three periods of the fastest that the low-pass lets through."""

SETTLE_S: Final = 0.01
"""What is left out at both ends of a contact [s]: the low-pass mixes the air into it."""

CONTACTS_MIN: Final = 4
"""Fewest contacts that are left out as wholes for the interval [count]; of fewer, pieces are."""

LEAVES_S: Final = (0.03, 0.15)
"""How long before and after the end of a contact its adhesion is looked at [s]."""

PULL_MIN: Final = 6.0
"""Least pull that counts as adhesion, in standard deviations of the force's noise [1]."""

UNTOLD: Final = 0.05
"""Most of the force's power in a leaving that spring and adhesion may leave [1]."""

RANGE_MAX_M: Final = 0.02
"""Largest distance at which adhesion may be strongest [m]: beyond, it is a drift of the force."""

RINGS_S: Final = 0.06
"""How long the vibration of leaving and of breaking loose is looked at [s]."""

STAYS: Final = "the tool does not leave the surface in the recording"


@dataclass
class ContactFit:
    """Numbers of a swatch by name, their 95 % intervals, what is absent and why, and what leaving sounds like."""

    numbers: dict[str, float] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    absent: dict[str, str] = field(default_factory=dict)
    leaving: Taps | None = None

    def add(self, names: Sequence[str], values: Array, halves: Array) -> None:
        """Note numbers, none of them negative, and half the widths of their intervals."""
        for name, value, half in zip(names, values.tolist(), halves.tolist(), strict=True):
            self.numbers[name], self.intervals[name] = value, (max(0.0, value - half), value + half)


def fit_contact(parts: Sequence[Part]) -> ContactFit:
    """What recordings of one surface tell of its contact."""
    found = ContactFit()
    _fit_damping(parts, found)
    _fit_adhesion(parts, found)
    _fit_leaving(parts, found)
    _fit_breakaway(parts, found)
    return found


def _contacts(parts: Sequence[Part]) -> list[tuple[Streams, Run]]:
    """Where the tool presses and does not slide."""
    return [
        (channels, run)
        for channels, states in parts
        if states.force_on_N is not None
        for run in runs((channels.force_N > states.force_on_N) & (states.states != InteractionState.SLIDING))
    ]


# Damping.


def _fit_damping(parts: Sequence[Part], found: ContactFit) -> None:
    with_depth = [part for part in parts if part[0].depth_m is not None]
    if not with_depth:
        found.absent["damping_Ns_m"] = "the recording holds no depth"
        return
    contacts = [rows for channels, run in _contacts(with_depth) if len(rows := _windows(channels, run))]
    if sum(map(len, contacts)) < 12:
        found.absent["damping_Ns_m"] = f"the tool presses without sliding for less than {6.0 * WINDOW_S:g} s"
        return
    if len(contacts) < CONTACTS_MIN:
        contacts = [piece for rows in contacts for piece in np.array_split(rows, 12 // len(contacts)) if len(piece) > 2]
    kinds = {"damping_Ns_m": (0, 1), "hunt_crossley_Ns_m2": (0, 2)}
    found_of = {name: _left_out(contacts, columns) for name, columns in kinds.items()}
    name = min(found_of, key=lambda name: found_of[name][1])
    without, error = found_of[name]
    value, half = _solve(contacts, kinds[name]), jackknife_half(without)
    (_, low), (_, high) = value - half, value + half
    better = error < _left_out(contacts, (0,))[1]
    unit = "N·s/m" if name == "damping_Ns_m" else "N·s/m²"
    said = f"95 % interval {low:.2g} to {high:.2g} {unit}"
    if high < 0.0 and better:
        late_ms = -1e3 * float(np.divide(*_solve(contacts, (0, 1))[::-1]))
        late = f"the force is {late_ms:.1f} ms later than the depth"
        found.absent["damping_Ns_m"] = f"it comes out negative ({said}): {late}"
    elif low <= 0.0 or not better:
        found.absent["damping_Ns_m"] = f"it cannot be told from none ({said})"
    else:
        found.add(("stiffness_N_m", name), value, half)
        if name != "damping_Ns_m":
            found.absent["damping_Ns_m"] = "it grows with the depth: hunt_crossley_Ns_m2"


def _windows(channels: Streams, run: Run) -> Array:
    """Averages (m, 4) over windows of a contact: of force, depth, its rate, and of the square of depth per time over 2.

    Depth is counted from where the force would begin, by a first spring.
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
    starts = np.arange(0, len(force) - width + 1, max(1, width // 2))
    cut = starts[:, None] + np.arange(width)
    return np.stack([force[cut] @ mean, depth[cut] @ mean, depth[cut] @ change, 0.5 * depth[cut] ** 2 @ change], axis=1)


def _centred(rows: Array, columns: Sequence[int]) -> tuple[Array, Array]:
    """Regressors (m, k) and forces (m,) of a contact about their means: its zero of depth may be its own."""
    about = rows - rows.mean(axis=0)
    return about[:, 1:][:, list(columns)], about[:, 0]


def _solve(contacts: Sequence[Array], columns: Sequence[int]) -> Array:
    """Coefficients (k,) with the least squares."""
    x, y = (np.concatenate(part) for part in zip(*(_centred(rows, columns) for rows in contacts), strict=True))
    return np.asarray(np.linalg.lstsq(x, y, rcond=None)[0])


def _left_out(contacts: Sequence[Array], columns: Sequence[int]) -> tuple[Array, float]:
    """Coefficients (n, k) without each contact, and the sum of squares that they leave in it [N²]."""
    without = np.array([_solve([*contacts[:i], *contacts[i + 1 :]], columns) for i in range(len(contacts))])
    total = 0.0
    for rows, found in zip(contacts, without, strict=True):
        x, y = _centred(rows, columns)
        total += float(((y - x @ found) ** 2).sum())
    return without, total


def _ends(parts: Sequence[Part]) -> list[tuple[Streams, Run]]:
    """Contacts that end in the recording; of many, `FITTED_MAX` spread over them."""
    found = [
        (channels, run)
        for channels, states in parts
        if states.force_on_N is not None
        for run in runs(channels.force_N > states.force_on_N)
        if run[0] > 0 and run[1] + round(LEAVES_S[1] * channels.rate_Hz) < len(channels.force_N)
    ]
    return found[:: -(-len(found) // FITTED_MAX)] if found else []


# Adhesion.


def _fit_adhesion(parts: Sequence[Part], found: ContactFit) -> None:
    values, errors, ends, told = [], [], _ends(parts), False
    for channels, (start, end) in ends:
        before, after = (round(s * channels.rate_Hz) for s in LEAVES_S)
        again = np.flatnonzero(channels.force_N[end : end + after] > 4.0 * channels.force_N[end - 1])
        part = slice(max(start, end - before), end + int([*again, after][0]))
        if channels.force_N[end : part.stop].min(initial=0.0) > -PULL_MIN * noise(channels.force_N, channels.rate_Hz):
            continue
        told = True
        depth = _way(channels, part, end)
        fitted = None if depth is None else _pull(channels.force_N[part], depth, channels.rate_Hz, found.numbers)
        if fitted is not None:
            values.append(fitted[0])
            errors.append(fitted[1])
    if len(values) < max(1, 0.5 * len(ends)):
        reason = "the force is below zero as the tool leaves, but not over a way that was recorded and as adhesion is"
        found.absent["adhesion_N"] = reason if told else "the force does not pull as the tool leaves" if ends else STAYS
        return
    mean, error = weighted_mean(np.array(values), np.array(errors))
    found.add(("adhesion_N", "adhesion_range_m"), mean, NORMAL_95 * error)


def _way(channels: Streams, part: slice, end: int) -> Array | None:
    """Depth over a leaving (m,): measured, or the way that its speed makes if it goes straight off; else None."""
    if channels.depth_m is not None:
        return channels.depth_m[part]
    moving = channels.speed_m_s[part]
    if np.ptp(moving) == 0.0:
        return None
    way = np.cumsum(moving) / channels.rate_Hz
    return np.asarray(way[end - part.start] - way)


def _pull(force: Array, depth: Array, rate_Hz: float, damping: Mapping[str, float]) -> tuple[Array, Array] | None:
    """Adhesion and its range (2,) of one leaving, with their standard errors; None where they explain too little.

    Its spring and its zero of depth are fitted with them; the model's force is low-passed as the recorded one is.
    """
    low = int(force.argmin())
    zero = float(np.interp(0.0, force[low::-1], depth[low::-1])) if low > 1 else float(depth[0])
    size, far = -float(force[low]), float(np.clip(zero - depth[low], 1e-5, RANGE_MAX_M))
    stiff = max(float(force[0]) / max(float(depth[0]) - zero, 1e-6), 1.0)
    begin = np.array([size, far, stiff, zero])
    rate_m_s = np.gradient(depth) * rate_Hz
    own_Ns_m, deep_Ns_m2 = (damping.get(name, 0.0) for name in ("damping_Ns_m", "hunt_crossley_Ns_m2"))

    def off(p: Array) -> Array:
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
    made: Any = scipy.optimize.least_squares(off, start, bounds=bounds, max_nfev=100)
    residual = np.asarray(made.fun)
    count = max(1.0, len(residual) * 2.0 * HAND_CUTOFF_HZ / rate_Hz - 4.0)  # what the low-pass leaves independent
    inverse = np.linalg.pinv(made.jac.T @ made.jac)
    variance = np.diag(inverse) * (residual**2).sum() / count
    left = force[edge:-edge]
    if (residual**2).sum() > min((1.0 - EXPLAINED_MIN) * (left[left < 0.0] ** 2).sum(), UNTOLD * (left**2).sum()):
        return None  # no adhesion, or no spring before: as of a tool that slides and has no depth recorded
    value, error = made.x * scale, np.sqrt(np.maximum(variance, 0.0)) * scale
    return value[:2], error[:2]


# Leaving and breaking loose.


def _fit_leaving(parts: Sequence[Part], found: ContactFit) -> None:
    bursts = [
        _burst(channels, max(start, end - round(RINGS_S * channels.rate_Hz)), end, _leaving_speed(channels, end))
        for channels, (start, end) in _ends(parts)
    ]
    taps = [tap for tap in bursts if tap is not None]
    known = [tap for tap in taps if np.isfinite(tap.approach_m_s)]
    if not known:
        reason = (
            "the recording does not say how fast the tool leaves" if taps else "nothing is heard as the tool leaves"
        )
        found.absent["leaving"] = reason if bursts else STAYS
        return
    fitted = pooled_taps(known, parts[0][0].rate_Hz, {})
    found.leaving = fitted.taps
    found.intervals |= {name.replace("taps.", "leaving."): pair for name, pair in fitted.intervals.items()}


def _leaving_speed(channels: Streams, end: int) -> float:
    """How fast the tool leaves [m/s], NaN where neither depth nor speed says so."""
    part = slice(end, end + round(0.02 * channels.rate_Hz))
    if channels.depth_m is not None:
        speed = -float(np.polyfit(np.arange(part.stop - part.start) / channels.rate_Hz, channels.depth_m[part], 1)[0])
    else:
        speed = float(np.median(channels.speed_m_s[part])) if np.ptp(channels.speed_m_s) > 0.0 else 0.0
    return speed if speed > 0.0 else float("nan")


def _burst(channels: Streams, first: int, at: int, speed_m_s: float) -> MeasuredTap | None:
    """The decaying sinusoid that begins near a sample, louder than what was before and what is after; else None."""
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


def _fit_breakaway(parts: Sequence[Part], found: ContactFit) -> None:
    values, errors = [], []
    for channels, states in parts:
        pull = channels.tangential_force_N
        if pull is None:
            continue
        length = round(RINGS_S * channels.rate_Hz)
        for start, end in runs(states.states == InteractionState.STILL):
            if end + length >= len(pull) or states.states[end] != InteractionState.SLIDING:
                continue
            peak = slice(max(start, end - length // 2), end + length // 2)
            freed_N = float(pull[peak].max() - np.median(pull[end + length // 2 : end + length]))
            tap = _burst(channels, start, peak.start + int(pull[peak].argmax()), float("nan"))
            if tap is not None and freed_N > PULL_MIN * noise(pull, channels.rate_Hz):
                values.append(tap.value / [freed_N, 1.0, 1.0])
                errors.append(tap.error / [freed_N, 1.0, 1.0])
    if not values:
        recorded = any(channels.tangential_force_N is not None for channels, _ in parts)
        reason = "no vibration is heard as friction breaks loose"
        found.absent["breakaway_1_kg"] = reason if recorded else "the recording holds no tangential force"
        return
    mean, error = weighted_mean(np.array(values), np.array(errors))
    found.add(("breakaway_1_kg", "breakaway_Hz", "breakaway_decay_1_s"), mean, NORMAL_95 * error)
