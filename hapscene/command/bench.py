"""`hapscene bench`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.options import add_command, add_out_folder, check_there


def add_bench(commands: Any) -> None:
    command = add_command(commands, "bench", _bench)
    add_out_folder(command, "out/bench")
    command.add_argument("--quick", action="store_true", help="fewer cases, in a third of the time")
    command.add_argument("--docs", metavar="DIR", help="write benchmark.md and its charts into this folder too")
    command.add_argument("--from", dest="table", type=Path, metavar="CSV", help="draw this bench.csv; measure nothing")
    command.add_argument("--zoo", metavar="DIR", help="folder of recorded paths and meshes to run as well")


def _bench(options: argparse.Namespace) -> int:
    """Measure the time per tick on this machine.

    for example:
      hapscene bench
      hapscene bench --quick --out out/quick
      hapscene bench --from out/bench/bench.csv --out out/again
    """
    check_there(options.table)
    from hapscene_benchmarks.run import bench

    docs = None if options.docs is None else Path(options.docs)
    zoo = None if options.zoo is None else Path(options.zoo)
    bench(Path(options.out), options.quick, docs, zoo, options.table)
    return 0
