"""What is felt or heard in an interval of a trial: the swatch that a stimulus describes, and its samples.

A stimulus is a swatch, or a recording. A recording is played as it was recorded, an excerpt that the interval's seed
draws from where the tool slides; with an order it is fitted at that order, and its texture made along the force and
speed of that same excerpt. The seed is also that of the noise: two intervals of one seed that differ in their order
alone are driven by the same noise.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.recording_file import load_recording
from hapscene.capture.segment import InteractionState, Part
from hapscene.capture.streams import Array, Streams, part_of
from hapscene.capture.swatch_fit import fit_parts, prepare
from hapscene.capture.synthesis import synthesize
from hapscene.errors import StudyError
from hapscene.study.plan import Plan
from hapscene.surface.library import load_swatch
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import read_swatch, save_swatch

FADE_S: Final = 0.02
"""How long a sound fades in and out [s]: no click."""

HEADROOM_DB: Final = 6.0
"""What is left above the loudest sample that was tried [dB]: another noise has other peaks."""

TRIES: Final = 8
"""Seeds with which each stimulus is tried for its loudest sample [count]."""

STOP_DB: Final = 110.0
"""What is left of images and of what would alias [−dB]: 14 dB below the rounding to 16 bits."""

FULL_SCALE: Final = 32_767

TEXTURE: Final = "lpc_texture"
"""The effect that is asked about."""

Stimulus = Mapping[str, Any]


class StimulusMaker:
    """Makes what stimuli describe; recordings are read and fitted once.

    Args:
        folder: where the files that stimuli name are looked for: that of the plan.
        kept: a folder that keeps what was fitted, so that the next person need not wait; None for none.
    """

    def __init__(self, folder: Path, kept: Path | None = None) -> None:
        self._folder, self._kept = folder, kept
        self._recording, self._fitted = cache(self._read), cache(self._fit)
        self._loaded = cache(load_swatch)

    def swatch(self, stimulus: Stimulus) -> Swatch:
        """The swatch that is felt: at its order, with its gain, with or without life and texture.

        Raises:
            HapsceneError: a file that cannot be used, or an order that the swatch does not have.
        """
        order, name = stimulus["order"], stimulus["swatch"]
        if stimulus["recording"]:
            if order == 0:
                raise StudyError(f"{stimulus['name']}: a recording is a swatch once it has an order, as order = 40")
            found = self._fitted(_recording_key(stimulus), order)
        else:
            found = self._loaded(str(self._folder / name) if name.endswith(".swatch") else name)
            if found.texture is None:
                raise StudyError(f"{stimulus['name']}: swatch {name!r} has no texture: there is nothing to ask about")
            if order > found.texture.order:
                raise StudyError(
                    f"{stimulus['name']}: swatch {name!r} has order {found.texture.order}; a higher one, {order}, is "
                    'fitted to its recording: recording = "FILE" in place of the swatch'
                )
            if order:
                found = replace(found, texture=found.texture.truncated(order))
        own = dict(found.effects.get(TEXTURE, {}))
        factors = {"texture_gain": _gain(stimulus), "texture_life": float(stimulus["life"])}
        own |= {name: factor * own.get(name, 1.0) for name, factor in factors.items()}
        return replace(found, effects={**found.effects, TEXTURE: own})

    def samples(self, stimulus: Stimulus, seed: int, rate_Hz: float) -> Array:
        """Acceleration (n,) [m/s²] of an interval at a rate [Hz], at its gain, faded at both ends.

        Raises:
            HapsceneError: as `swatch`, or a recording that slides too briefly.
        """
        seconds, excerpt = stimulus["seconds"], None
        if stimulus["recording"]:
            excerpt = self._excerpt(stimulus, seed)
        if excerpt is not None and stimulus["order"] == 0:
            made, own_Hz = _gain(stimulus) * excerpt.acceleration_m_s2, excerpt.rate_Hz
        else:
            swatch = self.swatch(stimulus)
            assert swatch.texture is not None
            own_Hz, factors = swatch.texture.rate_Hz, swatch.effects[TEXTURE]
            if excerpt is not None:
                force, speed = excerpt.force_N, excerpt.speed_m_s
            else:
                force, speed = (np.full(round(seconds * own_Hz), stimulus[name]) for name in ("force_N", "speed_m_s"))
            made = synthesize(swatch, force, speed, seed=seed, life=factors["texture_life"]) * factors["texture_gain"]
        made = resampled(made, own_Hz, rate_Hz)
        made = np.concatenate([made, np.zeros(1)])[: round(seconds * rate_Hz)]
        ramp = np.sin(0.5 * np.pi * np.arange(round(FADE_S * rate_Hz)) / (FADE_S * rate_Hz)) ** 2
        made[: len(ramp)] *= ramp
        made[len(made) - len(ramp) :] *= ramp[::-1]
        return made

    def _excerpt(self, stimulus: Stimulus, seed: int) -> Streams:
        """A stretch of a recording in which the tool slides throughout, drawn by the seed."""
        channels, states = self._recording(_recording_key(stimulus))
        count, sliding = round(stimulus["seconds"] * channels.rate_Hz), states.runs(InteractionState.SLIDING)
        runs = [(first, end) for first, end in sliding if end - first >= count]
        if not runs:
            longest = max((end - first for first, end in sliding), default=0) / channels.rate_Hz
            raise StudyError(
                f"{stimulus['name']}: {stimulus['recording']} slides for {longest:.2g} s at a stretch at most, shorter "
                f"than seconds = {stimulus['seconds']:g}"
            )
        places = np.concatenate([np.arange(first, end - count + 1) for first, end in runs])
        first = int(np.random.default_rng(seed).choice(places))
        return part_of(channels, slice(first, first + count))

    def _fit(self, key: "_Key", order: int) -> Swatch:
        made = self._recording(key)
        if self._kept is None:
            return fit_parts([made], "fitted", order)
        with (self._folder / key[0]).open("rb") as file:
            content = hashlib.file_digest(file, "sha256").hexdigest()
        name = hashlib.sha256(repr((content, key[1:], order)).encode()).hexdigest()[:16]
        path = self._kept / f"order-{order}-{name}.swatch"
        if not path.exists():
            save_swatch(fit_parts([made], "fitted", order), path)
        return read_swatch(path)

    def _read(self, key: "_Key") -> Part:
        file, rate_Hz, columns, units = key
        path = self._folder / file
        return prepare(load_recording(path, rate_Hz or None, columns=dict(columns) or None, units=dict(units) or None))


_Key = tuple[str, float, tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]]


def _recording_key(stimulus: Stimulus) -> _Key:
    """What is read of a recording, and how."""
    columns, units = (tuple(_pairs(stimulus[name], f"{stimulus['name']}.{name}")) for name in ("columns", "units"))
    return stimulus["recording"], stimulus["rate_Hz"], columns, units


def _pairs(text: str, where: str) -> Iterator[tuple[str, str]]:
    """Pairs as in "force=N,speed=mm/s"."""
    for item in filter(None, text.split(",")):
        name, equals, value = (part.strip() for part in item.partition("="))
        if not (name and equals and value):
            raise StudyError(f"stimuli.{where}: {item!r}: expected QUANTITY=VALUE pairs, as in force=N,speed=mm/s")
        yield name, value


def _gain(stimulus: Stimulus) -> float:
    """Factor on the texture: 0 where it is not among the effects that are on."""
    return float(10.0 ** (stimulus["gain_dB"] / 20.0)) if TEXTURE in stimulus["effects"] else 0.0


def resampled(samples: Array, rate_Hz: float, wanted_Hz: float) -> Array:
    """Samples (n,) at another rate: a windowed sinc, nothing shifted in time."""
    from scipy.signal import firwin, kaiser_beta, resample_poly

    ratio = Fraction(wanted_Hz / rate_Hz).limit_denominator(1000)
    if ratio == 1:
        return samples.copy()
    most = max(ratio.numerator, ratio.denominator)
    weights: Any = firwin(64 * most + 1, 0.93 / most, window=("kaiser", float(kaiser_beta(STOP_DB))))
    return np.asarray(resample_poly(samples, ratio.numerator, ratio.denominator, window=weights))


@dataclass(frozen=True)
class Level:
    """One level for a whole study: what is louder in a stimulus is louder for the ear.

    Attributes:
        gain: share of full scale for 1 m/s².
    """

    gain: float

    def whole(self, samples: Array) -> tuple[NDArray[np.int16], int]:
        """Samples (n,) [m/s²] in 16 bits, and how many of them did not fit [count]."""
        scaled = FULL_SCALE * self.gain * samples
        fits = np.clip(np.rint(scaled), -FULL_SCALE, FULL_SCALE)
        return fits.astype(np.int16), int(np.count_nonzero(np.abs(scaled) > FULL_SCALE + 0.5))


def level_of(maker: StimulusMaker, stimuli: Iterable[Stimulus], rate_Hz: float) -> Level:
    """The level at which the loudest of all stimuli leaves `HEADROOM_DB`.

    Args:
        maker: of the study.
        stimuli: all that may be played, with the extremes of what staircases vary.
        rate_Hz: at which they are played.

    Raises:
        HapsceneError: as `StimulusMaker.samples`, or all of them are silent.
    """
    peaks = [np.abs(maker.samples(one, seed, rate_Hz)).max() for one in stimuli for seed in range(TRIES)]
    loudest = float(max(peaks, default=0.0))
    if not loudest > 0.0:
        raise StudyError("all stimuli are silent: there is nothing to ask about")
    return Level(10.0 ** (-HEADROOM_DB / 20.0) / loudest)


def all_stimuli(plan: Plan) -> list[Stimulus]:
    """All that a plan may have played: the stimuli of its blocks, those of staircases at each of their levels."""
    names = {name for block in plan.blocks for name in (*block.stimuli, *(one for pair in block.pairs for one in pair))}
    found: list[Stimulus] = [plan.stimuli[name] for name in plan.stimuli if name in names]
    for block in plan.blocks:
        if block.kind == "staircase":
            found += [block.varied(plan.stimuli[block.stimulus], level) for level in (0.0, *block.levels)]
    return found
