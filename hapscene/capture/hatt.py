"""Swatches from the files of the Penn Haptic Texture Toolkit (HaTT), and back.

What is kept: the file's own triangles, its line spectral frequencies as they stand (six decimals: they are what the
toolkit blends; its ARcoeff have more, and are used only where the frequencies are missing or do not ascend), the
variance blended as the toolkit does (interpolation "hatt"), the friction coefficient as both static and dynamic.
Models with zeros (the 1 kHz files) are refused; the swatch's
provenance to what error. What the files do not hold, stiffness and damping, is left at the default.

The toolkit's own renderer plays nothing below 0.05 mm/s and 0.05 N; that threshold is not in the files and not kept.
"""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.hatt_file import HattModels, HattTaps, read_models, read_taps, root_name
from hapscene.capture.streams import Array
from hapscene.dsp.ar_filter import ar_from_lsf
from hapscene.errors import HapsceneError, SwatchError
from hapscene.files import refusing, write_whole
from hapscene.surface.library import load_swatch
from hapscene.surface.swatch import Swatch, SwatchLike
from hapscene.surface.swatch_file import SUFFIX, save_swatch
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture

# Taps of the Penn Haptic Texture Toolkit: transients at 1 kHz, and the swatch's taps.


RATE_HZ: Final = 1000.0
"""Sample rate of the toolkit's transients [Hz]; the files do not state it."""

SAMPLES: Final = 100
"""Samples of one of the toolkit's transients [count]."""


def as_taps(taps: HattTaps) -> Taps:
    """The transients as they stand, and a decaying sinusoid fitted to each, for what needs amplitude and frequency.

    The sinusoid is the one of least squared error over amplitude, frequency and decay.
    """
    rows = np.array([_decaying_sinusoid(wave) for wave in taps.acceleration_m_s2])
    return Taps(taps.approach_m_s, rows[:, 0], rows[:, 1], rows[:, 2], taps.acceleration_m_s2, RATE_HZ)


def play_taps(taps: Taps) -> HattTaps:
    """The taps as transients of the toolkit, at the approach speeds that the swatch holds.

    Transients at the toolkit's rate stay as they are; others are cut, or filled with silence, to its length. A
    decaying sinusoid above 500 Hz is silent: the toolkit's rate cannot carry it.
    """
    waves = [taps.transient(float(speed), RATE_HZ) for speed in taps.approach_m_s]
    stored = taps.wave_m_s2 is not None and taps.wave_rate_Hz == RATE_HZ
    count = len(waves[0]) if stored else SAMPLES
    return HattTaps(np.asarray(taps.approach_m_s), np.stack([np.resize(np.pad(w, (0, count)), count) for w in waves]))


def _decaying_sinusoid(wave: Array) -> tuple[float, float, float]:
    """Amplitude [m/s²], frequency [Hz] and decay [1/s] of A exp(−βt) sin(2πft) nearest to a transient."""
    peak = float(np.abs(wave).max())
    t_s = np.arange(len(wave)) / RATE_HZ
    if peak == 0.0:
        return 0.0, RATE_HZ / 10, RATE_HZ / 10

    def off(p: Array) -> Array:
        return np.asarray(p[0] * np.exp(-p[2] * t_s) * np.sin(2.0 * np.pi * p[1] * t_s) - wave / peak)

    density = np.abs(np.fft.rfft(wave, 8 * len(wave)))
    loudest = float(np.argmax(density[1:]) + 1) * RATE_HZ / (8 * len(wave))
    bounds = ([-100.0, 1.0, 0.1], [100.0, RATE_HZ / 2, 5000.0])
    tries = [
        scipy.optimize.least_squares(off, [sign, min(max(frequency, 2.0), 499.0), decay], bounds=bounds)
        for frequency in (loudest, 1.5 * loudest)
        for decay in (20.0, 150.0)
        for sign in (1.0, -1.0)
    ]
    best = min(tries, key=lambda fit: float(fit.cost))
    return peak * abs(float(best.x[0])), float(best.x[1]), float(best.x[2])


