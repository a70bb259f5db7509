"""The chart: measures every question and writes pictures and page. `QUESTIONS` lists the questions."""

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
from .question import Point, Question, Setting
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
"""Module of each question by its name, in the order of the page."""

TITLE: Final = "Chart: speed against accuracy"

METHOD: Final = """Each point is a method at one setting: its time, and its error against an independent reference. No
other point beats a point on the front in both. Errors in the shaded area are not perceptible."""


def question(name: str) -> Question:
    """Return the question of that name.

    Raises:
        HapsceneError: no such question.
    """
    if name not in QUESTIONS:
        raise HapsceneError(no_such("question", name, QUESTIONS))
    found: Question = import_module(f"{__package__}.{QUESTIONS[name]}").QUESTION
    return found


def error_of(name: str, arguments: Mapping[str, Any], stamp: str) -> dict[str, float]:
    """Return the errors of a setting. The stamp identifies the content of the scene file in the journal."""
    return {key: float(value) for key, value in question(name).error(**arguments).items()}


def time_of(name: str, arguments: Mapping[str, Any], stamp: str) -> list[float]:
    """Return median and p99 of a setting's time [µs]."""
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
    """Measure every question and write chart.csv, a picture of each and chart.html into `out`.

    Finished settings are kept in chart.jsonl until all are done; the same call resumes an interrupted one.

    Args:
        out: output folder, created if missing.
        scene: scene file; None for each question's default subject.
        only: names of questions; all if empty.
        quick: fewer settings, shorter paths.
        jobs: number of processes that compute errors; None for one per core. Times are measured afterwards in this
            process, one at a time.
        scheduler: address of a Dask cluster to use instead; the scene must have the same path there.
        table: an earlier chart.csv to draw instead of measuring.
        docs: the folder docs/results, whose chart.md and chart/ are written as well.
        say: called with each line of progress.

    Raises:
        HapsceneError: no such question; NUMBA_DISABLE_JIT=1, which disables compilation; an invalid `table`.
        OSError: `out` cannot be written.
    """
    if INTERPRETED and table is None:
        raise HapsceneError("NUMBA_DISABLE_JIT is set, but the chart measures compiled code: unset it")
    questions = [question(name) for name in dict.fromkeys(only or QUESTIONS)]
    if docs is not None and not docs.is_dir():
        raise HapsceneError(f"{docs}: no such folder")
    if table is None:
        out.mkdir(parents=True, exist_ok=True)
        found = _measure(questions, out / "chart.jsonl", scene, quick, jobs, scheduler, say)
        questions = [q for q in questions if found.points[q.name]]
    else:
        found, questions = _read(table, questions)
        out.mkdir(parents=True, exist_ok=True)
    say("made:")
    for path in _write(found, questions, out, docs):
        say(f"  {path}")
    return found


def _read(file: Path, questions: Sequence[Question]) -> tuple[Table, list[Question]]:
    """Read a table; return it and the questions that it has points of."""
    found = Table.read(file)
    present = [q for q in questions if found.points.get(q.name)]
    if not present:
        known = ", ".join(found.points) or "none"
        raise HapsceneError(f"{file}: no points of {', '.join(q.name for q in questions)}; it has points of: {known}")
    for q in present:
        try:
            q.advice(found.points[q.name])
        except (LookupError, ValueError, ArithmeticError, StopIteration):
            raise HapsceneError(
                f"{file}: points or measures of {q.name} are missing: choose other questions with --only"
            ) from None
    return found, present


def _measure(
    questions: Sequence[Question],
    journal: Path,
    scene: str | None,
    quick: bool,
    jobs: int | None,
    scheduler: str | None,
    say: Callable[[str], None],
) -> Table:
    """Measure all questions."""
    stamp = "" if scene is None else hashlib.sha256(Path(scene).read_bytes()).hexdigest()[:16]
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    settings = {q.name: list(q.settings(quick, scene)) for q in questions}
    reason = f"no body of the scene has at least {BODY_FACES_MIN:,} faces"
    if not any(settings.values()):
        raise HapsceneError(f"{scene}: {reason}: name a scene with a larger body, or omit the scene")
    pieces = []
    for q in questions:
        if not settings[q.name]:
            say(f"{q.name} omitted: {reason}")
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
        for q in questions
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
        found["settings"] = "fewer (--quick)"
    if scene is not None:
        found["scene"] = Path(scene).name
    return found


def _write(found: Table, questions: Sequence[Question], out: Path, docs: Path | None) -> list[Path]:
    """Write table, pictures and pages; return their paths."""
    made = [out / "chart.csv"]
    found.write(made[0], questions)
    for q in questions:
        made += write_picture(q, found.points[q.name], out / f"{q.name}.png")
    made.append(out / "chart.html")
    _write_text(made[-1], page_of(found, questions, out, "chart.csv").html())
    if docs is not None:
        folder = docs / "chart"
        folder.mkdir(exist_ok=True)
        for file in made:
            if file.suffix == ".png":
                shutil.copyfile(file, folder / file.name)
        kept = folder / f"{machine_slug(found.machine)}.csv"
        shutil.copyfile(out / "chart.csv", kept)
        made += [kept, docs / "chart.md"]
        _write_text(made[-1], page_of(found, questions, folder, f"chart/{kept.name}").markdown(docs))
    return made


def _write_text(file: Path, text: str) -> None:
    with whole_file(file) as part:
        part.write_text(text, encoding="utf-8")


def machine_slug(machine: Mapping[str, str]) -> str:
    """Return the file name of a machine: processor and cores, without the clock rate, which varies."""
    text = f"{machine.get('processor', 'machine').split('), ')[0]} {machine.get('cores', '?')} cores"
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"\((?:r|tm)\)", "", text.lower())).strip("-")


def page_of(found: Table, questions: Sequence[Question], pictures: Path, csv: str) -> Page:
    """Return the page: picture, conditions and recommendation of each question; in HTML also all points."""
    page = Page(TITLE)
    page.text(f"Generated by `hapscene lab chart --docs docs/results` from {csv}. {METHOD}")
    page.text(f"Machine: {'; '.join(f'{name} {value}' for name, value in found.machine.items())}.")
    for q in questions:
        points = found.points[q.name]
        measures = [m for m in q.measures if any(m.key in p.errors for p in points)]
        page.heading(q.title, key=q.name)
        page.picture(pictures / f"{q.name}.png", q.title)
        page.text(q.conditions)
        page.text(q.advice(points), strong=True)
        head = (
            "method",
            "setting",
            f"time per {q.per} [µs], median / p99",
            *(f"{m.name} [{m.unit}]" for m in measures),
        )
        rows = [
            (
                *(p.method, p.label, f"{shown(p.median_us)} / {shown(p.p99_us)}"),
                *(shown(p.errors[m.key]) if m.key in p.errors else "" for m in measures),
            )
            for p in points
        ]
        page.table(head, rows, fold="All points")
    return page
