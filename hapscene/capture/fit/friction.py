"""Fits friction coefficients with 95 % intervals to tangential and normal force."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.segment import BRIEF_S, InteractionState, SegmentedRecording, noise, runs
from hapscene.capture.io.streams import Array
from hapscene.errors import CaptureError
from hapscene.surface.swatch import FRICTION_MAX

__all__ = ["fit_friction", "no_sliding"]

BLOCK_S: Final = 0.05
"""Length of the blocks over which forces are averaged before the fit [s]."""

FINE: Final = 10
"""Parts of a block whose speeds are kept, because the Stribeck curve is not linear in the speed."""

STROKE_S: Final = 1.0
"""Longest stroke [s]; steady sliding is divided into strokes of this length."""

COMMON_ERROR: Final = 0.005
"""Relative standard error of dynamic friction that all strokes share [1]: they cross the same places, and friction may
rise below the recorded speeds. From simulated recordings."""

STROKES_MIN: Final = 4
"""Fewest strokes for a 95 % interval. Friction differs between strokes (place, direction, tilt), so the blocks of one
stroke are not independent: intervals from blocks contained the true value in 50 to 70 % of simulated recordings."""

EDGE_S: Final = 0.05
"""Time that is omitted at both ends of sliding [s], where the tool breaks away and comes to rest."""

SPEED_RANGE: Final = 3.0
"""Smallest ratio of highest to lowest speed at which a Stribeck curve is fitted [1]."""

CHANGE_MIN: Final = 0.03
"""Smallest relative growth of friction with speed that counts [1]; the JND is 11 %."""

DROP_MIN: Final = 0.05
"""Smallest relative decrease of friction with speed that counts [1]. Friction differs between places as well, and the
slow parts of strokes are often at the same places."""

FLAT: Final = 2.0
"""Smallest ratio of the highest speed to the Stribeck speed [1]; the Stribeck term is then 2 % of its value at rest."""

SCALES: Final = 24
"""Number of Stribeck speeds v_s that are tried; their spacing is 15 % if the speeds span a factor of 30."""

STRIBECK_MAX: Final = 0.7
"""Largest half-width of the 95 % interval of the logarithm of the Stribeck speed that counts as measured [1]."""

SEARCHED: Final = 1.25
"""Factor on the half-width of the logarithm of the Stribeck speed [1], since the speed is searched on a grid."""

STRIBECK_ERROR: Final = 0.05
"""Relative error of the Stribeck speed that all strokes share [1]: they cross the same places. With this and
`SEARCHED`, 95 % of the intervals of 1800 simulated recordings contained the true value, without them 90 %."""

BREAKAWAY_S: Final = (0.05, 0.005)
"""Time before and after the start of sliding in which the largest force ratio is searched [s]."""

PEAK_ERROR: Final = 0.02
"""Common relative standard error of the largest force ratios [1]: the low-pass lowers a sharp peak, noise raises it."""

STILL_S: Final = 0.05
"""Shortest rest before sliding that counts as a breakaway [s]."""

SAWTOOTH_S: Final = 0.03
"""Time before a slip over which the force ratio is fitted by a line [s]."""

GAP_S: Final = 0.005
"""Time that is omitted at both ends of that line [s], because the low-pass blurs them."""

BEGUN_S: Final = 0.0015
"""Uncertainty of the start of a slip [s], from simulated recordings."""

SLIP_S: Final = 0.15
"""Longest slip of stick–slip motion [s]; longer ones contain a complete block of sliding."""

SLIPS_MIN: Final = 5
"""Fewest slips that are treated as stick–slip motion."""


@dataclass(frozen=True)
class Friction:
    """Coefficients, 95 % intervals by name, reasons for missing coefficients, and a note on their origin."""

    static: float
    dynamic: float
    intervals: dict[str, tuple[float, float]]
    absent: dict[str, str]
    note: str = ""
    stribeck_m_s: float = 0.0
    viscous_s_m: float = 0.0


def fit_friction(recordings: Sequence[SegmentedRecording]) -> Friction:
    """Fits static and dynamic friction coefficients to recordings of one surface.

    Dynamic friction is the line through the origin with the smallest sum of absolute errors Σ |F_t − μ F_n| over blocks
    of sliding. This is the median of F_t/F_n weighted by F_n, which tolerates outliers in half of the blocks. No offset
    is fitted, because the range of forces in a stroke is too small to separate it from the slope.

    If the speeds span a factor of `SPEED_RANGE` and friction changes by `DROP_MIN` or `CHANGE_MIN`, the fit is
    μ(v) = μ_d + (μ_s − μ_d) exp(−(v/v_s)²) + μ_v v (Stribeck and viscous friction; Armstrong-Hélouvry, Dupont & Canudas
    de Wit 1994), with each term only if it is significant. Without μ_v, μ_d is the friction at the recorded speeds.

    Static friction is the median of the largest force ratios at breakaways from rest, or else that of the Stribeck
    curve, or else the dynamic coefficient. It is never below the dynamic one.

    If the tool only sticks and slips, static friction is the force ratio at the start of the slips, and dynamic
    friction the mean ratio over the slips, since the momentum of the tool is 0 before and after each.

    The intervals come from Student's t and the scatter between whole strokes, breakaways or slips (a jackknife that
    leaves out one stroke at a time). A quantity with too few of them has a reason instead of an interval.

    Raises:
        CaptureError: the coefficients exceed `FRICTION_MAX`.
    """
    recordings = [(channels, states) for channels, states in recordings if channels.tangential_force_N is not None]
    if not recordings:
        return _not_measured("neither the tangential force nor a friction ratio was recorded")
    blocks = _blocks(recordings)
    if len(blocks.ratio) < 3:
        slips = _slips(recordings)
        if len(slips) >= SLIPS_MIN:
            return _of_slips(slips)
        return _not_measured(
            f"the tool slides under a normal force for less than {3 * BLOCK_S:g} s plus {EDGE_S:g} s at each end, and "
            f"there are {len(slips)} stick–slip cycles (expected {SLIPS_MIN}; they need a recorded speed): record more "
            "strokes"
        )
    numbers, known, reason = _over_speed(blocks)
    dynamic, note = _slope(blocks), ""
    intervals = {"friction_dynamic": _of_strokes(blocks, dynamic)} | known if blocks.count >= STROKES_MIN else {}
    absent = {"friction_stribeck": reason} if reason else {}
    if not intervals:
        expected = f"expected at least {STROKES_MIN}, separated by rests or reversals"
        absent["friction_dynamic.interval"] = f"the recording has too few strokes ({blocks.count}; {expected})"
    dynamic = numbers.get("friction_dynamic", dynamic)
    static = numbers.get("friction_static", dynamic)
    if "friction_static" in numbers:
        note = f"Friction decreases with speed up to {1e3 * float(np.quantile(blocks.speed, 0.98)):.0f} mm/s."
    pulls = np.array(_breakaways(recordings))
    if len(pulls):
        static, note = _of_breakaways(pulls, dynamic, intervals, absent)
    elif "friction_static" not in numbers:
        absent["friction_static"] = "the tool never starts from rest in the recording; the dynamic coefficient is used"
    if static > FRICTION_MAX:
        raise CaptureError(
            f"friction coefficients {dynamic:.3g} and {static:.3g}; expected at most {FRICTION_MAX:g}: check units of "
            "both forces"
        )
    over_speed = (numbers.get(f"friction_{name}", 0.0) for name in ("stribeck_m_s", "viscous_s_m"))
    return Friction(static, dynamic, intervals, absent, note, *over_speed)


def _of_breakaways(
    pulls: Array, dynamic: float, intervals: dict[str, tuple[float, float]], absent: dict[str, str]
) -> tuple[float, str]:
    """Static friction of breakaways (n, 2), and its origin; `intervals` gets its interval, or `absent` a reason."""
    intervals.pop("friction_static", None)
    static = float(np.median(pulls[:, 0]))
    note = f"Static friction is the median of {len(pulls)} breakaway{'s' if len(pulls) > 1 else ''}."
    if static < dynamic:
        if "friction_dynamic" in intervals:
            intervals["friction_static"] = intervals["friction_dynamic"]
        else:
            absent["friction_static.interval"] = absent["friction_dynamic.interval"]
        return dynamic, f"{note} It was lower than dynamic friction, which is used instead."
    if len(pulls) >= STROKES_MIN:
        intervals["friction_static"] = _of_median(*pulls.T)
    else:
        absent["friction_static.interval"] = f"{len(pulls)} starts from rest (expected at least {STROKES_MIN})"
    return static, note


def _not_measured(reason: str) -> Friction:
    return Friction(0.0, 0.0, {}, {"friction_dynamic": reason, "friction_static": reason})


@dataclass(frozen=True)
class _Blocks:
    """m blocks of sliding: ratio of mean forces, mean normal force and speed (m,), speeds (m, FINE), stroke (m,)."""

    ratio: Array
    normal: Array
    speed: Array
    fine: Array
    stroke: NDArray[np.intp]

    @property
    def count(self) -> int:
        """Number of strokes."""
        return int(self.stroke[-1]) + 1


def _blocks(recordings: Sequence[SegmentedRecording]) -> _Blocks:
    """Blocks of all sliding; those with less than a tenth of the largest normal force are omitted."""
    rows, fine, strokes = [np.zeros((3, 0))], [np.zeros((0, FINE))], [np.zeros(0, np.intp)]
    for channels, states in recordings:
        assert channels.tangential_force_N is not None
        length, edge = round(BLOCK_S * channels.rate_Hz), round(EDGE_S * channels.rate_Hz)
        streams = np.stack([channels.tangential_force_N, channels.force_N, channels.speed_m_s])
        middle = ((np.arange(FINE) + 0.5) * length / FINE).astype(np.intp)
        for start, end in states.runs(InteractionState.SLIDING):
            # edges are omitted where the tool starts or stops, but not at the ends of the recording
            first = start + (edge if start > 0 else 0)
            last = end - (edge if end < streams.shape[1] else 0)
            count = (last - first) // length
            if count > 0:
                cut = streams[:, first : first + count * length].reshape(3, count, length)
                rows.append(np.abs(cut.mean(axis=2)))
                fine.append(cut[2][:, middle])
                strokes.append(_strokes(rows[-1][2]) + sum(int(each[-1]) + 1 for each in strokes if len(each)))
    tangential, normal, speed = np.concatenate(rows, axis=1)
    kept = normal > 0.1 * normal.max(initial=0.0)
    stroke = np.unique(np.concatenate(strokes)[kept], return_inverse=True)[1]
    return _Blocks((tangential[kept] / normal[kept]), normal[kept], speed[kept], np.concatenate(fine)[kept], stroke)


def _strokes(speed_m_s: Array) -> NDArray[np.intp]:
    """Number of the stroke (m,) of each block of a slide.

    A stroke ends where the speed falls below half of its maximum and rises to twice the minimum again, or after
    `STROKE_S`.
    """
    borders, top, low, lowest = [0], 0.0, np.inf, 0
    for i, speed in enumerate(speed_m_s.tolist()):
        if speed < low:
            low, lowest = speed, i
        if low < 0.5 * top and speed > 2.0 * low:
            borders.append(lowest)
            top, low = speed, speed
        elif speed > top:
            top, low = speed, speed
    made, most = np.zeros(len(speed_m_s), np.intp), round(STROKE_S / BLOCK_S)
    for first, last in pairwise([*borders, len(made)]):
        pieces = max(1, (last - first) // most)
        made[first:last] = made[first - 1] + 1 + np.arange(last - first) * pieces // (last - first)
    return np.asarray(made - made[0])


def _slope(blocks: _Blocks, chosen: slice | NDArray[np.bool_] = slice(None)) -> float:
    """Median of the force ratios, weighted by normal force."""
    ratio, normal = blocks.ratio[chosen], blocks.normal[chosen]
    order = np.argsort(ratio)
    weight = np.cumsum(normal[order])
    return float(ratio[order][np.searchsorted(weight, 0.5 * weight[-1])])


def _of_strokes(blocks: _Blocks, middle: float) -> tuple[float, float]:
    """95 % interval of the median by the scatter of the medians of strokes, weighted as the strokes are."""
    own = np.array([_slope(blocks, blocks.stroke == k) for k in range(blocks.count)])
    weight = np.bincount(blocks.stroke, blocks.normal) / blocks.normal.sum()
    freedom = max(1.0, 1.0 / float((weight**2).sum()) - 1.0)
    variance = float((weight**2 * (own - weight @ own) ** 2).sum()) * (freedom + 1.0) / freedom
    half = float(np.hypot(scipy.stats.t.ppf(0.975, freedom) * variance**0.5, 1.96 * COMMON_ERROR * middle))
    return middle - half, middle + half


def _over_speed(blocks: _Blocks) -> tuple[dict[str, float], dict[str, tuple[float, float]], str]:
    """Coefficients over speed and their intervals, if significant, and why there is no Stribeck curve.

    The law is linear except in v_s, which is chosen from a grid. All is repeated without each stroke (row 0: with all).
    """
    speed, count = blocks.speed, blocks.count
    slow, fast = np.quantile(speed, [0.02, 0.98])
    if reason := _why_not_over_speed(blocks, slow, fast):
        return {}, {}, reason
    scales = np.geomspace(max(0.5 * slow, 0.01 * fast), fast / FLAT, SCALES)
    counts = np.concatenate([np.ones((1, len(speed))), np.arange(count)[:, None] != blocks.stroke])
    weight, one = _robust_weight(blocks, scales), np.ones(len(speed))
    best = partial(_best_scale, blocks, counts, weight, scales)
    quantile = float(scipy.stats.t.ppf(0.975, count - 1))

    def half(values: Array) -> float:
        """Half-width of the 95 % interval of a coefficient (rows,)."""
        return quantile * float(np.sqrt((count - 1.0) * values[1:].var()))

    def is_significant(change: Array, whole: float, least: float) -> bool:
        """Whether the 95 % interval of a change is above 0 and the change large enough."""
        return bool(change[0] > half(change) and change[0] >= least * whole)

    usual = _slope(blocks)
    (level, viscous, drop), scale = best(one, speed)
    full, full_scale = {"friction_dynamic": level[0], "friction_viscous_s_m": viscous[0]}, scale[0]
    found = {"friction_viscous_s_m": viscous}
    if not is_significant(viscous * fast, usual, CHANGE_MIN):
        (level, drop), scale = best(one)
        found = {}
    slow_strokes = len(np.unique(blocks.stroke[speed < scale[0]]))
    if not is_significant(drop, usual, DROP_MIN):
        reason = f"friction does not decrease with speed between {1e3 * slow:.0f} and {1e3 * fast:.0f} mm/s"
    elif slow_strokes < STROKES_MIN:
        reason = (
            f"{slow_strokes} strokes are slower than {1e3 * scale[0]:.0f} mm/s for {1e3 * BLOCK_S:g} ms (expected at "
            f"least {STROKES_MIN}): record slower strokes"
        )
    elif scale.max() >= 0.99 * scales[-1] or half(np.log(scale)) > STRIBECK_MAX:
        reason = "friction decreases with speed, but differently in each stroke: record more and slower strokes"
    else:
        reason = ""
        found |= {"friction_dynamic": level, "friction_static": level + drop}
    if reason:
        level, viscous = _drawn(counts, weight, blocks.ratio, np.stack([one, speed]))[0].T
        grows = is_significant(viscous * fast, usual, CHANGE_MIN)
        found = {"friction_dynamic": level, "friction_viscous_s_m": viscous} if grows else {}
    numbers = {name: float(values[0]) for name, values in found.items()}
    common = 1.96 * COMMON_ERROR * usual  # of friction; of its slope over speed if both ends differ by it
    also = {"friction_dynamic": common, "friction_viscous_s_m": 2.0 * common / fast}
    intervals = {}
    for name, values in found.items():  # an omitted term changes the others: the difference is part of their error
        wide = np.linalg.norm([half(values), values[0] - full.get(name, values[0]), also.get(name, 0.0)])
        intervals[name] = numbers[name] - float(wide), numbers[name] + float(wide)
    if not reason:
        wide = np.linalg.norm([SEARCHED * half(np.log(scale)), np.log(scale[0] / full_scale), STRIBECK_ERROR])
        numbers["friction_stribeck_m_s"], factor = float(scale[0]), float(np.exp(wide))
        intervals["friction_stribeck_m_s"] = float(scale[0]) / factor, float(scale[0]) * factor
    return numbers, intervals, reason


def _why_not_over_speed(blocks: _Blocks, slow: float, fast: float) -> str:
    """Why the recording, with speeds from slow to fast, does not give coefficients over speed; "" if it does."""
    if np.ptp(blocks.speed) == 0.0:
        return "the speed was not recorded, or never changes"
    if len(blocks.speed) < 20 or fast < SPEED_RANGE * slow:
        return f"the highest speed is {fast / max(slow, 1e-9):.1f} times the lowest (expected {SPEED_RANGE:g})"
    few = f"the recording has too few strokes ({blocks.count}; expected at least {STROKES_MIN})"
    return few if blocks.count < STROKES_MIN else ""


def _robust_weight(blocks: _Blocks, scales: Array) -> Array:
    """Weight of each block (m,) from its distance to the curve that fits best."""
    plain = np.stack([blocks.ratio * blocks.normal, blocks.normal, blocks.speed])
    near = min((_curve(plain, v_s) for v_s in scales[::2]), key=lambda fit: fit[0])[1]
    finer = near * np.geomspace(0.75, 1.33, 19)  # the robust weights need an accurate curve
    return min((_curve(plain, v_s) for v_s in finer), key=lambda fit: fit[0])[2]


def _best_scale(blocks: _Blocks, counts: Array, weight: Array, scales: Array, *columns: Array) -> tuple[Array, Array]:
    """Coefficients (k, rows) of the columns and of the Stribeck term, and v_s of each row."""
    tried = scales
    for _ in range(2):  # the second grid refines the first between the neighbours of the best
        falls = np.exp(-((blocks.fine / tried[:, None, None]) ** 2)).mean(axis=2)
        of_all = [_drawn(counts, weight, blocks.ratio, np.stack([*columns, fall])) for fall in falls]
        at = np.argmin([error for _, error in of_all], axis=0)
        found = np.array([of_all[i][0][k] for k, i in enumerate(at)]).T, tried[at]
        low, high = tried[at].min() * scales[0] / scales[1], tried[at].max() * scales[1] / scales[0]
        tried = np.geomspace(low, high, 2 * SCALES)
    return found


def _drawn(counts: Array, weight: Array, ratio: Array, columns: Array) -> tuple[Array, Array]:
    """Weighted least squares for each row of counts (rows, m): coefficients (rows, k) of columns (k, m), and errors."""
    weighted, size = counts * weight**2, len(columns)
    products = (columns[:, None] * columns).reshape(size * size, -1)
    normal = (weighted @ products.T).reshape(-1, size, size)
    right = weighted @ (columns * ratio).T
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.diag((columns**2).mean(axis=1))
    found = np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0], np.float64)
    return found, np.asarray(weighted @ ratio**2 - (found * right).sum(axis=1))


def _curve(blocks: Array, scale_m_s: float) -> tuple[float, float, Array]:
    """Robust fit of a Stribeck curve with a given v_s: its error, v_s, and the Huber weights (m,)."""
    tangential, normal, speed = blocks
    ratio = tangential / normal
    matrix = np.stack([np.ones(len(ratio)), np.exp(-((speed / scale_m_s) ** 2))], axis=1)
    weight = np.sqrt(normal)
    away = np.zeros(len(ratio))
    for _ in range(8):
        found = np.linalg.lstsq(weight[:, None] * matrix, weight * ratio, rcond=None)[0]
        away = np.abs(ratio - matrix @ found)
        bound = 1.345 * 1.4826 * float(np.median(away)) + 1e-9
        weight = np.sqrt(normal * np.minimum(1.0, bound / np.maximum(away, 1e-12)))
    return float((normal * away).sum()), scale_m_s, weight


def _breakaways(recordings: Sequence[SegmentedRecording]) -> list[tuple[float, float]]:
    """Largest force ratio at each breakaway, and its standard deviation due to the noise of the forces."""
    pulls = []
    for channels, states in recordings:
        assert channels.tangential_force_N is not None
        rate, n = channels.rate_Hz, len(channels.force_N)
        tangential = np.abs(channels.tangential_force_N)
        before, after = (round(s * rate) for s in BREAKAWAY_S)
        least = 0.1 * float(channels.force_N.max())
        scatter = noise(channels.tangential_force_N, rate), noise(channels.force_N, rate)
        for still_start, still_end in runs(states.states == InteractionState.STILL):
            slides = still_end < n and states.states[still_end] == InteractionState.SLIDING
            if not slides or still_end - still_start < STILL_S * rate:
                continue
            first = max(still_start, still_end - before)
            begun = still_end
            if states.speed_on_m_s is not None:
                rest = channels.speed_rest_m_s
                calm = channels.speed_m_s[first:still_end] < rest + (states.speed_on_m_s - rest) / 3.0
                begun = first + int(np.flatnonzero(calm)[-1]) + 1 if np.any(calm) else begun
            part = slice(first, min(n, begun + after))
            pressed = channels.force_N[part] > least
            if not np.any(pressed):
                continue
            normal = channels.force_N[part][pressed]
            pull = float((tangential[part][pressed] / normal).max())
            pulls.append(
                (pull, float(np.hypot(PEAK_ERROR * pull, np.hypot(scatter[0], pull * scatter[1]) / np.median(normal))))
            )
    return pulls


def _slips(recordings: Sequence[SegmentedRecording]) -> list[tuple[float, float, float, float]]:
    """Stick–slip cycles: force ratio at breakaway, its uncertainty, mean ratio over the slip, fraction of rest in the
    slip.

    The speed of a slip is about half a period of a sine. The low-pass does not move the points of half the peak speed;
    the slip extends beyond them by a quarter of their distance at each end. If the detected start is early, the slip
    contains some rest, which biases the mean ratio.
    """
    found = []
    for channels, states in recordings:
        if states.speed_on_m_s is None or channels.tangential_force_N is None:
            continue
        rate, speed = channels.rate_Hz, channels.speed_m_s
        pressed = (states.states == InteractionState.STILL) | (states.states == InteractionState.SLIDING)
        gap, last_end = round(GAP_S * rate), -1
        for start, end in runs((speed > states.speed_on_m_s) & pressed):
            peak = 0.5 * float(speed[start:end].max())
            up, down = (start + int(at) for at in np.flatnonzero(speed[start:end] >= peak)[[0, -1]])
            begun, over = up - (down - up) // 4, down + (down - up) // 4
            rested = last_end >= 0 and begun - last_end >= 4 * gap and np.all(pressed[last_end:begun])
            if rested and end - start <= SLIP_S * rate:
                first = max(last_end + gap, begun - round((SAWTOOTH_S + GAP_S) * rate))
                line = slice(first, max(begun - gap, first + 2))
                ratio = np.abs(channels.tangential_force_N[line]) / np.maximum(channels.force_N[line], 1e-12)
                slope, pull = np.polyfit((np.arange(line.start, line.stop) - begun) / rate, ratio, 1).tolist()
                slip = slice(begun, over + 1)
                drag = np.abs(channels.tangential_force_N[slip]).sum() / channels.force_N[slip].sum()
                rest = 0.5 * BEGUN_S * rate / (over + 1 - begun)
                found.append((pull, abs(slope) * BEGUN_S, float(drag), rest))
            last_end = over
    return found


def no_sliding(recordings: Sequence[SegmentedRecording]) -> str:
    """Reason why the tool never slides although its speed was recorded, and what to record; else an empty text."""
    on = [states.speed_on_m_s for _, states in recordings if states.speed_on_m_s is not None]
    if not on:
        return ""
    if len(slips := _slips(recordings)) >= SLIPS_MIN:
        return (
            f"the motion is stick–slip ({len(slips)} slips) without sliding under a normal force for "
            f"{1e3 * BRIEF_S:g} ms: record faster strokes with less force"
        )
    fastest = max(float(channels.speed_m_s.max()) for channels, _ in recordings)
    return (
        f"the tool never slides under a normal force for {1e3 * BRIEF_S:g} ms: threshold {1e3 * min(on):.3g} mm/s, "
        f"the highest speed {1e3 * fastest:.3g} mm/s"
    )


def _of_slips(slips: list[tuple[float, float, float, float]]) -> Friction:
    """Friction coefficients of stick–slip motion."""
    pull, off, drag, rest = np.array(slips).T
    dynamic, static = float(np.median(drag)), float(np.median(pull))
    rested = _of_median(drag, rest * max(static - dynamic, 0.0))
    intervals = {"friction_static": _of_median(pull, off), "friction_dynamic": rested}
    note = f"Friction was measured on {len(slips)} stick–slip cycles."
    return Friction(
        max(static, dynamic), dynamic, intervals, {"friction_stribeck": "the tool never slides steadily"}, note
    )


def _of_median(values: Array, off: Array) -> tuple[float, float]:
    """95 % interval of a median of values (m,) by Student's t, plus their common uncertainty `off`."""
    middle, count = float(np.median(values)), len(values)
    error = np.sqrt(0.5 * np.pi / count) * float(np.std(values, ddof=1))
    half = float(np.hypot(scipy.stats.t.ppf(0.975, count - 1) * error, 1.96 * np.median(off)))
    return middle - half, middle + half
