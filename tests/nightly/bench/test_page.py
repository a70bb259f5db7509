"""Charts and page are generated from the table of results only."""

import re
from pathlib import Path

import pytest

from hapscene.errors import HapsceneError
from hapscene.handle.compensator import COMPENSATORS
from hapscene.render.renderer import EFFECTS
from hapscene_evidence.bench import machine
from hapscene_evidence.bench.case import short
from hapscene_evidence.bench.handle import SIGNALS
from hapscene_evidence.bench.page import AIMS
from hapscene_evidence.bench.run import bench, publish, write_results
from hapscene_evidence.bench.sheet import Sheet
from hapscene_evidence.bench.tick_time import ORDERS


@pytest.fixture(scope="module")
def sheet() -> Sheet:
    """A sheet with a value for every figure of a run."""
    sheet = Sheet()
    machine.describe_machine(sheet)
    sheet.add("method", "path", 10.0, "s")
    sheet.add("method", "hot runs", 5, "1")
    sheet.add("clock", "between two reads median", 20, "ns")
    for count in (1, 100, 1000):
        sheet.add(f"moving {count}", "step with bound bodies", 5.0 + 0.1 * count, "µs")
    sheet.add_spread("shapes 20 k", "deform", [2.0, 3.0], "ms")
    sheet.add("shapes 20 k", "tick p99, changing to at rest", 1.1, "1")
    for count in (1280, 20480, 81920, 327680, 1310720):
        name = f"sphere {short(count)}"
        sheet.add(name, "triangles", count, "1")
        sheet.add_spread(name, "contact", [0.2, 0.3, 0.4 + count / 5e6], "µs")
        sheet.add(name, "build", 12.0, "ms")
        for figure in ("proxy to facets", "proxy to closest point", "proxy to round surface"):
            sheet.add_spread(name, figure, [0.0, 1e-9], "m")
        sheet.add_spread(name, "force direction error", [100.0 / count, 200.0 / count], "°")
    for order in ORDERS:
        name = f"tick, order {order}"
        sheet.add_spread(name, "tick", [0.02 * order, 0.03 * order], "µs")
        sheet.add_spread(name, "contact", [0.2, 0.3], "µs")
        sheet.add(name, "run for 10 s of path", 0.02, "s")
        sheet.add(name, "step over the tick median", 2.0, "µs")
    _add_rest(sheet)
    return sheet


def _add_rest(sheet: Sheet) -> None:
    for figure in ("four idle effects median", "tick without effects median"):
        sheet.add("harness", figure, 0.0625, "µs")
    for part in EFFECTS:
        sheet.add("profile", part, 25.0, "ns")
    sheet.add("start", "import hapscene", 0.004, "s")
    sheet.add("start", "sphere 82 k, load to first tick", 3.5, "s")
    sheet.add("start", "sphere 1.31 M, load to first tick", 2.5, "s")
    sheet.add("start", "sphere 1.31 M, STL, load to first tick", 2.5, "s")
    sheet.add("sphere 1.31 M", "memory a triangle", 190.0, "B")
    sheet.add("synthesis, order 40", "nine models for 10 s", 0.02, "s")
    sheet.add("synthesis, order 40", "nine models, alive over lfilter", 2.2, "times")
    sheet.add("fit, 10 s", "time", 1.5, "s")
    sheet.add("fit, 600 s", "time", 20.0, "s")
    sheet.add("fit, 600 s", "memory", 3.0, "times")
    sheet.add("twin, Omni, handle", "tick", 9.0, "µs")
    for k, name in enumerate(COMPENSATORS):
        sheet.add(f"handle, {name}", "sample least", 0.1 + 0.05 * k, "µs")
        for signal in SIGNALS:
            for what in ("nominal", "median", "p95", "firm"):
                sheet.add(f"handle, {name}", f"{signal} {what}", 90.0 / (k + 1), "%")


@pytest.fixture(scope="module")
def made(sheet: Sheet, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Files that are written for the sheet, bench.md last."""
    return write_results(sheet, tmp_path_factory.mktemp("bench"))


@pytest.fixture(scope="module")
def anew(made: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the files that are written again from its table."""
    folder = tmp_path_factory.mktemp("anew")
    bench(folder, table=made[0])
    return folder


def test_every_chart_is_written_and_shown_on_the_page(made: list[Path]) -> None:
    charts = {file.name for file in made if file.suffix == ".png"}
    names = ("speed", "accuracy")
    assert charts == {f"{name}{ground}.png" for name in names for ground in ("", "-dark")}
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in made if file.suffix == ".png")
    page = made[-1].read_text(encoding="utf-8")
    assert set(re.findall(r'(?:src|srcset)="([^"]+)"', page)) == charts
    assert "nan" not in page


def test_targets_are_judged(made: list[Path]) -> None:
    page = made[-1].read_text(encoding="utf-8")
    assert "| import, load 82 k triangles, first tick | ≤ 3 s | 3.5 s | **no** |" in page
    assert "| calling five effects that do nothing | ≤ 0.3 µs | 0.0625 µs | yes |" in page
    assert "| `step()` with 1,000 moving bodies | ≤ 120 µs | 105 µs | yes |" in page
    assert page.count("| yes |") + page.count("| **no** |") == len(AIMS)


def test_result_page_is_written_from_the_table(made: list[Path], anew: Path, tmp_path: Path) -> None:
    docs = tmp_path / "docs"
    docs.mkdir()
    page = publish(made, docs)
    first = page.read_text(encoding="utf-8")
    shown = re.findall(r'(?:src|srcset)="([^"]+)"', first)
    assert "bench/speed.png" in shown
    assert all((docs / path).is_file() for path in shown)
    page.write_text("by hand")
    assert (docs / "bench" / "bench.csv").read_bytes() == made[0].read_bytes()
    assert all(file.read_bytes() == (anew / file.name).read_bytes() for file in made)
    publish([anew / file.name for file in made], docs)
    assert page.read_text(encoding="utf-8") == first


def test_missing_folder_is_reported_before_measuring(tmp_path: Path) -> None:
    with pytest.raises(HapsceneError, match="nowhere"):
        bench(tmp_path / "out", quick=True, docs=tmp_path / "nowhere")
    assert not (tmp_path / "out").exists()


def test_machine_is_described_without_its_name() -> None:
    import socket

    sheet = Sheet()
    machine.describe_machine(sheet)
    assert ("machine", "processor") in sheet
    assert all(socket.gethostname() not in str(figure.value) for figure in sheet)