LICENCE: Final = (
    "Not stated in the file. Files of the Penn Haptic Texture Toolkit are for non-profit research, "
    "and may not be passed on without Penn's approval."
)

_NOTES_MAX: Final = 20  # of what was odd in a file, in the provenance


def import_hatt(models_xml: str | os.PathLike[str], taps_xml: str | os.PathLike[str] | None = None) -> Swatch:
    """The swatch of a Models_X.xml and, where given, its Taps_X.xml.

    Above the largest force and speed of the models, the texture is that of the maximum.

    Raises:
        SwatchError: a file that is missing, too large, incomplete, or describes an unstable surface; the message names
            the file, the element and what was expected.
    """
    return import_noted(models_xml, taps_xml)[0]


def import_noted(
    models_xml: str | os.PathLike[str], taps_xml: str | os.PathLike[str] | None = None
) -> tuple[Swatch, str]:
    """What `import_hatt` does; beside the swatch, what its models were turned into and the error of it, else ""."""
    path = Path(models_xml)
    models = read_models(path)
    taps = None if taps_xml is None else read_taps(taps_xml)
    with refusing(SwatchError, path):
        texture, converted = _texture(models)
    unknown = "mu is missing: friction is taken as 0" if models.friction is None else ""
    notes = [note for note in (unknown, converted, *models.notes) if note]
    files = path.name if taps_xml is None else f"{path.name} and {Path(taps_xml).name}"
    if len(notes) > _NOTES_MAX:
        notes[_NOTES_MAX:] = [f"and {len(notes) - _NOTES_MAX} more of this kind"]
    provenance = f"Imported from {files} (layout of the Penn Haptic Texture Toolkit)."
    friction = models.friction or 0.0
    with refusing(SwatchError, path):
        swatch = Swatch(
            models.material,
            friction_static=friction,
            friction_dynamic=friction,
            texture=texture,
            taps=None if taps is None else as_taps(taps),
            absent=dict.fromkeys(("stiffness_N_m", "damping_Ns_m"), "files of the toolkit hold none"),
            provenance=" ".join([provenance, *(f"{note}." for note in notes)]),
            licence=LICENCE,
        )
    return swatch, converted


def _texture(models: HattModels) -> tuple[Texture, str]:
    """The texture of the models; where they have zeros, one without, and what that cost."""
    if not models.ma_lsf_rad.shape[1]:
        places = models.force_N, models.speed_m_s, models.triangles
        excitation = models.gain**2 * models.variance_m2_s4
        return Texture(models.rate_Hz, *places, models.ar_lsf_rad, excitation, interpolation="hatt"), ""
    zeros = models.ma_lsf_rad.shape[1]
    raise SwatchError(f"models with {zeros} zeros (the 1 kHz files) cannot be read: take the 10 kHz file")


def export_hatt(
    swatch: SwatchLike,
    models_xml: str | os.PathLike[str],
    taps_xml: str | os.PathLike[str] | None = None,
    *,
    rate_Hz: float | None = None,
) -> None:
    """Writes a swatch's texture, and with `taps_xml` its taps, in the toolkit's layout, each file whole or not at all.

    A texture that is not in interpolation "hatt" is the same at its models; between them the toolkit blends variance
    where hapscene blends power. Numbers have as many decimals as they need to come back to the bit. The toolkit knows
    no warped models: plain ones of higher order are written. `hatt_loses` says what else does not fit.

    Args:
        swatch: what is written.
        models_xml: the file for the texture.
        taps_xml: the file for the taps, or None.
        rate_Hz: rate to resample the texture to; the toolkit itself plays 10000 and 1000. None: the texture's own.

    Raises:
        SwatchError: the swatch has no texture, or no taps where they are asked for; a file cannot be written.
    """
    swatch = swatch if isinstance(swatch, Swatch) else load_swatch(swatch)
    if swatch.texture is None:
        raise SwatchError(f"swatch {swatch.name!r} has no texture: there are no models to write")
    if taps_xml is not None and swatch.taps is None:
        raise SwatchError(f"swatch {swatch.name!r} has no taps to write")
    texture = swatch.texture if rate_Hz is None else swatch.texture.resampled(rate_Hz)
    texture = texture.unwarped()
    texts = [(Path(models_xml), _models_text(swatch, texture))]
    if taps_xml is not None and swatch.taps is not None:
        texts.append((Path(taps_xml), _taps_text(play_taps(swatch.taps))))
    for path, text in texts:
        write_whole(path, text.encode(), SwatchError)


