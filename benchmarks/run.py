"""The whole benchmark, in order: measure, then write bench.csv, bench.md and the charts."""

import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from hapscene.constants import TICK_S
from hapscene.errors import HapsceneError
from hapscene.files import whole_file
from hapscene.native import INTERPRETED

from . import (
    accuracy,
    case,
    crowd,
    deform,
    handle,
    loop_time,
    machine,
    order,
    projection,
    ray,
    side_by_side,
    surface_fit,
    synthesis,
    tick_time,
    twin_time,
)
from .chart import write_charts
from .page import write_page
from .sheet import Sheet
from .side_by_side_page import section

SHARED: Final = Path(__file__).resolve().parents[2] / "shared"
"""Reference data beside the checkout, used where it is there."""

MAIN: Final = "sphere 82 k"
"""The case that the whole tick is measured on."""


def bench(
    out: Path, quick: bool = False, docs: Path | None = None, zoo: Path | None = None, table: Path | None = None
) -> None:
    """Measure speed and accuracy on this machine and write bench.csv, bench.md and charts into `out`.

    Args:
        out: folder to write into; made when it is missing.
        quick: fewer cases, shorter paths, fewer repeats.
        docs: the project's folder of documents: its benchmark.md and bench/ are made anew as well.
        zoo: folder of reference cases; by default ../shared/zoo beside the checkout, where it is there.
        table: a bench.csv from before, to draw and write from it; nothing is measured then.

    Raises:
        HapsceneError: under NUMBA_DISABLE_JIT=1, where times mean nothing; no such `docs` or `zoo`; `table` is none.
        OSError: `out` cannot be written.
    """
    zoo = _checked(docs, zoo, table is not None)
    sheet = Sheet.read(table) if table is not None else None
    out.mkdir(parents=True, exist_ok=True)
    if sheet is None:
        sheet = measure(quick, zoo, SHARED / "data" / "recordings", _say)
    made = write_results(sheet, out)
    _tell_made(made if docs is None else [*made, publish(made, docs)])


def write_results(sheet: Sheet, out: Path) -> list[Path]:
    """Write bench.csv, the charts and bench.md of a sheet into a folder; return their paths."""
    sheet.write(out / "bench.csv")
    charts = write_charts(sheet, out)
    write_page(sheet, out / "bench.md", [chart.name for chart in charts], _peers(out))
    return [out / "bench.csv", *charts, out / "bench.md"]


def publish(made: list[Path], docs: Path) -> Path:
    """Copy tables and charts into docs/bench, and write docs/benchmark.md from the tables there; return its path."""
    folder = docs / "bench"
    folder.mkdir(exist_ok=True)
    kept = [file for file in made if file.suffix in (".csv", ".png")]
    for file in kept:
        shutil.copyfile(file, folder / file.name)
    page = docs / "benchmark.md"
    charts = [file for file in kept if file.suffix == ".png"] or sorted(folder.glob("*.png"))
    write_page(Sheet.read(folder / "bench.csv"), page, [f"bench/{chart.name}" for chart in charts], _peers(folder))
    return page


def _peers(folder: Path) -> Sheet | None:
    """The table of other renderers, where one was made."""
    return Sheet.read(folder / "peers.csv") if (folder / "peers.csv").is_file() else None


def bench_peers(
    build: Path, out: Path, quick: bool, docs: Path | None, zoo: Path | None,
    names: Sequence[str], rounds: tuple[int, int], huge: bool,
) -> None:  # fmt: skip
    """Time other renderers beside hapscene, turn by turn, and write peers.csv and peers.md into `out`.

    Args:
        build: folder of their programs, chai_path and hapi_path.
        out, quick, docs, zoo: as of `bench`; the zoo has the bunny.
        names: of the cases; all that can be had where there are none.
        rounds: how often everybody has a turn, hot and cold.
        huge: huge pages for everybody.

    Raises:
        HapsceneError: as `bench`; `build` holds no program; an unknown case; a program fails.
        OSError: `out` or `docs` cannot be written.
    """
    zoo = _checked(docs, zoo)
    drivers = side_by_side.find_drivers(build)
    if not names and zoo is None:
        names = tuple(side_by_side.SPHERES)
        _say("without the bunny, whose mesh and path are in the zoo: --zoo DIR")
    cases = side_by_side.find_cases(names or side_by_side.CASES, zoo, 2000 if quick else 10_000)
    _say(f"side by side: {', '.join(drivers)}")
    out.mkdir(parents=True, exist_ok=True)
    sheet = side_by_side.measure(drivers, cases, *rounds, huge, _say)
    made = [out / "peers.csv", out / "peers.md"]
    sheet.write(made[0])
    with whole_file(made[1]) as part:
        part.write_text(section(sheet), encoding="utf-8")
    _tell_made(made if docs is None else [*made, publish(made, docs)])


