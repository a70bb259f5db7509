"""Swatch files: one JSON text per material, safe to open from untrusted sources.

Numbers are written so that they are read back exactly. Reading runs no code, reads at most `BYTES_MAX`, and checks
every key, type, shape and number. The result is a valid `Swatch`, or a `SwatchError` with the file, the key and what
was expected."""

import base64
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SwatchError, warn
from hapscene.io.files import Json, check_keys, parse_format, read_bytes, refusing, short, write_whole
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.look import PICTURE_BYTES_MAX, Look
from hapscene.surface.swatch import NAME_MAX, OWN_PARAMETERS, TOOL_FIELDS, Swatch
from hapscene.surface.taps import TAP_MAX, TAP_ROWS, Taps
from hapscene.surface.texture import MODEL_MAX, Texture

__all__ = [
    "BYTES_MAX",
    "SUFFIX",
    "TEXT_MAX",
    "SwatchWarning",
    "is_number",
    "read_swatch",
    "save_swatch",
    "swatch_from_json",
    "swatch_to_bytes",
    "swatch_to_json",
]

SUFFIX: Final = ".swatch"
FORMAT: Final = "hapscene swatch"
VERSION: Final = 4
"""Version of the format, raised when a reader of the old version would misread the new one. Version 3 adds looks, 4
adds tools and tips; swatches without them are written as version 2 or 3."""

BYTES_MAX: Final = 32 * 1024 * 1024
"""Largest file that is opened [bytes]: 100 models of order 120 have 0.3 MB, `NUMBER_MAX` frequencies 21 MB. With the
limits of `hapscene.io.files`, opening takes at most 175 MB for a valid file, 330 MB for the worst file found."""

NUMBER_MAX: Final = 256 * MODEL_MAX
"""Most numbers in a list of a texture [count]: `MODEL_MAX` models of order 256, or fewer of a higher order."""

TEXT_MAX: Final = 100_000
"""Longest provenance or licence [characters]: a long licence has 35,000."""

_TEXTS: Final = ("name", "provenance", "licence")
_TEXTURE_ROWS: Final = ("force_N", "speed_m_s", "variance_m2_s4", "triangles", "lsf_rad")
_REGIMES: Final = ("other", "dwell_s")
_LAYERS: Final = ("layers", "layer_by", "layer_at_rad")
_PICTURES: Final = ("albedo_png", "normal_png")
_MODULATION_ROWS: Final = ("spread", "decay_1_s", "decay_1_m")

MEASURED_MAX: Final = 4 * TAP_MAX
"""Most intervals, and most reasons, of a swatch [count]: three for each tap and one for each parameter."""


class SwatchWarning(UserWarning):
    """A swatch file has parts that are no longer rendered."""


