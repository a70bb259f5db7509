"""`hapscene lab chart`."""

from pathlib import Path

import pytest

import hapscene
from hapscene.cli import main
from hapscene_evidence.chart.question import Point
from hapscene_evidence.chart.table import Table


def test_unknown_question_is_reported_with_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "chart", "--only", "mesh,prox"]) == 2
    error = capsys.readouterr().err
    assert "'prox'" in error and "proxy" in error and "stabiliser" in error


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["none.scene.json"], "none.scene.json"),
        (["--from", "none.csv"], "none.csv"),
        (["--docs", "missing"], "missing"),
    ],
)
def test_invalid_arguments_are_rejected(words: list[str], name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "chart", *words]) == 2
    assert name in capsys.readouterr().err


def test_scene_without_large_bodies_is_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "tetrahedron.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    scene = hapscene.Scene()
    scene.add(tmp_path / "tetrahedron.obj", name="tetrahedron", unit="m", swatch="wood")
    hapscene.save_scene(scene, tmp_path / "small.scene.json")
    words = ["lab", "chart", str(tmp_path / "small.scene.json"), "--out", str(tmp_path / "out")]
    assert main([*words, "--only", "mesh"]) == 2
    assert "1,000 faces" in capsys.readouterr().err
    assert not (tmp_path / "out" / "chart.html").exists()


def test_table_is_drawn_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, out = tmp_path / "chart.csv", tmp_path / "out"
    points = [Point("Proxy", "active set", "", "60°", True, 0.03, 0.05, 0.0, {"off": 1e-12})]
    Table({"processor": "one"}, {"proxy": points}).write(table, [])
    assert main(["lab", "chart", "--from", str(table), "--out", str(out)]) == 0
    assert "chart.html" in capsys.readouterr().out
    pictures = {"chart.png", "chart-dark.png", "settings.png", "settings-dark.png"}
    assert {file.name for file in out.iterdir()} == {"chart.csv", "chart.html", *pictures}
