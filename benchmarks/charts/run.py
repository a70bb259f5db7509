"""The chart: every question swept, drawn, and told on one page. A new question takes its line in `QUESTIONS`."""

import hashlib
import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from hapscene.errors import HapsceneError, no_such
from hapscene.files import whole_file
from hapscene.native import INTERPRETED
from hapscene.parameter_sweep import Piece, sweep
from hapscene.view.chart import picture

from ..machine import describe_machine
from ..markdown import paragraph, shown
from ..markdown import table as markdown_table
from ..sheet import Sheet
from .chart_drawing import write_picture
from .chart_page import exponent_rows, write_page
from .chart_table import Table
from .question import Point, Question, fronts, no_time
from .touched_surface import BODY_FACES_MIN

QUESTIONS: Final[Mapping[str, str]] = {
    "whole-tick": "whole_tick",
    "mesh": "mesh",
    "triangles": "triangles",
    "groove": "groove",
    "painting": "painting",
    "bodies": "bodies",
    "texture-order": "texture_order",
    "texture-domain": "texture_domain",
    "level-law": "level_law",
    "life": "life",
    "texture-update": "texture_update",
    "acceleration-rate": "acceleration_rate",
    "tap-model": "tap_model",
    "friction-model": "friction_model",
    "force-rate": "force_rate",
    "stabiliser": "stabiliser",
    "compensator": "compensator",
    "pose-prediction": "pose_prediction",
    "audio-latency": "audio_latency",
    "growth": "growth",
}
"""The module of each question, whose `QUESTION` it is, in the order of the page."""

TITLE: Final = "Speed and accuracy, one charted against the other"

SEED: Final = 0
"""Of all that a question draws at random."""


@cache
def question(name: str) -> Question:
    """The question of that name.

    Raises:
        HapsceneError: there is none.
    """
    if name not in QUESTIONS:
        raise HapsceneError(no_such("question", name, QUESTIONS))
    asked: Question = import_module(f"hapscene_benchmarks.charts.{QUESTIONS[name]}").QUESTION
    return asked


def error_of(name: str, arguments: Mapping[str, Any], stamp: str) -> dict[str, float]:
    """The errors of a setting, in whichever process. The stamp tells one state of the scene's file from another."""
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

    What is done is noted in chart.jsonl there, so the same call goes on where one was stopped; it is gone once all is.

    Args:
        out: folder to write into; made when it is missing.
        scene: file of the scene that is asked about; None for what each question takes itself.
        only: names of questions; all without them.
        quick: fewer settings, shorter paths.
        jobs: processes in which errors are found; None for one a core. Times are always taken alone, here, afterwards.
        scheduler: of a Dask cluster in their place; a scene must have the same path there.
        table: a chart.csv from before, to draw it anew; nothing is measured then.
        docs: the project's folder of documents: chart.md and chart/ are made anew as well.
        say: called with each line of progress.

    Raises:
        HapsceneError: no such question; under NUMBA_DISABLE_JIT=1, where times mean nothing; `table` is none.
        OSError: `out` cannot be written.
    """
    if INTERPRETED and table is None:
        raise HapsceneError("the chart times compiled code: run it without NUMBA_DISABLE_JIT")
    asked = [question(name) for name in dict.fromkeys(only or QUESTIONS)]
    if docs is not None and not docs.is_dir():
        raise HapsceneError(f"{docs}: no such folder")
    found = None if table is None else Table.read(table)
    out.mkdir(parents=True, exist_ok=True)
    if found is None:
        missing = {q.name: why for q in asked if (why := q.needs())}
        for name, why in missing.items():
            say(f"{name} is left out: {why}")
        asked = [q for q in asked if q.name not in missing]
        found = _measured(asked, out / "chart.jsonl", scene, quick, jobs, scheduler, say)
    asked = [q for q in asked if found.points.get(q.name)]
    if table is not None and not asked:
        raise HapsceneError(f"{table}: no figures of what is asked for; it has: {', '.join(found.points) or 'none'}")
    for q in asked if table is not None else ():
        try:
            q.advice(found.points[q.name])
        except (LookupError, ValueError, ArithmeticError, StopIteration):
            raise HapsceneError(f"{table}: of {q.name} it has not all points and measures; draw others alone") from None
    say("made:")
    for path in _written(found, asked, out, docs):
        say(f"  {path}")
    return found


def _measured(
    asked: Sequence[Question],
    journal: Path,
    scene: str | None,
    quick: bool,
    jobs: int | None,
    scheduler: str | None,
    say: Callable[[str], None],
) -> Table:
    """Every question answered, and where."""
    stamp = "" if scene is None else hashlib.sha256(Path(scene).read_bytes()).hexdigest()[:16]
    load = [os.getloadavg()[0]] if hasattr(os, "getloadavg") else []
    settings = {q.name: list(q.settings(quick, scene)) for q in asked}
    reason = f"no body of the scene has {BODY_FACES_MIN:,} faces or more"
    if asked and not any(settings.values()):
        raise HapsceneError(
            f"{scene}: {reason}, which is what is asked about: leave the scene out, or name a larger one"
        )
    for name in [name for name, found in settings.items() if not found]:
        say(f"{name} is left out: {reason}")
    pieces = []
    for q in asked:
        for s in settings[q.name]:
            arguments = {"name": q.name, "arguments": dict(s.arguments), "stamp": stamp}
            key = f"{q.name}: {s.method}, {s.label}"
            pieces.append(Piece(f"{key}: error", f"{__name__}:error_of", arguments, alone=q.growth))
            if q.time is not no_time:
                pieces.append(Piece(f"{key}: time", f"{__name__}:time_of", arguments, alone=True))

    def after(done: int, count: int, key: str) -> None:
        say(f"{done} of {count}  {key}")

    results = sweep(pieces, journal=journal, jobs=jobs, scheduler=scheduler, after=after)
    points: dict[str, list[Point]] = {}
    for q in asked:
        points[q.name] = []
        for s in settings[q.name]:
            key = f"{q.name}: {s.method}, {s.label}"
            median_us, p99_us = results.get(f"{key}: time", no_time())
            points[q.name].append(Point(s.method, s.label, median_us, p99_us, results[f"{key}: error"]))
        points[q.name] += q.cited
    journal.unlink(missing_ok=True)  # all is told in chart.csv; the next run measures anew
    sheet = Sheet()
    describe_machine(sheet)
    machine = {f.name: f"{f.value:g}" if isinstance(f.value, float) else f.value for f in sheet}
    machine["seed"] = str(SEED)
    if load:
        machine["load before and after"] = f"{load[0]:.1f} and {os.getloadavg()[0]:.1f}"
    if quick:
        machine["settings"] = "fewer, in short (--quick)"
    if scene is not None:
        machine["scene"] = Path(scene).name
    return Table(machine, points)


def _written(found: Table, asked: Sequence[Question], out: Path, docs: Path | None) -> list[Path]:
    """Write table, pictures and page; return their paths."""
    made = [out / "chart.csv"]
    found.write(made[0], asked)
    for q in asked:
        made += write_picture(q, found.points[q.name], out / f"{q.name}.png")
    made.append(out / "chart.html")
    with whole_file(made[-1]) as part:
        part.write_text(write_page(found, asked, TITLE), encoding="utf-8")
    if docs is not None:
        folder = docs / "chart"
        folder.mkdir(exist_ok=True)
        for file in made:
            if file.suffix == ".png":
                shutil.copyfile(file, folder / file.name)
        kept = folder / f"{machine_slug(found.machine)}.csv"
        shutil.copyfile(out / "chart.csv", kept)
        made += [kept, docs / "chart.md"]
        with whole_file(made[-1]) as part:
            part.write_text(_document(found, asked, f"chart/{kept.name}"), encoding="utf-8")
    return made


def machine_slug(machine: Mapping[str, str]) -> str:
    """A machine's name as that of a file: its processor and cores, without the clock, which changes."""
    text = f"{machine.get('processor', 'machine').split('), ')[0]} {machine.get('cores', '?')} cores"
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"\((?:r|tm)\)", "", text.lower())).strip("-")


