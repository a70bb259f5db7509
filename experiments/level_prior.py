"""How loud surfaces get with force and speed: what `hapscene.capture.fit.windows` expects before it has measured.

`python -m hapscene_experiments.level_prior FOLDER` learns it from the models of many surfaces, such as the 1 kHz files
of the Penn Haptic Texture Toolkit (Culbertson, Lopez Delgado & Kuchenbecker 2014), which may not be passed on and are
not here. Of each surface ln power = c + α ln force + β ln speed is fitted to the places that were recorded; the
surfaces' own (α, β) are taken to be normal, and its mean and covariance are found with each surface's error taken out
(expectation–maximisation). Then every surface is left out once and predicted by what the others say.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.hatt_file import HattModels, read_models
from hapscene.dsp.ar_filter import ar_from_lsf, power_response
from hapscene_benchmarks.markdown import table

Array = NDArray[np.float64]

PLACES_MIN: Final = 6
"""Fewest recorded places of a surface whose law is fitted [count]."""

SCATTER_DB: Final = 2.0
"""Scatter of a place about its surface's law [dB]: the median of the toolkit's surfaces."""

LOW_HZ: Final = 20.0
"""Lowest frequency that counts [Hz]."""

DB: Final = 10.0 / np.log(10.0)


class Places(NamedTuple):
    """Where a surface was recorded: ln force and ln speed (n, 2), and ln power (n,)."""

    at: Array
    power: Array


class Prior(NamedTuple):
    """Exponents of the power over force and speed that surfaces have: mean (2,) and covariance (2, 2)."""

    mean: Array
    covariance: Array


OLD: Final = Prior(np.ones(2), 0.25 * np.eye(2))
"""Vibration in proportion to the power of friction, force times speed: what stood here before anything was learnt."""

NONE: Final = Prior(np.zeros(2), 1e-12 * np.eye(2))
"""The level does not change: clamped."""

FREE: Final = Prior(np.zeros(2), 1e4 * np.eye(2))
"""Nothing is expected: least squares."""


def recorded_places(models: HattModels) -> Places:
    """The places of a file that were recorded; left out is what is silent, a copy, or only closes the rectangle."""
    omega = np.pi * (np.arange(4096) + 0.5) / 4096
    numerator = ar_from_lsf(models.ma_lsf_rad) if models.ma_lsf_rad.shape[1] else np.ones((len(models.gain), 1))
    density = power_response(ar_from_lsf(models.ar_lsf_rad), omega) / power_response(numerator, omega)
    heard = omega >= 2.0 * np.pi * LOW_HZ / models.rate_Hz
    power = models.gain**2 * models.variance_m2_s4 * (density * heard).mean(axis=1)
    force, speed = models.force_N, models.speed_m_s
    inner = (force > 0.0) & (speed > 0.0) & (power > 0.0)
    inner &= (force < force.max() * (1.0 - 1e-6)) & (speed < speed.max() * (1.0 - 1e-6))
    _, first = np.unique(np.column_stack((power, models.ar_lsf_rad[:, :3])).round(9), axis=0, return_index=True)
    kept = [i for i in sorted(first.tolist()) if inner[i]]
    return Places(np.log(np.column_stack((force, speed))[kept]), np.log(power[kept]))


def law(places: Places) -> tuple[Array, Array]:
    """Exponents (2,) of a surface by least squares, and the covariance (2, 2) of their error."""
    row = np.column_stack((np.ones(len(places.power)), places.at))
    found, *_ = np.linalg.lstsq(row, places.power, rcond=None)
    variance = np.sum((places.power - row @ found) ** 2) / (len(row) - 3)
    return np.asarray(found[1:]), np.asarray((variance * np.linalg.inv(row.T @ row))[1:, 1:])


def learn(laws: Sequence[tuple[Array, Array]], rounds: int = 100) -> Prior:
    """The normal distribution that surfaces' exponents come from, their own errors taken out."""
    found, error = np.array([one[0] for one in laws]), np.array([one[1] for one in laws])
    mean, between = found.mean(axis=0), np.cov(found.T)
    for _ in range(rounds):
        weight = np.linalg.inv(between + error)
        mean = np.linalg.solve(weight.sum(axis=0), np.einsum("nij,nj->i", weight, found))
        share = between @ weight
        true = mean + np.einsum("nij,nj->ni", share, found - mean)
        rest = between - share @ between
        between = (np.einsum("ni,nj->ij", true - mean, true - mean) + rest.sum(axis=0)) / len(found)
    return Prior(mean, between)


