"""Fits friction coefficients with 95 % intervals to tangential and normal force."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.segment import BRIEF_S, InteractionState, SegmentedRecording, noise, runs
from hapscene.capture.io.streams import HAND_CUTOFF_HZ, Array, Streams, filtered
from hapscene.errors import CaptureError
from hapscene.surface.swatch import FRICTION_MAX

__all__ = ["EDGE_S", "Friction", "fit_friction", "no_sliding"]

BLOCK_S: Final = 0.05
"""Length of the blocks over which forces are averaged before the fit [s]."""

CORRELATED: Final = 5
"""Neighbouring blocks that the bootstrap draws together; hand motion is correlated over a quarter of a second."""

DRAWS: Final = 400
"""Number of bootstrap samples; the ends of the intervals are then accurate to a tenth of their width."""

EDGE_S: Final = 0.05
"""Time that is omitted at both ends of sliding [s], where the tool breaks away and comes to rest."""

SPEED_RANGE: Final = 3.0
"""Smallest ratio of highest to lowest speed at which a Stribeck curve is fitted [1]."""

DROP_MIN: Final = 0.03
"""Smallest relative change of friction with speed that counts [1]; the JND is 11 %."""

SCALES: Final = 24
"""Number of Stribeck speeds v_s that are tried; their spacing is 15 % if the speeds span a factor of 30."""

BREAKAWAY_S: Final = (0.05, 0.03)
"""Time before and after the start of sliding in which the largest force ratio of an abrupt start is searched [s]."""

STILL_S: Final = 0.05
"""Shortest rest before sliding that counts as a breakaway [s]."""

PULL_S: Final = (0.045, 0.02)
"""Time before and after a breakaway over which the force ratio is fitted by two parabolas [s]."""

LATE_S: Final = 0.003
"""Standard deviation of the time of breakaway about the time that the speed indicates [s]; limited to three times this
value."""

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

    If the speeds span a factor of `SPEED_RANGE` and friction changes significantly by at least `DROP_MIN`, the fit is
    μ(v) = μ_d + (μ_s − μ_d) exp(−(v/v_s)²) + μ_v v (Stribeck and viscous friction; Armstrong-Hélouvry, Dupont & Canudas
    de Wit 1994), with each term only if it is significant.

    Static friction is the median force ratio at breakaways from rest, or else that of the Stribeck curve, or else the
    dynamic coefficient. It is never below the dynamic one.

    If the tool only sticks and slips, static friction is the force ratio at the start of the slips, and dynamic
    friction the mean ratio over the slips, since the momentum of the tool is 0 before and after each.

    The intervals come from a bootstrap over runs of neighbouring blocks, and from Student's t for breakaways and slips.

    Raises:
        CaptureError: the coefficients exceed `FRICTION_MAX`.
    """
    recordings = [(channels, states) for channels, states in recordings if channels.tangential_force_N is not None]
    if not recordings:
        return _not_measured("neither the tangential force nor a friction ratio was recorded")
    blocks = _blocks(recordings)
    if blocks.shape[1] < 3:
        slips = _slips(recordings)
        if len(slips) >= SLIPS_MIN:
            return _of_slips(slips)
        return _not_measured(
            f"the tool slides under a normal force for less than {3 * BLOCK_S:g} s plus {EDGE_S:g} s at each end, and "
            f"there are {len(slips)} stick–slip cycles (expected {SLIPS_MIN}; they need a recorded speed): record more "
            "strokes"
        )
    draws = _draws(blocks.shape[1])
    dynamic, absent, note = _slope(blocks), {}, ""
    intervals = {"friction_dynamic": _interval(np.array([_slope(blocks[:, draw]) for draw in draws]))}
    drawn, reason = _over_speed(blocks, draws, dynamic)
    if reason:
        absent["friction_stribeck"] = reason
    intervals |= {name: _interval(values) for name, values in drawn.items()}
    numbers = {name: float(np.median(values)) for name, values in drawn.items()}
    dynamic = numbers.get("friction_dynamic", dynamic)
    static = numbers.get("friction_static", dynamic)
    if "friction_static" in numbers:
        note = f"Friction decreases with speed up to {1e3 * float(np.quantile(blocks[2], 0.98)):.0f} mm/s."
    pulls = np.array(_breakaways(recordings))
    if len(pulls):
        static = float(np.median(pulls[:, 0]))
        intervals.pop("friction_static", None)
        if len(pulls) >= 3:
            intervals["friction_static"] = _of_median(*pulls.T)
        note = f"Static friction is the median of {len(pulls)} breakaways."
        if static < dynamic:
            static = dynamic
            note += " It was lower than dynamic friction, which is used instead."
            intervals["friction_static"] = intervals["friction_dynamic"]
    elif reason:
        absent["friction_static"] = "the tool never starts from rest in the recording; the dynamic coefficient is used"
    if max(static, dynamic) > FRICTION_MAX:
        raise CaptureError(
            f"friction coefficients {dynamic:.3g} and {static:.3g}; expected at most {FRICTION_MAX:g}: check units of "
            "both forces"
        )
    over_speed = (numbers.get(f"friction_{name}", 0.0) for name in ("stribeck_m_s", "viscous_s_m"))
    return Friction(max(static, dynamic), dynamic, intervals, absent, note, *over_speed)


