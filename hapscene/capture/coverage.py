"""What a recording still lacks for a good fit, while it is made: how well each force and speed is known, what to do.

The plane of force and speed that is wanted is cut into cells, evenly in logarithms. Sliding is taken piece by piece, as
the fit takes it (`hapscene.capture.texture_pieces`), each with its level in dB. What is known of the levels of the
cells follows from a linear model with known priors (Rasmussen & Williams 2006, eq. 2.24):

    level = c + α ln F + β ln v + d,    α, β as other surfaces have them,    d of each cell with `DEPARTS_DB`

where each piece adds its own scatter, as it is found in this recording. So the variance of every cell is known, of
those without a piece too, and how far a second more in each would bring the error down, over all that is wanted. Advice
goes to where most is gained in the time that it takes to get there; when nowhere `ENOUGH_DB` is gained, it is
enough. Work is by the sample that comes, whatever the length of the recording.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import scipy

from hapscene.capture.segment import TAP_S
from hapscene.capture.streams import HAND_CUTOFF_HZ, Array
from hapscene.capture.texture_fit import PIECES_PER_MODEL
from hapscene.capture.texture_pieces import EXPONENT_SPREADS, EXPONENTS, OUTLIER_SPREADS, PIECE_S, SPREAD_MIN_DB
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import CaptureError

FORCE_N: Final = (0.3, 3.0)
"""Forces that are wanted unless others are asked for [N]: from a light stroke to a firm one."""

SPEED_M_S: Final = (0.02, 0.3)
"""Speeds that are wanted unless others are asked for [m/s]."""

CELL_RATIO: Final = 2.2
"""Largest ratio of a cell's ends [1]: by the square of speed the level changes by 3.4 dB to either side of its middle,
as much as pieces of one place scatter. A simulated hand that looks comes to about one cell a second: with 1.8 it left
40 % of them without a model's pieces in 10 s, with this 8 %, and the fits had 0.1 to 0.5 dB less error of shape."""

CELLS_MAX: Final = 12
"""Most cells along an axis [count]."""

STEP_S: Final = 0.01
"""What force, speed and level are averaged over before anything is told of them [s]."""

STEPS: Final = round(PIECE_S / STEP_S)
"""Steps of a piece [count]."""

STILL_STEPS: Final = 5
"""Fewest steps in the air before a tap, or at rest before a slide breaks away [count]."""

ON_SHARE: Final = 0.25
"""Share of the least force and speed wanted from which the tool touches, and slides [1]."""

DEPARTS_DB: Final = 2.0
"""Standard deviation by which a cell's level departs from the law of force and speed [dB]: the median of the surfaces
of the Penn Haptic Texture Toolkit."""

ENOUGH_DB: Final = 0.03
"""By how much the expected error of the level must come down in a further second for it to be worth it [dB]. Two made
surfaces had enough after 15 and 20 s; ten to fifteen seconds more took 0.2 and 0.3 dB off the held-out level."""

TRAVEL_S: Final = 0.7
"""How long a hand takes for a cell's width [s]."""

KEPT: Final = 1.5
"""How many times better another cell must be for the advice to change before its cell is done [1]."""

PATIENCE_S: Final = 4.0
"""How long a cell is advised that the hand does not come to, before others have their turn [s]."""

SHOWN_S: Final = 0.05
"""What the level that is shown, and the place of the hand, follow with [s]."""

FLAT: Final = 3
"""Successive samples at one largest value that count as clipped [count]."""

FINE: Final = 16
"""How many of its steps a signal must be large for flat tops to say anything [1]."""

_DB: Final = 10.0 / np.log(10.0)
_LARGE: Final = 1e4  # variance of a level that is not known [dB²]


@dataclass(frozen=True)
class Wanted:
    """What a recording is to hold.

    Attributes:
        force_N, speed_m_s: least and largest.
        taps: how many, and of how many slides the breaking away where friction is recorded [count].
        full_scale: by quantity what its sensor reaches, in SI; flat tops of the acceleration are found without.
    """

    force_N: tuple[float, float] = FORCE_N
    speed_m_s: tuple[float, float] = SPEED_M_S
    taps: int = 3
    full_scale: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, (low, high) in (("forces", self.force_N), ("speeds", self.speed_m_s)):
            if not 0.0 < low < high < np.inf:
                raise CaptureError(f"{name} that are wanted go from a lower to a higher one above 0, not {low}:{high}")


