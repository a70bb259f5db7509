"""Swatches from the files of the Penn Haptic Texture Toolkit (HaTT), and back.

What is kept: the file's own triangles, its line spectral frequencies as they stand (six decimals: they are what the
toolkit blends; its ARcoeff have more, and are used only where the frequencies are missing or do not ascend), the
variance blended as the toolkit does (interpolation "hatt"), the friction coefficient as both static and dynamic.
Models with zeros (the 1 kHz files) are turned into models without: `hapscene.capture.arma` says how, the swatch's
provenance to what error. What the files do not hold, stiffness and damping, is left at the default.

The toolkit's own renderer plays nothing below 0.05 mm/s and 0.05 N; that threshold is not in the files and not kept.
"""

import os
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.hatt_file import HattModels, HattTaps, read_models, read_taps
from hapscene.capture.hatt_tap import as_taps, play_taps
from hapscene.errors import SwatchError
from hapscene.output import whole_file
from hapscene.surface.lsf import ar_from_lsf
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

Array = NDArray[np.float64]

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
    notes = list(models.notes)
    texture, converted = _texture(path, models)
    if converted:
        notes.insert(0, converted)
    if models.friction is None:
        notes.insert(0, "mu is missing: friction is taken as 0")
    files = path.name if taps_xml is None else f"{path.name} and {Path(taps_xml).name}"
    if len(notes) > _NOTES_MAX:
        notes[_NOTES_MAX:] = [f"and {len(notes) - _NOTES_MAX} more of this kind"]
    provenance = f"Imported from {files} (layout of the Penn Haptic Texture Toolkit)."
    friction = models.friction or 0.0
    try:
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
    except SwatchError as error:
        raise SwatchError(f"{path}: {error}") from None
    return swatch, converted


def _texture(path: Path, models: HattModels) -> tuple[Texture, str]:
    """The texture of the models; where they have zeros, one without, and what that cost."""
    try:
        if not models.ma_lsf_rad.shape[1]:
            excitation = models.gain**2 * models.variance_m2_s4
            texture = Texture(
                models.rate_Hz,
                models.force_N,
                models.speed_m_s,
                models.triangles,
                models.ar_lsf_rad,
                excitation,
                interpolation="hatt",
            )
            return texture, ""
        from hapscene.capture.arma import as_texture

        made = as_texture(models)
    except SwatchError as error:
        raise SwatchError(f"{path}: {error}") from None
    zeros, poles = models.ma_lsf_rad.shape[1], models.ar_lsf_rad.shape[1]
    return made.texture, (
        f"Models of {poles} poles and {zeros} zeros turned into {len(made.texture.force_N)} all-pole models of order "
        f"{made.texture.order}: the spectrum is {made.error_at_models_dB:.2g} dB off at most at the models, "
        f"{made.error_rms_dB:.2g} dB rms and {made.error_max_dB:.2g} dB at most between them"
    )


def export_hatt(
    swatch: Swatch,
    models_xml: str | os.PathLike[str],
    taps_xml: str | os.PathLike[str] | None = None,
    rate_Hz: float | None = None,
) -> None:
    """Writes a swatch's texture, and with `taps_xml` its taps, in the toolkit's layout, each file whole or not at all.

    A texture that is not in interpolation "hatt" is the same at its models; between them the toolkit blends variance
    where hapscene blends power. Numbers have as many decimals as they need to come back to the bit.

    Args:
        swatch: what is written.
        models_xml: the file for the texture.
        taps_xml: the file for the taps, or None.
        rate_Hz: rate to resample the texture to; the toolkit itself plays 10000 and 1000. None: the texture's own.

    Raises:
        SwatchError: the swatch has no texture, or no taps where they are asked for; a file cannot be written.
    """
    if swatch.texture is None:
        raise SwatchError(f"swatch {swatch.name!r} has no texture: there are no models to write")
    if taps_xml is not None and swatch.taps is None:
        raise SwatchError(f"swatch {swatch.name!r} has no taps to write")
    texture = swatch.texture if rate_Hz is None else swatch.texture.resampled(rate_Hz)
    texts = [(Path(models_xml), _models_text(swatch, texture))]
    if taps_xml is not None and swatch.taps is not None:
        texts.append((Path(taps_xml), _taps_text(play_taps(swatch.taps))))
    for path, text in texts:
        try:
            with whole_file(path) as part:
                part.write_text(text, encoding="utf-8", newline="\n")
        except OSError as error:
            raise SwatchError(f"{path}: cannot be written: {error.strerror or error}") from None


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
