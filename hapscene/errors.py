"""What goes wrong, said so that the reader knows what to do next.

Every error a user can cause derives from `HapsceneError`; the command line prints its text and exits with 2.
The text names the file, the place in it, what was expected and what would have worked.
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
    "ViewError",
]

NAMED = 16  # names that one sentence lists


class HapsceneError(Exception):
    """An error with a message for the user: bad input, not a fault of the program."""


class FormatError(HapsceneError):
    """A file that is not what it should be: missing, too large, damaged, of a later version.

    Each room has its own, which is one of these: `except FormatError` catches them all. What it says of the file's
    content is one line that may be shown.
    """

    def __init__(self, text: str = "") -> None:
        super().__init__(printable(text))


class MeshError(FormatError):
    """A mesh file that is missing, broken, or says no unit."""


class SceneError(FormatError):
    """A scene that does not fit together: unknown names, a mesh that changed, a bad pose."""


class SaveConflict(SceneError):
    """Writing would lose somebody's work: ask the user, then write all the same, or elsewhere."""


class SwatchError(FormatError):
    """A swatch that is missing, of a later version, or describes an unstable surface."""


class PathError(FormatError):
    """A recorded path of the tool that cannot be played."""


class EffectError(HapsceneError):
    """An effect plugin that is unknown, wrongly declared, or does not compile."""


class CaptureError(FormatError):
    """A recording from which no swatch can be fitted."""


class StudyError(FormatError):
    """A study's plan, folder or answers that are not what they should be, or do not fit each other."""


class HandleError(FormatError):
    """A haptography handle that cannot be: bad parameters, an unknown compensator, signals that do not fit."""


class DeviceError(HapsceneError):
    """A device that is unknown, not there, not to be used, or gone, with what would help."""


class ViewError(HapsceneError):
    """A picture that cannot be drawn here, with the package that would help."""


def no_such(kind: str, name: str, known: Iterable[str]) -> str:
    """The sentence for an unknown name: "no swatch 'oka'; there are: oak, paper; did you mean 'oak'?".

    Of more than `NAMED` names, it lists the nearest.
    """
    names = sorted(known)
    if not names:
        return f"no {kind} {name!r}; there are none"
    more = len(names) - NAMED
    if more > 0:
        names = sorted(difflib.get_close_matches(name, names, n=NAMED, cutoff=0.0))
    listed = f"{', '.join(names)}{f' and {more} more' if more > 0 else ''}"
    return f"no {kind} {name!r}; there are: {listed}{did_you_mean(name, names)}"


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The end of that sentence where a known name is near: "; did you mean 'oak'?", else nothing."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def warn(message: str, category: type[Warning]) -> None:
    """Warn, pointing at the line outside of hapscene that led there."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "hapscene":
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


def printable(text: str, most: int | None = None, *, lines: bool = False) -> str:
    """Text from outside (a file's name, a name in a file, a server's word) as a terminal may be shown it.

    Controls, escapes, what turns the direction of writing, other invisible signs and undecodable bytes of a file's
    name are told by their numbers, as in Python's and JSON's texts: `\\x1b`, `\\u202e`. A JSON text stays one.

    Args:
        text: what is to be shown.
        most: most signs of it that are shown; what is longer ends with "…".
        lines: ends of lines are kept.
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
    """Signs that steer the terminal on purpose: written by themselves, they reach it as they are."""