class Coverage:
    """What a recording holds, as it comes.

    Args:
        rate_Hz: of all streams.
        quantities: which are recorded: acceleration, and force, speed or position, tangential_force where they are.
        wanted: what it is to hold.

    Attributes:
        force_N, speed_m_s: (m+1,), (k+1,) edges of the cells; of a quantity that is not recorded there is one cell.
        cannot: what cannot be guided, in sentences.
        dropped, clipped, knocks: samples that never came, that were cut off, pieces far too loud or soft [count].
        taps, starts: brief contacts; slides that broke away from rest [count].
    """

    def __init__(self, rate_Hz: float, quantities: tuple[str, ...], wanted: Wanted | None = None) -> None:
        if "acceleration" not in quantities:
            raise CaptureError(f"no acceleration is recorded, only {', '.join(quantities)}: nothing can be fitted")
        if not rate_Hz > 4.0 * HAND_CUTOFF_HZ:
            raise CaptureError(f"rate_Hz must be above {4.0 * HAND_CUTOFF_HZ:g}, is {rate_Hz}")
        self.rate_Hz, self.wanted = rate_Hz, wanted or Wanted()
        self.has_force = "force" in quantities
        self.has_speed = "speed" in quantities or "position" in quantities
        self._has_pull = "tangential_force" in quantities or "friction" in quantities
        self.force_N = _edges(self.wanted.force_N, self.has_force)
        self.speed_m_s = _edges(self.wanted.speed_m_s, self.has_speed)
        self.cannot = [
            f"{name} is not recorded: the page cannot say {what}"
            for name, there, what in (
                ("force", self.has_force, "how hard to press, nor ask for taps"),
                ("speed", self.has_speed, "how fast to go"),
            )
            if not there
        ]
        self._length = max(1, round(STEP_S * rate_Hz))
        self._sections = scipy.signal.butter(4, ACCELERATION_BAND_HZ[0], "highpass", fs=rate_Hz, output="sos")
        self._rest: dict[str, Array] = {}
        self._next = 0
        self._filter: Array | None = None
        self._flats = _FlatTops()
        self._last_m: Array | None = None
        # what the hand does now
        self.now = _Now()
        self._run = np.empty((0, 3))  # steps of the piece that is being slid
        self._state, self._for, self._air, self._touch = (
            "air",
            STILL_STEPS,
            0,
            0,
        )  # and steps: of it, the air before, contact
        # what is known
        middle = [0.5 * np.log(edges[1:] * edges[:-1]) for edges in (self.force_N, self.speed_m_s)]
        self._middle = np.stack([grid.ravel() for grid in np.meshgrid(*middle, indexing="ij")], axis=1)
        self._shape = len(middle[0]), len(middle[1])
        along = _DB * (self._middle - self._middle.mean(axis=0))
        self._expected = along @ EXPONENTS
        self._prior = _LARGE + (along * np.array(EXPONENT_SPREADS) ** 2) @ along.T + DEPARTS_DB**2 * np.eye(len(along))
        count = len(self._middle)
        self._count, self._sum, self._square = np.zeros((3, count))
        self._beside = np.zeros(3)  # of neighbouring pieces: products, squares, how many
        self._before = -1, 0.0
        self.dropped = self.clipped = self.knocks = self.taps = self.starts = 0
        self.clipped_s = self.dropped_s = -np.inf
        self._target, self._since_s = -1, 0.0
        self._skipped = np.zeros(count)
        self._know()

    @property
    def pieces(self) -> Array:
        """(m, k) pieces of sliding in each cell [count]."""
        return np.asarray(self._count.reshape(self._shape))

    @property
    def seconds(self) -> float:
        """How much was recorded [s]."""
        return self._next / self.rate_Hz

    # --- samples

    def feed(self, first: int, streams: Mapping[str, Array]) -> None:
        """Takes samples in.

        Args:
            first: number of the first one; what lies between it and the last one that came was dropped.
            streams: by quantity in SI, (n,) or (axes, n).
        """
        size = np.shape(streams["acceleration"])[-1]
        if first > self._next:
            self.dropped, self.dropped_s = self.dropped + first - self._next, first / self.rate_Hz
            self._rest, self._run, self._last_m = {}, self._run[:0], None
        self._next = first + size
        rows = {name: np.atleast_2d(np.asarray(stream, np.float64)) for name, stream in streams.items()}
        cut = self._flats.count(rows["acceleration"])
        for name, most in self.wanted.full_scale.items():
            if name in rows:
                cut = max(cut, int(np.count_nonzero((np.abs(rows[name]) >= 0.999 * most).any(axis=0))))
        if cut:
            self.clipped, self.clipped_s = self.clipped + cut, self.seconds
        rows["acceleration"] = self._high_passed(rows["acceleration"])
        if self._rest:
            rows = {name: np.concatenate([self._rest[name], row], axis=1) for name, row in rows.items()}
        whole = rows["acceleration"].shape[1] // self._length * self._length
        self._rest = {name: row[:, whole:] for name, row in rows.items()}
        if whole:
            self._steps({name: row[:, :whole].reshape(len(row), -1, self._length) for name, row in rows.items()})

    def _high_passed(self, acceleration: Array) -> Array:
        if self._filter is None:
            self._filter = scipy.signal.sosfilt_zi(self._sections)[:, None, :] * acceleration[None, :, :1]
        passed, self._filter = scipy.signal.sosfilt(self._sections, acceleration, zi=self._filter)
        return np.asarray(passed)

    def _steps(self, rows: Mapping[str, Array]) -> None:
        """Takes steps in, each quantity (axes, steps, samples)."""
        power = np.sum(np.mean(rows["acceleration"] ** 2, axis=2), axis=0)
        peak = np.abs(rows["acceleration"]).max(axis=(0, 2))
        force = rows["force"][0].mean(axis=1) if self.has_force else np.ones(len(power))
        speed = np.ones(len(power))
        if "speed" in rows:
            speed = np.abs(rows["speed"][0].mean(axis=1))
        elif self.has_speed:
            at = rows["position"].mean(axis=2)
            before = at[:, :1] if self._last_m is None else self._last_m
            speed = np.linalg.norm(np.diff(at, axis=1, prepend=before), axis=0) / STEP_S
            self._last_m = at[:, -1:]
        for step in np.stack([power, force, speed, peak], axis=1):
            self._step(*step.tolist())

    def _step(self, power: float, force_N: float, speed_m_s: float, peak: float) -> None:
        """Takes one step in: what the tool does, and where a piece is whole, how loud it was."""
        least_N, least_m_s = ON_SHARE * self.wanted.force_N[0], ON_SHARE * self.wanted.speed_m_s[0]
        state = "air" if force_N < least_N else "still" if speed_m_s < least_m_s else "sliding"
        self.now.follow(power, force_N, speed_m_s, peak, state)
        before, self._state = self._state, state
        if state == "air" != before:
            self.taps += self._touch <= TAP_S / STEP_S and self._air >= STILL_STEPS
        elif before == "air" != state:
            self._air, self._touch = self._for, 0
        elif state == "sliding" and before == "still":
            self.starts += self._for >= STILL_STEPS
        self._for = self._for + 1 if state == before else 1
        self._touch += 1
        if state != "sliding":
            self._run = self._run[:0]
            self._before = -1, 0.0
            return
        self._run = np.vstack([self._run, (power, force_N, speed_m_s)])
        if len(self._run) == STEPS:
            self._piece(*self._run.mean(axis=0).tolist())
            self._run = self._run[:0]

    def _piece(self, power: float, force_N: float, speed_m_s: float) -> None:
        """Takes a piece in."""
        cell = self.cell(force_N, speed_m_s)
        if cell < 0 or power <= 0.0:
            self._before = -1, 0.0
            return
        off = _DB * (np.log([force_N, speed_m_s]) - self._middle[cell]) * [self.has_force, self.has_speed]
        level = _DB * np.log(power) - float(off @ EXPONENTS)
        away = level - self._level[cell]
        total = self._count.sum()
        spread = np.hypot(max(self.scatter_dB, SPREAD_MIN_DB), self._sd[cell])
        if total >= 2 * STEPS and abs(away) > OUTLIER_SPREADS * spread:
            self.knocks += 1
            return
        if self._before[0] >= 0:
            self._beside += self._before[1] * away, 0.5 * (self._before[1] ** 2 + away**2), 1.0
        self._before = cell, away
        self._count[cell] += 1.0
        self._sum[cell] += level
        self._square[cell] += level**2
        self._know()

    def cell(self, force_N: float, speed_m_s: float) -> int:
        """The number of the cell at a force and a speed; −1 beyond what is wanted."""
        i = int(np.searchsorted(self.force_N, force_N)) - 1 if self.has_force else 0
        j = int(np.searchsorted(self.speed_m_s, speed_m_s)) - 1 if self.has_speed else 0
        return i * self._shape[1] + j if 0 <= i < self._shape[0] and 0 <= j < self._shape[1] else -1

    # --- what is known, and what a further second would add

    def _know(self) -> None:
        """The levels of all cells [dB], what they are uncertain by, and what a second more in each is worth."""
        seen = self._count > 0
        n = self._count[seen]
        mean = self._sum[seen] / n
        free = float(np.sum(n - 1.0))
        within = max(0.0, float(np.sum(self._square[seen] - n * mean**2)))
        # as if eight pieces had told before: of a few that happen to agree no certainty is made
        self.scatter_dB = float(np.sqrt((within + 8.0 * SPREAD_MIN_DB**2) / (free + 8.0)))
        alike = (
            float(np.clip(self._beside[0] / max(self._beside[1], 1e-9), 0.0, 0.9)) if self._beside[2] >= STEPS else 0.0
        )
        each = self.scatter_dB**2 * (1.0 + alike) / (1.0 - alike)  # pieces that follow one another tell less
        self._level, covariance = self._expected, self._prior
        if len(n):
            gain = np.linalg.solve(self._prior[np.ix_(seen, seen)] + np.diag(each / n), self._prior[seen]).T
            offset = float(np.mean(mean - self._expected[seen]))
            self._level = self._expected + offset + gain @ (mean - offset - self._expected[seen])
            covariance = self._prior - gain @ self._prior[seen]
        variance = np.maximum(np.diag(covariance), 1e-9)
        self._sd = np.sqrt(variance)
        self.error_dB = float(np.sqrt(variance.mean()))
        after = variance - covariance**2 / (variance + each * PIECE_S)[:, None]  # (cell that is visited, cell)
        self._gain = self.error_dB - np.sqrt(np.maximum(after, 0.0).mean(axis=1))
        self._share = np.minimum(self._count / PIECES_PER_MODEL, ENOUGH_DB / np.maximum(self._gain, 1e-12))

    @property
    def share(self) -> Array:
        """(m, k) how far each cell is filled [1]: 1 where it has a model's pieces and a second more adds nothing."""
        return np.asarray(np.minimum(self._share, 1.0).reshape(self._shape))

    @property
    def lacks(self) -> list[str]:
        """What is lacking besides sliding, as advice."""
        if not self.has_force:
            return []
        left = self.wanted.taps - self.taps
        lacking = [f"lift and tap {_times(left)}"] if left > 0 else []
        left = self.wanted.taps - self.starts
        if self._has_pull and self.has_speed and left > 0:
            lacking.append(f"stop, stay pressed, and pull gently until it slides, {_times(left)}")
        return lacking

    @property
    def enough(self) -> bool:
        """Whether more would not help."""
        return bool((self._share >= 1.0).all()) and not self.lacks

    def advice(self) -> str:
        """What to do next, in plain words."""
        if (self._share >= 1.0).all():
            return self.lacks[0] if self.lacks else "enough: more would not help"
        if self.now.state == "air":
            return "put the tool down and stroke"
        if self.now.state == "still":
            return "stroke"
        i, j = divmod(self._aim(), self._shape[1])
        words = []
        for there, value, edges, k, (more, less) in (
            (self.has_force, self.now.force_N, self.force_N, i, ("press harder", "press more lightly")),
            (self.has_speed, self.now.speed_m_s, self.speed_m_s, j, ("faster", "slower")),
        ):
            if there and not edges[k] <= value <= edges[k + 1]:
                words.append(more if value < edges[k] else less)
        return ", ".join(words) or "good: go on like this"

    @property
    def target(self) -> tuple[int, int] | None:
        """The cell that the advice leads to."""
        return None if self._target < 0 or (self._share >= 1.0).all() else divmod(self._target, self._shape[1])

    def _aim(self) -> int:
        """The cell that gains most in the time that it takes: the way, and the pieces of a model there."""
        place = np.log([max(self.now.force_N, 1e-3), max(self.now.speed_m_s, 1e-4)])
        width = np.array([np.log(edges[1] / edges[0]) for edges in (self.force_N, self.speed_m_s)])
        away = np.abs(self._middle - place) / width * [self.has_force, self.has_speed]
        cost = TRAVEL_S * np.maximum(away - 0.5, 0.0).max(axis=1) + PIECES_PER_MODEL * PIECE_S
        worth = np.where(self._share < 1.0, np.maximum(self._gain, 1e-6) / cost, 0.0) * 0.25**self._skipped
        best, kept = int(np.argmax(worth)), self._target
        if kept >= 0 and self._share[kept] < 1.0 and self.seconds - self._since_s > PATIENCE_S:
            self._skipped[kept] += 1.0
            kept = -1
        if kept < 0 or worth[best] > KEPT * worth[kept]:
            self._target, self._since_s = best, self.seconds
        return self._target


