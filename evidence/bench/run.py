"""The benchmark: measures everything and writes bench.csv, bench.md and the charts."""

import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from hapscene.compiled.native import INTERPRETED
from hapscene.constants import TICK_S
from hapscene.errors import HapsceneError

from ..page import write_page
from . import (
    accuracy,
    case,
    crowd,
    handle,
    machine,
    side_by_side,
    start_time,
    synthesis,
    tick_time,
)
from .against import SLOWER, compare_checkouts, lines
from .chart import write_charts
from .page import page_of
from .sheet import Sheet

__all__ = ["bench", "bench_against", "bench_peers", "measure", "publish", "write_results"]

MAIN: Final = "sphere 82 k"
"""Case on which the tick is measured."""


def bench(out: Path, quick: bool = False, docs: Path | None = None, table: Path | None = None) -> None:
    """Measure speed and accuracy on this machine, and write bench.csv, bench.md and charts into `out`.

    With `quick` fewer cases and repeats; with `table`, an earlier bench.csv, nothing is measured. `docs` is the folder
    docs/results, whose benchmark.md and bench/ are written as well.

    Raises:
        HapsceneError: NUMBA_DISABLE_JIT=1, which disables compilation; no such `docs`; an invalid `table`.
    """
    _check(docs, table is not None)
    sheet = Sheet.read(table) if table is not None else None
    out.mkdir(parents=True, exist_ok=True)
    if sheet is None:
        sheet = measure(quick, _say)
    made = write_results(sheet, out)
    _print_made(made if docs is None else [*made, publish(made, docs)])


def write_results(sheet: Sheet, out: Path) -> list[Path]:
    """Write bench.csv, charts and bench.md into a folder; return their paths."""
    made = [out / "bench.csv", *write_charts(sheet, out), out / "bench.md"]
    sheet.write(made[0])
    write_page(made[-1], page_of(sheet, out).markdown(out))
    return made


def publish(made: list[Path], docs: Path) -> Path:
    """Copy tables and charts into the folder bench of `docs`, and write benchmark.md from them; return its path."""
    folder = docs / "bench"
    folder.mkdir(exist_ok=True)
    for file in made:
        if file.suffix in (".csv", ".png"):
            shutil.copyfile(file, folder / file.name)
    page = docs / "benchmark.md"
    peers = Sheet.read(folder / "peers.csv") if (folder / "peers.csv").is_file() else None
    write_page(page, page_of(Sheet.read(folder / "bench.csv"), folder, peers).markdown(docs))
    return page


def bench_against(other: Path, rounds: int) -> bool:
    """Print tick and `step` of this checkout against another one; return whether neither is slower.

    Raises:
        HapsceneError: `other` is not a checkout; NUMBA_DISABLE_JIT=1; a process fails.
    """
    _check(None)
    found = compare_checkouts(other, rounds, _say)
    _say("\n".join(lines(found)))
    return all(one.ratio <= SLOWER for one in found)


def bench_peers(build: Path, docs: Path, cases: list[case.Case], rounds: tuple[int, int]) -> None:
    """Time other renderers (programs in the folder `build`, see `path_driver`) and hapscene in turn, with hot and with
    cold caches, and write bench/peers.csv and the page into `docs`.

    Raises:
        HapsceneError: as for `bench`; no program in `build`; a program fails.
    """
    _check(docs)
    sheet = side_by_side.measure(side_by_side.find_drivers(build), cases, *rounds, _say)
    sheet.write(docs / "bench" / "peers.csv")
    _print_made([publish([], docs)])


def measure(quick: bool, say: Callable[[str], None]) -> Sheet:
    """Measure everything, in the order of the page."""
    sheet = Sheet()
    ticks, repeats = (2000, 2) if quick else (10_000, tick_time.REPEATS)
    sizes = (3, 6) if quick else case.SUBDIVISIONS
    machine.describe_machine(sheet)
    sheet.add("method", "path", ticks * TICK_S, "s")
    sheet.add("method", "hot runs", repeats, "1")
    tick_time.measure_clock(sheet)
    _measure_spheres(sheet, sizes, ticks, repeats, say)
    for one in case.zoo_cases():
        say(f"{one.name}: contact")
        tick_time.measure_contact(sheet, one, repeats)
    main = case.Case(MAIN, case.sphere(6), case.slide_path(ticks))
    _measure_ticks(sheet, main, repeats, say)
    say("start of a process")
    for one in (main, *([] if quick else case.sphere_cases(case.SUBDIVISIONS[-1:], ticks))):
        start_time.measure_start(sheet, one, 1 if quick else 5)
    say("deforming body")
    crowd.measure_deform(sheet, 1.0 if quick else 10.0)
    say("synthesis")
    synthesis.measure_synthesis(sheet)
    say("fits")
    synthesis.measure_fit(sheet, (10.0,) if quick else (10.0, 600.0))
    say("closed loop; compensators of the handle")
    tick_time.measure_twin(sheet)
    handle.measure_handle(sheet, 12 if quick else handle.PLANTS)
    return sheet


def _measure_spheres(
    sheet: Sheet, sizes: tuple[int, ...], ticks: int, repeats: int, say: Callable[[str], None]
) -> None:
    """Measure contact time and accuracy over mesh size, and many bodies."""
    for k in sizes:
        (one,) = case.sphere_cases((k,), ticks)
        say(f"{one.name}: contact, accuracy")
        recording = tick_time.measure_contact(sheet, one, repeats)
        accuracy.measure_accuracy(sheet, one, recording)
    say("many bodies")
    crowd.measure_crowd(sheet, repeats)


def _measure_ticks(sheet: Sheet, main: case.Case, repeats: int, say: Callable[[str], None]) -> None:
    """Measure the tick at each order, and the cost of effects."""
    for p in tick_time.ORDERS:
        say(f"{main.name}: tick, order {p}")
        tick_time.measure_tick(sheet, main, tick_time.swatch_of_order(p), p, repeats)
    tick_time.measure_harness(sheet, main, repeats)
    tick_time.measure_effects(sheet, main, tick_time.swatch_of_order(40), repeats)


def _check(docs: Path | None, measured: bool = False) -> None:
    """Check the arguments of `bench`."""
    if INTERPRETED and not measured:
        raise HapsceneError("NUMBA_DISABLE_JIT is set, but the benchmark measures compiled code: unset it")
    if docs is not None and not docs.is_dir():
        raise HapsceneError(f"{docs}: no such folder")


def _print_made(made: Sequence[Path]) -> None:
    _say("\n".join(["made:", *(f"  {file}" for file in made)]))


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":  # python -m hapscene_evidence.bench.run BUILD DOCS
    spheres = case.sphere_cases(case.SUBDIVISIONS, 10_000)
    balls = [case.with_ball(one) for one in spheres if one.name in ("sphere 20 k", "sphere 1.31 M")]
    bunny = [one for one in case.zoo_cases() if "bunny" in one.name]
    bench_peers(Path(sys.argv[1]), Path(sys.argv[2]), spheres + balls + bunny, (5, 3))
