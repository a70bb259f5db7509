"""Identified handles on disk: one JSON text each, safe to open from anybody.

Reading runs no code and checks every key, type and number; what it hands out is an `Identification` that a compensator
can be made of, or a `HandleError` that names the file, the place in it and what was expected.
"""

import json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Final

from hapscene.errors import HandleError
from hapscene.handle.fit import GRIP_MAX, HAND, OWN, Identification, IdentifiedGrip
from hapscene.handle.plant import NUMBER_MAX, Plant
from hapscene.io.files import check_keys, parse_format, read_bytes, refusing, short, write_whole

__all__ = ["BYTES_MAX", "SUFFIX", "handle_from_json", "handle_to_json", "load_handle", "save_handle"]

SUFFIX: Final = ".handle"
FORMAT: Final = "hapscene handle"
VERSION: Final = 1
"""Version of the format. Raised when a reader of the old one would misread the new one."""

BYTES_MAX: Final = 1 << 20
"""Largest file that is opened [bytes]: one of 20 grips has 15 kB."""

TEXT_MAX: Final = 10_000
"""Longest text [characters]."""

_PLANT: Final = tuple(field.name for field in fields(Plant))
_PAIRS: Final = ("asymptote_Hz", "band_Hz")
_NUMBERS: Final = ("asymptote_kg", "delay_s", "accelerometer_Hz", "rate_Hz", "misfit")
_GRIP_NUMBERS: Final = (*HAND, "coherence", "coherence_least")


def save_handle(handle: Identification, path: str | os.PathLike[str]) -> None:
    """Write the handle to `path` (suffix .handle), whole or not at all.

    Raises:
        HandleError: another suffix, numbers that no handle has, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix != SUFFIX:
        raise HandleError(f"{target}: a handle's file name must end in {SUFFIX}")
    text = handle_to_json(handle)
    handle_from_json(text)  # nothing is written that would not be read
    write_whole(target, text.encode(errors="backslashreplace"), HandleError)


def load_handle(path: str | os.PathLike[str]) -> Identification:
    """The handle of a file.

    Raises:
        HandleError: a file that is missing, too large, damaged, of a later version, or no handle.
    """
    file = Path(path)
    with refusing(HandleError):
        data = read_bytes(file, BYTES_MAX, "handle")
    with refusing(HandleError, file):
        return handle_from_json(data)


def handle_to_json(handle: Identification) -> str:
    """The text of a handle's file; numbers come back to the bit."""
    content = {"format": FORMAT, "version": VERSION, **asdict(handle)}
    try:
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    except ValueError as error:
        raise HandleError(f"a handle's numbers must be finite: {error}") from None


def handle_from_json(data: bytes | str) -> Identification:
    """The handle of a file's content.

    Raises:
        HandleError: not JSON, not a handle, a later version, or a wrong key, type or number.
    """
    with refusing(HandleError):
        return _handle(parse_format(data, "a handle", FORMAT, VERSION))


def _handle(content: dict[str, Any]) -> Identification:
    known = [field.name for field in fields(Identification)]
    check_keys("", content, ("format", "version", *known))
    check_keys("plant", content["plant"], _PLANT)
    plant = Plant(**{key: _number(f"plant.{key}", content["plant"][key]) for key in _PLANT})
    grips = content["grips"]
    if not isinstance(grips, list) or not 1 <= len(grips) <= GRIP_MAX:
        raise HandleError(f"grips must be a list of 1 to {GRIP_MAX} grips, is {short(grips)}")
    numbers: dict[str, Any] = {key: _pair(key, content[key]) for key in _PAIRS}
    numbers |= {key: _number(key, content[key]) for key in _NUMBERS}
    for key in ("rate_Hz", "accelerometer_Hz", "asymptote_kg"):
        if numbers[key] <= 0.0:
            raise HandleError(f"{key} must be above 0, is {numbers[key]:g}")
    return Identification(
        name=_text("name", content["name"]),
        plant=plant,
        grips=tuple(_grip(f"grips[{i}]", grip) for i, grip in enumerate(grips)),
        intervals=_by_name("intervals", content["intervals"], (*OWN, "amplifier_Hz"), _pair),
        absent=_by_name("absent", content["absent"], (*OWN, "amplifier_Hz"), _text),
        provenance=_text("provenance", content["provenance"]),
        **numbers,
    )


def _grip(where: str, content: Any) -> IdentifiedGrip:
    check_keys(where, content, ("name", *_GRIP_NUMBERS, "intervals", "absent"))
    numbers = {key: _number(f"{where}.{key}", content[key]) for key in _GRIP_NUMBERS}
    for key, value in numbers.items():
        if value < 0.0:
            raise HandleError(f"{where}.{key} must be 0 or more, is {value:g}")
    return IdentifiedGrip(
        name=_text(f"{where}.name", content["name"]),
        intervals=_by_name(f"{where}.intervals", content["intervals"], HAND, _pair),
        absent=_by_name(f"{where}.absent", content["absent"], HAND, _text),
        **numbers,
    )


def _by_name(where: str, content: Any, names: Iterable[str], read: Callable[[str, Any], Any]) -> Mapping[str, Any]:
    """What is said of some of the numbers `names`."""
    if not isinstance(content, dict):
        raise HandleError(f"{where} must be an object, is {short(content)}")
    known = list(names)
    for key in content:
        if key not in known:
            raise HandleError(f"{where}: unknown key {short(key)}; there may be: {', '.join(known)}")
    return {key: read(f"{where}.{key}", value) for key, value in content.items()}


def _text(where: str, value: Any) -> str:
    if not isinstance(value, str) or len(value) > TEXT_MAX or not value.isprintable():  # a terminal may obey the others
        raise HandleError(f"{where} must be a text of at most {TEXT_MAX} printable characters, is {short(value)}")
    return value


def _number(where: str, value: Any) -> float:
    if type(value) not in (int, float) or not -NUMBER_MAX <= value <= NUMBER_MAX:  # false for NaN
        raise HandleError(f"{where} must be a number of at most {NUMBER_MAX:g}, is {short(value)}")
    return float(value)


def _pair(where: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise HandleError(f"{where} must be two numbers, is {short(value)}")
    low, high = (_number(f"{where}[{i}]", item) for i, item in enumerate(value))
    if low > high:
        raise HandleError(f"{where} must ascend, is {low:g}, {high:g}")
    return low, high
