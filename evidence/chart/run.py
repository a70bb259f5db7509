"""The chart: measures every question and writes table, pictures and page. `QUESTIONS` lists the questions."""

import math
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Final

from hapscene.compiled.native import INTERPRETED
from hapscene.errors import HapsceneError, no_such

from ..bench.machine import describe_machine
from ..bench.sheet import Sheet
from ..page import Page, shown, write_page
from .drawing import draw_rows, draw_settings
from .question import Point, Question, merge_identical
from .rows import CHOSEN, HEAD, Row, rows_of, sentences
from .table import LOAD, LOAD_MAX, Table
from .touched_surface import BODY_FACES_MIN

__all__ = ["QUESTIONS", "chart", "question"]

QUESTIONS: Final[Mapping[str, str]] = {
    "mesh": "mesh",
    "texture": "texture",
    "texture-update": "texture_update",
    "force-rate": "force_rate",
    "acceleration-rate": "acceleration_rate",
    "proxy": "proxy",
    "stabiliser": "stabiliser",
    "compensator": "compensator",
}
"""Module of each question by its name, in the order of the page."""

TITLE: Final = "Chart: speed against accuracy"
COMMAND: Final = "hapscene lab chart --docs docs/results"
PICTURE, SETTINGS = "chart.png", "settings.png"
"""Picture of the table's rows, and of all settings."""

METHOD: Final = """Each row is a lever: its default, and a cheaper setting. The error of that setting and of all finer
ones is at most 1 JND, or another limit (speed at rest, energy), to which errors are relative. A saving counts if it
exceeds the noise: repetitions, cases that cost the same, and coarser settings that take longer than finer ones."""

NAMED: Final = ("processor", "cores", "date", LOAD, "scene")
"""Properties of the machine on the page of results; the table has all."""

NO_BODY: Final = f"no body of the scene has at least {BODY_FACES_MIN:,} faces"

ROUNDS: Final = 2
"""Measurements of each time, one round after the other, so that their difference includes slow changes [count]."""


def question(name: str) -> Question:
    """Return the question of that name. Raises HapsceneError: no such question."""
    if name not in QUESTIONS:
        raise HapsceneError(no_such("question", name, QUESTIONS))
    found: Question = import_module(f"{__package__}.{QUESTIONS[name]}").QUESTION
    return found


def chart(
    out: Path,
    scene: str | None = None,
    *,
    only: Sequence[str] = (),
    table: Path | None = None,
    docs: Path | None = None,
    say: Callable[[str], None] = print,
) -> Table:
    """Measure every question, or those in `only`, and write chart.csv, pictures and chart.html into `out`.

    With `table`, an earlier chart.csv, nothing is measured. `docs` is the folder docs/results, whose chart.md and
    chart/ are written as well.

    Raises:
        HapsceneError: no such question; NUMBA_DISABLE_JIT=1, which disables compilation; an invalid `table`.
    """
    if INTERPRETED and table is None:
        raise HapsceneError("NUMBA_DISABLE_JIT is set, but the chart measures compiled code: unset it")
    questions = [question(name) for name in dict.fromkeys(only or QUESTIONS)]
    if docs is not None and not docs.is_dir():
        raise HapsceneError(f"{docs}: no such folder")
    if table is None:
        out.mkdir(parents=True, exist_ok=True)  # before the measurement, so that an invalid folder costs no time
        found = _measure(questions, scene, say)
    else:
        found = Table.read(table)
    questions = [q for q in questions if found.points.get(q.name)]
    if not questions:
        raise HapsceneError(f"{table}: no points of these questions; it has points of: {', '.join(found.points)}")
    _rows(found, questions)  # raises on an incomplete table, before files are written
    out.mkdir(parents=True, exist_ok=True)
    say("made:")
    for path in _write(found, questions, out, docs):
        say(f"  {path}")
    return found


def _measure(questions: Sequence[Question], scene: str | None, say: Callable[[str], None]) -> Table:
    """Measure all settings of all questions in this process, one after the other."""
    settings = [(q, s) for q in questions for s in merge_identical(q, q.settings(scene))]
    for name in sorted({q.name for q in questions} - {q.name for q, _ in settings}):
        say(f"{name} omitted: {NO_BODY}")
    if not settings:
        raise HapsceneError(f"{scene}: {NO_BODY}: name a scene with a larger body, or omit the scene")
    rounds, loads = [], []
    for k in range(ROUNDS):
        rounds.append([q.time(**s.arguments) for q, s in settings])
        loads.append(os.getloadavg()[0] / (os.cpu_count() or 1) if hasattr(os, "getloadavg") else math.nan)
        say(f"times: round {k + 1} of {ROUNDS}")
    points: dict[str, list[Point]] = {}
    for (q, s), *times_us in zip(settings, *rounds, strict=True):
        medians = [median_us for median_us, _ in times_us]
        noise_us, p99_us = max(medians) - min(medians), min(p99_us for _, p99_us in times_us)
        errors = {key: float(value) for key, value in q.error(**s.arguments).items()}
        point = Point(s.lever, s.method, s.label, s.case, s.default, min(medians), p99_us, noise_us, errors)
        points.setdefault(q.name, []).append(point)
        say(", ".join(filter(None, (*s[:3], s.case))))
    return Table(_machine(max(loads), scene), points)


