"""The whole chart: every question measured, drawn and put on one page. A new question takes its line in `QUESTIONS`."""

import hashlib
import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from hapscene.compiled.native import INTERPRETED
from hapscene.errors import HapsceneError, no_such
from hapscene.io.files import whole_file
from hapscene.parallel import Task, run_tasks

from ..bench.machine import describe_machine
from ..bench.sheet import Sheet
from ..page import Page, shown
from .drawing import write_picture
from .question import Measure, Point, Question, Setting, fronts
from .table import Table
from .touched_surface import BODY_FACES_MIN

__all__ = ["QUESTIONS", "chart", "question"]

QUESTIONS: Final[Mapping[str, str]] = {
    "mesh": "mesh",
    "texture": "texture",
    "texture-update": "texture_update",
    "force-rate": "force_rate",
    "acceleration-rate": "acceleration_rate",
    "groove": "groove",
    "stabiliser": "stabiliser",
    "compensator": "compensator",
}
"""The module of each question, in the order of the page."""

TITLE: Final = "The chart: speed and accuracy, one charted against the other"

METHOD: Final = """Each point is a method at one setting: the time that it takes, and its error against a truth that the
method did not make. No other point beats those on the front in both. Errors in the shaded part cannot be felt."""


def question(name: str) -> Question:
    """The question of that name.

    Raises:
        HapsceneError: no such question.
    """
    if name not in QUESTIONS:
        raise HapsceneError(no_such("question", name, QUESTIONS))
    found: Question = import_module(f"{__package__}.{QUESTIONS[name]}").QUESTION
    return found


def error_of(name: str, arguments: Mapping[str, Any], stamp: str) -> dict[str, float]:
    """The errors of a setting, in whichever process. The stamp identifies the content of the scene's file."""
    return {key: float(value) for key, value in question(name).error(**arguments).items()}


def time_of(name: str, arguments: Mapping[str, Any], stamp: str) -> list[float]:
    """Median and p99 of a setting's time [µs]."""
    return [float(value) for value in question(name).time(**arguments)]


def chart(
    out: Path,
    scene: str | None = None,
    *,
    only: Sequence[str] = (),
    quick: bool = False,
    jobs: int | None = None,
    scheduler: str | None = None,
    table: Path | None = None,
    docs: Path | None = None,
    say: Callable[[str], None] = print,
) -> Table:
    """Measure every question and write chart.csv, a picture each and chart.html into `out`.

    Finished settings are noted in chart.jsonl there until all are done: the same call continues an interrupted one.

    Args:
        out: folder to write into; made when it is missing.
        scene: file of the scene that is asked about; None for each question's own subject.
        only: names of questions; all without them.
        quick: fewer settings, shorter paths.
        jobs: processes that find errors; None for one a core. Times are always taken alone, here, afterwards.
        scheduler: address of a Dask cluster in their place; a scene must have the same path there.
        table: an earlier chart.csv, to draw it again; nothing is measured then.
        docs: the project's folder of documents: chart.md and chart/ are written too.
        say: called with each line of progress.

    Raises:
        HapsceneError: no such question; NUMBA_DISABLE_JIT=1, where times mean nothing; an invalid `table`.
        OSError: `out` cannot be written.
    """
    if INTERPRETED and table is None:
        raise HapsceneError("the chart times compiled code: run it without NUMBA_DISABLE_JIT")
    asked = [question(name) for name in dict.fromkeys(only or QUESTIONS)]
    if docs is not None and not docs.is_dir():
        raise HapsceneError(f"{docs}: no such folder")
    if table is None:
        out.mkdir(parents=True, exist_ok=True)
        found = _measure(asked, out / "chart.jsonl", scene, quick, jobs, scheduler, say)
        asked = [q for q in asked if found.points[q.name]]
    else:
        found, asked = _read(table, asked)
        out.mkdir(parents=True, exist_ok=True)
    say("made:")
    for path in _write(found, asked, out, docs):
        say(f"  {path}")
    return found


def _read(file: Path, asked: Sequence[Question]) -> tuple[Table, list[Question]]:
    """A table, and those of the questions that it has points of."""
    found = Table.read(file)
    there = [q for q in asked if found.points.get(q.name)]
    if not there:
        known = ", ".join(found.points) or "none"
        raise HapsceneError(f"{file}: has no points of {', '.join(q.name for q in asked)}; it has: {known}")
    for q in there:
        try:
            q.advice(found.points[q.name])
        except (LookupError, ValueError, ArithmeticError, StopIteration):
            raise HapsceneError(f"{file}: {q.name} lacks points or measures: draw others with --only") from None
    return found, there


