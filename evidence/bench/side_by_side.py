"""Times of other renderers and hapscene on the same meshes and paths, measured in turn, and their part of the page."""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import HapsceneError

from ..page import Page, shown
from . import path_driver
from .case import Case
from .machine import describe_machine, machine_words
from .sheet import Sheet, spread
from .tick_time import REPEATS

OURS: Final = "hapscene"

PROGRAMS: Final = (  # name, program, options
    ("CHAI3D static", "chai_path", ("--mode", "static", "--scale", "20")),
    ("CHAI3D dynamic", "chai_path", ("--mode", "dynamic", "--scale", "20")),
    ("HAPI", "hapi_path", ()),
)

POINTS: Final = ("HAPI",)
"""Renderers whose tool is a point; they are left out of cases with a ball."""

COLD_TICKS: Final = 500
"""Ticks that are timed with cold caches, from the middle of the path [count]."""

FLUSH_MB: Final = 64
"""Memory that is rewritten before each cold tick [MiB]; larger than the caches."""

UNITS: Final = {"build": "ms", "ticks": "1", "contact": "µs", "tick": "µs", "over": "times", "proxy": "µm"}
"""Unit of a figure by its first word."""

Drivers = dict[str, tuple[Sequence[str], Sequence[str]]]
"""Command of each renderer: words before and after MESH PATH OUT."""


AIMS: Final = (("CHAI3D static", 1.3, 1.0), ("CHAI3D dynamic", 2.0, 2.0), ("HAPI", 2.0, 1.0))
"""Targets: smallest ratio of a renderer's time to hapscene's contact and to its haptic tick, hot, in every case."""

METHOD: Final = f"""The same meshes and paths on one machine. In each round every renderer runs every case in a separate
process; the order rotates between rounds. Hot: minimum of five runs for each tick, after a warm-up run. Cold:
{COLD_TICKS} ticks from the middle of the path, once, with {FLUSH_MB} MiB rewritten before each. Ticks count in which
both renderers are in contact. Values are medians of the rounds."""

OMITTED: Final = ("sphere 20 k", "sphere 328 k")
"""Cases that the page omits: they lie between others."""

UNFAIR: Final = """### What the comparison does not control
- CHAI3D: `cAlgorithmFingerProxy::computeForces` is timed (proxy and force), without global positions and tool. HAPI:
  `GodObjectRenderer::renderHapticsOneStep`. hapscene's contact is the proxy without force; its tick adds the wall,
  limits, a recorded row and ten acceleration samples. A fair value lies between the two.
- The results differ. Of 37 cases with known answers, CHAI3D static (its default) solves 5, CHAI3D dynamic 32, HAPI 28,
  hapscene 37. HAPI loses contact on half of the bunny's path.
- CHAI3D runs at 20 units per metre, as in its examples; in metres it does not detect triangles below 0.16 mm².
"""


class Turn(NamedTuple):
    """Result of one renderer on one case: rows (ticks, `COLUMNS` or one more), and build time [ms]."""

    rows: NDArray[np.float64]
    build_ms: float


def find_drivers(build: Path) -> Drivers:
    """Return the programs in a folder, after that of hapscene. Raises HapsceneError: no program in the folder."""
    found: Drivers = {OURS: ((sys.executable, "-m", path_driver.__name__), ())}
    for name, program, options in PROGRAMS:
        file = build.resolve() / program
        if file.is_file() and os.access(file, os.X_OK):
            found[name] = ((str(file),), options)
    if len(found) == 1:
        raise HapsceneError(
            f"{build}: neither chai_path nor hapi_path found; expected a program for another renderer: "
            "evidence/bench/path_driver.py describes how to build it"
        )
    return found


def measure(drivers: Drivers, cases: list[Case], rounds: int, cold_rounds: int, say: Callable[[str], None]) -> Sheet:
    """Run all renderers in turn, each in a separate process; the order rotates between rounds.

    Figures are medians of the rounds; ratios are computed within each round.

    Raises:
        HapsceneError: a program fails, or its output is invalid.
    """
    sheet = Sheet()
    describe_machine(sheet)
    sheet.add("method", "hot rounds", rounds, "1")
    sheet.add("method", "cold rounds", cold_rounds, "1")
    with tempfile.TemporaryDirectory() as work:
        found: dict[str, list[dict[str, float]]] = {}
        for kind, r in [*(("hot", r) for r in range(rounds)), *(("cold", r) for r in range(cold_rounds))]:
            for case in cases:
                say(f"{kind} round {r + 1}: {case.name}")
                turns, names = {}, [name for name in drivers if case.tip_radius_m == 0.0 or name not in POINTS]
                for name in names[r % len(names) :] + names[: r % len(names)]:
                    turns[name] = _turn(drivers, name, case, Path(work), kind == "cold")
                for name in names:
                    found.setdefault(f"{kind}, {case.name}, {name}", []).append(beside(turns[name], turns[OURS]))
    for key, of_rounds in found.items():
        for name in of_rounds[0]:
            values = [figures[name] for figures in of_rounds]
            sheet.add(key, name, float(np.median(values)), UNITS[name.split()[0]])
            if name.startswith("over "):
                sheet.add(key, f"{name}, least", min(values), "times")
                sheet.add(key, f"{name}, greatest", max(values), "times")
    return sheet


