"""The chart: each setting is measured once, stored in the table, drawn and shown on the page."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from hapscene.errors import HapsceneError
from hapscene_evidence.chart import run
from hapscene_evidence.chart.question import Measure, Point, Question, Setting
from hapscene_evidence.chart.table import LOAD, Table

CALLED: Counter[str] = Counter()


def error(x: float) -> dict[str, float]:
    CALLED[f"error {x:g}"] += 1
    return {"off": x}


def time(x: float) -> tuple[float, float]:
    CALLED[f"time {x:g}"] += 1
    return 8.0 / x, 16.0 / x


QUICK = Question(
    name="powers",
    title="How large is <x>?",
    measures=(Measure("off", "error", "°", 2.0, "Source 1900"),),
    settings=lambda scene: [Setting("Power", "a & b", f"{x:g}", {"x": x}, default=x == 1) for x in (1, 2, 4)],
    error=error,
    time=time,
    conditions="One subject.",
)
POINT = Point("Power", "a", "1", "", True, 1.0, 2.0, 0.0, {"off": 0.1})


@pytest.fixture(autouse=True)
def asked(monkeypatch: pytest.MonkeyPatch) -> None:
    CALLED.clear()
    monkeypatch.setattr(run, "QUESTIONS", {"powers": "powers"})
    monkeypatch.setattr(run, "question", lambda name: QUICK)
    monkeypatch.setattr("os.getloadavg", lambda: (0.5, 0.5, 0.5))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the pictures, which take seconds."""

    def draw(*arguments: object) -> list[Path]:
        path = arguments[-1]
        assert isinstance(path, Path)
        made = [path, path.with_stem(f"{path.stem}-dark")]
        for file in made:
            file.write_bytes(b"a picture")
        return made

    monkeypatch.setattr(run, "draw_rows", draw)
    monkeypatch.setattr(run, "draw_settings", draw)


def test_settings_are_measured_stored_and_read_again(tmp_path: Path) -> None:
    found = run.chart(tmp_path, say=lambda text: None)
    assert [(p.label, p.median_us, p.errors) for p in found.points["powers"]] == [
        ("1", 8.0, {"off": 1.0}),
        ("2", 4.0, {"off": 2.0}),
        ("4", 2.0, {"off": 4.0}),
    ]
    pictures = {"chart.png", "chart-dark.png", "settings.png", "settings-dark.png"}
    assert {file.name for file in tmp_path.iterdir()} == {"chart.csv", "chart.html", *pictures}
    CALLED.clear()
    assert run.chart(tmp_path / "again", table=tmp_path / "chart.csv", say=lambda text: None) == found and not CALLED
    assert {"processor", "numpy", "date", LOAD} <= found.machine.keys()


@pytest.mark.usefixtures("undrawn")
def test_page_is_escaped_and_self_contained(tmp_path: Path) -> None:
    run.chart(tmp_path, say=lambda text: None)
    page = (tmp_path / "chart.html").read_text(encoding="utf-8")
    assert "How large is &lt;x&gt;?" in page and "<x>" not in page and "a &amp; b, 2" in page
    assert not re.search(r'(?:src|href)="(?!#|data:)', page) and "url(" not in page and "<script" not in page


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("load", "advises"), [("0.6", True), ("1.4", False)])
def test_result_page_gives_no_advice_under_load(tmp_path: Path, load: str, advises: bool) -> None:
    docs = tmp_path / "docs"
    docs.mkdir()
    table = tmp_path / "chart.csv"
    machine = {"processor": "AMD EPYC", LOAD: load}
    points = [POINT, replace(POINT, label="2", default=False, median_us=0.5)]
    Table(machine, {"powers": points}).write(table, [QUICK])
    run.chart(tmp_path / "out", table=table, docs=docs, say=lambda text: None)
    assert (docs / "chart" / "chart.csv").read_bytes() == table.read_bytes()
    text = (docs / "chart.md").read_text(encoding="utf-8")
    assert text.count("<picture>") == text.count("\n| --- |") == text.count('src="chart/chart.png"') == advises
    assert ("0.5 of 1 µs" in text) == advises
    assert (f"load {load} per core" in text and run.COMMAND in text.split("**")[1]) != advises


@pytest.mark.parametrize("text", ["", "question,method\n", "a,b\n1,2\n"])
def test_invalid_table_is_rejected(tmp_path: Path, text: str) -> None:
    path = tmp_path / "chart.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(HapsceneError, match=r"chart\.csv"):
        Table.read(path)


@pytest.mark.parametrize("change", [{"default": False}, {"errors": {"on": 0.1}}])
def test_table_without_default_or_error_is_rejected(tmp_path: Path, change: dict[str, object]) -> None:
    table = tmp_path / "chart.csv"
    Table({}, {"powers": [replace(POINT, **change)]}).write(table, [QUICK])
    with pytest.raises(HapsceneError, match="powers"):
        run.chart(tmp_path / "out", table=table, say=lambda text: None)
