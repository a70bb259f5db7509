"""Handle files: an identified handle as JSON, with the suffix .handle.

Files from unknown sources are safe to open: reading executes no code and checks every key, type and number.
"""

import json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Final

from hapscene.errors import HandleError
from hapscene.handle.fit import GRIP_MAX, HAND_PARAMETERS, HANDLE_PARAMETERS, Identification, IdentifiedGrip
from hapscene.handle.plant import NUMBER_MAX, Plant
from hapscene.io.files import Json, check_keys, parse_format, read_bytes, refusing, short, write_whole

__all__ = ["BYTES_MAX", "SUFFIX", "handle_from_json", "handle_to_json", "load_handle", "save_handle"]

SUFFIX: Final = ".handle"
FORMAT: Final = "hapscene handle"
VERSION: Final = 1
"""Version of the format. Increased when older versions of hapscene would misread a new file."""

BYTES_MAX: Final = 1 << 20
"""Size limit of a file [bytes]. A file with 20 grips has 15 kB."""

TEXT_MAX: Final = 10_000
"""Length limit of a text [characters]."""

_PAIRS: Final = ("asymptote_Hz", "band_Hz")
_NUMBERS: Final = ("asymptote_kg", "delay_s", "accelerometer_Hz", "rate_Hz", "misfit")
_GRIP_NUMBERS: Final = (*HAND_PARAMETERS, "coherence", "coherence_least")


def save_handle(handle: Identification, path: str | os.PathLike[str]) -> None:
    """Write a handle to `path` (suffix .handle), atomically.

    Raises:
        HandleError: wrong suffix, values out of range, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix != SUFFIX:
        raise HandleError(f"{target}: the name of a handle file must end in {SUFFIX}")
    text = handle_to_json(handle)
    handle_from_json(text)  # write no file that cannot be read
    write_whole(target, text.encode(errors="backslashreplace"), HandleError)


def load_handle(path: str | os.PathLike[str]) -> Identification:
    """Read a handle file.

    Raises:
        HandleError: the file does not exist, is too large or damaged, has a later version, or is not a handle file.
    """
    file = Path(path)
    with refusing(HandleError):
        data = read_bytes(file, BYTES_MAX, "handle")
    with refusing(HandleError, file):
        return handle_from_json(data)


def handle_to_json(handle: Identification) -> str:
    """The content of a handle file. Numbers are written exactly."""
    content = {"format": FORMAT, "version": VERSION, **asdict(handle)}
    try:
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    except ValueError as error:
        raise HandleError(f"the numbers of a handle must be finite: {error}") from None


def handle_from_json(data: bytes | str) -> Identification:
    """Parse the content of a handle file.

    Raises:
        HandleError: not JSON, not a handle file, a later version, or an invalid key, type or number.
    """
    with refusing(HandleError):
        return _handle(parse_format(data, "a handle", FORMAT, VERSION))


def _handle(content: dict[str, Json]) -> Identification:
    check_keys("", content, ("format", "version", *(field.name for field in fields(Identification))))
    parameters = [field.name for field in fields(Plant)]
    check_keys("plant", content["plant"], parameters)
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
        plant=Plant(**{key: _number(f"plant.{key}", content["plant"][key]) for key in parameters}),
        grips=tuple(_grip(f"grips[{i}]", grip) for i, grip in enumerate(grips)),
        intervals=_by_name("intervals", content["intervals"], (*HANDLE_PARAMETERS, "amplifier_Hz"), _pair),
        absent=_by_name("absent", content["absent"], (*HANDLE_PARAMETERS, "amplifier_Hz"), _text),
        provenance=_text("provenance", content["provenance"]),
        **numbers,
    )


def _grip(where: str, content: Json) -> IdentifiedGrip:
    check_keys(where, content, ("name", *_GRIP_NUMBERS, "intervals", "absent"))
    numbers = {key: _number(f"{where}.{key}", content[key]) for key in _GRIP_NUMBERS}
    for key, value in numbers.items():
        if value < 0.0:
            raise HandleError(f"{where}.{key} must be 0 or more, is {value:g}")
    return IdentifiedGrip(
        name=_text(f"{where}.name", content["name"]),
        intervals=_by_name(f"{where}.intervals", content["intervals"], HAND_PARAMETERS, _pair),
        absent=_by_name(f"{where}.absent", content["absent"], HAND_PARAMETERS, _text),
        **numbers,
    )


def _by_name(where: str, content: Json, names: Iterable[str], read: Callable[[str, Any], Any]) -> Mapping[str, Any]:
    """Read an object whose keys are some of `names`."""
    check_keys(where, content, names, required=())
    return {key: read(f"{where}.{key}", value) for key, value in content.items()}


def _text(where: str, value: object) -> str:
    # unprintable characters could control a terminal
    if not isinstance(value, str) or len(value) > TEXT_MAX or not value.isprintable():
        raise HandleError(f"{where} must be a text of at most {TEXT_MAX} printable characters, is {short(value)}")
    return value


def _number(where: str, value: Json) -> float:
    if type(value) not in (int, float) or not -NUMBER_MAX <= value <= NUMBER_MAX:  # false for NaN
        raise HandleError(f"{where} must be a number of at most {NUMBER_MAX:g}, is {short(value)}")
    return float(value)


def _pair(where: str, value: object) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise HandleError(f"{where} must be two numbers, is {short(value)}")
    low, high = (_number(f"{where}[{i}]", item) for i, item in enumerate(value))
    if low > high:
        raise HandleError(f"{where} must be in ascending order, is {low:g}, {high:g}")
    return low, high
