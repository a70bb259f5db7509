"""`hapscene bench`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.console import tell
from hapscene.command.options import add_command, add_out_folder, check_there


def add_bench(commands: Any) -> None:
    command = add_command(commands, "bench", _bench)
    add_out_folder(command, "out/bench")
    command.add_argument("--quick", action="store_true", help="fewer cases, in a third of the time")
    command.add_argument("--docs", metavar="DIR", help="write benchmark.md and its charts into this folder too")
    command.add_argument("--from", dest="table", type=Path, metavar="CSV", help="draw this bench.csv; measure nothing")
    command.add_argument("--zoo", metavar="DIR", help="folder of recorded paths and meshes to run as well")
    further = command.add_subparsers(
        metavar="compare A B", help="ratios between two tables of figures, with their spread"
    )
    compare = add_command(further, "compare", _compare)
    compare.add_argument("first", type=Path, metavar="A", help="a bench.csv or chart.csv")
    compare.add_argument("second", type=Path, metavar="B", help="another one, of the same kind")


def _bench(options: argparse.Namespace) -> int:
    """Measure the time per tick on this machine.

    for example:
      hapscene bench
      hapscene bench --quick --out out/quick
      hapscene bench --from out/bench/bench.csv --out out/again
      hapscene bench compare docs/bench/bench.csv out/bench/bench.csv
    """
    check_there(options.table)
    from hapscene_benchmarks.run import bench

    docs = None if options.docs is None else Path(options.docs)
    zoo = None if options.zoo is None else Path(options.zoo)
    bench(Path(options.out), options.quick, docs, zoo, options.table)
    return 0


def _compare(options: argparse.Namespace) -> int:
    """Ratios between two tables of figures, with their spread, by what they are figures of.

    Above 1, B is slower or farther off. Ratios of times mean something on the same quiet machine alone; whether it is
    one is told.

    for example:
      hapscene bench compare docs/bench/bench.csv out/bench/bench.csv
      hapscene bench compare before/chart.csv after/chart.csv
    """
    check_there(options.first)
    check_there(options.second)
    from hapscene_benchmarks.comparison import lines

    tell(lines(options.first, options.second))
    return 0
