"""Synthesis of the samples of an interval.

A stimulus with a recording plays an excerpt in which the tool slides throughout; the seed of the interval selects
it. A stimulus with a swatch is synthesised at its force and speed; with both, at the force and speed of the excerpt.
The seed also determines the noise.
"""

from collections.abc import Callable, Iterable
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from threading import Event
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.fit.segment import InteractionState, SegmentedRecording
from hapscene.capture.fit.swatch import prepare
from hapscene.capture.fit.synthesis import synthesize
from hapscene.capture.io.recording import load_recording
from hapscene.capture.io.streams import Streams, part_of
from hapscene.errors import StudyError
from hapscene.handle.compensator import find_compensator
from hapscene.handle.handle_file import load_handle
from hapscene.handle.handle_loop import play
from hapscene.handle.handle_output import HandleOutput
from hapscene.handle.plant import Array, Plant
from hapscene.study.plan import Plan, StaircaseBlock, Stimulus
from hapscene.study.trial_order import Interval
from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["OutputPlayer", "StimulusMaker", "all_stimuli", "handle_player", "headphone_player"]

FADE_S: Final = 0.02
"""Duration of fade-in and fade-out, which avoid clicks [s]."""

HEADROOM_DB: Final = 6.0
"""Headroom above the largest measured sample [dB], since other noise has other peaks."""

TRIES: Final = 8
"""Number of seeds with which the largest sample of each stimulus is measured [count]."""

STOP_DB: Final = 110.0
"""Stop-band attenuation of the resampling filter [dB]: 14 dB below the quantisation of 16 bits."""


class StimulusMaker:
    """Synthesises stimuli; reads each recording and swatch once.

    Args:
        folder: folder of the plan; paths in the plan are relative to it.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder, self._loaded = Path(folder), cache(load_swatch)
        self._recordings: dict[str, SegmentedRecording] = {}

    def swatch(self, stimulus: Stimulus) -> Swatch:
        """The swatch of a stimulus. Raises HapsceneError: an invalid file, or a swatch without a texture."""
        name = stimulus.swatch
        found = self._loaded(str(self._folder / name) if name.endswith(".swatch") else name)
        if found.texture is None:
            raise StudyError(f"stimulus {stimulus.name}: swatch {name!r} has no texture to play")
        return found

    def samples(self, stimulus: Stimulus, seed: int, rate_Hz: float) -> Array:
        """Acceleration (n,) [m/s²] of an interval at a sample rate [Hz], with its gain, faded at both ends.

        Raises:
            HapsceneError: as for `swatch`, or a recording whose slides are too short.
        """
        seconds, gain = stimulus.seconds, float(10.0 ** (stimulus.gain_dB / 20.0))
        excerpt = self._excerpt(stimulus, seed) if stimulus.recording else None
        if excerpt is not None and not stimulus.swatch:
            made, own_Hz = gain * excerpt.acceleration_m_s2, excerpt.rate_Hz
        else:
            swatch = self.swatch(stimulus)
            assert swatch.texture is not None
            own_Hz = swatch.texture.rate_Hz
            if excerpt is not None:
                force, speed = excerpt.force_N, excerpt.speed_m_s
            else:
                force, speed = (np.full(round(seconds * own_Hz), x) for x in (stimulus.force_N, stimulus.speed_m_s))
            own = swatch.effects.get("lpc_texture", {})
            life = float(stimulus.life) * own.get("texture_life", 1.0)
            made = synthesize(swatch, force, speed, seed=seed, modulation=life) * (gain * own.get("texture_gain", 1.0))
        made = resampled(made, own_Hz, rate_Hz)
        made = np.concatenate([made, np.zeros(1)])[: round(seconds * rate_Hz)]
        ramp = np.sin(0.5 * np.pi * np.arange(round(FADE_S * rate_Hz)) / (FADE_S * rate_Hz)) ** 2
        made[: len(ramp)] *= ramp
        made[len(made) - len(ramp) :] *= ramp[::-1]
        return made

    def _excerpt(self, stimulus: Stimulus, seed: int) -> Streams:
        """An excerpt of a recording in which the tool slides throughout, selected by the seed."""
        channels, states = self._recording(stimulus)
        count, sliding = round(stimulus.seconds * channels.rate_Hz), states.runs(InteractionState.SLIDING)
        runs = [(first, end) for first, end in sliding if end - first >= count]
        if not runs:
            longest = max((end - first for first, end in sliding), default=0) / channels.rate_Hz
            raise StudyError(
                f"stimulus {stimulus.name}: the longest slide in {stimulus.recording} takes {longest:.2g} s; expected "
                f"at least seconds = {stimulus.seconds:g}"
            )
        places = np.concatenate([np.arange(first, end - count + 1) for first, end in runs])
        first = int(np.random.default_rng(seed).choice(places))
        return part_of(channels, slice(first, first + count))

    def _recording(self, stimulus: Stimulus) -> SegmentedRecording:
        key = repr((stimulus.recording, stimulus.rate_Hz, stimulus.columns, stimulus.units))
        if key not in self._recordings:
            file, columns, units = self._folder / stimulus.recording, stimulus.columns or None, stimulus.units or None
            recording = load_recording(file, stimulus.rate_Hz or None, columns=columns, units=units)
            self._recordings[key] = prepare(recording)
        return self._recordings[key]


def resampled(samples: Array, rate_Hz: float, wanted_Hz: float) -> Array:
    """Resample (n,) samples by a windowed sinc filter without delay."""
    from scipy.signal import firwin, kaiser_beta, resample_poly

    ratio = Fraction(wanted_Hz / rate_Hz).limit_denominator(1000)
    if ratio == 1:
        return samples.copy()
    most = max(ratio.numerator, ratio.denominator)
    weights: Any = firwin(64 * most + 1, 0.93 / most, window=("kaiser", float(kaiser_beta(STOP_DB))))
    return np.asarray(resample_poly(samples, ratio.numerator, ratio.denominator, window=weights))


def gain_of(maker: StimulusMaker, stimuli: Iterable[Stimulus], rate_Hz: float) -> float:
    """The gain of a study, in full scale per m/s², at which the loudest stimulus leaves `HEADROOM_DB`.

    Raises:
        HapsceneError: as for `StimulusMaker.samples`, or all stimuli are silent.
    """
    peaks = [np.abs(maker.samples(one, seed, rate_Hz)).max() for one in stimuli for seed in range(TRIES)]
    loudest = float(max(peaks, default=0.0))
    if not loudest > 0.0:
        raise StudyError("all stimuli are silent; expected at least one with vibration")
    return float(10.0 ** (-HEADROOM_DB / 20.0) / loudest)


def all_stimuli(plan: Plan) -> list[Stimulus]:
    """All stimuli that a plan can play, including each level of its staircases."""
    staircases = [block for block in plan.blocks if isinstance(block, StaircaseBlock)]
    names = {name for block in plan.blocks if block not in staircases for name in block.used}
    found = [plan.stimuli[name] for name in plan.stimuli if name in names]
    for block in staircases:
        found += [block.varied(plan.stimuli[block.stimulus], level) for level in (0.0, *block.distances)]
    return found


# Playback of the intervals of a trial on headphones or on a handle.


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

    `shaped` returns the output values of an interval; `report` returns `settings` besides the counters of the output.
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

    `file` is a handle file of `hapscene device identify`; empty for the nominal handle.

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
