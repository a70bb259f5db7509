"""Whether advice on what a recording lacks makes a better one: hands that follow it for 10 s, and that do not for 30 s.

    python -m hapscene_experiments.coverage_case --seeds 40
    python -m hapscene_experiments.coverage_case --seeds 40 --lengths 5 10 15 20

Surfaces are textures with known parameters: lines that move with speed and force, a level that follows a law drawn as
surfaces have them and departs from it. Hands stroke back and forth and waver as those of the recordings do in two
seconds (log-normal, 0.08 in force, 0.12 in speed, forgotten in 0.1 s). One follows the advice in words, late and not
always; one has a force and speed of its own; one wanders widely, as who was told to vary both. What they recorded is
fitted by the framework's own fit, and asked for forces and speeds all over the range that was wanted. The truth is the
parameters of the surface: nothing of what was recorded.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.capture import metric
from hapscene.capture.coverage import FORCE_N, SPEED_M_S, Coverage, Wanted
from hapscene.capture.recording_file import SurfaceRecording
from hapscene.capture.swatch_fit import fit
from hapscene.capture.synthesis import _Player
from hapscene.capture.texture_pieces import EXPONENT_SPREADS, EXPONENTS
from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.linear_prediction import solve
from hapscene.surface.life import Life
from hapscene.surface.texture import Texture
from hapscene_benchmarks.markdown import table

Array = NDArray[np.float64]

RATE_HZ: Final = 5000.0

BLOCK_S: Final = 0.05
"""How often the hand looks [s]: as often as the page is told."""

LATE_S: Final = 0.35
"""How long after the advice the hand does as it says [s]."""

LAPSE: Final = 0.1
"""Share of the advice that is passed over [1]."""

PACE_1_S: Final = 0.9
"""How fast a hand that was told "harder" changes its force or speed, as a logarithm [1/s]: by 2.5 times in a second."""

AIM_S, AIM_PACE_1_S, AIM_OFF = 0.4, 2.0, 0.15
"""A hand that looks where it is to go closes the distance in so many seconds [s], at most so fast [1/s], and errs by so
much [1], drawn anew for each goal: 15 % in force and in speed."""

WAVER: Final = (0.08, 0.12)
"""Standard deviations of the logarithms of force and speed within two seconds [1], of the recordings of wood, paper and
leather: 0.07 to 0.09, and 0.09 to 0.15."""

FORGOTTEN_S: Final = 0.1
"""What those forget with [s], there."""

STROKE_M, TURN_M = 0.15, 0.005
"""How long a stroke is, and over how much of its ends the hand turns round [m]."""

WIDE: Final = 0.5
"""Standard deviation of the logarithms of who wanders widely [1]."""

DEPARTS_DB: Final = 2.0
"""By how much a surface's level departs from its law, root mean square [dB] (`hapscene_experiments.level_prior`)."""

NOISE_M_S2: Final = 0.02
"""Of the accelerometer."""

PLACES: Final = 200
"""Forces and speeds that are asked for [count]."""

HANDS: Final = ("looks", "listens", "own way", "wanders widely")
GUIDED: Final = HANDS[:2]