def _not_measured(reason: str) -> Friction:
    return Friction(0.0, 0.0, {}, {"friction_dynamic": reason, "friction_static": reason})


def _blocks(recordings: Sequence[SegmentedRecording]) -> Array:
    """Magnitudes of mean tangential force, normal force and speed, and the variance of the speed (4, m), per block.

    Blocks with less than a tenth of the largest normal force are omitted. The variance is that of a linear change
    between the halves of a block, which excludes noise.
    """
    rows = []
    for channels, states in recordings:
        assert channels.tangential_force_N is not None
        length, edge = max(1, round(BLOCK_S * channels.rate_Hz)), round(EDGE_S * channels.rate_Hz)
        streams = np.stack([channels.tangential_force_N, channels.force_N, channels.speed_m_s])
        for start, end in states.runs(InteractionState.SLIDING):
            # edges are omitted where the tool starts or stops, but not at the ends of the recording
            first = start + (edge if start > 0 else 0)
            last = end - (edge if end < streams.shape[1] else 0)
            count = (last - first) // length
            if count > 0:
                cut = streams[:, first : first + count * length].reshape(3, count, length)
                halves = [half.mean(axis=1) for half in np.array_split(cut[2], 2, axis=1)]
                rows.append(np.concatenate([np.abs(cut.mean(axis=2)), [(halves[1] - halves[0]) ** 2 / 3.0]]))
    blocks = np.concatenate(rows, axis=1) if rows else np.zeros((4, 0))
    return blocks[:, blocks[1] > 0.1 * blocks[1].max(initial=0.0)]


