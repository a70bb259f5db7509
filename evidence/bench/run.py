"""The benchmark: measures everything and writes bench.csv, bench.md and the charts."""

import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from hapscene.compiled.native import INTERPRETED
from hapscene.constants import TICK_S
from hapscene.errors import HapsceneError
from hapscene.io.files import whole_file

from ..page import Page
from . import (
    accuracy,
    case,
    crowd,
    deform,
    handle,
    machine,
    order,
    side_by_side,
    start_time,
    surface_fit,
    synthesis,
    tick_time,
    twin_time,
)
from .against import SLOWER, compare_checkouts, lines
from .chart import write_charts
from .page import page_of
from .sheet import Sheet
from .side_by_side_page import add_peers

__all__ = ["bench", "bench_against", "bench_peers", "measure", "publish", "write_results"]

SHARED: Final = Path(__file__).resolve().parents[3] / "shared"
"""Folder of reference data beside the checkout, used if present."""

MAIN: Final = "sphere 82 k"
"""Case on which the tick is measured."""


def bench(
    out: Path, quick: bool = False, docs: Path | None = None, zoo: Path | None = None, table: Path | None = None
) -> None:
    """Measure speed and accuracy on this machine, and write bench.csv, bench.md and charts into `out`.

    Args:
        out: output folder, created if missing.
        quick: fewer cases, shorter paths, fewer repeats.
        docs: the folder docs/results, whose benchmark.md and bench/ are written as well.
        zoo: folder of reference cases; by default ../shared/zoo beside the checkout, if it exists.
        table: an earlier bench.csv to use instead of measuring.

    Raises:
        HapsceneError: NUMBA_DISABLE_JIT=1, which disables compilation; no such `docs` or `zoo`; an invalid `table`.
        OSError: `out` cannot be written.
    """
    zoo = _checked(docs, zoo, table is not None)
    sheet = Sheet.read(table) if table is not None else None
    out.mkdir(parents=True, exist_ok=True)
    if sheet is None:
        sheet = measure(quick, zoo, _say)
    made = write_results(sheet, out)
    _print_made(made if docs is None else [*made, publish(made, docs)])


def write_results(sheet: Sheet, out: Path) -> list[Path]:
    """Write bench.csv, charts and bench.md into a folder; return their paths."""
    made = [out / "bench.csv", *write_charts(sheet, out), out / "bench.md"]
    sheet.write(made[0])
    _write_text(made[-1], page_of(sheet, out, _peers(out)).markdown(out))
    return made


def publish(made: list[Path], docs: Path) -> Path:
    """Copy tables and charts into the folder bench of `docs`, and write benchmark.md from them; return its path."""
    folder = docs / "bench"
    folder.mkdir(exist_ok=True)
    for file in made:
        if file.suffix in (".csv", ".png"):
            shutil.copyfile(file, folder / file.name)
    page = docs / "benchmark.md"
    _write_text(page, page_of(Sheet.read(folder / "bench.csv"), folder, _peers(folder)).markdown(docs))
    return page


def _write_text(file: Path, text: str) -> None:
    with whole_file(file) as part:
        part.write_text(text, encoding="utf-8")


def _peers(folder: Path) -> Sheet | None:
    """Return the table of other renderers, if it exists."""
    return Sheet.read(folder / "peers.csv") if (folder / "peers.csv").is_file() else None


def bench_against(other: Path, rounds: int) -> bool:
    """Print tick and `step` of this checkout against another one; return whether neither is slower.

    Raises:
        HapsceneError: `other` is not a checkout; NUMBA_DISABLE_JIT=1; a process fails.
    """
    _checked(None, None)
    found = compare_checkouts(other, rounds, _say)
    _say("\n".join(lines(found)))
    return all(one.ratio <= SLOWER for one in found)


