"""The chart: each point is measured once, stored in the table, drawn and shown on the page."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from hapscene.errors import HapsceneError
from hapscene_evidence.chart import run
from hapscene_evidence.chart.question import Measure, Point, Question, Setting, front, fronts
from hapscene_evidence.chart.table import Table

CALLED: Counter[str] = Counter()


def error(x: float) -> dict[str, float]:
    CALLED[f"error {x:g}"] += 1
    return {"off": 1.0 / x}


def time(x: float) -> tuple[float, float]:
    CALLED[f"time {x:g}"] += 1
    if CALLED["stop"]:
        raise KeyboardInterrupt
    return x, 2.0 * x


QUICK = Question(
    name="powers",
    title="How large is <x>?",
    measures=(Measure("off", "error", "°", 0.3, "Source 1900"),),
    settings=lambda quick, scene: [Setting("a & b", f"{x:g}", {"x": x}) for x in ((1.0, 4.0) if quick else (1, 2, 4))],
    error=error,
    time=time,
    advice=lambda points: f"Take one of {len(points)}.",
    conditions="None.",
)


@pytest.fixture(autouse=True)
def asked(monkeypatch: pytest.MonkeyPatch) -> None:
    CALLED.clear()
    monkeypatch.setattr(run, "QUESTIONS", {"powers": "powers"})
    monkeypatch.setattr(run, "question", lambda name: QUICK)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the pictures, which take seconds."""

    def write_picture(question: Question, points: object, path: Path) -> list[Path]:
        made = [path, path.with_stem(f"{path.stem}-dark")]
        for file in made:
            file.write_bytes(b"a picture")
        return made

    monkeypatch.setattr(run, "write_picture", write_picture)


def test_points_are_measured_stored_and_read_again(tmp_path: Path) -> None:
    found = run.chart(tmp_path, jobs=1, say=lambda text: None)
    assert [(p.label, p.median_us, p.errors) for p in found.points["powers"]] == [
        ("1", 1.0, {"off": 1.0}),
        ("2", 2.0, {"off": 0.5}),
        ("4", 4.0, {"off": 0.25}),
    ]
    names = {"chart.csv", "chart.html", "powers.png", "powers-dark.png"}
    assert {file.name for file in tmp_path.iterdir()} == names  # the journal is deleted at the end
    again = Table.read(tmp_path / "chart.csv")
    assert again == found
    assert {"processor", "numpy", "date"} <= again.machine.keys()


@pytest.mark.usefixtures("undrawn")
def test_table_is_used_instead_of_measuring(tmp_path: Path) -> None:
    found = run.chart(tmp_path, jobs=1, say=lambda text: None)
    CALLED.clear()
    page = (tmp_path / "chart.html").read_text(encoding="utf-8")
    assert run.chart(tmp_path / "again", table=tmp_path / "chart.csv", say=lambda text: None) == found
    assert not CALLED
    assert (tmp_path / "again" / "chart.html").read_text(encoding="utf-8") == page


@pytest.mark.usefixtures("undrawn")
def test_interrupted_chart_is_resumed(tmp_path: Path) -> None:
    CALLED["stop"] = 1
    with pytest.raises(KeyboardInterrupt):
        run.chart(tmp_path, jobs=1, say=lambda text: None)
    CALLED["stop"] = 0
    said: list[str] = []
    run.chart(tmp_path, jobs=1, say=said.append)
    assert [CALLED[f"error {x}"] for x in (1, 2, 4)] == [1, 1, 1]
    assert [CALLED[f"time {x}"] for x in (1, 2, 4)] == [2, 1, 1]
    assert said[0].startswith("4 of 6")


@pytest.mark.usefixtures("undrawn")
def test_page_is_escaped_and_self_contained(tmp_path: Path) -> None:
    run.chart(tmp_path, jobs=1, say=lambda text: None)
    page = (tmp_path / "chart.html").read_text(encoding="utf-8")
    assert "How large is &lt;x&gt;?" in page and "<x>" not in page
    assert "<td>a &amp; b</td><td>1</td><td>1 / 2</td><td>1</td>" in page and "Take one of 3." in page
    assert not re.search(r'(?:src|href)="(?!#|data:)', page) and "url(" not in page and "<script" not in page


def test_front_holds_the_points_that_no_other_beats() -> None:
    at = {"a": (1.0, 5.0), "b": (2.0, 6.0), "c": (3.0, 1.0), "d": (3.5, 1.0), "e": (4.0, 0.5)}
    points = [Point("m", k, t, t, {"off": v}) for k, (t, v) in at.items()]
    assert [p.label for p in front(points, QUICK.measures[0])] == ["a", "c", "e"]
    most = replace(QUICK.measures[0], more_is_better=True)
    assert [p.label for p in front(points, most)] == ["a", "b"]
    by_size = [Point("m", k, 1.0, 1.0, {"off": v, "size": t}) for k, (t, v) in at.items()]
    assert [p.label for p in front(by_size, QUICK.measures[0], "size")] == ["a", "c", "e"]
    apart = replace(QUICK, subject=lambda point: "low" if point.label in "ab" else "high")
    assert [[p.label for p in each] for each in fronts(apart, points, QUICK.measures[0])] == [["a"], ["c", "e"]]


@pytest.mark.usefixtures("undrawn")
def test_result_page_names_the_machine(tmp_path: Path) -> None:
    docs = tmp_path / "docs"
    docs.mkdir()
    table = tmp_path / "chart.csv"
    machine = {"processor": "AMD EPYC (family 25, model 17), 2.6 GHz", "cores": "2"}
    Table(machine, {"powers": [Point("a", "1", 1.0, 2.0, {"off": 0.1})]}).write(table, [QUICK])
    run.chart(tmp_path / "out", table=table, docs=docs, say=lambda text: None)
    assert (docs / "chart" / "amd-epyc-family-25-model-17-2-cores.csv").read_bytes() == table.read_bytes()
    text = (docs / "chart.md").read_text(encoding="utf-8")
    assert 'src="chart/powers.png"' in text
    assert "Take one of 1." in text


@pytest.mark.parametrize("text", ["", "question,method\n", "a,b\n1,2\n"])
def test_invalid_table_is_rejected(tmp_path: Path, text: str) -> None:
    path = tmp_path / "chart.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(HapsceneError, match=r"chart\.csv"):
        Table.read(path)


def test_table_without_measures_is_rejected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "question", lambda name: replace(QUICK, advice=lambda points: f"{points[0].errors['on']}"))
    table = tmp_path / "chart.csv"
    Table({}, {"powers": [Point("a", "1", 1.0, 2.0, {"off": 0.1})]}).write(table, [QUICK])
    with pytest.raises(HapsceneError, match="powers"):
        run.chart(tmp_path / "out", table=table, say=lambda text: None)
