"""`hapscene lab chart`."""

from pathlib import Path

import pytest

import hapscene
from hapscene.cli import main
from hapscene_evidence.chart.question import Point
from hapscene_evidence.chart.table import Table


def test_unknown_question(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "chart", "--only", "mesh,grove"]) == 2
    output = capsys.readouterr().err
    assert "no question 'grove'; there are: " in output
    assert "groove" in output
    assert "stabiliser" in output


def test_invalid_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, expected in (
        (["--jobs", "2", "--scheduler", "tcp://a:1"], "--scheduler"),
        (["none.scene.json"], "none.scene.json: no such file"),
        (["--from", "none.csv"], "none.csv: no such file"),
        (["--docs", str(tmp_path / "none")], "no such folder"),
    ):
        assert main(["lab", "chart", *words]) == 2
        assert expected in capsys.readouterr().err


def test_a_scene_without_large_bodies_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "tetrahedron.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    hapscene.save_scene(scene_of(tmp_path / "tetrahedron.obj"), tmp_path / "small.scene.json")
    words = ["lab", "chart", str(tmp_path / "small.scene.json"), "--quick", "--out", str(tmp_path / "out"), "--only"]
    for names in ("mesh",):
        assert main([*words, names]) == 2
        assert "no body of the scene has 1,000 faces or more" in capsys.readouterr().err
    assert not (tmp_path / "out" / "chart.html").exists()


def test_an_incomplete_table_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "chart.csv"
    for points, expected in (
        ({}, "has no points of"),
        ({"groove": [Point("projection, 60°", "1", 0.01, 0.02, {"off": 2})]}, "lacks points or measures"),
    ):
        Table({"processor": "one"}, points).write(table, [])
        assert main(["lab", "chart", "--from", str(table), "--out", str(tmp_path / "out")]) == 2
        assert expected in capsys.readouterr().err


def scene_of(mesh: Path) -> hapscene.Scene:
    scene = hapscene.Scene()
    scene.add(mesh, name="tetrahedron", unit="m", swatch="wood")
    return scene


def test_a_table_is_drawn_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, out = tmp_path / "chart.csv", tmp_path / "out"
    points = [
        Point("active set", "60°", 0.03, 0.05, {"off": 1e-12}),
        Point("projection, 60°", "1", 0.01, 0.02, {"off": 2}),
    ]
    Table({"processor": "one"}, {"groove": points}).write(table, [])
    assert main(["lab", "chart", "--from", str(table), "--out", str(out)]) == 0
    assert "chart.html" in capsys.readouterr().out
    assert {file.name for file in out.iterdir()} == {"chart.csv", "chart.html", "groove.png", "groove-dark.png"}
