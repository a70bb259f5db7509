"""How level and spectrum of a surface change with force and speed, learned from the Penn Haptic Texture Toolkit.

`python -m hapscene_evidence.paper.penn_toolkit FOLDER` reads the toolkit's 10 kHz files (Models_*.xml), which its
licence forbids to pass on, and prints the errors with which one condition of a surface predicts its other ones, by laws
that are learned from the other surfaces.
"""

import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.io.hatt import read_models
from hapscene.dsp.ar_filter import ar_from_lsf
from hapscene.perception import band_edges_Hz

Array = NDArray[np.float64]

CONDITIONS_MIN: Final = 6
"""Fewest conditions of a surface that is used. Models at the largest force or speed are copies of inner ones."""

LOG_HZ: Final = np.linspace(np.log(20.0), np.log(1000.0), 240, endpoint=False)
"""Logarithms of the frequencies of the spectra: 20 in each of the twelve bands."""

POWERS: Final = np.linspace(-0.4, 1.0, 15)
"""Exponents γ that are tried: frequencies grow as speed^γ."""

DB: Final = 10.0 / np.log(10.0)


def conditions_of(path: Path) -> tuple[Array, Array]:
    """Return logarithms of force and speed (n, 2), and spectra (n, 240) [dB re 1 (m/s²)²] of a file."""
    m = read_models(path)
    inner = (
        (m.variance_m2_s4 > 0.0) & (m.force_N < 0.9999 * m.force_N.max()) & (m.speed_m_s < 0.9999 * m.speed_m_s.max())
    )
    turn = np.exp(-2j * np.pi * np.outer(np.arange(m.ar_lsf_rad.shape[1] + 1), np.exp(LOG_HZ) / m.rate_Hz))
    a = np.array([ar_from_lsf(lsf) for lsf in m.ar_lsf_rad[inner]])
    density = m.variance_m2_s4[inner, None] / np.abs(a @ turn) ** 2 * 2.0 / m.rate_Hz
    places = np.log(np.stack([m.force_N[inner], m.speed_m_s[inner]], axis=1))
    return places, DB * np.log(density * np.exp(LOG_HZ) * np.diff(LOG_HZ)[0])


def bands(spectra_dB: Array) -> Array:
    """Return the levels (n, 12) of spectra in the perceptible bands [dB], relative to their total."""
    power = np.exp(spectra_dB / DB).reshape(len(spectra_dB), len(band_edges_Hz()) - 1, -1).sum(axis=2)
    return np.asarray(DB * np.log(power / power.sum(axis=1, keepdims=True)))


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def level_errors(surfaces: list[tuple[Array, Array]]) -> dict[str, list[float]]:
    """Return errors [dB] of a constant level, of exponents of 1 and 1, and of the mean exponents of other surfaces."""
    total = [DB * np.log(np.exp(spectra / DB).sum(axis=1)) for _, spectra in surfaces]
    own = [
        np.linalg.lstsq(p - p.mean(axis=0), (t - t.mean()) / DB)[0] for (p, _), t in zip(surfaces, total, strict=True)
    ]
    found: dict[str, list[list[float]]] = {}
    for k, ((places, _), level) in enumerate(zip(surfaces, total, strict=True)):
        learned = np.mean(own[:k] + own[k + 1 :], axis=0)
        by_force, by_speed = np.array_split(np.argsort(places, axis=0), 2)
        one: list[tuple[Any, Any]] = [([i], np.arange(len(level)) != i) for i in range(len(level))]
        splits = {"one condition → the others": one}
        splits["slow half → fast half"] = [(by_force[:, 1], by_speed[:, 1])]
        splits["soft half → hard half"] = [(by_force[:, 0], by_speed[:, 0])]
        for name, parts in splits.items():
            away = [(places[b] - places[a].mean(axis=0), level[b] - level[a].mean()) for a, b in parts]
            place, change = (np.concatenate(each) for each in zip(*away, strict=True))
            found.setdefault(name, []).append([rms(change - DB * place @ e) for e in ([0.0, 0.0], [1.0, 1.0], learned)])
    return {"exponents: mean": np.mean(own, axis=0).tolist(), "exponents: sd": np.std(own, axis=0).tolist()} | {
        name: np.mean(errors, axis=0).tolist() for name, errors in found.items()
    }