def _turn(drivers: Drivers, name: str, case: Case, work: Path, cold: bool) -> Turn:
    """Run a renderer on a case; a cold run returns only the rows of the cold ticks."""
    mesh, path, out = work / f"{case.name}.mesh", work / "path", work / "out"
    first = len(case.p_WT_m) // 2 if cold else 0
    tool = case.p_WT_m[: first + COLD_TICKS] if cold else case.p_WT_m
    if not mesh.exists():
        path_driver.write_mesh(mesh, case.mesh)
    tool.astype("<f8").tofile(path)
    out.unlink(missing_ok=True)
    how = ("--cold-first", str(first), "--flush-mb", str(FLUSH_MB)) if cold else ("--repeats", str(REPEATS))
    before, after = drivers[name]
    command = [*before, str(mesh), str(path), str(out), *after, *how, "--radius", str(case.tip_radius_m)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    built = re.search(r"^build_ms ([0-9.]+)", done.stdout, re.MULTILINE)
    columns = path_driver.COLUMNS + (name == OURS)
    size_B = out.stat().st_size if out.exists() else 0
    why = ""
    if done.returncode:
        why = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    elif size_B != 8 * columns * len(tool):
        why = f"wrote {size_B} bytes; expected {len(tool)} ticks of {columns} numbers of 8 bytes"
    if why or built is None:
        raise HapsceneError(f"{name} on {case.name} ({before[-1]}): {why or 'no line build_ms NUMBER in its output'}")
    return Turn(np.fromfile(out, "<f8").reshape(-1, columns)[first:], float(built[1]))


def beside(one: Turn, ours: Turn) -> dict[str, float]:
    """Return a renderer's figures of a round, over ticks in which hapscene is in contact too; NaN without any."""
    on = one.rows[:, 6] > 0.0
    both = on & (ours.rows[:, 6] > 0.0)
    found = {"build": one.build_ms, "ticks in contact": float(on.sum())}
    difference_m = np.linalg.norm(one.rows[:, :3] - ours.rows[:, :3], axis=1)
    values = (1e-3 * one.rows[:, 7], 1e-3 * ours.rows[:, 7], 1e-3 * ours.rows[:, 8], 1e6 * difference_m)
    time, contact, tick, difference = (spread(value[both] if both.any() else [np.nan]) for value in values)
    for q in ("median", "p99"):
        found[f"contact {q}"] = time[q]
        if one is ours:
            found[f"tick {q}"] = tick[q]
        else:
            found[f"over contact {q}"], found[f"over tick {q}"] = time[q] / contact[q], time[q] / tick[q]
            found[f"proxy away {q}"] = difference[q]
    return found


def add_peers(page: Page, sheet: Sheet | None, known: Collection[str]) -> None:
    """Add the part to the page; without a sheet, the method only. `known` describes the machine of the page."""
    page.heading("Other renderers")
    page.text(
        f"Generated by `python -m hapscene_evidence.bench.run BUILD docs/results`; "
        f"`evidence/bench/path_driver.py` describes these programs. {METHOD}"
    )
    if sheet is None:
        page.text("Not measured.")
    else:
        hot, cold = (sheet.number("method", f"{kind} rounds") for kind in ("hot", "cold"))
        how = f"Rounds: {hot:g} hot, {cold:g} cold."
        machine = "; ".join(word for word in machine_words(sheet) if word not in known)
        page.text(f"Machine: as above{machine and f', except {machine}'}. {how} All ratios: bench/peers.csv.")
        _add_aims(page, sheet)
        for kind in ("hot", "cold"):
            if sheet.cases(f"{kind}, "):
                _add_table(page, sheet, kind)
    page.markdown_only(UNFAIR)


def _add_aims(page: Page, sheet: Sheet) -> None:
    """Add the smallest ratio of all cases, of median and p99, and its target."""
    rows = []
    for peer, *aims in AIMS:
        for what, aim in zip(("contact", "tick"), aims, strict=True):
            cases = [case for case in sheet.cases("hot, ") if case.endswith(f", {peer}")]
            found = [(sheet.number(c, f"over {what} {q}"), c, q) for c in cases for q in ("median", "p99")]
            if found:
                ratio, case, quantile = min(found)
                met = "yes" if ratio >= aim else "**no**"
                where = f"{case.split(', ')[1]}, {quantile}"
                rows.append((f"{peer} / hapscene's {what}", f"≥ {aim:g}", f"{ratio:.2f}", where, met))
    if rows:
        page.table(("ratio of times, hot", "target", "smallest", "case", "met"), rows)


def _add_table(page: Page, sheet: Sheet, kind: str) -> None:
    """Add the times of every renderer on every case."""
    measured = sheet.cases(f"{kind}, ")
    keys = [case.split(", ")[1:] for case in measured]
    cases, names = (list(dict.fromkeys(found)) for found in zip(*keys, strict=True))

    def pair(case: str, name: str, what: str) -> str:
        if f"{kind}, {case}, {name}" not in measured:
            return "–"
        return " / ".join(shown(sheet.number(f"{kind}, {case}, {name}", f"{what} {q}")) for q in ("median", "p99"))

    page.text(f"{kind.capitalize()}, median / p99 [µs]:")
    columns = [(OURS, "contact"), (OURS, "tick"), *((peer, "contact") for peer in names[1:])]
    head = ("case", "hapscene, contact", "hapscene, tick", *names[1:])
    page.table(head, [(case, *(pair(case, *column) for column in columns)) for case in cases if case not in OMITTED])
