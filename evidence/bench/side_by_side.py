"""Other renderers beside hapscene: the same meshes and paths, one machine, one run, turn by turn."""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import HapsceneError, did_you_mean

from . import path_driver
from .case import SUBDIVISIONS, Case, short, sphere_cases, zoo_cases
from .machine import describe_machine
from .sheet import Sheet, spread
from .tick_time import REPEATS

OURS: Final = "hapscene"

PROGRAMS: Final = (  # name, program, what it is told
    ("CHAI3D static", "chai_path", ("--mode", "static", "--scale", "20")),
    ("CHAI3D dynamic", "chai_path", ("--mode", "dynamic", "--scale", "20")),
    ("HAPI", "hapi_path", ()),
)

COLD_TICKS: Final = 500
"""Ticks that are timed cold, from the middle of the path on [count]."""

FLUSH_MB: Final = 64
"""Memory that is rewritten before each of them [MiB]: more than the caches hold."""

HUGE: Final = {"GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"}
"""Environment in which glibc asks for huge pages for all memory."""

UNITS: Final = {"build": "ms", "ticks": "1", "contact": "µs", "tick": "µs", "over": "times", "proxy": "µm"}
"""Of a figure, by its first word."""

SPHERES: Final = {short(20 * 4**k).replace(" ", ""): k for k in SUBDIVISIONS}
CASES: Final = (*SPHERES, "bunny")

Drivers = dict[str, tuple[Sequence[str], Sequence[str]]]
"""Name → the words of a command before MESH PATH OUT, and after."""


class Turn(NamedTuple):
    """One renderer on one case: rows (ticks, `COLUMNS` or one more), and its time to build what it searches [ms]."""

    rows: NDArray[np.float64]
    build_ms: float


def find_drivers(build: Path) -> Drivers:
    """Those that a folder holds, hapscene's own first.

    Raises:
        HapsceneError: it holds none.
    """
    found: Drivers = {OURS: ((sys.executable, "-m", path_driver.__name__), ())}
    for name, program, options in PROGRAMS:
        file = build.resolve() / program
        if file.is_file() and os.access(file, os.X_OK):
            found[name] = ((str(file),), options)
    if len(found) == 1:
        raise HapsceneError(
            f"{build}: holds neither chai_path nor hapi_path, programs that run other renderers; docs/benchmark.md, "
            '"A driver for another renderer", says how they are built'
        )
    return found


def find_cases(names: Iterable[str], zoo: Path | None, ticks: int) -> list[Case]:
    """Cases by their names in `CASES`: spheres and the path over them are made, the bunny is the zoo's.

    Raises:
        HapsceneError: an unknown name; the bunny without a zoo.
    """
    cases = []
    for name in names:
        if name in SPHERES:
            cases += sphere_cases((SPHERES[name],), ticks)
        elif name != "bunny":
            raise HapsceneError(f"no case {name!r}{did_you_mean(name, CASES)}; there are: {', '.join(CASES)}")
        elif zoo is None:
            raise HapsceneError("the bunny's mesh and path are in the zoo: --zoo DIR says where that is")
        else:
            cases += [case for case in zoo_cases(zoo) if "bunny" in case.name]
    return cases


