"""`hapscene lab`: warmup, chart, reproduce, stability."""

import csv
from pathlib import Path
from typing import Any

import pytest

from hapscene import warm_up
from hapscene.cli import main
from hapscene.compiled import cache
from hapscene.compiled.native import INTERPRETED
from hapscene.device.sim.hand import grip_named
from hapscene.stability import z_width
from hapscene.stability.study import stability
from hapscene.surface.effect import EFFECTS
from hapscene.surface.swatch import Swatch
from hapscene_evidence.chart.question import Point
from hapscene_evidence.chart.table import Table
from hapscene_evidence.paper import reproduction
from hapscene_evidence.paper.prediction_figure import two_materials
from hapscene_evidence.paper.reproduction import END, FILES, START


@pytest.mark.parametrize("has_cache", [True, False])
def test_warmup_compiles_into_the_cache(
    has_cache: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[bool] = []
    monkeypatch.setattr(warm_up, "warm_up", lambda: asked.append(True))
    if not has_cache:
        monkeypatch.setattr(cache, "cache_folder", lambda: None)
    works = has_cache and not INTERPRETED
    assert main(["lab", "warmup"]) == (0 if works else 2) and asked == [True] * works
    assert not works or str(cache.cache_folder()) in capsys.readouterr().out.splitlines()[-1]


def test_effects_are_listed_with_their_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "effects"]) == 0
    output = capsys.readouterr().out
    for name, item in EFFECTS.listed().items():
        assert item.plugin is not None and f"{name}  (" in output and item.plugin.summary in output
        assert all(param.meaning in output for param in item.plugin.params)
        assert (f"settings={{'{name}': " in output) == (item.plugin.scope == "scene")


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["chart", "--only", "mesh,prox"], "'prox'"),
        (["chart", "none.scene.json"], "none.scene.json"),
        (["chart", "--from", "none.csv"], "none.csv"),
        (["chart", "--docs", "missing"], "missing"),
        (["reproduce", "--recordings", "missing"], "missing: no such folder"),
        (["reproduce", "--recordings", "empty"], "empty: no recording found; expected one or more of cdp_wood.csv"),
        (["reproduce", "--out", "file"], "file: is a file; expected a folder"),
        (["stability", "--device", "onmi"], "no device 'onmi'; there are: ideal, omni"),
        (["stability", "--device", "ideal"], "has no mass"),
        (["stability", "--grip", "soft"], "no grip 'soft'"),
    ],
)
def test_invalid_options_write_nothing(
    words: list[str], error: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    assert main(["lab", *words]) == 2
    assert error in capsys.readouterr().err and len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("command", ["bench", "chart", "reproduce"])
def test_installed_package_reports_that_a_checkout_is_needed(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hapscene.cli.lab.find_spec", lambda name: None)
    assert main(["lab", command, "--out", str(tmp_path / "out")]) == 2
    assert "clone" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_chart_is_drawn_again_from_its_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, out = tmp_path / "chart.csv", tmp_path / "out"
    points = [Point("Proxy", "active set", "", "60°", True, 0.03, 0.05, 0.0, {"off": 1e-12})]
    Table({"processor": "one"}, {"proxy": points}).write(table, [])
    assert main(["lab", "chart", "--from", str(table), "--out", str(out)]) == 0
    assert "chart.html" in capsys.readouterr().out
    pictures = {"chart.png", "chart-dark.png", "settings.png", "settings-dark.png"}
    assert {file.name for file in out.iterdir()} == {"chart.csv", "chart.html", *pictures}


def test_reproduce_writes_a_page_its_numbers_and_a_summary_in_the_docs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reproduction, "FIGURES", {"fig2": ("two materials", two_materials)})
    words = ["lab", "reproduce", "--out", str(tmp_path / "out"), "--docs", str(tmp_path)]
    assert main(words) == 2  # no paper.md
    summary = tmp_path / "paper.md"
    summary.write_text(f"before\n{START}old\n{END}after\n", encoding="utf-8")
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "1 of 1: two materials" in said and all(name in said for name in FILES)
    html = (tmp_path / "out" / FILES[0]).read_text(encoding="utf-8")
    assert html.count("<svg") == 2 and "wood, synthesised" in html and 'id="fig2"' in html
    with (tmp_path / "out" / FILES[1]).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 and rows[0]["unit"] == "N" and 1.0 < float(rows[0]["here"]) < 1.4
    text = summary.read_text(encoding="utf-8")
    assert text.startswith(f"before\n{START}# The haptography paper") and text.endswith(f"{END}after\n")
    assert "old\n" not in text


@pytest.mark.nightly
def test_an_interrupted_stability_study_resumes_and_writes_its_chart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    swatches = [Swatch("steel", 20_000.0), Swatch("felt", 200.0)]
    args = (tmp_path / "out", "premium-1.5", (1000.0,), (0, 1), grip_named("light"), swatches)
    traced = list[tuple[float, int]]()
    trace = z_width.trace

    def some(*args: Any) -> z_width.StableRegion:
        traced.append(args[3:5])
        if len(traced) == 2:
            raise KeyboardInterrupt
        return trace(*args)

    monkeypatch.setattr(z_width, "trace", some)
    with pytest.raises(KeyboardInterrupt):
        stability(*args, dampings_Ns_m=(0.0, 2.0), jobs=1)
    assert not (tmp_path / "out").exists()
    said = list[str]()
    made = stability(*args, said.append, dampings_Ns_m=(0.0, 2.0), jobs=1)
    assert traced == [(1000.0, 0), (1000.0, 1), (1000.0, 1)]
    assert [file.name for file in tmp_path.iterdir()] == ["out"]  # the journal is deleted
    charts = {"z_width.png", "z_width-dark.png"}
    assert {file.name for file in made} == {*charts, "z_width.csv", "swatches.csv"}
    with (tmp_path / "out" / "z_width.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["delay_ticks"] == "0"]
    assert [float(row["damping_Ns_m"]) for row in rows] == [0.0, 2.0]
    assert float(rows[1]["limit_N_m"]) > float(rows[0]["limit_N_m"]) > z_width.STIFFNESS_N_M[0]
    assert any(line.startswith("steel: 20000 N/m is unstable at 1 kHz; the device limits it to") for line in said)
    assert any("felt" in line for line in said)
