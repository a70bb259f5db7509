"""How well swatches of one part of a recording stand for another part, which they have not seen.

    python -m hapscene_experiments.held_out recordings/ --rate 10000 --columns … --units …
    python -m hapscene_experiments.held_out --simulated --quick

Each recording is cut into halves, and into thirds; each part is fitted, and played along the force and speed of each
other part with `--seeds` seeds, alive and without life. What is told is the mean over all of them, beside the recorded
part itself and beside the part that was fitted: a swatch that is as near as that one is as near as can be known.
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, permutations
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hapscene.capture import metric
from hapscene.capture.batch import gather
from hapscene.capture.recording_file import SurfaceRecording, load_recording
from hapscene.capture.streams import Streams, clean, part_of
from hapscene.capture.swatch_fit import fit
from hapscene.capture.synthesis import synthesize
from hapscene.dsp.linear_prediction import autocorrelation, solve, tapered
from hapscene.errors import CaptureError

Array = NDArray[np.float64]

SEEDS: Final = 20
"""Seeds that each swatch is played with [count]."""

ORDERS: Final = (8, 14, 20, 28, 40, 60, 90, 120)
"""Orders of the single AR model that a texture's shape is held against."""

SURFACES: Final = ("steady", "grains", "bursts", "squeal")
"""Simulated surfaces: noise; a gain that goes by the distance, one that goes by time; a tone that comes and goes."""


@dataclass(frozen=True)
class Score:
    """One part held against another, means over the seeds; liveliness is modulation [1], spread [dB] and crest [1].

    Attributes:
        shape_dB: log-spectral distance of what was played, without life and alive, and of the best single AR model.
        level_dB: power of what was played alive over the recorded, and of the part that was fitted over it.
        lively: (4, 3) liveliness recorded, without life, alive, and of the part that was fitted.
        off: (3, 3) |ln ratio| to the recorded: without life, alive, and of the part that was fitted.
    """

    shape_dB: tuple[float, float, float]
    level_dB: tuple[float, float]
    lively: Array
    off: Array


def scores(
    recording: SurfaceRecording | Streams, parts: int, seeds: int = SEEDS, order: int | Literal["auto"] = "auto"
) -> list[Score]:
    """Each of so many parts of a recording, fitted with models of that order, against each other one."""
    r = recording
    whole = clean(r.acceleration_m_s2, r.rate_Hz, r.force_N, r.speed_m_s, None)
    edges = np.linspace(0, len(whole.force_N), parts + 1).astype(int)
    cut = [part_of(whole, slice(*edge)) for edge in pairwise(edges)]
    return [_score(own, other, seeds, order) for own, other in permutations(cut, 2)]


def _score(own: Streams, other: Streams, seeds: int, order: int | Literal["auto"]) -> Score:
    rate, real = own.rate_Hz, other.acceleration_m_s2
    swatch = fit(own.acceleration_m_s2, rate, force_N=own.force_N, speed_m_s=own.speed_m_s, order=order)
    played = [
        [synthesize(swatch, other.force_N, other.speed_m_s, seed=seed, life=life) for seed in range(seeds)]
        for life in (0.0, 1.0)
    ]
    lively = [
        np.array([metric.liveliness(y, rate) for y in group]) for group in ([real], *played, [own.acceleration_m_s2])
    ]
    frequency, density = metric.spectrum(real, rate)
    signal = tapered(own.acceleration_m_s2, rate)
    models = [solve(autocorrelation(signal, order)) for order in ORDERS]
    heard = [np.mean([metric.spectrum(y, rate)[1] for y in group], axis=0) for group in played]
    heard += [metric.model_spectrum(a, 1.0, rate, frequency) for a in models]
    distance = [metric.log_spectral_distance(one, density, frequency) for one in heard]
    powers = [
        metric.band_power(one, frequency).sum()
        for one in (density, heard[1], metric.spectrum(own.acceleration_m_s2, rate)[1])
    ]
    return Score(
        (distance[0], distance[1], min(distance[2:])),
        (10.0 * math.log10(powers[1] / powers[0]), 10.0 * math.log10(powers[2] / powers[0])),
        np.array([group.mean(axis=0) for group in lively]),
        np.array([np.abs(np.log(group / lively[0])).mean(axis=0) for group in lively[1:]]),
    )