def _draws(count: int) -> NDArray[np.intp]:
    """Indices (DRAWS, count) of a block bootstrap."""
    together = min(CORRELATED, max(1, count // 3))
    rng = np.random.default_rng(0)
    first = rng.integers(0, count, (DRAWS, -(-count // together)))
    return ((first[:, :, None] + np.arange(together)).reshape(DRAWS, -1) % count)[:, :count]


def _slope(blocks: Array) -> float:
    """Median of the force ratios, weighted by normal force."""
    tangential, normal = blocks[:2]
    ratio = tangential / normal
    order = np.argsort(ratio)
    weight = np.cumsum(normal[order])
    return float(ratio[order][np.searchsorted(weight, 0.5 * weight[-1])])


def _over_speed(blocks: Array, draws: NDArray[np.intp], dynamic: float) -> tuple[dict[str, Array], str]:
    """Bootstrap samples (draws,) of the coefficients of the Stribeck curve by name, and a reason if there is no curve.

    The law is linear except in v_s, which is chosen from a grid for each bootstrap sample. Within a block the speed may
    change; the mean of the curve over the block is approximated to second order.
    """
    tangential, normal, speed, spread = blocks
    slow, fast = np.quantile(speed, [0.02, 0.98])
    if np.ptp(speed) == 0.0:
        return {}, "the speed was not recorded, or never changes"
    if len(speed) < 20 or fast < SPEED_RANGE * slow:
        return (
            {},
            f"the highest speed is {fast / max(slow, 1e-9):.1f} times the lowest; expected at least {SPEED_RANGE:g}",
        )
    scales = np.geomspace(max(slow, 0.02 * fast), fast / 1.5, SCALES)
    near = min((_curve(blocks[:3], v_s) for v_s in scales[::2]), key=lambda fit: fit[0])[1]
    finer = near * np.geomspace(0.75, 1.33, 19)  # the robust weights need an accurate curve
    weight = min((_curve(blocks[:3], v_s) for v_s in finer), key=lambda fit: fit[0])[2]
    counts = np.stack([np.bincount(draw, minlength=len(speed)) for draw in draws]).astype(np.float64)
    ratio, one = tangential / normal, np.ones(len(speed))

    def best(*columns: Array) -> tuple[Array, Array]:
        """Coefficients (k, draws) of the columns and of the Stribeck term, and v_s of each draw."""
        tried = scales
        for _ in range(2):  # the second grid refines the first between the neighbours of the best
            place = (speed / tried[:, None]) ** 2
            falls = np.exp(-place) * (1.0 + spread * (2.0 * place - 1.0) / tried[:, None] ** 2)
            of_all = [_drawn(counts, weight, ratio, np.stack([*columns, fall])) for fall in falls]
            at = np.argmin([error for _, error in of_all], axis=0)
            found = np.array([of_all[i][0][k] for k, i in enumerate(at)]).T, tried[at]
            low, high = np.quantile(tried[at], [0.02, 0.98]) / [scales[1] / scales[0], scales[0] / scales[1]]
            tried = np.geomspace(low, high, 2 * SCALES)
        return found

    def is_significant(change: Array, whole: Array) -> bool:
        """Whether the 95 % interval of a change is above 0 and the change large enough."""
        return bool(np.quantile(change, 0.025) > 0.0 and np.median(change) >= DROP_MIN * np.median(whole))

    (level, viscous, drop), scale = best(one, speed)
    found = {"friction_viscous_s_m": viscous}
    if not is_significant(viscous * fast, np.array(dynamic)):
        (level, drop), scale = best(one)
        found = {}
    if is_significant(drop, level) and level.min() > 0.0:
        found |= {"friction_dynamic": level, "friction_static": level + drop, "friction_stribeck_m_s": scale}
        return found, ""
    reason = f"friction does not decrease with speed between {1e3 * slow:.0f} and {1e3 * fast:.0f} mm/s"
    level, viscous = _drawn(counts, weight, ratio, np.stack([one, speed]))[0].T
    grows = is_significant(viscous * fast, np.array(dynamic))
    return {"friction_dynamic": level, "friction_viscous_s_m": viscous} if grows else {}, reason


def _drawn(counts: Array, weight: Array, ratio: Array, columns: Array) -> tuple[Array, Array]:
    """Weighted least squares for each draw: coefficients (draws, k) of columns (k, m), and squared errors (draws,)."""
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
    """Force ratio at each breakaway, and its uncertainty due to that of the time of breakaway.

    Two parabolas, low-passed as the forces are, are fitted to the force ratio before and after the breakaway; the ratio
    is the end of the first one. If they fit less than a third of the breakaways, which are then abrupt, the largest
    ratio over 10 ms is used.
    """
    pulls: list[tuple[float, float]] = []
    jerks: list[tuple[float, float]] = []
    for channels, states in recordings:
        assert channels.tangential_force_N is not None
        rate, n = channels.rate_Hz, len(channels.force_N)
        length = max(1, round(0.01 * rate))
        tangential = np.abs(scipy.ndimage.uniform_filter1d(channels.tangential_force_N, length))
        normal = scipy.ndimage.uniform_filter1d(channels.force_N, length)
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
            part = slice(first, min(n, still_end + after))
            pressed = normal[part] > least
            if not np.any(pressed):
                continue
            level = float(np.median(channels.force_N[part][pressed]))
            pull, slope, left = _broken(channels, begun)
            if left <= 3.0 * np.hypot(scatter[0], pull * scatter[1]) / level + 1e-9:
                pulls.append((pull, abs(slope) * LATE_S))
            else:
                jerks.append((float((tangential[part][pressed] / normal[part][pressed]).max()), 0.0))
    return pulls if len(pulls) > len(jerks) // 2 else jerks


def _broken(channels: Streams, begun: int) -> tuple[float, float, float]:
    """Force ratio at a breakaway near sample `begun`, its slope before it [1/s], and the rms residual of the fit."""
    assert channels.tangential_force_N is not None
    rate = channels.rate_Hz
    before, after, margin, late = (round(s * rate) for s in (*PULL_S, 0.06, 3.0 * LATE_S))
    first, last = begun - late - before, begun + late + after
    if first < 0 or last > len(channels.force_N) or np.any(channels.force_N[first:last] <= 0.0):
        return 0.0, 0.0, np.inf
    t_s = np.arange(-before - margin, after + margin) / rate
    halves = [np.where(side, t_s**k, 0.0) for side in (t_s < 0.0, t_s >= 0.0) for k in range(3)]
    models = filtered(np.stack(halves), rate, HAND_CUTOFF_HZ, "lowpass")[:, margin:-margin]
    ratio = channels.tangential_force_N[first:last] / channels.force_N[first:last]
    windows = np.lib.stride_tricks.sliding_window_view(ratio, before + after)
    found = np.linalg.lstsq(models.T, windows.T, rcond=None)[0]
    left = np.mean((found.T @ models - windows) ** 2, axis=1)
    apart = 2.0 * HAND_CUTOFF_HZ * sum(PULL_S)  # independent samples after the low-pass
    likelihood = (left / max(left.min(), 1e-12)) ** (-0.5 * apart)
    likelihood *= np.exp(-0.5 * (np.arange(-late, late + 1) / (LATE_S * rate)) ** 2)
    likelihood /= likelihood.sum()
    return abs(float(likelihood @ found[0])), float(likelihood @ found[1]), float(np.sqrt(left.min()))


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


def _interval(values: Array) -> tuple[float, float]:
    """95 % interval of bootstrap values (m,), by quantiles."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)
