"""A fit of its own: friction coefficients from tangential and normal force, with their 95 % intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.segment import InteractionState, Segmentation, runs
from hapscene.capture.streams import Array, Streams
from hapscene.errors import CaptureError
from hapscene.surface.swatch import FRICTION_MAX

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
"""How long before and after the beginning of a slide its largest pull is looked for [s]."""

STILL_S: Final = 0.05
"""Least time at rest before a slide that counts as breaking away [s]."""


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


@dataclass(frozen=True)
class _OverSpeed:
    """Coefficients as drawn (draws,), empty where there is none, and why friction does not fall."""

    dynamic: Array = field(default_factory=lambda: np.zeros(0))
    static: Array = field(default_factory=lambda: np.zeros(0))
    stribeck_m_s: Array = field(default_factory=lambda: np.zeros(0))
    viscous_s_m: Array = field(default_factory=lambda: np.zeros(0))
    reason: str = ""


def fit_friction(parts: Sequence[tuple[Streams, Segmentation]]) -> Friction:
    """Static and dynamic Coulomb coefficients of recordings of one surface.

    Dynamic: the line through the origin with the least sum of absolute errors, Σ |F_t − μ F_n|, over blocks of
    sliding; it is the median of F_t/F_n weighted by F_n, and half of the blocks may be outliers. A free offset is not
    fitted: the forces of a stroke span too little to tell it from the slope.
    Where the speeds span `SPEED_RANGE` and friction falls or grows by `DROP_MIN`, so surely that the interval excludes
    0: μ(v) = μ_d + (μ_s − μ_d) exp(−(v/v_s)²) + μ_v v (Stribeck and viscous; Armstrong-Hélouvry, Dupont & Canudas de
    Wit 1994), each part only where it is seen; dynamic is then μ_d, and static that at rest.
    Static: the largest pull as the tool breaks away from rest, the median over all such; without any that of the
    Stribeck curve; without that the dynamic one. Never below dynamic.
    The intervals are those of a bootstrap over runs of neighbouring blocks.

    Raises:
        CaptureError: the coefficients are beyond `FRICTION_MAX`.
    """
    parts = [(channels, states) for channels, states in parts if channels.tangential_force_N is not None]
    if not parts:
        return _none("the recording holds no tangential force and no friction ratio")
    blocks = _blocks(parts)
    if blocks.shape[1] < 3:
        return _none(f"the tool slides under a normal force for less than {3 * BLOCK_S:g} s")
    draws = _draws(blocks.shape[1])
    dynamic = _slope(blocks)
    intervals = {"friction_dynamic": interval(np.array([_slope(blocks[:, draw]) for draw in draws]))}
    static, absent, note = dynamic, {}, ""
    law = _over_speed(blocks, draws, dynamic)
    if law.reason:
        absent["friction_stribeck"] = law.reason
    numbers = {"friction_dynamic": law.dynamic, "friction_static": law.static}
    numbers |= {"friction_stribeck_m_s": law.stribeck_m_s, "friction_viscous_s_m": law.viscous_s_m}
    intervals |= {name: interval(drawn) for name, drawn in numbers.items() if len(drawn)}
    if len(law.dynamic):
        static = dynamic = float(np.median(law.dynamic))
    if len(law.static):
        static, fast = float(np.median(law.static)), 1e3 * float(np.quantile(blocks[2], 0.98))
        note = f"Friction falls with speed, to {fast:.0f} mm/s."
    stribeck, viscous = (
        float(np.median(drawn)) if len(drawn) else 0.0 for drawn in (law.stribeck_m_s, law.viscous_s_m)
    )
    pulls = np.array(_breakaways(parts))
    if len(pulls):
        static = max(dynamic, float(np.median(pulls)))
        intervals.pop("friction_static", None)
        if len(pulls) >= 3:
            chosen = np.random.default_rng(0).integers(0, len(pulls), (DRAWS, len(pulls)))
            intervals["friction_static"] = interval(np.median(pulls[chosen], axis=1))
        note = f"Static friction is that of {len(pulls)} starts from rest."
    elif law.reason:
        absent["friction_static"] = "the tool never starts from rest in the recording: the dynamic coefficient is taken"
    if max(static, dynamic) > FRICTION_MAX:
        raise CaptureError(f"friction coefficients of {dynamic:.3g} and {static:.3g}: are both forces in newtons?")
    return Friction(max(static, dynamic), dynamic, intervals, absent, note, stribeck, viscous)


def _none(reason: str) -> Friction:
    return Friction(0.0, 0.0, {}, {"friction_dynamic": reason, "friction_static": reason})


def _blocks(parts: Sequence[tuple[Streams, Segmentation]]) -> Array:
    """Mean tangential and normal force and speed (3, m), as magnitudes, of all blocks of sliding, pressed with a tenth
    of the largest force or more."""
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
                rows.append(np.abs(cut.mean(axis=2)))
    blocks = np.concatenate(rows, axis=1) if rows else np.zeros((3, 0))
    return blocks[:, blocks[1] > 0.1 * blocks[1].max(initial=0.0)]


def _draws(count: int) -> NDArray[np.intp]:
    """Indices (DRAWS, count) of a bootstrap that draws neighbours together."""
    together = min(CORRELATED, max(1, count // 3))
    rng = np.random.default_rng(0)
    first = rng.integers(0, count, (DRAWS, -(-count // together)))
    return ((first[:, :, None] + np.arange(together)).reshape(DRAWS, -1) % count)[:, :count]


def _slope(blocks: Array) -> float:
    """The weighted median of the ratios."""
    tangential, normal, _ = blocks
    ratio = tangential / normal
    order = np.argsort(ratio)
    weight = np.cumsum(normal[order])
    return float(ratio[order][np.searchsorted(weight, 0.5 * weight[-1])])


def _over_speed(blocks: Array, draws: NDArray[np.intp], dynamic: float) -> _OverSpeed:
    """How friction goes with speed, by a law that is linear but for v_s: for each draw the best of `SCALES`."""
    tangential, normal, speed = blocks
    slow, fast = np.quantile(speed, [0.02, 0.98])
    if np.ptp(speed) == 0.0:
        return _OverSpeed(reason="the speed was not recorded, or never changes")
    if len(speed) < 20 or fast < SPEED_RANGE * slow:
        return _OverSpeed(reason=f"the speeds span {fast / max(slow, 1e-9):.1f} times, and {SPEED_RANGE:g} are needed")
    scales = np.geomspace(max(slow, 0.02 * fast), fast / 1.5, SCALES)
    weight = min((_curve(blocks, v_s) for v_s in scales[::2]), key=lambda fit: fit[0])[2]
    counts = np.stack([np.bincount(draw, minlength=len(speed)) for draw in draws]).astype(np.float64)
    ratio, one = tangential / normal, np.ones(len(speed))

    def best(*columns: Array) -> tuple[Array, Array]:
        """Coefficients (k, draws) of columns and of the fall, and each draw's v_s."""
        falls = np.exp(-((speed / scales[:, None]) ** 2))
        of_all = [_drawn(counts, weight, ratio, np.stack([*columns, fall])) for fall in falls]
        at = np.argmin([error for _, error in of_all], axis=0)
        return np.array([of_all[i][0][k] for k, i in enumerate(at)]).T, scales[at]

    (level, viscous, drop), scale = best(one, speed)
    if not (np.quantile(viscous, 0.025) > 0.0 and np.median(viscous) * fast >= DROP_MIN * dynamic):
        (level, drop), scale = best(one)
        viscous = np.zeros(0)
    if np.quantile(drop, 0.025) > 0.0 and np.median(drop) >= DROP_MIN * np.median(level) and level.min() > 0.0:
        return _OverSpeed(level, level + drop, scale, viscous)
    reason = f"friction does not fall with speed between {1e3 * slow:.0f} and {1e3 * fast:.0f} mm/s"
    level, viscous = _drawn(counts, weight, ratio, np.stack([one, speed]))[0].T
    if not (np.quantile(viscous, 0.025) > 0.0 and np.median(viscous) * fast >= DROP_MIN * dynamic):
        return _OverSpeed(reason=reason)
    return _OverSpeed(level, viscous_s_m=viscous, reason=reason)


