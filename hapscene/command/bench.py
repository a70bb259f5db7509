"""`hapscene bench`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.console import tell
from hapscene.command.options import add_command, add_out_folder, check_evidence, check_out_folder, check_there, whole


def add_bench(commands: Any) -> None:
    command = add_command(commands, "bench", _bench)
    add_out_folder(command, "out/bench")
    command.add_argument("--quick", action="store_true", help="fewer cases, in a third of the time")
    command.add_argument("--docs", metavar="DIR", help="write benchmark.md and its charts into this folder too")
    command.add_argument("--from", dest="table", type=Path, metavar="CSV", help="draw this bench.csv; measure nothing")
    command.add_argument("--zoo", metavar="DIR", help="folder of recorded paths and meshes to run as well")
    rounds = whole("a number of rounds", 0)
    peers = command.add_argument_group("other renderers beside it, turn by turn, and nothing else")
    peers.add_argument("--peers", type=Path, metavar="BUILD", help="folder that holds chai_path and hapi_path")
    peers.add_argument("--rounds", type=rounds, default=5, metavar="N", help="rounds with hot caches (default 5)")
    peers.add_argument("--cold-rounds", type=rounds, default=3, metavar="N", help="with cold caches (default 3)")
    peers.add_argument("--cases", default="", metavar="NAME,…", help="these of 1k, 20k, 82k, 328k, 1.31M, bunny alone")
    command.add_argument(
        "--against", type=Path, metavar="CHECKOUT",
        help="compare whole tick and step with those of another checkout, in turn, --rounds times",
    )  # fmt: skip
    peers.add_argument("--huge", action="store_true", help="huge pages for all memory of all of them, by glibc")
    further = command.add_subparsers(
        metavar="compare A B", help="ratios between two tables of figures, with their spread"
    )
    compare = add_command(further, "compare", _compare)
    compare.add_argument("first", type=Path, metavar="A", help="a bench.csv")
    compare.add_argument("second", type=Path, metavar="B", help="another one")


def _bench(options: argparse.Namespace) -> int:
    """Measure the time per tick on this machine.

    Exit codes: 0 done; 1 with --against, this checkout is slower by more than 3 %.

    for example:
      hapscene bench
      hapscene bench --quick --out out/quick
      hapscene bench --from out/bench/bench.csv --out out/again
      hapscene bench compare docs/bench/bench.csv out/bench/bench.csv
      hapscene bench --peers BUILD --rounds 3 --cases 1k,bunny
      hapscene bench --against ../hapscene-before
    """
    check_there(options.table)
    check_there(options.peers, what="folder", prefix="--peers ")
    check_there(options.against, what="folder", prefix="--against ")
    check_evidence("bench")
    from hapscene_evidence.bench.run import bench, bench_against, bench_peers

    if options.against is not None:
        return 0 if bench_against(options.against, max(options.rounds, 1)) else 1

    docs = None if options.docs is None else Path(options.docs)
    zoo = None if options.zoo is None else Path(options.zoo)
    if options.peers is None:
        bench(Path(options.out), options.quick, docs, zoo, options.table)
    else:
        check_out_folder(options.out)
        names = [name.strip() for name in options.cases.split(",") if name.strip()]
        rounds = (options.rounds, options.cold_rounds)
        bench_peers(options.peers, Path(options.out), options.quick, docs, zoo, names, rounds, options.huge)
    return 0


def _compare(options: argparse.Namespace) -> int:
    """Ratios between two tables of figures, with their spread, by what they are figures of.

    Above 1, B is slower or farther off. Ratios of times mean something on the same quiet machine alone; whether it is
    one is told.

    for example:
      hapscene bench compare docs/bench/bench.csv out/bench/bench.csv
    """
    check_there(options.first)
    check_there(options.second)
    check_evidence("bench")
    from hapscene_evidence.bench.comparison import lines

    tell(lines(options.first, options.second))
    return 0
