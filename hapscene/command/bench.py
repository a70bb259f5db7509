"""`hapscene bench`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.word import add_command


def add_bench(commands: Any) -> None:
    command = add_command(
        commands,
        "bench",
        _bench,
        "measure the time per tick on this machine",
        "hapscene bench --out out/bench",
    )
    command.add_argument("--out", default="out/bench", metavar="DIR", help="folder to write into (default out/bench)")
    command.add_argument("--quick", action="store_true", help="fewer cases, in a quarter of the time")


def _bench(options: argparse.Namespace) -> int:
    from hapscene.bench.run import bench

    bench(Path(options.out), options.quick)
    return 0