def surface(seed: int, life: float = 0.3) -> Texture:
    """A surface: 9 × 9 models between the forces and speeds that are wanted, and somewhat beyond."""
    rng = np.random.default_rng([seed, 0])
    exponents = rng.normal(EXPONENTS, EXPONENT_SPREADS)
    line_Hz, moved = np.exp(rng.uniform(np.log(60.0), np.log(900.0), 4)), rng.uniform(0.0, 1.0, (4, 2)) * (0.7, 0.3)
    width, height = rng.uniform(0.1, 0.4, 4), np.exp(rng.normal(0.0, 0.7, 4))
    bumps = rng.normal(size=(2, 3, 3))
    force, speed = np.meshgrid(np.geomspace(0.5 * FORCE_N[0], 1.5 * FORCE_N[1], 9),
                               np.geomspace(0.5 * SPEED_M_S[0], 1.5 * SPEED_M_S[1], 9), indexing="ij")  # fmt: skip
    x, y = np.log(force / 1.0), np.log(speed / 0.08)
    waves = [np.cos(i * x + j * y + 6.0 * b) * a for (i, j), a, b in
             zip(np.ndindex(3, 3), bumps[0].ravel(), bumps[1].ravel(), strict=True) if i + j]  # fmt: skip
    departs = np.sum(waves, axis=0)
    departs *= DEPARTS_DB / departs.std()
    frequency = np.linspace(0.0, 0.5 * RATE_HZ, 2049)
    a = []
    for one, other in zip(x.ravel(), y.ravel(), strict=True):
        at = (line_Hz * np.exp(moved[:, 0] * other + moved[:, 1] * one))[:, None]
        density = 0.01 + np.sum(height[:, None] / (1.0 + ((frequency - at) / (width[:, None] * at)) ** 2), axis=0)
        a.append(solve(np.fft.irfft(density)[:21]))
    filters = np.stack(a)
    power = 10.0 * np.exp(exponents[0] * x + exponents[1] * y).ravel() * 10.0 ** (0.1 * departs.ravel())
    living = Life(np.array([life]), np.array([1.0 / 0.07]), np.zeros(1)) if life else None
    return Texture.from_models(
        RATE_HZ, force.ravel(), speed.ravel(), a=filters, variance_m2_s4=power / power_gain(filters), life=living
    )


def recorded(texture: Texture, hand: str, seconds: float, seed: int) -> tuple[SurfaceRecording, Coverage]:
    """What a hand records of a surface, and what the page said of it at the end."""
    rng = np.random.default_rng([seed, 1 + HANDS.index(hand)])
    coverage = Coverage(RATE_HZ, ("acceleration", "force", "speed"), Wanted(taps=0))
    player, block = _Player(texture, 1.0, seed), round(BLOCK_S * RATE_HZ)
    own = np.log([rng.uniform(0.6, 2.0), rng.uniform(0.06, 0.2)])
    goal, centre = own.copy(), np.log([np.sqrt(np.prod(FORCE_N)), np.sqrt(np.prod(SPEED_M_S))])
    pace = PACE_1_S * rng.uniform(0.7, 1.3, 2)
    waver, slow, place_m = rng.normal(size=2) * WAVER, rng.normal(size=2), 0.0
    advised: list[tuple[str, tuple[int, int] | None, Array]] = [("", None, own)] * round(LATE_S / BLOCK_S)
    aimed, off = None, np.zeros(2)
    streams = []
    for turn in range(round(seconds / BLOCK_S)):
        if hand in GUIDED:
            advised.append((coverage.advice() if rng.random() >= LAPSE else "", coverage.target, goal + waver))
            words, target, seen = advised.pop(0)
            if hand == "listens":
                goal = goal + BLOCK_S * pace * [_sign(words, "harder", "lightly"), _sign(words, "faster", "slower")]
            elif target is not None:
                if target != aimed:
                    aimed, off = target, AIM_OFF * rng.normal(size=2)
                edges = [coverage.force_N[target[0] :][:2], coverage.speed_m_s[target[1] :][:2]]
                away = np.log(edges).mean(axis=1) + off - seen
                goal = goal + BLOCK_S * np.clip(away / AIM_S, -AIM_PACE_1_S, AIM_PACE_1_S)
            goal = np.clip(goal, np.log([0.1, 0.01]), np.log([6.0, 0.6]))
        else:
            forgets, spread = (5.0, 0.15) if hand == "own way" else (2.0, WIDE)
            kept = np.exp(-BLOCK_S / forgets)
            slow = kept * slow + np.sqrt(1.0 - kept**2) * rng.normal(size=2)
            goal = (own if hand == "own way" else centre) + spread * slow
        kept, before = np.exp(-BLOCK_S / FORGOTTEN_S), waver
        waver = kept * waver + np.sqrt(1.0 - kept**2) * rng.normal(size=2) * WAVER
        force, speed = np.exp(goal[:, None] + np.linspace(before, waver, block).T)
        for i in range(block):  # slower where it turns round
            speed[i] *= np.sqrt(np.clip(min(place_m, STROKE_M - place_m) / TURN_M, 0.01, 1.0))
            place_m = (place_m + speed[i] / RATE_HZ) % STROKE_M
        heard = np.zeros(block)
        player.add(force, speed, heard)
        heard += NOISE_M_S2 * rng.normal(size=block)
        coverage.feed(turn * block, {"acceleration": heard, "force": force, "speed": speed})
        streams.append((heard, force, speed))
    acceleration, force, speed = np.concatenate(streams, axis=1)
    return SurfaceRecording(RATE_HZ, acceleration, force, speed, None), coverage