def _machine(load: float, scene: str | None) -> dict[str, str]:
    sheet = Sheet()
    describe_machine(sheet)
    found = {f.name: f"{f.value:g}" if isinstance(f.value, float) else f.value for f in sheet}
    found[LOAD] = f"{load:.1f}"
    if scene is not None:
        found["scene"] = Path(scene).name
    return found


def _rows(found: Table, questions: Sequence[Question]) -> list[Row]:
    return [row for q in questions for row in rows_of(q, found.points[q.name])]


def _write(found: Table, questions: Sequence[Question], out: Path, docs: Path | None) -> list[Path]:
    """Write table, pictures and pages; return their paths."""
    made = [out / "chart.csv", out / "chart.html"]
    found.write(made[0], questions)
    found = Table.read(made[0])  # the page shows the numbers of the file, which are rounded
    pictures = draw_rows(_rows(found, questions), out / PICTURE)
    made += [*pictures, *draw_settings(questions, found.points, out / SETTINGS)]
    write_page(made[1], page_of(found, questions, out, "chart.csv", details=True).html())
    if docs is not None:
        folder = docs / "chart"
        folder.mkdir(exist_ok=True)
        made += [Path(shutil.copyfile(file, folder / file.name)) for file in (*pictures, made[0])]
        made.append(docs / "chart.md")
        page = page_of(found, questions, folder, "chart/chart.csv", details=False)
        write_page(made[-1], page.markdown(docs))
    return made


def page_of(found: Table, questions: Sequence[Question], pictures: Path, csv: str, details: bool) -> Page:
    """Return the page: one picture, one table and what it recommends; with details also every setting."""
    rows = _rows(found, questions)
    page = Page(TITLE)
    page.text(
        f"Generated by `{COMMAND}` from {csv}. {METHOD} "
        "`hapscene lab chart SCENE` charts your scene, with every setting."
    )
    if not details:
        page.markdown_only("Texture orders follow [one criterion](../explanation/texture-model.md).\n")
    if found.quiet:
        for sentence in sentences(rows):
            page.text(sentence, strong=True)
        page.picture(pictures / PICTURE, f"Time and error of the default and of the {CHOSEN}, for each lever")
        page.table(HEAD, [row.cells() for row in rows])
    else:
        page.text(
            f"No advice: other programs ran while times were measured (load {found.machine[LOAD]} per core; at most "
            f"{LOAD_MAX:g} is valid). Errors and memory are valid. Stop the programs and run `{COMMAND}` again.",
            strong=True,
        )
    shown_of_machine = found.machine if details else [name for name in NAMED if name in found.machine]
    page.text(f"Machine: {'; '.join(f'{name} {found.machine[name]}' for name in shown_of_machine)}.")
    if details:
        page.picture(pictures / SETTINGS, "Error and time of every setting")
        for q in questions:
            _add_settings(page, q, found.points[q.name])
    return page


def _add_settings(page: Page, q: Question, points: Sequence[Point]) -> None:
    """Add the conditions of a question and a folded table of its settings."""
    measures = [m for m in q.measures if any(m.key in p.errors for p in points)]
    page.heading(q.title, key=q.name)
    page.text(q.conditions)
    limits = [f"{m.name}: {m.limit:.3g} {m.unit}{f' ({m.source})' if m.source else ''}" for m in measures if m.limit]
    page.text(f"Limits: {'; '.join(limits)}.")
    head = ("lever", "setting", "case", "time per ms [µs], median / p99", *(f"{m.name} [{m.unit}]" for m in measures))
    rows = [
        (
            *(p.lever, f"{p.method} {p.label}", p.case, f"{shown(p.median_us)} / {shown(p.p99_us)}"),
            *(shown(p.errors[m.key]) if m.key in p.errors else "" for m in measures),
        )
        for p in points
    ]
    page.table(head, rows, fold="All settings")
