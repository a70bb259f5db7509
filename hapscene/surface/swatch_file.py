"""Swatch files: one JSON text per material, safe to open from untrusted sources.

Numbers are written so that they are read back exactly. Reading runs no code, reads at most `BYTES_MAX`, and checks
every key, type, shape and number. The result is a valid `Swatch`, or a `SwatchError` with the file, the key and what
was expected."""

import base64
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
import numpy as np
from msgspec import Meta
from msgspec.structs import asdict
from numpy.typing import NDArray

from hapscene.errors import SwatchError, warn
from hapscene.io.files import Json, parse_format, read_bytes, refusing, short, to_struct, write_whole
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.look import PICTURE_BYTES_MAX, Look
from hapscene.surface.swatch import NAME_MAX, TOOL_FIELDS, Swatch
from hapscene.surface.taps import TAP_MAX, TAP_ROWS, Taps
from hapscene.surface.texture import MODEL_MAX, Texture

__all__ = [
    "BYTES_MAX",
    "SUFFIX",
    "TEXT_MAX",
    "Number",
    "SwatchWarning",
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
_IGNORED: Final = ("excitation", "other", "dwell_s", "layers", "layer_by", "layer_at_rad")
_PICTURES: Final = ("albedo_png", "normal_png")
_MODULATION_ROWS: Final = ("spread", "decay_1_s", "decay_1_m")

MEASURED_MAX: Final = 4 * TAP_MAX
"""Most intervals, and most reasons, of a swatch [count]: three for each tap and one for each parameter."""

Number = Annotated[float, Meta(gt=-1e300, lt=1e300)]
"""A finite number of a file."""

_Index = Annotated[int, Meta(ge=0, lt=1 << 31)]
_Row = Annotated[list[Number], Meta(max_length=NUMBER_MAX)]
_Text = Annotated[str, Meta(max_length=TEXT_MAX)]
_Name = Annotated[str, Meta(max_length=NAME_MAX)]
_Picture = Annotated[bytes, Meta(max_length=PICTURE_BYTES_MAX)]


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
        if len(getattr(swatch, key)) > TEXT_MAX:
            raise SwatchError(f"{key} must be a text of at most {TEXT_MAX} characters")
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


class _Look(msgspec.Struct, forbid_unknown_fields=True):
    roughness: Number = Look.roughness
    size_m: Number = Look.size_m
    albedo_png: _Picture = b""
    normal_png: _Picture = b""


class _Modulation(msgspec.Struct, forbid_unknown_fields=True):
    spread: _Row
    decay_1_s: _Row
    decay_1_m: _Row


class _Taps(msgspec.Struct, forbid_unknown_fields=True):
    approach_m_s: _Row
    amplitude_m_s2: _Row
    frequency_Hz: _Row
    decay_1_s: _Row
    wave_m_s2: list[_Row] | None = None
    wave_rate_Hz: Number = 0.0


class _Texture(msgspec.Struct, forbid_unknown_fields=True):
    rate_Hz: Number
    force_N: _Row
    speed_m_s: _Row
    variance_m2_s4: _Row
    triangles: list[tuple[_Index, _Index, _Index]]
    lsf_rad: list[_Row]
    interpolation: str = "lsf"
    warp: Number = 0.0
    exponents: tuple[Number, Number] = (0.0, 0.0)
    life: _Modulation | None = None
    # of earlier versions, no longer rendered: the distribution of the noise, a second regime, layers by angle
    excitation: Any = None
    other: Any = None
    dwell_s: Any = None
    layers: Any = None
    layer_by: Any = None
    layer_at_rad: Any = None


class _Content(msgspec.Struct, forbid_unknown_fields=True):
    format: str
    version: int
    name: _Text
    provenance: _Text = ""
    licence: _Text = ""
    tool: _Text = ""
    tip: _Text = ""
    albedo_rgb: tuple[Number, Number, Number] = Swatch.albedo_rgb
    stiffness_N_m: Number = Swatch.stiffness_N_m
    damping_Ns_m: Number = Swatch.damping_Ns_m
    friction_static: Number = 0.0
    friction_dynamic: Number = 0.0
    hunt_crossley_Ns_m2: Number = 0.0
    friction_stribeck_m_s: Number = 0.0
    friction_viscous_s_m: Number = 0.0
    adhesion_N: Number = 0.0
    breakaway_1_kg: Number = 0.0
    breakaway_Hz: Number = 0.0
    breakaway_decay_1_s: Number = 0.0
    adhesion_range_m: Number = 0.0
    effects: dict[_Name, dict[_Name, Number]] = {}
    intervals: Annotated[dict[_Text, tuple[Number, Number]], Meta(max_length=MEASURED_MAX)] = {}
    absent: Annotated[dict[_Text, _Text], Meta(max_length=MEASURED_MAX)] = {}
    look: _Look | None = None
    taps: _Taps | None = None
    leaving: _Taps | None = None
    texture: _Texture | None = None


def _swatch(content: dict[str, Json]) -> Swatch:
    found = to_struct(content, _Content)
    for name in (*found.effects, *(param for numbers in found.effects.values() for param in numbers)):
        if not name.isprintable():
            raise SwatchError(f"effects: a name must be printable, is {short(name)}")
    found.effects.get("lpc_texture", {}).pop("angle_deg", None)  # of layers, which are no longer rendered
    fields = asdict(found) | {"texture": None if found.texture is None else _texture(found.texture)}
    if found.look is not None:
        fields["look"] = Look(**asdict(found.look))
    for key, part in (("taps", found.taps), ("leaving", found.leaving)):
        if part is not None:
            wave = None if part.wave_m_s2 is None else _matrix(f"{key}.wave_m_s2", part.wave_m_s2)
            fields[key] = Taps(**asdict(part) | {"wave_m_s2": wave})
    if found.texture is not None and (found.texture.other is not None or found.texture.layers is not None):
        warn(
            f"swatch {found.name!r}: a second regime or layers of its texture, written by an earlier version, are "
            "ignored; the texture is rendered without them",
            SwatchWarning,
        )
    del fields["format"], fields["version"]
    return Swatch(**fields)


def _texture(content: _Texture) -> Texture:
    fields = {key: value for key, value in asdict(content).items() if key not in _IGNORED}
    life = fields.pop("life")
    fields["modulation"] = None if life is None else GainModulation(**asdict(life))
    fields["lsf_rad"] = _matrix("texture.lsf_rad", content.lsf_rad)
    return Texture(**fields)


def _matrix(where: str, rows: list[list[float]]) -> NDArray[np.float64]:
    if len(set(map(len, rows))) > 1 or sum(map(len, rows)) > NUMBER_MAX:
        raise SwatchError(f"{where} must have rows of one length, with at most {NUMBER_MAX} numbers")
    return np.array(rows, np.float64)