def predicted(known: Places, at: Array, prior: Prior) -> Array:
    """ln power (k,) at other places (k, 2) of a surface that is known at some: the posterior mean."""
    middle, precision = known.at.mean(axis=0), np.linalg.inv(prior.covariance)
    away, weight = known.at - middle, (DB / SCATTER_DB) ** 2
    side = weight * away.T @ (known.power - known.power.mean()) + precision @ prior.mean
    exponents = np.linalg.solve(weight * away.T @ away + precision, side)
    return np.asarray(known.power.mean() + (at - middle) @ exponents)


def left_out(surfaces: Mapping[str, Places], seed: int = 0, ones: int = 8) -> dict[str, dict[str, float]]:
    """How far levels are off [dB rms, mean over surfaces], each surface left out of what is learnt: by task, by prior.

    From one place to all others, from the slow half to the fast one, from the soft half to the hard one.
    """
    rng, laws = np.random.default_rng(seed), {name: law(places) for name, places in surfaces.items()}
    off: dict[str, dict[str, list[float]]] = {}
    for name, (at, power) in surfaces.items():
        learnt = learn([one for other, one in laws.items() if other != name])
        priors = {"clamped": NONE, "exponents 1 and 1": OLD, "least squares": FREE, "learnt": learnt}
        tasks = [("one place → the others", [int(i)]) for i in rng.permutation(len(power))[:ones]]
        for said, axis in (("slow half → fast half", 1), ("soft half → hard half", 0)):
            tasks.append((said, np.argsort(at[:, axis], kind="stable")[: len(power) // 2].tolist()))
        for task, known in tasks:
            rest = np.setdiff1d(np.arange(len(power)), known)
            for prior, numbers in priors.items():
                if len(known) > 3 or (prior != "least squares" and len(known) == 1):
                    far = power[rest] - predicted(Places(at[known], power[known]), at[rest], numbers)
                    off.setdefault(task, {}).setdefault(prior, []).append(DB * float(np.sqrt(np.mean(far**2))))
    return {task: {prior: float(np.mean(each)) for prior, each in found.items()} for task, found in off.items()}


def read_surfaces(folder: Path) -> dict[str, Places]:
    """The recorded places of each surface of a folder that has `PLACES_MIN` or more of them."""
    found = {path.stem: recorded_places(read_models(path)) for path in sorted(folder.glob("Models_*.xml"))}
    return {name: places for name, places in found.items() if len(places.power) >= PLACES_MIN}


def report(surfaces: Mapping[str, Places]) -> str:
    """What is learnt, and how well it does on surfaces that were left out, in words and a table."""
    prior, off = learn([law(places) for places in surfaces.values()]), left_out(surfaces)
    told = [
        f"{one:.2f} (sd {np.sqrt(var):.2f})" for one, var in zip(prior.mean, prior.covariance.diagonal(), strict=True)
    ]
    names = list(dict.fromkeys(name for found in off.values() for name in found))
    rows = [(task, *(f"{found[n]:.1f}" if n in found else "–" for n in names)) for task, found in off.items()]
    said = f"{len(surfaces)} surfaces: exponent of force {told[0]}, of speed {told[1]}"
    return f"{said}.\n\n{table(('level off [dB rms]', *names), rows)}"


if __name__ == "__main__":
    print(report(read_surfaces(Path(sys.argv[1]))))