def _sign(words: str, up: str, down: str) -> float:
    return float(up in words) - float(down in words)


class Missed(NamedTuple):
    """How far a fit is from the surface, over forces and speeds that were wanted.

    Attributes:
        level_dB: error of the level, root mean square.
        shape_dB: log-spectral distance, level aside, mean.
        share: of the cells that had the pieces of a model [1].
        expected_dB: error of the level as the page expected it.
    """

    level_dB: float
    shape_dB: float
    share: float
    expected_dB: float


def missed(texture: Texture, hand: str, seconds: float, seed: int) -> Missed:
    """How far the fit of what a hand recorded is from the surface."""
    recording, coverage = recorded(texture, hand, seconds, seed)
    found = fit(recording).texture
    assert found is not None
    rng = np.random.default_rng([seed, 9])
    low, high = np.log([FORCE_N, SPEED_M_S]).T
    force, speed = np.exp(rng.uniform(low, high, (PLACES, 2))).T
    frequency = np.arange(20.0, 1000.0, 5.0)
    densities = [one.density(force, speed, frequency_Hz=frequency) for one in (found, texture)]
    level = 10.0 * np.log10(densities[0].sum(axis=1) / densities[1].sum(axis=1))
    shape = [metric.log_spectral_distance(one, two, frequency) for one, two in zip(*densities, strict=True)]
    share = float(np.mean(coverage.pieces >= 4))
    return Missed(float(np.sqrt(np.mean(level**2))), float(np.mean(shape)), share, coverage.error_dB)


def paired(first: Array, second: Array) -> str:
    """By how much the first (n,) are below the second: median, its 95 % interval by bootstrap, and in how many."""
    less = second - first
    drawn = np.median(np.random.default_rng(0).choice(less, (2000, len(less))), axis=1)
    low, high = np.quantile(drawn, (0.025, 0.975))
    return f"{np.median(less):.2f} [{low:.2f}, {high:.2f}], {np.count_nonzero(less > 0.0)} of {len(less)}"


def compared(found: Mapping[tuple[str, float], Sequence[Missed]]) -> str:
    """The medians of each hand and length, and the guided beside the others surface by surface."""
    columns = {key: np.array(rows).T for key, rows in found.items()}
    rows = [
        (f"{hand}, {seconds:g} s", *(f"{np.median(row):.2f}" for row in column))
        for (hand, seconds), column in columns.items()
    ]
    made = str(table(("hand", "level [dB]", "shape [dB]", "cells with a model's pieces", "level as expected"), rows))
    rows = [
        (f"{hand}, {seconds:g} s, under {other}, {length:g} s", *map(paired, column[:2], columns[other, length][:2]))
        for (hand, seconds), column in columns.items() if hand in GUIDED
        for other, length in columns if other not in GUIDED
    ]  # fmt: skip
    return made + "\n" + str(table(("", "level: median, 95 %, surfaces", "shape"), rows))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser("hapscene_experiments.coverage_case", description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="surfaces (default 20)")
    parser.add_argument("--lengths", type=float, nargs="+", default=[10.0], help="of the guided [s] (default 10)")
    parser.add_argument("--unguided", type=float, default=30.0, help="seconds of the others (default 30)")
    options = parser.parse_args(arguments)
    cases = [(hand, seconds) for hand in GUIDED for seconds in options.lengths]
    cases += [(hand, options.unguided) for hand in HANDS if hand not in GUIDED]
    found: dict[tuple[str, float], list[Missed]] = {case: [] for case in cases}
    for seed in range(options.seeds):
        texture = surface(seed)
        for case in cases:
            found[case].append(missed(texture, *case, seed))
        print(f"surface {seed + 1} of {options.seeds}", file=sys.stderr, flush=True)
    print(compared(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
