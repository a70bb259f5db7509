"""Coverage: which forces and speeds a recording still lacks for a good fit, and what to do next, while it is made.

The wanted plane of force and speed is cut into cells, evenly in logarithms. Sliding is counted in pieces, as the fit
takes it (`hapscene.capture.fit.windows`). A cell is filled after `CELL_S` of sliding in it. The advice leads to the
nearest cell that lacks the pieces of a model, then to the nearest that is not filled.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from hapscene.capture.fit.segment import TAP_S
from hapscene.capture.fit.texture import PIECES_PER_MODEL
from hapscene.capture.fit.windows import PIECE_S
from hapscene.capture.io.streams import HAND_CUTOFF_HZ, Array
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.errors import CaptureError

__all__ = ["CELL_S", "FORCE_N", "SPEED_M_S", "Coverage", "Wanted"]

FORCE_N: Final = (0.3, 3.0)
"""Default range of wanted forces [N]: from a light stroke to a firm one."""

SPEED_M_S: Final = (0.02, 0.3)
"""Default range of wanted speeds [m/s]."""

CELL_RATIO: Final = 2.2
"""Largest ratio of a cell's ends [1]: by the square of speed the level changes by 3.4 dB to either side of its middle,
as much as pieces of one place scatter."""

CELLS_MAX: Final = 12
"""Most cells along an axis [count]."""

CELL_S: Final = 1.0
"""Sliding that fills a cell [s]."""

STEP_S: Final = 0.01
"""Time over which force, speed and level are averaged [s]."""

STEPS: Final = round(PIECE_S / STEP_S)
"""Steps of a piece [count]."""

STILL_STEPS: Final = 5
"""Fewest steps in the air before a tap, or at rest before a slide breaks away [count]."""

ON_SHARE: Final = 0.25
"""Share of the least wanted force and speed from which the tool touches, and slides [1]."""

PATIENCE_S: Final = 4.0
"""How long a cell is advised that the hand does not reach, before others are [s]."""

SHOWN_S: Final = 0.05
"""Time constant of the displayed level, force and speed [s]."""

FLAT: Final = 3
"""Successive samples at the largest value that count as clipped [count]."""

FINE: Final = 16
"""Least amplitude of a signal, in its own steps, at which flat tops mean clipping [1]."""


@dataclass(frozen=True)
class Wanted:
    """What a recording is to hold: least and largest force and speed; number of taps, and of slides from rest."""

    force_N: tuple[float, float] = FORCE_N
    speed_m_s: tuple[float, float] = SPEED_M_S
    taps: int = 3

    def __post_init__(self) -> None:
        for name, (low, high) in (("force", self.force_N), ("speed", self.speed_m_s)):
            if not 0.0 < low < high < np.inf:
                raise CaptureError(f"the wanted {name} must range from above 0 to a higher value, not {low}:{high}")


class Coverage:
    """Coverage of a recording, block by block.

    Args:
        rate_Hz: of all streams.
        quantities: which are recorded: acceleration, and force, speed or position, tangential_force where they are.
        wanted: what the recording is to hold.

    Attributes:
        force_N, speed_m_s: (m+1,), (k+1,) edges of the cells; a quantity that is not recorded has one cell.
        pieces: (m, k) pieces of sliding in each cell [count].
        limits: what cannot be guided, in sentences.
        dropped, clipped: samples that were lost, that were cut off by the sensor [count].
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
        self.limits = [] if self.has_force else ["force is not recorded: no advice on pressing and taps"]
        self.limits += [] if self.has_speed else ["speed is not recorded: no advice on speed"]
        self.pieces = np.zeros((len(self.force_N) - 1, len(self.speed_m_s) - 1), np.int64)
        self._length = max(1, round(STEP_S * rate_Hz))
        self._sections = scipy.signal.butter(4, ACCELERATION_BAND_HZ[0], "highpass", fs=rate_Hz, output="sos")
        self._filter: Array | None = None
        self._rest: dict[str, Array] = {}
        self._next = 0
        self._flats = _FlatTops()
        self._last_m: Array | None = None
        self.now = _Now()
        self._run: list[tuple[float, float]] = []  # force and speed of the piece that is being slid
        # contact state; steps in it, in the air before the contact, and in contact
        self._state, self._for, self._air, self._touch = "air", STILL_STEPS, 0, 0
        self.dropped = self.clipped = self.taps = self.starts = 0
        self.clipped_s = self.dropped_s = -np.inf
        self._target: tuple[int, int] | None = None
        self._since_s = 0.0
        self._missed = np.zeros(self.pieces.shape)  # times that the hand did not reach a cell

    @property
    def seconds(self) -> float:
        """Length of the recording [s]."""
        return self._next / self.rate_Hz

    @property
    def share(self) -> Array:
        """(m, k) how far each cell is filled, at most 1."""
        return np.asarray(np.minimum(self.pieces * PIECE_S / CELL_S, 1.0))

    # --- samples

    def feed(self, first: int, streams: Mapping[str, Array]) -> None:
        """Takes samples in.

        Args:
            first: number of the first one; samples between it and the last one that came were dropped.
            streams: by quantity in SI, (n,) or (axes, n).
        """
        size = np.shape(streams["acceleration"])[-1]
        if first > self._next:
            self.dropped, self.dropped_s = self.dropped + first - self._next, first / self.rate_Hz
            self._rest, self._run, self._last_m = {}, [], None
        self._next = first + size
        rows = {name: np.atleast_2d(np.asarray(stream, np.float64)) for name, stream in streams.items()}
        if cut := self._flats.count(rows["acceleration"]):
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
        """Takes one step in: updates the contact state, and counts a piece once it is complete."""
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
        self._run = [*self._run, (force_N, speed_m_s)] if state == "sliding" else []
        if len(self._run) == STEPS:
            cell = self.cell(*np.mean(self._run, axis=0).tolist())
            if cell is not None and power > 0.0:
                self.pieces[cell] += 1
            self._run = []

    def cell(self, force_N: float, speed_m_s: float) -> tuple[int, int] | None:
        """The cell at a force and a speed; None outside the wanted ranges."""
        i = int(np.searchsorted(self.force_N, force_N)) - 1 if self.has_force else 0
        j = int(np.searchsorted(self.speed_m_s, speed_m_s)) - 1 if self.has_speed else 0
        return (i, j) if 0 <= i < self.pieces.shape[0] and 0 <= j < self.pieces.shape[1] else None

    # --- advice

    @property
    def lacks(self) -> list[str]:
        """What is missing besides sliding, as advice."""
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
        """Whether every cell is filled and nothing is missing."""
        return bool((self.share >= 1.0).all()) and not self.lacks

    def advice(self) -> str:
        """What to do next, in plain words."""
        target = self.target
        if target is None:
            return self.lacks[0] if self.lacks else "enough: every cell is filled"
        if self.now.state == "air":
            return "put the tool down and stroke"
        if self.now.state == "still":
            return "stroke"
        words = []
        for recorded, value, edges, k, (more, less) in (
            (self.has_force, self.now.force_N, self.force_N, target[0], ("press harder", "press more lightly")),
            (self.has_speed, self.now.speed_m_s, self.speed_m_s, target[1], ("faster", "slower")),
        ):
            if recorded and not edges[k] <= value <= edges[k + 1]:
                words.append(more if value < edges[k] else less)
        return ", ".join(words) or "good: go on like this"

    @property
    def target(self) -> tuple[int, int] | None:
        """The cell to go to, for at most `PATIENCE_S`; None where all are filled."""
        if (self.share >= 1.0).all():
            return None
        open_cells = self.pieces < PIECES_PER_MODEL  # first a model in every cell, then all of `CELL_S`
        open_cells = open_cells if open_cells.any() else self.share < 1.0
        if self._target is not None and open_cells[self._target]:
            if self.seconds - self._since_s <= PATIENCE_S:
                return self._target
            self._missed[self._target] += 1.0
        force, speed = (
            np.abs(np.log(np.sqrt(edges[1:] * edges[:-1]) / max(value, 1e-4))) / np.log(edges[1] / edges[0])
            for edges, value in ((self.force_N, self.now.force_N), (self.speed_m_s, self.now.speed_m_s))
        )
        away = np.maximum(force[:, None] * self.has_force, speed[None] * self.has_speed) + 2.0 * self._missed
        i, j = np.unravel_index(int(np.where(open_cells, away, np.inf).argmin()), away.shape)
        self._target, self._since_s = (int(i), int(j)), self.seconds
        return self._target


@dataclass
class _Now:
    """Level, force, speed and contact state, smoothed for display."""

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
    """Detects clipping: runs of one value, the largest or the least that ever came."""

    def __init__(self) -> None:
        self._tail: Array | None = None
        self._step = np.inf

    def count(self, rows: Array) -> int:
        """Samples at which any of the axes (k, n) is clipped, those of runs that end in this block."""
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