@dataclass
class _Now:
    """What the hand does now, as it is shown."""

    rms_m_s2: float = 0.0
    peak_m_s2: float = 0.0
    force_N: float = 0.0
    speed_m_s: float = 0.0
    state: str = "air"

    def follow(self, power: float, force_N: float, speed_m_s: float, peak: float, state: str) -> None:
        """Takes a step in."""
        share = STEP_S / SHOWN_S
        self.rms_m_s2 = float(np.sqrt((1.0 - share) * self.rms_m_s2**2 + share * power))
        self.peak_m_s2 = max(peak, (1.0 - 0.1 * share) * self.peak_m_s2)
        self.force_N += share * (force_N - self.force_N)
        self.speed_m_s += share * (speed_m_s - self.speed_m_s)
        self.state = state


class _FlatTops:
    """Finds where a signal is cut off: runs of one value, the largest or the least that ever came."""

    def __init__(self) -> None:
        self._tail: Array | None = None
        self._step = np.inf

    def count(self, rows: Array) -> int:
        """Samples at which any of the axes (k, n) is cut off, those of runs that end in this block."""
        if self._tail is None:
            self._low, self._high = rows.min(axis=1), rows.max(axis=1)
            self._tail = rows[:, :0]
        rows = np.concatenate([self._tail, rows], axis=1)
        self._tail = rows[:, -(FLAT - 1) :]
        self._low, self._high = np.minimum(self._low, rows.min(axis=1)), np.maximum(self._high, rows.max(axis=1))
        change = np.abs(np.diff(rows, axis=1))
        if np.any(change > 0.0):
            self._step = min(self._step, float(change[change > 0.0].min()))
        fine = (self._high - self._low) > 2 * FINE * self._step
        flat = np.zeros(rows.shape, np.int64)
        flat[:, 1:] = (change == 0.0) & ((rows[:, 1:] >= self._high[:, None]) | (rows[:, 1:] <= self._low[:, None]))
        held = flat[:, 1:] * flat[:, :-1]  # the third of a run, and each one after it
        return int(np.count_nonzero((held * fine[:, None]).any(axis=0)))


def _edges(ends: tuple[float, float], recorded: bool) -> Array:
    """Edges of the cells between two ends, evenly in logarithms."""
    if not recorded:
        return np.array(ends)
    count = int(np.clip(np.ceil(np.log(ends[1] / ends[0]) / np.log(CELL_RATIO) - 1e-9), 1, CELLS_MAX))
    return np.geomspace(*ends, count + 1)


def _times(count: int) -> str:
    words = ("", "once", "twice", "three times", "four times", "five times")
    return words[count] if count < len(words) else f"{count} times"