def spectrum_errors(surfaces: list[tuple[Array, Array]]) -> dict[str, float]:
    """Return the error [dB rms in bands at equal level] with which one condition predicts the others, by each law."""
    pairs = [np.nonzero(~np.eye(len(places), dtype=bool)) for places, _ in surfaces]
    changes = [places[j] - places[i] for (places, _), (i, j) in zip(surfaces, pairs, strict=True)]
    shape = [bands(spectra) for _, spectra in surfaces]
    moved = [b[j] - b[i] for b, (i, j) in zip(shape, pairs, strict=True)]
    normal, right = ([x.T @ y / len(x) for x, y in zip(changes, each, strict=True)] for each in (changes, moved))
    laws = [np.linalg.solve(sum(normal) - n, sum(right) - r) for n, r in zip(normal, right, strict=True)]
    linear = [rms(m - change @ law) for m, change, law in zip(moved, changes, laws, strict=True)]
    own = np.array([b.mean(axis=0) for b in shape])
    shrunk = []
    for k in range(len(surfaces)):
        others = [n for n in range(len(surfaces)) if n != k]
        mean = own[others].mean(axis=0)
        away = [[shape[n][at] - mean for at in pairs[n]] for n in range(len(surfaces))]
        kept = sum(np.sum(x * y) / len(x) for x, y in (away[n] for n in others))
        kept /= sum(np.sum(x * x) / len(x) for x, _ in (away[n] for n in others))
        shrunk.append(rms(away[k][1] - kept * away[k][0] - changes[k] @ laws[k]))
    means = np.array([spectra.mean(axis=0) - spectra.mean() for _, spectra in surfaces])
    found = {"does not move": float(np.mean([rms(m) for m in moved])), "bands change linearly": float(np.mean(linear))}
    found["the same, drawn to the mean surface"] = float(np.mean(shrunk))
    for name, fixed in (("frequencies ∝ speed^γ", 0.0), ("the same, mean spectrum of the tool fixed", 1.0)):
        errors = np.empty((len(surfaces), len(POWERS)))
        for k, ((_, spectra), (i, j)) in enumerate(zip(surfaces, pairs, strict=True)):
            tool = fixed * (means.sum(axis=0) - means[k]) / (len(means) - 1)
            for n, power in enumerate(POWERS):
                at = LOG_HZ - power * changes[k][:, 1:]
                made = [tool + np.interp(f, LOG_HZ, spectra[a] - tool) for f, a in zip(at, i, strict=True)]
                errors[k, n] = rms(bands(np.array(made)) - shape[k][j])
        best = np.argmin(errors.sum(axis=0) - errors, axis=1)
        found[f"{name}, γ = {np.mean(POWERS[best]):.2f}"] = float(np.mean(errors[np.arange(len(errors)), best]))
    return found


def main(folder: Path) -> None:
    """Print the tables."""
    surfaces = [
        found
        for file in sorted(folder.rglob("Models_*.xml"))
        if len((found := conditions_of(file))[0]) >= CONDITIONS_MIN
    ]
    if not surfaces:
        sys.exit(f"{folder}: no Models_*.xml with {CONDITIONS_MIN} conditions; download the toolkit's 10 kHz models")
    print(f"{len(surfaces)} surfaces; level errors [dB rms]: constant, exponents 1 and 1, learned")
    for name, errors in level_errors(surfaces).items():
        print(f"{name}: {', '.join(f'{error:.2f}' for error in errors)}")
    print("spectrum errors [dB rms in bands]")
    for name, error in spectrum_errors(surfaces).items():
        print(f"{name}: {error:.2f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