def bench_peers(
    build: Path, out: Path, quick: bool, docs: Path | None, zoo: Path | None, rounds: tuple[int, int]
) -> None:
    """Time other renderers and hapscene in turn, and write peers.csv and peers.md into `out`.

    Args:
        build: folder of the programs chai_path and hapi_path (see `path_driver`).
        out, quick, docs, zoo: as for `bench`; with `quick` only the smallest sphere is measured.
        rounds: numbers of rounds with hot and with cold caches.

    Raises:
        HapsceneError: as for `bench`; no program in `build`; a program fails.
        OSError: `out` or `docs` cannot be written.
    """
    zoo = _checked(docs, zoo)
    drivers = side_by_side.find_drivers(build)
    cases = case.sphere_cases(case.SUBDIVISIONS[:1] if quick else case.SUBDIVISIONS, 2000 if quick else 10_000)
    cases += [case.with_ball(one) for one in cases if quick or one.name in ("sphere 20 k", "sphere 1.31 M")]
    if zoo is not None and not quick:
        cases += [one for one in case.zoo_cases(zoo) if "bunny" in one.name]
    out.mkdir(parents=True, exist_ok=True)
    sheet = side_by_side.measure(drivers, cases, *rounds, _say)
    made, page = [out / "peers.csv", out / "peers.md"], Page("Benchmark: other renderers")
    sheet.write(made[0])
    add_peers(page, sheet)
    _write_text(made[1], page.markdown(out))
    _print_made(made if docs is None else [*made, publish(made, docs)])


def measure(quick: bool, zoo: Path | None, say: Callable[[str], None]) -> Sheet:
    """Measure everything, in the order of the page."""
    sheet = Sheet()
    ticks, repeats = (2000, 2) if quick else (10_000, tick_time.REPEATS)
    sizes = (3, 6) if quick else case.SUBDIVISIONS
    machine.describe_machine(sheet)
    sheet.add("method", "path", ticks * TICK_S, "s")
    sheet.add("method", "hot runs", repeats, "1")
    tick_time.measure_clock(sheet)
    _measure_spheres(sheet, sizes, ticks, repeats, say)
    if zoo is not None:
        for one in case.zoo_cases(zoo):
            say(f"{one.name}: contact")
            tick_time.measure_contact(sheet, one, repeats)
    main = case.Case(MAIN, case.sphere(6), case.slide_path(ticks))
    _measure_ticks(sheet, main, repeats, say)
    say("start of a process")
    for one in (main, *([] if quick else case.sphere_cases(case.SUBDIVISIONS[-1:], ticks))):
        start_time.measure_start(sheet, one, 1 if quick else 5)
    say("deforming body")
    deform.measure_deform(sheet, 1.0 if quick else 10.0)
    say("synthesis")
    synthesis.measure_synthesis(sheet)
    say("fits")
    surface_fit.measure_fit(sheet, (10.0,) if quick else (10.0, 600.0))
    say("closed loop; compensators of the handle")
    twin_time.measure_twin(sheet)
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
    for p in order.ORDERS:
        say(f"{main.name}: tick, order {p}")
        tick_time.measure_tick(sheet, main, order.swatch_of_order(p), p, repeats)
    tick_time.measure_harness(sheet, main, repeats)
    tick_time.measure_effects(sheet, main, order.swatch_of_order(40), repeats)


def _checked(docs: Path | None, zoo: Path | None, measured: bool = False) -> Path | None:
    """Check the arguments of `bench`; return the folder of the zoo if it exists."""
    if INTERPRETED and not measured:
        raise HapsceneError("NUMBA_DISABLE_JIT is set, but the benchmark measures compiled code: unset it")
    for folder in (docs, zoo):
        if folder is not None and not folder.is_dir():
            raise HapsceneError(f"{folder}: no such folder")
    return SHARED / "zoo" if zoo is None and (SHARED / "zoo").is_dir() else zoo


def _print_made(made: Sequence[Path]) -> None:
    _say("\n".join(["made:", *(f"  {file}" for file in made)]))


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":  # python -m hapscene_evidence.bench.run BUILD DOCS [ZOO]
    build, docs, *zoo = map(Path, sys.argv[1:])
    bench_peers(build, Path("out/bench"), False, docs, zoo[0] if zoo else None, (5, 3))