def hatt_loses(swatch: Swatch) -> list[str]:
    """What a swatch has and the toolkit's files do not hold, each as "its slow gain"."""
    texture = swatch.texture
    if texture is None:
        return []
    lost = {
        "the tool and the tip": bool(swatch.tool or swatch.tip),
        "the texture's slow gain": texture.life is not None,
        "its level beyond the largest force and speed": bool(np.any(texture.exponents != 0.0)),
        f"its warp (plain models of order {texture.unwarped().order} are written)": texture.warp != 0.0,
    }
    return [what for what, so in lost.items() if so]


def _models_text(swatch: Swatch, texture: Texture) -> str:
    """A models file."""
    from xml.sax.saxutils import escape

    speed_mm_s = 1e3 * texture.speed_m_s
    lines = ['<?xml version="1.0" encoding="utf-8"?>', '<modelSet texture="0">']
    head = {
        "material": escape(swatch.name),
        "AccelUnits": "m/s^2",
        "SpeedUnits": "mm/s",
        "ForceUnits": "N",
        "SampleRate": f"{texture.rate_Hz:.17g}",
        "mu": _decimal(swatch.friction_dynamic, 6),
        "numMod": str(len(speed_mm_s)),
        "numTri": str(len(texture.triangles)),
        "maxSpeed": _decimal(speed_mm_s.max(), 6),
        "maxForce": _decimal(texture.force_N.max(), 6),
    }
    lines += [f"   <{key}>{value}</{key}>" for key, value in head.items()]
    lines += _list("speedList", speed_mm_s, 6, 1, ' type="array"')
    lines += _list("forceList", texture.force_N, 6, 1, ' type="array"')
    for triangle in texture.triangles + 1:
        lines += _list("tri", triangle, 0, 1, ' type="array"')
    lines += [f"   <numARCoeff>{texture.order}</numARCoeff>", "   <numMACoeff>0</numMACoeff>"]
    coefficients = ar_from_lsf(texture.lsf_rad)
    for i in range(len(speed_mm_s)):
        lines += ["   <model>", f"      <modNum>{i + 1}</modNum>"]
        lines += _list("ARcoeff", coefficients[i], 20, 2) + _list("ARlsf", texture.lsf_rad[i], 6, 2)
        lines += [*_list("MAcoeff", np.ones(1), 20, 2), "      <MAlsf/>"]
        lines += [
            f"      <var>{_decimal(texture.variance_m2_s4[i], 10)}</var>",
            f"      <speedMod>{_decimal(speed_mm_s[i], 6)}</speedMod>",
            f"      <forceMod>{_decimal(texture.force_N[i], 6)}</forceMod>",
            "   </model>",
        ]
    return "\n".join([*lines, "</modelSet>", ""])


def _taps_text(taps: HattTaps) -> str:
    """A taps file."""
    speed_mm_s = 1e3 * taps.approach_m_s
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<tapSet>", f"   <numTap>{len(speed_mm_s)}</numTap>"]
    lines += _list("speedList", speed_mm_s, 6, 1, ' type="array"')
    for speed, wave in zip(speed_mm_s, taps.acceleration_m_s2, strict=True):
        lines += ["   <tap>", f"      <tapSpeed>{_decimal(speed, 6)}</tapSpeed>"]
        lines += [*_list("tapAccel", wave, 8, 2), "   </tap>"]
    return "\n".join([*lines, "</tapSet>", ""])


