"""Search in a library: words and bounds."""

import operator
import re
from collections.abc import Callable, Iterable
from typing import Final

from hapscene.errors import SwatchError
from hapscene.surface.library import Entry

_BOUND: Final = re.compile(r"([A-Za-z][A-Za-z0-9_]*)\s*(<=|>=|<|>)\s*(\S+)")
_COMPARE: Final[dict[str, Callable[[float, float], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_SHORT: Final = {"stiffness": "stiffness_N_m", "roughness": "roughness_m_s2", "friction": "friction_dynamic"}


def search(entries: Iterable[Entry], terms: Iterable[str]) -> list[Entry]:
    """The entries that meet every term.

    A term is a word found in name, feel, provenance or licence, without regard to case ("wood", "grippy"), or a bound
    on a figure ("friction<0.3", "stiffness>=500", "tap_Hz>80").

    Raises:
        SwatchError: a malformed bound, one on an unknown figure, or one that is no number.
    """
    found = list(entries)
    known = {key for entry in found for key in entry.figures} | set(_SHORT)
    for term in terms:
        bound = _BOUND.fullmatch(term.strip())
        if bound is None and re.search("[<>]", term):
            raise SwatchError(f"{term!r}: a malformed bound: expected a figure, a sign and a number, as friction<0.4")
        if bound is None:
            found = [entry for entry in found if term.casefold() in _text(entry)]
            continue
        name, sign, limit = bound.groups()
        if name not in known:
            raise SwatchError(f"no figure {name!r} to search by; there are: {', '.join(sorted(known))}")
        try:
            value = float(limit)
        except ValueError:
            raise SwatchError(f"{term!r}: expected a number after {sign}, found {limit!r}") from None
        key = _SHORT.get(name, name)
        found = [e for e in found if key in e.figures and _COMPARE[sign](e.figures[key], value)]
    return found


def _text(entry: Entry) -> str:
    return " ".join([entry.name, *entry.words, entry.provenance, entry.licence]).casefold()