def simulated(
    surface: str, seconds: float, seed: int = 0, rate_Hz: float = 5000.0
) -> tuple[Streams, NDArray[np.bool_]]:
    """A stroke over one of `SURFACES`, made with nothing of the renderer, and where it squeals (n,)."""
    rng = np.random.default_rng([seed, SURFACES.index(surface)])
    count = round(seconds * rate_Hz)
    t_s = np.arange(count) / rate_Hz
    turn = rng.uniform(0.0, 2.0 * np.pi, 2)
    force = 1.5 + 0.4 * np.sin(3.1 * t_s + turn[0])
    speed = 0.15 + 0.1 * np.sin(5.0 * t_s + turn[1])
    squeals = np.zeros(count, dtype=np.bool_)
    level = np.sqrt(force * speed)
    if surface == "squeal":  # 17 to 25 dB, and 29 to 35 dB at 690 Hz, in turn
        start, loud = 0, False
        while start < count:
            end = start + 1 + int(rng.exponential(0.4 if loud else 0.6) * rate_Hz)
            squeals[start:end] = loud
            level[start:end] = 10.0 ** (rng.uniform(*((29.0, 35.0) if loud else (17.0, 25.0))) / 20.0)
            start, loud = end, not loud
    elif surface != "steady":  # a spread of 0.4, forgotten in 70 ms, or in what is travelled in them at 0.15 m/s
        gone = np.cumsum(speed / (0.07 * 0.15) if surface == "grains" else np.full(count, 1.0 / 0.07)) / rate_Hz
        kept = math.exp(-(step := 1.0 / (0.07 * rate_Hz)))
        drawn = math.sqrt(1.0 - kept**2) * rng.standard_normal(math.ceil(gone[-1] / step) + 2000)
        x = lfilter([1.0], [1.0, -kept], drawn)[1998:]  # even in what it forgets by
        level *= np.exp(0.4 * np.interp(gone, step * np.arange(len(x)), x) - 0.16)
    voices = []
    for poles_Hz, radius in (((150.0, 500.0), 0.95), ((690.0,), 0.995)):
        poles = radius * np.exp(2j * np.pi * np.array(poles_Hz) / rate_Hz)
        y = lfilter([1.0], np.poly([*poles, *np.conj(poles)]).real, rng.standard_normal(count + 2000))[2000:]
        voices.append(y / y.std())
    return Streams(rate_Hz, level * np.where(squeals, voices[1], voices[0]), force, speed, None), squeals


def _recordings(options: argparse.Namespace) -> Iterator[tuple[str, Callable[[], SurfaceRecording | Streams]]]:
    """Names, and what reads or makes them."""
    units = dict(pair.split("=") for pair in options.units.split(",") if pair)
    for item in gather(options.recordings) if options.recordings else ():
        yield item.path.stem, partial(load_recording, item.path, rate_Hz=options.rate, units=units)
    for surface in SURFACES if options.simulated else ():
        yield f"simulated: {surface}", partial(_made, surface)


def _made(surface: str) -> Streams:
    return simulated(surface, 10.0)[0]


def _line(name: str, found: Sequence[Score]) -> str:
    shape, level = (np.array([getattr(s, of) for s in found]) for of in ("shape_dB", "level_dB"))
    lively, off = np.mean([s.lively for s in found], axis=0), np.mean([s.off for s in found], axis=0)
    cells = [" / ".join(f"{x:.2f}" for x in shape.mean(axis=0))]
    cells.append(" / ".join(f"{x:.1f}" for x in np.sqrt(np.mean(level**2, axis=0))))
    for i in range(3):
        cells.append(" / ".join(f"{x:.2f}" for x in lively[:, i]))
        cells.append(" / ".join(f"{x:.2f}" for x in off[:, i]))
    return f"| {name} | {' | '.join(cells)} |"


HEAD: Final = """\
Shape: log-spectral distance without life / alive / of the best single AR model. Level: rms difference, alive / of the \
part that was fitted. Liveliness: recorded / without life / alive / of the part that was fitted; and |ln ratio| to the \
recorded, without life / alive / of the part that was fitted.

| recording | shape [dB] | level [dB] | modulation, 2 to 10 Hz | off | spread of levels [dB] | off | crest | off |
|---|---|---|---|---|---|---|---|---|"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser("hapscene_experiments.held_out", description=__doc__.splitlines()[0])
    parser.add_argument("recordings", metavar="RECORDING", nargs="*", type=Path, help="files, and folders of them")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"of each swatch (default {SEEDS})")
    parser.add_argument("--simulated", action="store_true", help=f"and surfaces that are made: {', '.join(SURFACES)}")
    parser.add_argument("--quick", action="store_true", help="halves alone, three seeds")
    parser.add_argument("--rate", type=float, metavar="HZ", help="sample rate [Hz]")
    parser.add_argument("--units", default="", help="units of the quantities, as acceleration=g,force=N")
    options = parser.parse_args(arguments)
    if not (options.recordings or options.simulated):
        parser.error("nothing to judge: name recordings, or --simulated")
    seeds, splits = (3, (2,)) if options.quick else (options.seeds, (2, 3))
    done = 0
    try:
        given = list(_recordings(options))
        print(HEAD)
        for name, read in given:
            try:
                recording = read()
                for parts in splits:
                    print(_line(f"{name}, {parts} parts", scores(recording, parts, seeds)), flush=True)
                    done += 1
            except CaptureError as error:  # the others go on
                print(f"hapscene: {name}: {error}", file=sys.stderr)
    except CaptureError as error:
        print(f"hapscene: {error}", file=sys.stderr)
    return 0 if done else 2


if __name__ == "__main__":
    sys.exit(main())
