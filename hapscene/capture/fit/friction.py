"""A fit of its own: friction coefficients from tangential and normal force, with their 95 % intervals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.segment import BRIEF_S, InteractionState, Part, noise, runs
from hapscene.capture.io.streams import HAND_CUTOFF_HZ, Array, Streams, filtered
from hapscene.errors import CaptureError
from hapscene.surface.swatch import FRICTION_MAX

__all__ = ["EDGE_S", "Friction", "fit_friction", "no_sliding"]

BLOCK_S: Final = 0.05
"""Time over which forces are averaged before anything is fitted [s]."""

CORRELATED: Final = 5
"""Neighbouring blocks that are drawn together for an interval [count]: what a hand does in a quarter of a second."""

DRAWS: Final = 400
"""Draws of the bootstrap [count]: the interval's ends are then known to a tenth of its width."""

EDGE_S: Final = 0.05
"""What is left out at both ends of a stretch of sliding [s]: the tool breaks away and comes to rest there."""

SPEED_RANGE: Final = 3.0
"""Least ratio of fast to slow sliding at which the Stribeck curve is looked for [1]."""

DROP_MIN: Final = 0.03
"""Least fall or rise of friction with speed, as a share, that counts [1]; 11 % is felt."""

SCALES: Final = 24
"""Speeds v_s that are tried for a Stribeck curve [count]: 15 % apart where speeds span 30 times."""

BREAKAWAY_S: Final = (0.05, 0.03)
"""How long before and after the beginning of a slide its largest pull is looked for, where it is no line [s]."""

STILL_S: Final = 0.05
"""Least time at rest before a slide that counts as breaking away [s]."""

PULL_S: Final = (0.045, 0.02)
"""Over how long before and after it breaks away a pull is taken for two parabolas [s]."""

LATE_S: Final = 0.003
"""Standard deviation of when a tool breaks away from when its speed tells so [s]; at most three of it."""

SAWTOOTH_S: Final = 0.03
"""Over how long before it slips a pull is taken for a line [s]."""

GAP_S: Final = 0.005
"""What of it is left out at both ends [s]: the low-pass mixes in what is beside it."""

BEGUN_S: Final = 0.0015
"""To how much the beginning of a slip is known [s]: those of simulated ones are found within it, mostly."""

SLIP_S: Final = 0.15
"""Longest slip of a tool that sticks and slips [s]: of longer ones a block remains between both edges."""

SLIPS_MIN: Final = 5
"""Fewest slips that are taken for sticking and slipping [count]."""


@dataclass(frozen=True)
class Friction:
    """Coefficients, 95 % intervals by name, what is absent and why, and a note on where they come from."""

    static: float
    dynamic: float
    intervals: dict[str, tuple[float, float]]
    absent: dict[str, str]
    note: str = ""
    stribeck_m_s: float = 0.0
    viscous_s_m: float = 0.0


