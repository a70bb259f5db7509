"""Error classes, and helpers for error messages.

Every error that a user can cause derives from `HapsceneError`; the command line prints its message and exits with 2.
A message says what is wrong (file, row, name, value), what was expected, and what to do.
"""

import difflib
import json
import sys
import unicodedata
import warnings
from collections.abc import Iterable

__all__ = [
    "CaptureError",
    "DeviceError",
    "EffectError",
    "FormatError",
    "HandleError",
    "HapsceneError",
    "MeshError",
    "PathError",
    "SaveConflict",
    "SceneError",
    "StudyError",
    "SwatchError",
    "UsageWarning",
    "ViewError",
]

NAMED = 16  # largest number of names listed in a message


class HapsceneError(Exception):
    """Base class of errors caused by invalid input or the environment, with a message for the user."""


class FormatError(HapsceneError):
    """A file is missing, too large, damaged, or of a later version. Base class for the errors of all file types.

    Non-printable characters in the message are escaped.
    """

    def __init__(self, text: str = "") -> None:
        super().__init__(printable(text))


class MeshError(FormatError):
    """A mesh file is missing, damaged, or has no unit."""


class SceneError(FormatError):
    """A scene is inconsistent: unknown names, changed meshes, invalid poses."""


class SaveConflict(SceneError):
    """Saving would overwrite changes of another program: ask the user, then overwrite or save elsewhere."""


class SwatchError(FormatError):
    """A swatch is missing, of a later version, or describes an unstable surface."""


class PathError(FormatError):
    """A path of the tool is invalid."""


class EffectError(HapsceneError):
    """An effect plugin is unknown, declared incorrectly, or does not compile."""


class CaptureError(FormatError):
    """No swatch can be fitted to a recording."""


class StudyError(FormatError):
    """The plan, folder or answers of a study are invalid or inconsistent."""


class HandleError(FormatError):
    """A haptography handle is invalid: parameters, compensator or signals."""


class DeviceError(HapsceneError):
    """A device is unknown, not connected, not usable, or was disconnected."""


class ViewError(HapsceneError):
    """A picture cannot be drawn, for example because a package is missing."""


class UsageWarning(UserWarning):
    """Valid input that is probably a mistake, such as a position in another unit."""


def no_such(kind: str, name: str, known: Iterable[str]) -> str:
    """Message for an unknown name: "no swatch 'oka'; there are: oak, paper; did you mean 'oak'?".

    Of more than `NAMED` names, the most similar ones are listed.
    """
    names = sorted(known)
    if not names:
        return f"no {kind} {name!r}; no {kind} is available"
    more = len(names) - NAMED
    if more > 0:
        names = sorted(difflib.get_close_matches(name, names, n=NAMED, cutoff=0.0))
    listed = f"{', '.join(names)}{f' and {more} more' if more > 0 else ''}"
    return f"no {kind} {name!r}; there are: {listed}{did_you_mean(name, names)}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Suggestion of a similar name, "; did you mean 'oak'?"; "" without a similar name."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def warn(message: str, category: type[Warning]) -> None:
    """Issue a warning that refers to the caller's line outside of hapscene."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "hapscene":
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


def printable(text: str, most: int | None = None, *, lines: bool = False) -> str:
    """Escape untrusted text, such as file names, for the terminal.

    Control characters, changes of the writing direction, other invisible characters and undecodable bytes become
    escapes such as `\\x1b` and `\\u202e`. JSON text remains valid.

    Args:
        text: the text.
        most: largest number of characters; a longer text is cut and ends with "…".
        lines: keep newlines.
    """
    if most is not None and len(text) > most:
        text = text[: most - 1] + "…"
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or (lines and c == "\n") else _number(c) for c in text)


def _number(sign: str) -> str:
    if sign < " ":
        return repr(sign)[1:-1]
    return sign if unicodedata.category(sign) == "Zs" else json.dumps(sign)[1:-1]


class Codes(str):
    """Terminal control codes that are written on purpose and not escaped."""