def save_swatch(swatch: Swatch, path: str | os.PathLike[str]) -> None:
    """Write a swatch to a file (suffix .swatch), atomically.

    Raises:
        SwatchError: the suffix differs, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix != SUFFIX:
        raise SwatchError(f"{target}: the name of a swatch file must end in {SUFFIX}")
    write_whole(target, swatch_to_bytes(swatch), SwatchError)


def swatch_to_bytes(swatch: Swatch) -> bytes:
    """Return the content of a swatch file.

    Raises:
        SwatchError: a text could not be read back.
    """
    for key in _TEXTS:
        _text(key, getattr(swatch, key))
    return swatch_to_json(swatch).encode("utf-8")


def swatch_to_json(swatch: Swatch) -> str:
    """Return the text of a swatch file: one key or one row of numbers per line."""
    tools = {key: getattr(swatch, key) for key in TOOL_FIELDS if getattr(swatch, key)}
    version = VERSION if tools else 2 if swatch.look is None else 3
    content: dict[str, Json] = {"format": FORMAT, "version": version}
    content |= {key: getattr(swatch, key) for key in (*_TEXTS, "albedo_rgb")} | tools | swatch.own_numbers
    content |= {key: getattr(swatch, key) for key in ("effects", "intervals", "absent")}
    if swatch.look is not None:
        content["look"] = _look_content(swatch.look)
    content["taps"] = _taps_content(swatch.taps)
    if swatch.leaving is not None:
        content["leaving"] = _taps_content(swatch.leaving)
    content["texture"] = None
    if swatch.texture is not None:
        content["texture"] = _texture_content(swatch.texture)
    return _layout(content, "") + "\n"


def _look_content(look: Look) -> dict[str, Json]:
    """Return the section of a look, with pictures as base64."""
    pictures = {key: base64.b64encode(getattr(look, key)).decode("ascii") for key in _PICTURES if getattr(look, key)}
    return {"roughness": look.roughness, "size_m": look.size_m} | pictures


def _taps_content(taps: Taps | None) -> dict[str, Json] | None:
    if taps is None:
        return None
    rows = (*TAP_ROWS, *(() if taps.wave_m_s2 is None else ("wave_rate_Hz", "wave_m_s2")))
    return {key: getattr(taps, key) for key in rows}


def _texture_content(texture: Texture) -> dict[str, Json]:
    """Return the section of a texture."""
    content = {key: getattr(texture, key) for key in ("rate_Hz", "interpolation", "warp", "exponents")}
    gain = texture.modulation
    content["life"] = gain if gain is None else {key: getattr(gain, key) for key in _MODULATION_ROWS}
    content |= {key: getattr(texture, key) for key in _TEXTURE_ROWS}
    return content


def _layout(value: object, indent: str) -> str:
    """Format JSON with each list of numbers on one line, which json.dumps cannot do."""
    inner = indent + "  "
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        if not value:
            return "{}"
        lines = ",\n".join(f"{inner}{json.dumps(key)}: {_layout(item, inner)}" for key, item in value.items())
        return f"{{\n{lines}\n{indent}}}"
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return "[" + ", ".join(_layout(item, indent) for item in value) + "]"
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + ",\n".join(inner + json.dumps(row) for row in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def read_swatch(path: Path) -> Swatch:
    """Read a swatch file.

    Raises:
        SwatchError: the file is missing, too large, damaged, of a later version, or has an unstable texture.

    Warns:
        SwatchWarning: the file has parts of a texture of an earlier version that are no longer rendered.
    """
    with refusing(SwatchError):
        data = read_bytes(path, BYTES_MAX, "swatch")
    with refusing(SwatchError, path):
        return swatch_from_json(data)


def swatch_from_json(data: bytes | str) -> Swatch:
    """Read the content of a swatch file.

    Raises:
        SwatchError: the content is not JSON, not a swatch, of a later version, or has a wrong key, type, shape or
            number.
    """
    with refusing(SwatchError):
        return _swatch(parse_format(data, "a swatch", FORMAT, VERSION))


def _swatch(content: dict[str, Json]) -> Swatch:
    sections = ["effects", "intervals", "absent", "taps", "leaving", "texture"]
    if content["version"] >= 3:
        sections.append("look")
    texts = (*_TEXTS, *(TOOL_FIELDS if content["version"] >= 4 else ()))
    check_keys("", content, ("format", "version", *texts, "albedo_rgb", *OWN_PARAMETERS, *sections), ("name",))
    fields: dict[str, Any] = {key: _text(key, content[key]) for key in texts if key in content}
    fields |= {key: _number(key, content[key]) for key in OWN_PARAMETERS if key in content}
    if "albedo_rgb" in content:
        fields["albedo_rgb"] = tuple(_array("albedo_rgb", content["albedo_rgb"], 1))
    effects = _effects(content.get("effects", {}))
    effects.get("lpc_texture", {}).pop("angle_deg", None)  # of layers, which are no longer rendered
    fields["effects"] = effects
    intervals, absent = (_measured(key, content.get(key, {})) for key in ("intervals", "absent"))
    fields["intervals"] = {name: tuple(_array(f"intervals.{name}", pair, 1)) for name, pair in intervals.items()}
    fields["absent"] = {name: _text(f"absent.{name}", reason) for name, reason in absent.items()}
    fields |= {key: _taps(key, content.get(key)) for key in ("taps", "leaving")}
    fields["look"] = _look(content.get("look"))
    fields["texture"] = _texture(content.get("texture"), content["version"])
    if any((content.get("texture") or {}).get(key) is not None for key in ("other", "layers")):
        warn(
            f"swatch {fields['name']!r}: a second regime or layers of its texture, written by an earlier version, are "
            "ignored; the texture is rendered without them",
            SwatchWarning,
        )
    return Swatch(**fields)


def _look(content: Json) -> Look | None:
    if content is None:
        return None
    check_keys("look", content, ("roughness", "size_m", *_PICTURES), ())
    fields: dict[str, Any] = {
        key: _number(f"look.{key}", content[key]) for key in ("roughness", "size_m") if key in content
    }
    for key in _PICTURES:
        text = content.get(key, "")
        if not isinstance(text, str) or len(text) > 2 * PICTURE_BYTES_MAX:
            raise SwatchError(f"look.{key} must be a PNG picture as base64 of at most {PICTURE_BYTES_MAX:,} bytes")
        try:
            fields[key] = base64.b64decode(text, validate=True)
        except ValueError:
            raise SwatchError(f"look.{key} must be a PNG picture as base64, is {short(text)}") from None
    return Look(**fields)


def _texture(content: Json, version: int) -> Texture | None:
    where = "texture"
    if content is None:
        return None
    required = ("rate_Hz", *_TEXTURE_ROWS)
    known = [*required, "interpolation"]
    if version == 1:
        known.append("excitation")  # distribution of the noise, which is inaudible: ignored
    else:
        known += ["warp", "exponents", "life", *_REGIMES]
    if version >= 4:
        known += _LAYERS
    check_keys(where, content, known, required)
    fields: dict[str, Any] = {}
    for key in _TEXTURE_ROWS:
        dimensions = 2 if key in ("triangles", "lsf_rad") else 1
        fields[key] = _array(f"{where}.{key}", content[key], dimensions, whole=key == "triangles")
    if "exponents" in content:
        fields["exponents"] = _array(f"{where}.exponents", content["exponents"], 1)
    fields |= {key: _number(f"{where}.{key}", content[key]) for key in ("rate_Hz", "warp") if key in content}
    fields["modulation"] = _modulation(f"{where}.life", content.get("life"))
    return Texture(**fields, interpolation=_text(f"{where}.interpolation", content.get("interpolation", "lsf")))


def _modulation(where: str, content: Json) -> GainModulation | None:
    if content is None:
        return None
    check_keys(where, content, _MODULATION_ROWS)
    return GainModulation(**{key: _array(f"{where}.{key}", content[key], 1) for key in _MODULATION_ROWS})


def _taps(where: str, content: Json) -> Taps | None:
    if content is None:
        return None
    check_keys(where, content, (*TAP_ROWS, "wave_rate_Hz", "wave_m_s2"), TAP_ROWS)
    fields: dict[str, Any] = {key: _array(f"{where}.{key}", content[key], 1) for key in TAP_ROWS}
    if "wave_m_s2" in content or "wave_rate_Hz" in content:
        check_keys(where, content, content, ("wave_rate_Hz", "wave_m_s2"))
        fields["wave_rate_Hz"] = _number(f"{where}.wave_rate_Hz", content["wave_rate_Hz"])
        fields["wave_m_s2"] = _array(f"{where}.wave_m_s2", content["wave_m_s2"], 2)
    return Taps(**fields)


def _measured(where: str, content: object) -> dict[str, Json]:
    """Check a mapping of names of measured parameters."""
    if not isinstance(content, dict) or len(content) > MEASURED_MAX:
        raise SwatchError(f"{where} must be an object of at most {MEASURED_MAX} entries")
    return {_text(f"a name in {where}", name): value for name, value in content.items()}


def _effects(content: object) -> dict[str, dict[str, float]]:
    if not isinstance(content, dict) or not all(isinstance(numbers, dict) for numbers in content.values()):
        raise SwatchError('effects must be an object of objects, as {"friction": {"bristle_m": 1e-4}}')
    for name in (*content, *(param for numbers in content.values() for param in numbers)):
        if not (len(name) <= NAME_MAX and name.isprintable()):
            raise SwatchError(f"effects: a name must be at most {NAME_MAX} printable characters, is {short(name)}")
    return {
        effect: {param: _number(f"effects.{effect}.{param}", value) for param, value in numbers.items()}
        for effect, numbers in content.items()
    }


def _text(where: str, value: object) -> str:
    if not isinstance(value, str):
        raise SwatchError(f"{where} must be a text, is {short(value)}")
    if len(value) > TEXT_MAX or any("\ud800" <= c <= "\udfff" for c in value):
        raise SwatchError(f"{where} must be a text of at most {TEXT_MAX} characters that UTF-8 has")
    return value


def is_number(value: Json) -> bool:
    """Return whether a JSON value is a finite number, excluding true and false; an int can have any size."""
    return type(value) in (int, float) and -1e300 < value < 1e300


def _number(where: str, value: Json) -> float:
    if not is_number(value):
        raise SwatchError(f"{where} must be a finite number, is {short(value)}")
    return float(value)


def _array(where: str, value: object, dimensions: int, whole: bool = False) -> NDArray[np.float64]:
    """Convert nested lists of numbers to an array with this number of dimensions."""
    rows = value if dimensions == 2 else [value]
    if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
        raise SwatchError(f"{where} must be a list of {'lists of ' if dimensions == 2 else ''}numbers")
    if len({len(row) for row in rows}) > 1:
        raise SwatchError(f"{where} must have rows of one length")
    if sum(map(len, rows)) > NUMBER_MAX:
        raise SwatchError(f"{where} has more than {NUMBER_MAX} numbers")
    for i, row in enumerate(rows):
        for j, number in enumerate(row):
            if not is_number(number):
                place = f"{where}[{i}][{j}]" if dimensions == 2 else f"{where}[{j}]"
                raise SwatchError(f"{place} must be a finite number, is {short(number)}")
            if whole and (type(number) is not int or not 0 <= number < 1 << 31):
                raise SwatchError(f"{where}[{i}][{j}] must be the index of a model, is {short(number)}")
    array = np.array(rows, dtype=np.float64)
    return array if dimensions == 2 else array[0]
