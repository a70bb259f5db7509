"""What plays the intervals of a trial: headphones or a handle."""

from collections.abc import Callable, Iterable
from functools import partial
from threading import Event
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import StudyError
from hapscene.handle.compensator import find_compensator
from hapscene.handle.handle_file import load_handle
from hapscene.handle.handle_output import HandleOutput
from hapscene.handle.plant import Array, Plant
from hapscene.handle.playback import play
from hapscene.study.stimulus import FULL_SCALE, Stimulus, StimulusMaker, level_of
from hapscene.study.trial_order import Interval
from hapscene.wall_clock import CLOCK, Clock

DEAF_S: Final = 10.0
"""How much longer than it lasts a sound is waited for, before what plays it counts as gone [s]."""

LOOK_S: Final = 0.005
"""How often it is looked whether a sound has ended [s]."""


class Player(Protocol):
    """What plays intervals."""

    def ready(self, interval: Interval) -> Callable[[], None]:
        """Makes it, which takes long for some stimuli; what is returned plays it, as often as it is called, at once.

        It plays until the end has been put out, or `close`; it raises HapsceneError where what plays it is gone.

        Raises:
            HapsceneError: it cannot be made.
        """

    def close(self) -> None:
        """End; what is played breaks off. Twice does no harm."""

    def report(self) -> dict[str, float]:
        """What it was played with, and what went wrong, by name."""


class _Samples:
    """A `Feed`: samples once they are given, silence otherwise. Each side writes what is its own: nothing is locked."""

    def __init__(self) -> None:
        self._given = self._now = np.zeros(0), Event()
        self._first = 0

    def give(self, samples: Array) -> Event:
        """Have them played; the event is set once all were pulled."""
        self._given = samples, Event()
        return self._given[1]

    def pull(self, out: Array) -> None:
        if self._now is not self._given:
            self._now, self._first = self._given, 0
        samples, ended = self._now
        part = samples[self._first : self._first + len(out)]
        out[: len(part)] = part
        out[len(part) :] = 0.0
        self._first += len(part)
        if len(part) < len(out):
            ended.set()

    def fade_in(self) -> None:
        """A sound that was broken off begins anew."""
        if not self._now[1].is_set():
            self._first = 0

    def hear(self, numbers: NDArray[np.int64], force_N: Array, acceleration_m_s2: Array) -> None:
        """Nothing learns."""


class OutputPlayer:
    """Plays on an output that stays open, silent between intervals: nothing clicks, and nothing begins late.

    Args:
        output: what it is played on; closed with this.
        shaped: the values that the output is given for an interval.
        told: what `report` says besides the output's own counts.
        clock: measures how long a sound takes.
    """

    def __init__(
        self,
        output: HandleOutput,
        shaped: Callable[[Interval], Array],
        told: Callable[[], dict[str, float]],
        clock: Clock = CLOCK,
    ) -> None:
        self._output, self._shaped, self._told, self._clock = output, shaped, told, clock
        self._feed, self._closed = _Samples(), False
        output.start(self._feed)

    def ready(self, interval: Interval) -> Callable[[], None]:
        return partial(self._play, self._shaped(interval))

    def _play(self, samples: Array) -> None:
        ended, last_s = self._feed.give(samples), self._clock.now_s() + len(samples) / self._output.rate_Hz + DEAF_S
        while not (self._clock.wait(ended, LOOK_S) or self._output.fault or self._closed):
            if self._clock.now_s() > last_s:
                raise StudyError(f"{self._output.name}: takes no samples any more: was it unplugged?")
        if self._output.fault:
            raise StudyError(self._output.fault)
        self._clock.sleep_s(0.0 if self._closed else self._output.latency_s)

    def close(self) -> None:
        self._closed = True
        self._output.close()

    def report(self) -> dict[str, float]:
        return {**self._told(), **self._output.counts}


def headphones(
    maker: StimulusMaker, output: HandleOutput, stimuli: Iterable[Stimulus], clock: Clock = CLOCK
) -> OutputPlayer:
    """Plays as sound, in whole steps of 16 bits, all at one level.

    Raises:
        HapsceneError: stimuli that cannot be made, or an output that takes no sound.
    """
    if output.takes_force:
        raise StudyError(f'{output.name} takes a force, not sound: it is a handle (channel = "handle")')
    level = level_of(maker, stimuli, output.rate_Hz)
    clipped = 0

    def shaped(interval: Interval) -> Array:
        nonlocal clipped
        whole, beyond = level.whole(maker.samples(interval.stimulus, interval.seed, output.rate_Hz))
        clipped += beyond
        return whole / FULL_SCALE

    def told() -> dict[str, float]:
        return {"full_scale_m_s2": 1.0 / level.gain, "clipped": clipped}

    return OutputPlayer(output, shaped, told, clock)


def handle(
    maker: StimulusMaker, output: HandleOutput, stimuli: Iterable[Stimulus], file: str = "", clock: Clock = CLOCK
) -> OutputPlayer:
    """Plays on a handle: the acceleration itself, by each stimulus's compensator, "flat" where it says none.

    Args:
        maker: of the study.
        output: the handle.
        stimuli: all that may be played; their compensators are looked at.
        file: of `hapscene device identify`, or empty: then the assumed handle is meant.

    Raises:
        HapsceneError: no such compensator, or a file that cannot be used.
    """
    plant = load_handle(file).plant if file else Plant()
    for stimulus in stimuli:
        find_compensator(stimulus["compensator"] or "flat")
    counts = {"clips": 0, "hits": 0, "clipped": 0}

    def shaped(interval: Interval) -> Array:
        samples = maker.samples(interval.stimulus, interval.seed, output.rate_Hz)
        compensator = interval.stimulus["compensator"] or "flat"
        played = play(samples, output.rate_Hz, plant, compensator=str(compensator), nominal=plant, seed=interval.seed)
        values = output.gain * played.force_N
        counts["clips"] += played.clips
        counts["hits"] += played.hits
        counts["clipped"] += int(np.count_nonzero(np.abs(values) > output.ceiling))
        return np.clip(values, -output.ceiling, output.ceiling)

    return OutputPlayer(output, shaped, lambda: dict(counts), clock)
