"""Two tables of `hapscene lab bench`, one beside the other: ratios, with their spread."""

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from hapscene.errors import HapsceneError

from ..page import shown
from .sheet import Sheet

__all__ = ["Group", "compared", "lines"]

SAME: Final = ("processor", "cores", "system")
"""What two machines must have in common to count as the same."""

FARTHEST: Final = 5
"""Figures that are named: those whose ratio is farthest from 1 [count]."""


class Group(NamedTuple):
    """Ratios B over A of figures of one kind: how many, the least, their quartiles and the greatest."""

    name: str
    figures: int
    least: float
    low: float
    median: float
    high: float
    greatest: float


def compared(first: Path, second: Path) -> tuple[list[str], list[Group], list[tuple[str, float]]]:
    """Words about both machines, ratios by group, and the figures that differ most.

    Raises:
        HapsceneError: a file is no such table, or they have no figure in common.
    """
    (machine_a, a), (machine_b, b) = _figures(first), _figures(second)
    both = [key for key in a if key in b and a[key] > 0.0 and b[key] > 0.0]
    if not both:
        raise HapsceneError(f"{first} and {second} have no figure in common")
    ratio = {key: b[key] / a[key] for key in both}
    groups = []
    for group in dict.fromkeys(key[0] for key in both):
        ratios = [ratio[key] for key in both if key[0] == group]
        groups.append(Group(group, len(ratios), *np.percentile(ratios, (0, 25, 50, 75, 100)).tolist()))
    other = [name for name in SAME if machine_a.get(name) != machine_b.get(name)]
    words = [f"A  {_words(machine_a)}", f"B  {_words(machine_b)}"]
    words.append(f"not the same machine: {', '.join(other)} differ" if other else "the same machine, or one like it")
    only = len(a) + len(b) - 2 * len([key for key in a if key in b])
    words += [f"{only} figures are in one of them alone"] if only else []
    far = sorted(ratio.items(), key=lambda item: -abs(np.log(item[1])))[:FARTHEST]
    return words, groups, [(f"{group}: {name}", value) for (group, name), value in far]


def lines(first: Path, second: Path) -> list[str]:
    """The same as lines of text."""
    words, groups, far = compared(first, second)
    width = max(len(group.name) for group in groups)
    said = [*words, "", f"{'B over A':{width}}  median  quartiles      least–greatest  figures"]
    for g in groups:
        quartiles, ends = f"{g.low:.2f}–{g.high:.2f}", f"{g.least:.2f}–{g.greatest:.2f}"
        said.append(f"{g.name:{width}}  {g.median:6.2f}  {quartiles:<13}  {ends:<14}  {g.figures}")
    return [*said, "", "farthest apart:", *(f"  {shown(value)} times  {name}" for name, value in far)]


def _words(machine: dict[str, str]) -> str:
    known = [f"{name} {machine[name]}" for name in ("processor", "cores", "hapscene", "date") if name in machine]
    return "; ".join(known + [f"load {machine[name]}" for name in machine if name.startswith("load")])


def _figures(path: Path) -> tuple[dict[str, str], dict[tuple[str, str], float]]:
    """The machine of a table, and its figures by group and name."""
    sheet = Sheet.read(path)
    machine = {f.name: f.value if isinstance(f.value, str) else f"{f.value:g}" for f in sheet if f.case == "machine"}
    figures = {}
    for f in sheet:
        if f.unit not in ("", "1") and f.case != "method" and not isinstance(f.value, str):
            group = next(filter(str.isalpha, f.case.replace(",", "").split()), f.case)
            figures[f"{group} [{f.unit}]", f"{f.case}, {f.name}"] = f.value
    return machine, figures