def _list(name: str, values: NDArray[np.generic], decimals: int, depth: int, attribute: str = "") -> list[str]:
    """The lines of an element that lists numbers."""
    indent = "   " * depth
    inner = [f"{indent}   <value>{_decimal(float(v), decimals)}</value>" for v in values.tolist()]
    return [f"{indent}<{name}{attribute}>", *inner, f"{indent}</{name}>"]


def _decimal(value: float, decimals: int) -> str:
    """The number with that many decimals, as the toolkit writes it; with all it needs, where that would round it."""
    text = f"{value:.{decimals}f}"
    return text if float(text) == float(value) else repr(float(value))


# Many files of the Penn Haptic Texture Toolkit at once: paired, imported, the broken ones named.


@dataclass
class ImportOutcome:
    """What became of a batch: the swatches made, and one sentence for each file that was not."""

    made: list[Path] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)


def import_many(
    files: Iterable[str | Path],
    folder: str | Path,
    say: Callable[[str], None] = lambda line: None,
    outcome: ImportOutcome | None = None,
) -> ImportOutcome:
    """Imports models files with the taps files of the same name, into `folder`/<name>.swatch.

    `Models_X.xml` and `Taps_X.xml` belong together; a single one of each does whatever its name. A folder stands for
    the .xml files in it. Each swatch is written whole or not at all; a broken file stops none of the others.

    Args:
        files: XML files and folders.
        folder: where the swatches go; made where it is missing.
        say: told a line for each swatch, and a second one where models with zeros were turned into models without.
        outcome: filled in as the batch goes on, for a caller that may be interrupted; None for a new one.

    Raises:
        SwatchError: the folder cannot be made.
    """
    outcome = ImportOutcome() if outcome is None else outcome
    pairs = _pairs(files, outcome)
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SwatchError(f"{target}: cannot be made: {error.strerror or error}") from None
    taken: dict[str, Path] = {}
    for i, (name, (models, taps)) in enumerate(pairs, 1):
        path = target / (name + SUFFIX)
        try:
            if path.name.casefold() in taken:
                raise SwatchError(f"{models}: would be {path.name}, as {taken[path.name.casefold()]}: another folder?")
            taken[path.name.casefold()] = models
            swatch, converted = import_noted(models, taps)
            save_swatch(swatch, path)
        except HapsceneError as error:
            outcome.broken.append(str(error))
            say(f"{i}/{len(pairs)}  {models.name}: broken")
            continue
        outcome.made.append(path)
        say(f"{i}/{len(pairs)}  {models.name} → {path.name}")
        if converted:
            say(f"  {converted}")
    return outcome


def _pairs(files: Iterable[str | Path], outcome: ImportOutcome) -> list[tuple[str, tuple[Path, Path | None]]]:
    """(name, (models file, its taps file or None)) in the order given."""
    paths: list[Path] = []
    for file in map(Path, files):
        paths += sorted(file.glob("*.xml")) if file.is_dir() else [file]
    found: dict[str, list[Path]] = {"modelSet": [], "tapSet": []}
    for path in dict.fromkeys(paths):
        try:
            kind = root_name(path)
        except HapsceneError as error:
            outcome.broken.append(str(error))
            continue
        if kind in found:
            found[kind].append(path)
        else:
            outcome.broken.append(f"{path}: the root element: expected <modelSet> or <tapSet>, found <{kind}>")
    models, taps = found.values()
    if len(models) == len(taps) == 1:
        return [(_key(models[0]), (models[0], taps[0]))]
    by_place = {(path.parent, _key(path)): path for path in taps}
    by_name = {_key(path): path for path in taps}
    pairs = []
    for path in models:
        partner = by_place.get((path.parent, _key(path)), by_name.get(_key(path)))
        if partner in taps:
            taps.remove(partner)
        pairs.append((_key(path), (path, partner)))
    outcome.broken += [f"{path}: expected Models_{_key(path)}.xml among the files, found none" for path in taps]
    return pairs


def _key(path: Path) -> str:
    """What a file is called without the toolkit's prefix."""
    return path.stem.removeprefix("Models_").removeprefix("Taps_") or path.stem