def _measure(
    asked: Sequence[Question],
    journal: Path,
    scene: str | None,
    quick: bool,
    jobs: int | None,
    scheduler: str | None,
    say: Callable[[str], None],
) -> Table:
    """The points of all questions, and the machine."""
    stamp = "" if scene is None else hashlib.sha256(Path(scene).read_bytes()).hexdigest()[:16]
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    settings = {q.name: list(q.settings(quick, scene)) for q in asked}
    reason = f"no body of the scene has {BODY_FACES_MIN:,} faces or more"
    if not any(settings.values()):
        raise HapsceneError(f"{scene}: {reason}, which the question is about: omit the scene, or name a larger one")
    pieces = []
    for q in asked:
        if not settings[q.name]:
            say(f"{q.name} is left out: {reason}")
        for s in settings[q.name]:
            arguments = {"name": q.name, "arguments": dict(s.arguments), "stamp": stamp}
            for kind, alone in (("error", False), ("time", True)):
                pieces.append(Task(_key(q, s, kind), error_of if kind == "error" else time_of, arguments, alone))
    results = run_tasks(
        pieces,
        journal=journal,
        jobs=jobs,
        scheduler=scheduler,
        after=lambda done, count, key: say(f"{done} of {count}  {key}"),
    )
    points = {
        q.name: [_point(s, results[_key(q, s, "time")], results[_key(q, s, "error")]) for s in settings[q.name]]
        for q in asked
    }
    journal.unlink(missing_ok=True)
    return Table(_machine(load, quick, scene), points)


def _point(s: Setting, time_us: Sequence[float], errors: Mapping[str, float]) -> Point:
    median_us, p99_us = time_us
    return Point(s.method, s.label, median_us, p99_us, errors)


def _key(q: Question, s: Setting, kind: str) -> str:
    return f"{q.name}: {s.method}, {s.label}: {kind}"


def _machine(load_before: float, quick: bool, scene: str | None) -> dict[str, str]:
    sheet = Sheet()
    describe_machine(sheet)
    found = {f.name: f"{f.value:g}" if isinstance(f.value, float) else f.value for f in sheet}
    if load_before == load_before:
        found["load before and after"] = f"{load_before:.1f} and {os.getloadavg()[0]:.1f}"
    if quick:
        found["settings"] = "fewer, in short (--quick)"
    if scene is not None:
        found["scene"] = Path(scene).name
    return found


def _write(found: Table, asked: Sequence[Question], out: Path, docs: Path | None) -> list[Path]:
    """Write table, pictures and page; return their paths."""
    made = [out / "chart.csv"]
    found.write(made[0], asked)
    for q in asked:
        made += write_picture(q, found.points[q.name], out / f"{q.name}.png")
    made.append(out / "chart.html")
    _write_text(made[-1], page_of(found, asked, out, "chart.csv").html())
    if docs is not None:
        folder = docs / "chart"
        folder.mkdir(exist_ok=True)
        for file in made:
            if file.suffix == ".png":
                shutil.copyfile(file, folder / file.name)
        kept = folder / f"{machine_slug(found.machine)}.csv"
        shutil.copyfile(out / "chart.csv", kept)
        made += [kept, docs / "chart.md"]
        _write_text(made[-1], page_of(found, asked, folder, f"chart/{kept.name}").markdown(docs))
    return made


def _write_text(file: Path, text: str) -> None:
    with whole_file(file) as part:
        part.write_text(text, encoding="utf-8")


def machine_slug(machine: Mapping[str, str]) -> str:
    """File name of a machine: its processor and cores, without the clock, which changes."""
    text = f"{machine.get('processor', 'machine').split('), ')[0]} {machine.get('cores', '?')} cores"
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"\((?:r|tm)\)", "", text.lower())).strip("-")


def page_of(found: Table, asked: Sequence[Question], pictures: Path, csv: str) -> Page:
    """The page of a chart: for each question a picture, what to choose, the front, and all points."""
    page = Page(TITLE)
    page.text(f"Made by `hapscene lab chart`; every figure is from {csv}. {METHOD}")
    page.text(f"Machine: {'; '.join(f'{name} {value}' for name, value in found.machine.items())}.")
    for q in asked:
        points = found.points[q.name]
        measures = [m for m in q.measures if any(m.key in p.errors for p in points)]
        page.heading(q.title, key=q.name)
        page.picture(pictures / f"{q.name}.png", f"{q.title} {'; '.join(m.name for m in measures)}")
        page.text(q.conditions)
        page.text(q.advice(points), strong=True)
        best = {id(p): p for m in measures for each in fronts(q, points, m) for p in each}.values()
        _add_points(page, q, sorted(best, key=lambda p: p.median_us), measures, "")
        _add_points(page, q, points, measures, "All points")
    return page


def _add_points(page: Page, q: Question, points: Sequence[Point], measures: Sequence[Measure], fold: str) -> None:
    head = ("method", "setting", f"time a {q.per} [µs], median / p99", *(f"{m.name} [{m.unit}]" for m in measures))
    rows = [
        (
            *(p.method, p.label, f"{shown(p.median_us)} / {shown(p.p99_us)}"),
            *(shown(p.errors[m.key]) if m.key in p.errors else "" for m in measures),
        )
        for p in points
    ]
    page.table(head, rows, fold=fold)