def measure(
    drivers: Drivers, cases: list[Case], rounds: int, cold_rounds: int, huge: bool, say: Callable[[str], None]
) -> Sheet:
    """Let all take turns, each in a process of its own, in an order that turns by one from round to round.

    Figures are medians of the rounds, ratios those of each round's own numbers.

    Raises:
        HapsceneError: a driver fails, or writes something else than it should.
    """
    sheet = Sheet()
    describe_machine(sheet)
    load = [f"{os.getloadavg()[0]:.2f}"] if hasattr(os, "getloadavg") else []
    sheet.add("method", "hot rounds", rounds, "1")
    sheet.add("method", "cold rounds", cold_rounds, "1")
    sheet.add("method", "huge pages", "for all" if huge else "where each asks for them")
    names = list(drivers)
    with tempfile.TemporaryDirectory() as work:
        found: dict[str, list[dict[str, float]]] = {}
        for kind, r in [*(("hot", r) for r in range(rounds)), *(("cold", r) for r in range(cold_rounds))]:
            for case in cases:
                say(f"{kind} round {r + 1}: {case.name}")
                turns = {}
                for name in names[r % len(names) :] + names[: r % len(names)]:
                    turns[name] = _turn(drivers, name, case, Path(work), kind == "cold", huge)
                for name in names:
                    found.setdefault(f"{kind}, {case.name}, {name}", []).append(beside(turns[name], turns[OURS]))
    for key, of_rounds in found.items():
        for name in of_rounds[0]:
            values = [figures[name] for figures in of_rounds]
            sheet.add(key, name, float(np.median(values)), UNITS[name.split()[0]])
            if name.startswith("over "):
                sheet.add(key, f"{name}, least", min(values), "times")
                sheet.add(key, f"{name}, greatest", max(values), "times")
    if load:
        sheet.add("machine", "load before and after", f"{load[0]} and {os.getloadavg()[0]:.2f}")
    return sheet


def _turn(drivers: Drivers, name: str, case: Case, work: Path, cold: bool, huge: bool) -> Turn:
    """Run a driver on a case; of a cold run the rows of the cold ticks."""
    mesh, path, out = work / f"{case.name}.mesh", work / "path", work / "out"
    first = len(case.p_WT_m) // 2 if cold else 0
    tool = case.p_WT_m[: first + COLD_TICKS] if cold else case.p_WT_m
    if not mesh.exists():
        path_driver.write_mesh(mesh, case.mesh)
    tool.astype("<f8").tofile(path)
    out.unlink(missing_ok=True)
    how = ("--cold-first", str(first), "--flush-mb", str(FLUSH_MB)) if cold else ("--repeats", str(REPEATS))
    before, after = drivers[name]
    command, environment = [*before, str(mesh), str(path), str(out), *after, *how], os.environ | (HUGE if huge else {})
    done = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace", check=False)
    built = re.search(r"^build_ms ([0-9.]+)", done.stdout, re.MULTILINE)
    columns = path_driver.COLUMNS + (name == OURS)
    size_B = out.stat().st_size if out.exists() else 0
    why = ""
    if done.returncode:
        why = (done.stderr.strip().splitlines() or [f"it ended with {done.returncode}"])[-1]
    elif size_B != 8 * columns * len(tool):
        why = f"it wrote {size_B} bytes, expected {len(tool)} ticks of {columns} numbers of 8 bytes"
    if why or built is None:
        raise HapsceneError(f"{name} on {case.name} ({before[-1]}): {why or 'it printed no line build_ms NUMBER'}")
    return Turn(np.fromfile(out, "<f8").reshape(-1, columns)[first:], float(built[1]))


def beside(one: Turn, ours: Turn) -> dict[str, float]:
    """A round's figures of a renderer; times are of the ticks in which hapscene is in contact too, NaN without any."""
    on = one.rows[:, 6] > 0.0
    both = on & (ours.rows[:, 6] > 0.0)
    found = {"build": one.build_ms, "ticks in contact": float(on.sum())}
    away_m = np.linalg.norm(one.rows[:, :3] - ours.rows[:, :3], axis=1)
    values = (1e-3 * one.rows[:, 7], 1e-3 * ours.rows[:, 7], 1e-3 * ours.rows[:, 8], 1e6 * away_m)
    time, contact, tick, away = (spread(value[both] if both.any() else [np.nan]) for value in values)
    for q in ("median", "p99"):
        found[f"contact {q}"] = time[q]
        if one is ours:
            found[f"tick {q}"] = tick[q]
        else:
            found[f"over contact {q}"], found[f"over tick {q}"] = time[q] / contact[q], time[q] / tick[q]
            found[f"proxy away {q}"] = away[q]
    return found