def _document(found: Table, asked: Sequence[Question], csv: str) -> str:
    """docs/chart.md: a picture, what to choose, and the front of each question."""
    machine = "; ".join(f"{name} {value}" for name, value in found.machine.items())
    parts = [
        f"# The chart: {TITLE[0].lower()}{TITLE[1:]}\n",
        paragraph(f"""Made by `hapscene lab chart --docs docs`; every figure is from [{Path(csv).name}]({csv}), none is
        copied by hand. Each point is a method at one setting: the time that it takes, and its error against a truth
        that the method did not make. Those on the front are beaten in both by no other. What lies in the shaded part
        cannot be felt, so it is not needed. `hapscene lab chart SCENE --out DIR` draws it for a scene of yours, on your
        machine, with a page on which every point can be read.""")
        + "\n",
        paragraph(f"Machine: {machine}.") + "\n",
    ]  # fmt: skip
    for q in asked:
        points = found.points[q.name]
        measures = [m for m in q.measures if any(m.key in p.errors for p in points)]
        alt = f"{q.title} {'; '.join(m.name for m in measures)}"
        parts += [f"## {q.title}\n", picture(f"chart/{q.name}.png", alt) + "\n"]
        parts += [paragraph(q.conditions) + "\n", f"**{paragraph(q.advice(points))}**\n"]
        if q.growth:
            parts.append(markdown_table(("cost", "of", "grows as (95 %)"), exponent_rows(points, measures)))
            continue
        best = {points.index(p) for m in measures for each in fronts(q, points, m) for p in each}
        if best:
            head = ("method", "setting", f"time a {q.per} [µs], {' / '.join(q.quantiles)}")
            rows = [
                (
                    *(p.method, p.label, f"{shown(p.median_us)} / {shown(p.p99_us)}"),
                    *(shown(p.errors[m.key]) if m.key in p.errors else "" for m in measures),
                )
                for p in (points[k] for k in sorted(best, key=lambda k: points[k].median_us))
            ]
            parts.append(markdown_table((*head, *(f"{m.name} [{m.unit}]" for m in measures)), rows))
    return "\n".join(parts)
