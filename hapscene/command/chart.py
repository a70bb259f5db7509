"""`hapscene chart`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.console import note, tell
from hapscene.command.options import (
    add_command,
    add_out_folder,
    check_evidence,
    check_out_folder,
    check_scene,
    check_there,
    whole,
)
from hapscene.errors import HapsceneError


def add_chart(commands: Any) -> None:
    command = add_command(commands, "chart", _chart)
    command.add_argument("scene", nargs="?", help="ask about this scene or mesh, where a question is about one")
    add_out_folder(command, "out/chart")
    command.add_argument("--only", type=_names, default=(), metavar="NAME,…", help="these questions alone")
    command.add_argument("--quick", action="store_true", help="fewer settings, shorter paths")
    command.add_argument(
        "--jobs", type=whole("a number of processes", 1), metavar="N",
        help="processes that find the errors (default: one per core); times are taken alone, afterwards",
    )  # fmt: skip
    command.add_argument(
        "--scheduler", metavar="ADDRESS",
        help="find the errors on a Dask cluster instead: tcp://host:8786; SCENE has the same path there",
    )  # fmt: skip
    command.add_argument("--from", dest="table", type=Path, metavar="CSV", help="draw this chart.csv; measure nothing")
    command.add_argument(
        "--docs", type=Path, metavar="DIR", help="write chart.md and its pictures into this folder too"
    )


def _chart(options: argparse.Namespace) -> int:
    """Chart speed against accuracy: what each approximation costs and buys, and what to choose.

    Each question becomes a picture, all of them one page, chart.html, and one table, chart.csv. What was stopped, the
    same command goes on with.

    for example:
      hapscene chart
      hapscene chart scene.json --only mesh,force-rate --out out/mine
      hapscene chart --quick --jobs 1
      hapscene chart --scheduler tcp://head:8786
      hapscene chart --from out/chart/chart.csv --out out/again
    """
    if options.jobs is not None and options.scheduler is not None:
        raise HapsceneError("--jobs is for processes here, --scheduler for a cluster: give one of the two")
    check_there(options.table)
    check_there(options.docs, what="folder", prefix="--docs ")
    check_out_folder(options.out)
    scene = None
    if options.scene is not None:
        check_scene(options.scene)
        scene = str(Path(options.scene).resolve())
    check_evidence("chart")
    from hapscene_evidence.chart.run import chart

    try:
        chart(
            Path(options.out), scene, only=options.only, quick=options.quick, jobs=options.jobs,
            scheduler=options.scheduler, table=options.table, docs=options.docs, say=lambda text: tell([text]),
        )  # fmt: skip
    except KeyboardInterrupt:
        note("what was measured is kept: the same command goes on from here")
        raise
    return 0


def _names(text: str) -> tuple[str, ...]:
    """Names as in "mesh,groove"."""
    return tuple(name.strip() for name in text.split(",") if name.strip())