def measure(quick: bool, zoo: Path | None, recordings: Path, say: Callable[[str], None]) -> Sheet:
    """Measure everything; the order is that of the page."""
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
    main = case.Case(MAIN, case.sphere(6), case.slide_path(ticks), True)
    _measure_ticks(sheet, main, repeats, say)
    say("loop of 1 kHz, start of a process")
    loop_time.measure_sleep(sheet, 1.0 if quick else 3.0)
    loop_time.measure_cold(sheet, main, 1.0 if quick else 5.0)
    for one in (main, *([] if quick else case.sphere_cases(case.SUBDIVISIONS[-1:], ticks))):
        loop_time.measure_start(sheet, one, 1 if quick else 5)
    say("shapes that change")
    deform.measure_deform(sheet, 1.0 if quick else 10.0)
    say("synthesis of textures")
    synthesis.measure_synthesis(sheet)
    say("fits")
    surface_fit.measure_fit(sheet, (10.0,) if quick else (10.0, 600.0))
    say("the twin in closed loop; the handle's compensators")
    twin_time.measure_twin(sheet)
    handle.measure_handle(sheet, 12 if quick else handle.PLANTS)
    handle.measure_sensor(sheet, 12 if quick else handle.PLANTS)
    handle.measure_teleoperation(sheet)
    say("grooves; recordings" if recordings.is_dir() else "grooves; no recordings beside the checkout: no texture.png")
    projection.measure_projection(sheet)
    if recordings.is_dir():
        order.measure_recordings(sheet, recordings)
    return sheet


def _measure_spheres(
    sheet: Sheet, sizes: tuple[int, ...], ticks: int, repeats: int, say: Callable[[str], None]
) -> None:
    """Contact time and accuracy over mesh size; rays at the ends; many bodies."""
    for k in sizes:
        (one,) = case.sphere_cases((k,), ticks)
        say(f"{one.name}: contact, accuracy")
        recording = tick_time.measure_contact(sheet, one, repeats)
        accuracy.measure_accuracy(sheet, one, recording)
    for k in (sizes[-1], sizes[0]):
        name = f"sphere {case.short(20 * 4**k)}"
        say(f"{name}: its rays, noted from the interpreted tick")
        ray.measure_rays(sheet, name, k, ticks, repeats)
    say("many bodies")
    crowd.measure_crowd(sheet, ticks, repeats)


def _measure_ticks(sheet: Sheet, main: case.Case, repeats: int, say: Callable[[str], None]) -> None:
    """The whole tick at each order, and what calling effects costs."""
    for p in order.ORDERS:
        say(f"{main.name}: whole tick, order {p}")
        tick_time.measure_tick(sheet, main, order.swatch_of_order(p), p, repeats)
    tick_time.measure_harness(sheet, main, repeats)
    tick_time.measure_profile(sheet, main, order.swatch_of_order(40), repeats)


def _checked(docs: Path | None, zoo: Path | None, measured: bool = False) -> Path | None:
    """Refuse what `bench` refuses; return the folder of the zoo, where there is one."""
    if INTERPRETED and not measured:
        raise HapsceneError("the benchmark times compiled code: run it without NUMBA_DISABLE_JIT")
    for folder in (docs, zoo):
        if folder is not None and not folder.is_dir():
            raise HapsceneError(f"{folder}: no such folder")
    return SHARED / "zoo" if zoo is None and (SHARED / "zoo").is_dir() else zoo


def _tell_made(made: Sequence[Path]) -> None:
    _say("\n".join(["made:", *(f"  {file}" for file in made)]))


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":  # python -m hapscene_benchmarks.run BUILD DOCS [ZOO]
    build, docs, *zoo = map(Path, sys.argv[1:])
    bench_peers(build, Path("out/bench"), False, docs, zoo[0] if zoo else None, (), (5, 3), False)
