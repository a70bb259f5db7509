"""Playback of the intervals of a trial on headphones or on a handle."""

from collections.abc import Callable, Iterable
from functools import partial
from threading import Event
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import StudyError
from hapscene.handle.compensator import find_compensator
from hapscene.handle.handle_file import load_handle
from hapscene.handle.handle_output import HandleOutput
from hapscene.handle.plant import Array, Plant
from hapscene.handle.playback import play
from hapscene.study.plan import Stimulus
from hapscene.study.stimulus import StimulusMaker, gain_of
from hapscene.study.trial_order import Interval
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["OutputPlayer", "handle_player", "headphone_player"]

TIMEOUT_S: Final = 10.0
"""Time beyond the duration of a sound after which its output counts as disconnected [s]."""

POLL_S: Final = 0.005
"""Polling interval for the end of a sound [s]."""


class _Samples:
    """A `Feed` that plays given samples once, then silence. Each thread writes its own fields, so that no lock is
    needed."""

    def __init__(self) -> None:
        self._given = self._now = np.zeros(0), Event()
        self._first = 0

    def give(self, samples: Array) -> Event:
        """Play samples; the returned event is set when all have been read."""
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
        """Restart an interrupted sound."""
        if not self._now[1].is_set():
            self._first = 0

    def receive_feedback(self, numbers: NDArray[np.int64], force_N: Array, acceleration_m_s2: Array) -> None:
        """Ignore the measurement: nothing adapts to it."""


class OutputPlayer:
    """Plays on an output that stays open and silent between intervals, without clicks and without delay at the start.

    Args:
        output: the output; closed with this object.
        shaped: returns the output values of an interval.
        settings: settings that `report` returns besides the counters of the output.
        clock: measures the duration of a sound.
    """

    def __init__(
        self,
        output: HandleOutput,
        shaped: Callable[[Interval], Array],
        settings: dict[str, float],
        clock: Clock = CLOCK,
    ) -> None:
        self._output, self._shaped, self._clock = output, shaped, clock
        self._counts = {**settings, "clipped": 0.0}
        self._feed, self._closed = _Samples(), False
        output.start(self._feed)

    def ready(self, interval: Interval) -> Callable[[], None]:
        """Synthesise an interval, which may take long, and return a function that plays it immediately.

        The function may be called repeatedly. It returns when all samples are played or the player is closed, and
        raises HapsceneError if the output is disconnected.

        Raises:
            HapsceneError: the interval cannot be synthesised.
        """
        values, most = self._shaped(interval), self._output.ceiling
        self._counts["clipped"] += int(np.count_nonzero(np.abs(values) > most))
        return partial(self._play, np.clip(values, -most, most))

    def _play(self, samples: Array) -> None:
        ended, output = self._feed.give(samples), self._output
        last_s = self._clock.now_s() + len(samples) / output.rate_Hz + TIMEOUT_S
        while not (self._clock.wait(ended, POLL_S) or output.fault or self._closed):
            if self._clock.now_s() > last_s:
                raise StudyError(f"{output.name}: the output no longer accepts samples; is it still connected?")
        if output.fault:
            raise StudyError(output.fault)
        self._clock.sleep_s(0.0 if self._closed else output.latency_s)

    def close(self) -> None:
        """Close the output; a sound stops. Calling it twice has no effect."""
        self._closed = True
        self._output.close()

    def report(self) -> dict[str, float]:
        """Settings, and numbers of errors, by name."""
        return {**self._counts, **self._output.counts}


def headphone_player(
    maker: StimulusMaker, output: HandleOutput, stimuli: Iterable[Stimulus], clock: Clock = CLOCK
) -> OutputPlayer:
    """Return a player of acceleration as sound, with the same gain for all stimuli.

    Raises:
        HapsceneError: stimuli that cannot be synthesised, or an output that is not an audio output.
    """
    if output.takes_force:
        raise StudyError(f'{output.name} is a handle, not an audio output; set channel = "handle" in the plan')
    gain = gain_of(maker, stimuli, output.rate_Hz)

    def shaped(interval: Interval) -> Array:
        return gain * maker.samples(interval.stimulus, interval.seed, output.rate_Hz)

    return OutputPlayer(output, shaped, {"full_scale_m_s2": 1.0 / gain}, clock)


def handle_player(
    maker: StimulusMaker, output: HandleOutput, stimuli: Iterable[Stimulus], file: str = "", clock: Clock = CLOCK
) -> OutputPlayer:
    """Return a player of acceleration on a handle, with the compensator of each stimulus ("flat" by default).

    Args:
        maker: synthesises the stimuli.
        output: the handle.
        stimuli: all stimuli that may be played; their compensators are checked.
        file: handle file of `hapscene device identify`; empty for the nominal handle.
        clock: measures the duration of a sound.

    Raises:
        HapsceneError: an unknown compensator, or an invalid handle file.
    """
    plant = load_handle(file).plant if file else Plant()
    for stimulus in stimuli:
        find_compensator(stimulus.compensator or "flat")

    def shaped(interval: Interval) -> Array:
        samples = maker.samples(interval.stimulus, interval.seed, output.rate_Hz)
        compensator = interval.stimulus.compensator or "flat"
        played = play(samples, output.rate_Hz, plant, compensator=compensator, nominal=plant, seed=interval.seed)
        return output.gain * played.force_N

    return OutputPlayer(output, shaped, {}, clock)
