"""Charts and page are generated from the table of results only."""

import re
from pathlib import Path

import pytest

from hapscene.errors import HapsceneError
from hapscene_evidence.bench import machine
from hapscene_evidence.bench.page import AIMS
from hapscene_evidence.bench.run import bench, publish, write_results
from hapscene_evidence.bench.sheet import Sheet


@pytest.fixture(scope="module")
def sheet() -> Sheet:
    """The sheet of the published page, which has every figure; two are set to be beyond and within their targets."""
    sheet = Sheet.read(Path(__file__).resolve().parents[3] / "docs" / "results" / "bench" / "bench.csv")
    sheet.add("start", "sphere 82 k, load to first tick", 3.5, "s")
    sheet.add("moving 1000", "step with bound bodies", 105.0, "µs")
    return sheet


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