def _drawn(counts: Array, weight: Array, ratio: Array, columns: Array) -> tuple[Array, Array]:
    """Coefficients (draws, k) of columns (k, m) for each draw, blocks counted (draws, m), and the squares left."""
    weighted = counts * weight**2
    normal = np.einsum("dm,im,jm->dij", weighted, columns, columns, optimize=True)
    right = np.einsum("dm,im,m->di", weighted, columns, ratio, optimize=True)
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.diag((columns**2).mean(axis=1))
    found = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    return found, weighted @ ratio**2 - (found * right).sum(axis=1)


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


def _breakaways(parts: Sequence[tuple[Streams, Segmentation]]) -> list[float]:
    """The largest ratio of the forces at each start from rest, over 10 ms so that noise does not decide."""
    from scipy.ndimage import uniform_filter1d

    pulls = []
    for channels, states in parts:
        assert channels.tangential_force_N is not None
        rate, n = channels.rate_Hz, len(channels.force_N)
        length = max(1, round(0.01 * rate))
        tangential = np.abs(uniform_filter1d(channels.tangential_force_N, length))
        normal = uniform_filter1d(channels.force_N, length)
        before, after = (round(s * rate) for s in BREAKAWAY_S)
        least = 0.1 * float(channels.force_N.max())
        for still_start, still_end in runs(states.states == InteractionState.STILL):
            slides = still_end < n and states.states[still_end] == InteractionState.SLIDING
            if not slides or still_end - still_start < STILL_S * rate:
                continue
            part = slice(max(still_start, still_end - before), min(n, still_end + after))
            pressed = normal[part] > least
            if np.any(pressed):
                pulls.append(float((tangential[part][pressed] / normal[part][pressed]).max()))
    return pulls


def interval(values: Array) -> tuple[float, float]:
    """Between the quantiles at 2.5 and 97.5 % of a bootstrap's values (m,)."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)