def fit_friction(parts: Sequence[Part]) -> Friction:
    """Static and dynamic Coulomb coefficients of recordings of one surface.

    Dynamic: the line through the origin with the least sum of absolute errors, Σ |F_t − μ F_n|, over blocks of
    sliding; it is the median of F_t/F_n weighted by F_n, and half of the blocks may be outliers. A free offset is not
    fitted: the forces of a stroke span too little to tell it from the slope.
    Where the speeds span `SPEED_RANGE` and friction falls or grows by `DROP_MIN`, so surely that the interval excludes
    0: μ(v) = μ_d + (μ_s − μ_d) exp(−(v/v_s)²) + μ_v v (Stribeck and viscous; Armstrong-Hélouvry, Dupont & Canudas de
    Wit 1994), each part only where it is seen; dynamic is then μ_d, and static that at rest.
    Static: the pull as the tool breaks away from rest, the median over all such; without any that of the Stribeck
    curve; without that the dynamic one. Never below dynamic.
    A tool that sticks and slips, never sliding for as long as a block: static is the pull at each break, dynamic the
    mean pull over each slip, in which the tool gains no momentum.
    The intervals are those of a bootstrap over runs of neighbouring blocks; of breaks and slips, Student's.

    Raises:
        CaptureError: the coefficients are beyond `FRICTION_MAX`.
    """
    parts = [(channels, states) for channels, states in parts if channels.tangential_force_N is not None]
    if not parts:
        return _none("the recording holds no tangential force and no friction ratio")
    blocks = _blocks(parts)
    if blocks.shape[1] < 3:
        slips = _slips(parts)
        if len(slips) >= SLIPS_MIN:
            return _of_slips(slips)
        told = "its speed" if any(states.speed_on_m_s is not None for _, states in parts) else "no speed, which"
        return _none(
            f"the tool slides under a normal force for less than {3 * BLOCK_S:g} s, {EDGE_S:g} s at each end apart "
            f"({told} would tell slips too: {SLIPS_MIN} or more are needed, {len(slips)} are found)"
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
        note = f"Friction falls with speed, to {1e3 * float(np.quantile(blocks[2], 0.98)):.0f} mm/s."
    pulls = np.array(_breakaways(parts))
    if len(pulls):
        static = float(np.median(pulls[:, 0]))
        intervals.pop("friction_static", None)
        if len(pulls) >= 3:
            intervals["friction_static"] = _of_median(*pulls.T)
        note = f"Static friction is that of {len(pulls)} starts from rest."
        if static < dynamic:
            static = dynamic
            note += " They give less than sliding does, whose is taken."
            intervals["friction_static"] = intervals["friction_dynamic"]
    elif reason:
        absent["friction_static"] = "the tool never starts from rest in the recording: the dynamic coefficient is taken"
    if max(static, dynamic) > FRICTION_MAX:
        raise CaptureError(f"friction coefficients of {dynamic:.3g} and {static:.3g}: are both forces in newtons?")
    over_speed = (numbers.get(f"friction_{name}", 0.0) for name in ("stribeck_m_s", "viscous_s_m"))
    return Friction(max(static, dynamic), dynamic, intervals, absent, note, *over_speed)


def _none(reason: str) -> Friction:
    return Friction(0.0, 0.0, {}, {"friction_dynamic": reason, "friction_static": reason})


def _blocks(parts: Sequence[Part]) -> Array:
    """Mean tangential and normal force and speed, as magnitudes, and the speed's variance (4, m), of all blocks of
    sliding that are pressed with a tenth of the largest force or more.

    The variance is that of a speed that changes evenly, from its two halves, so that its noise is not in it.
    """
    rows = []
    for channels, states in parts:
        assert channels.tangential_force_N is not None
        length, edge = max(1, round(BLOCK_S * channels.rate_Hz)), round(EDGE_S * channels.rate_Hz)
        streams = np.stack([channels.tangential_force_N, channels.force_N, channels.speed_m_s])
        for start, end in states.runs(InteractionState.SLIDING):
            # only where the tool starts or stops: the ends of the recording are none
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
    """Indices (DRAWS, count) of a bootstrap that draws neighbours together."""
    together = min(CORRELATED, max(1, count // 3))
    rng = np.random.default_rng(0)
    first = rng.integers(0, count, (DRAWS, -(-count // together)))
    return ((first[:, :, None] + np.arange(together)).reshape(DRAWS, -1) % count)[:, :count]


def _slope(blocks: Array) -> float:
    """The weighted median of the ratios."""
    tangential, normal = blocks[:2]
    ratio = tangential / normal
    order = np.argsort(ratio)
    weight = np.cumsum(normal[order])
    return float(ratio[order][np.searchsorted(weight, 0.5 * weight[-1])])


def _over_speed(blocks: Array, draws: NDArray[np.intp], dynamic: float) -> tuple[dict[str, Array], str]:
    """Coefficients by name, as drawn (draws,), and why friction does not fall, or "".

    The law is linear but for v_s, of which each draw has the best of `SCALES`. The curve bends within a block in
    which the speed changes: to second order its mean is taken.
    """
    tangential, normal, speed, spread = blocks
    slow, fast = np.quantile(speed, [0.02, 0.98])
    if np.ptp(speed) == 0.0:
        return {}, "the speed was not recorded, or never changes"
    if len(speed) < 20 or fast < SPEED_RANGE * slow:
        return {}, f"the speeds span {fast / max(slow, 1e-9):.1f} times, and {SPEED_RANGE:g} are needed"
    scales = np.geomspace(max(slow, 0.02 * fast), fast / 1.5, SCALES)
    near = min((_curve(blocks[:3], v_s) for v_s in scales[::2]), key=lambda fit: fit[0])[1]
    finer = near * np.geomspace(0.75, 1.33, 19)  # weights about a curve that is off would pull to it
    weight = min((_curve(blocks[:3], v_s) for v_s in finer), key=lambda fit: fit[0])[2]
    counts = np.stack([np.bincount(draw, minlength=len(speed)) for draw in draws]).astype(np.float64)
    ratio, one = tangential / normal, np.ones(len(speed))

    def best(*columns: Array) -> tuple[Array, Array]:
        """Coefficients (k, draws) of columns and of the fall, and each draw's v_s."""
        tried = scales
        for _ in range(2):  # then between the two beside the best: what is told may not be a step of the grid
            place = (speed / tried[:, None]) ** 2
            falls = np.exp(-place) * (1.0 + spread * (2.0 * place - 1.0) / tried[:, None] ** 2)
            of_all = [_drawn(counts, weight, ratio, np.stack([*columns, fall])) for fall in falls]
            at = np.argmin([error for _, error in of_all], axis=0)
            found = np.array([of_all[i][0][k] for k, i in enumerate(at)]).T, tried[at]
            low, high = np.quantile(tried[at], [0.02, 0.98]) / [scales[1] / scales[0], scales[0] / scales[1]]
            tried = np.geomspace(low, high, 2 * SCALES)
        return found

    def counts_for(change: Array, whole: Array) -> bool:
        """Whether a change as drawn is surely above 0, and large enough."""
        return bool(np.quantile(change, 0.025) > 0.0 and np.median(change) >= DROP_MIN * np.median(whole))

    (level, viscous, drop), scale = best(one, speed)
    found = {"friction_viscous_s_m": viscous}
    if not counts_for(viscous * fast, np.array(dynamic)):
        (level, drop), scale = best(one)
        found = {}
    if counts_for(drop, level) and level.min() > 0.0:
        found |= {"friction_dynamic": level, "friction_static": level + drop, "friction_stribeck_m_s": scale}
        return found, ""
    reason = f"friction does not fall with speed between {1e3 * slow:.0f} and {1e3 * fast:.0f} mm/s"
    level, viscous = _drawn(counts, weight, ratio, np.stack([one, speed]))[0].T
    grows = counts_for(viscous * fast, np.array(dynamic))
    return {"friction_dynamic": level, "friction_viscous_s_m": viscous} if grows else {}, reason


def _drawn(counts: Array, weight: Array, ratio: Array, columns: Array) -> tuple[Array, Array]:
    """Coefficients (draws, k) of columns (k, m) for each draw, blocks counted (draws, m), and the squares left."""
    weighted, size = counts * weight**2, len(columns)
    products = (columns[:, None] * columns).reshape(size * size, -1)
    normal = (weighted @ products.T).reshape(-1, size, size)
    right = weighted @ (columns * ratio).T
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.diag((columns**2).mean(axis=1))
    found = np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0], np.float64)
    return found, np.asarray(weighted @ ratio**2 - (found * right).sum(axis=1))


def _curve(blocks: Array, scale_m_s: float) -> tuple[float, float, Array]:
    """Robust error, the scale, and the weights (m,) of the best curve of that scale: Huber's, reweighted."""
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


def _breakaways(parts: Sequence[Part]) -> list[tuple[float, float]]:
    """The ratio of the forces at each start from rest, and what its time, hardly known, makes of it.

    It is the end of the parabola before it: two of them, low-passed as the forces are, are laid through the pull before
    and after; where they do not fit most, as not to jerks, the largest over 10 ms is taken.
    """
    pulls: list[tuple[float, float]] = []
    jerks: list[tuple[float, float]] = []
    for channels, states in parts:
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
    """The ratio of the forces as a tool breaks away about `begun`, how fast it grew [1/s], what is left (rms)."""
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
    apart = 2.0 * HAND_CUTOFF_HZ * sum(PULL_S)  # samples that the low-pass leaves independent
    likelihood = (left / max(left.min(), 1e-12)) ** (-0.5 * apart)
    likelihood *= np.exp(-0.5 * (np.arange(-late, late + 1) / (LATE_S * rate)) ** 2)
    likelihood /= likelihood.sum()
    return abs(float(likelihood @ found[0])), float(likelihood @ found[1]), float(np.sqrt(left.min()))


def _slips(parts: Sequence[Part]) -> list[tuple[float, float, float, float]]:
    """Of each slip after a rest: the ratio of the forces as it breaks, what its time makes of it, that over the slip,
    and the share of rest that may be in it: one that begins early by δ has δ of it, one that begins late has none.

    The speed of a slip is about half a sine: its ends are a sixth of it beyond where it has half its peak, which the
    low-pass leaves where they were.
    """
    found = []
    for channels, states in parts:
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


def no_sliding(parts: Sequence[Part]) -> str:
    """Why a tool whose speed was recorded never slides, and what would; else nothing."""
    on = [states.speed_on_m_s for _, states in parts if states.speed_on_m_s is not None]
    if not on:
        return ""
    if len(slips := _slips(parts)) >= SLIPS_MIN:
        what = f"the tool sticks and slips, {len(slips)} times: it never slides under a normal force"
        return f"{what} for {1e3 * BRIEF_S:g} ms on end; a faster stroke or a lighter hand would"
    fastest = max(float(channels.speed_m_s.max()) for channels, _ in parts)
    return (
        f"the tool never slides under a normal force for {1e3 * BRIEF_S:g} ms on end: that is told from "
        f"{1e3 * min(on):.3g} mm/s on, and speed_m_s is {1e3 * fastest:.3g} mm/s at most"
    )


def _of_slips(slips: list[tuple[float, float, float, float]]) -> Friction:
    """Coefficients of a tool that sticks and slips."""
    pull, off, drag, rest = np.array(slips).T
    dynamic, static = float(np.median(drag)), float(np.median(pull))
    rested = _of_median(drag, rest * max(static - dynamic, 0.0))
    intervals = {"friction_static": _of_median(pull, off), "friction_dynamic": rested}
    note = f"The tool sticks and slips: friction is that of {len(slips)} slips."
    return Friction(max(static, dynamic), dynamic, intervals, {"friction_stribeck": "the tool never slides on"}, note)


def _of_median(values: Array, off: Array) -> tuple[float, float]:
    """The 95 % interval of a median (m,), by Student's t, and of what all values may be off together."""
    middle, count = float(np.median(values)), len(values)
    error = np.sqrt(0.5 * np.pi / count) * float(np.std(values, ddof=1))
    half = float(np.hypot(scipy.stats.t.ppf(0.975, count - 1) * error, 1.96 * np.median(off)))
    return middle - half, middle + half


def _interval(values: Array) -> tuple[float, float]:
    """Between the quantiles at 2.5 and 97.5 % of a bootstrap's values (m,)."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)
