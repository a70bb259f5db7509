"""The command line, as a user meets it."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene import __version__
from hapscene.cli import main

PATH = "t,x,y,z\n" + "".join(f"{k / 1000},0,0,{0.012 - 0.00001 * k:.6f}\n" for k in range(300))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a mesh and a path, and nowhere to draw a picture."""
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "cube.ply")
    trimesh.creation.box((20, 20, 20)).export(tmp_path / "cube.stl")
    (tmp_path / "path.csv").write_text(PATH)
    monkeypatch.chdir(tmp_path)
    return tmp_path


TOUCH = ["touch", "cube.ply", "--unit", "m", "--out", "out", "--no-picture"]


def test_touch_along_a_path(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TOUCH, "--path", "path.csv", "--seed", "5", "--effects", "wall", "--rate", "5000"]) == 0
    said = capsys.readouterr().out
    assert "rendering 0.3 s of path … " in said and said.splitlines()[-1].strip().startswith("out")
    summary = json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["effects"] == ["wall"] and summary["seed"] == 5 and summary["a_rate_Hz"] == 5000
    assert summary["ticks"] == 300 and summary["ticks_in_contact"] > 50


def test_touch_without_a_path(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(TOUCH) == 0
    assert "a hand feels it from above" in capsys.readouterr().out
    assert json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8"))["ticks_in_contact"] > 500


def spoiled(rows: str) -> Callable[[Path], object]:
    return lambda folder: (folder / "path.csv").write_text(rows)


BAD_INPUT: dict[str, tuple[Callable[[Path], object], list[str], str]] = {
    "no mesh": (lambda folder: None, ["touch", "none.ply"], "none.ply"),
    "empty mesh": (lambda folder: (folder / "cube.ply").write_bytes(b""), ["touch", "cube.ply"], "cube.ply"),
    "cut mesh": (
        lambda folder: (folder / "cube.ply").write_bytes((folder / "cube.ply").read_bytes()[:300]),
        ["touch", "cube.ply"],
        "cube.ply",
    ),
    "no mesh at all": (lambda folder: None, ["touch", "path.csv"], "path.csv"),
    "no unit": (lambda folder: None, ["touch", "cube.stl"], "--unit"),
    "unknown unit": (lambda folder: None, ["touch", "cube.stl", "--unit", "furlong"], "furlong"),
    "no scene": (lambda folder: None, ["touch", "none.scene.json"], "none.scene.json"),
    "broken scene": (
        lambda folder: (folder / "a.scene.json").write_text("{"),
        ["touch", "a.scene.json"],
        "a.scene.json",
    ),
    "no path": (lambda folder: None, [*TOUCH[:4], "--path", "none.csv"], "none.csv: no such file"),
    "path of one row": (spoiled("t,x,y,z\n0,0,0,0\n"), [*TOUCH[:4], "--path", "path.csv"], "at least 2"),
    "path with NaN": (spoiled(PATH + "0.3,0,nan,0\n"), [*TOUCH[:4], "--path", "path.csv"], "line 302"),
    "path backwards": (
        spoiled(PATH + "0.1,0,0,0\n"),
        [*TOUCH[:4], "--path", "path.csv"],
        "time that increases",
    ),
    "path lacks z": (spoiled("t,x,y\n0,0,0\n1,0,0\n"), [*TOUCH[:4], "--path", "path.csv"], "column 'z'"),
    "no swatch": (lambda folder: None, [*TOUCH[:4], "--swatch", "oka"], "no swatch 'oka'; there are"),
    "no effect": (
        lambda folder: None,
        [*TOUCH[:4], "--effects", "wall,fricton"],
        "no effect 'fricton'; there are",
    ),
    "odd rate": (lambda folder: None, [*TOUCH[:4], "--rate", "12345"], "a_rate_Hz=12345"),
    "out is a file": (lambda folder: (folder / "out").write_text("a file"), TOUCH[:4], "out: is a file"),
    "mend elsewhere": (
        lambda folder: None,
        ["check", "cube.ply", "--unit", "m", "--fix", "no/x.ply"],
        "x.ply",
    ),
    "check nothing": (lambda folder: None, ["check", "none.stl"], "none.stl"),
}


@pytest.mark.parametrize("name", BAD_INPUT)
def test_bad_input_is_one_line_and_leaves_nothing(folder: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    spoil, arguments, message = BAD_INPUT[name]
    spoil(folder)
    before = {file: file.stat().st_mtime_ns for file in folder.iterdir()}
    if arguments[0] == "touch":
        arguments = [*arguments, "--out", "out"]
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert told.startswith("hapscene: ") and told.count("\n") == 1
    assert message in told and "Traceback" not in told
    assert {file: file.stat().st_mtime_ns for file in folder.iterdir()} == before


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["tuoch"],
        ["touch", "cube.ply"],
        [*TOUCH, "--seed", "-1"],
        [*TOUCH, "--seed", "x"],
        [*TOUCH, "--rate", "0"],
    ],
)
def test_wrong_words_exit_with_2_and_the_usage(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert capsys.readouterr().err.startswith("usage: hapscene")


def test_debug_shows_the_traceback(folder: Path) -> None:
    from hapscene.errors import PathError

    for arguments in (["--debug", *TOUCH, "--path", "none.csv"], [*TOUCH, "--path", "none.csv", "--debug"]):
        with pytest.raises(PathError):
            main(arguments)


def test_interrupt_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hapscene.view.plot.write_plot", interrupt)
    assert main(TOUCH) == 130
    assert capsys.readouterr().err == "hapscene: interrupted; nothing was written\n"
    assert not (folder / "out").exists()


def test_process_ends_with_the_code_and_no_traceback(folder: Path) -> None:
    command = [sys.executable, "-m", "hapscene.cli", "touch", "none.ply", "--out", "out"]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == 2 and done.stderr.startswith("hapscene: none.ply")
    assert done.stderr.count("\n") == 1


def test_help_and_version_load_nothing_heavy() -> None:
    code = (
        "import sys\nfrom hapscene.cli import main\n"
        "try:\n    main(['touch', '--help'])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "assert not {'numpy', 'numba', 'scipy', 'trimesh', 'matplotlib'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "for example:\n  hapscene touch" in done.stdout


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0 and capsys.readouterr().out == f"hapscene {__version__}\n"


def test_plugins_are_listed_with_units(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins"]) == 0
    said = capsys.readouterr().out
    assert "wall  (hapscene" in said and "damping_Ns_m" in said and "N·s/m" in said
    assert "  parameter                default  unit     meaning\n" in said
    assert "A swatch gives the parameters where it names them, and always the stiffness_N_m" in said
    assert main(["plugins", "--json"]) == 0
    listed = {item["name"]: item for item in json.loads(capsys.readouterr().out)}
    assert {"friction", "lpc_texture", "tap", "wall"} <= set(listed)
    assert all(
        {"name", "unit", "default", "minimum", "maximum", "meaning"} == set(p) for p in listed["wall"]["parameters"]
    )


def test_check_examines_and_mends(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "cube.stl", "--unit", "mm", "--fix", "mended.ply"]) == 0
    said = capsys.readouterr().out
    assert "20 mm × 20 mm × 20 mm" in said and "mended: " in said and "mended.ply" in said
    assert main(["check", "mended.ply", "--unit", "m", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["closed"] is True and report["vertex_count"] == 8
    np.testing.assert_allclose(report["size_m"], 0.02)


def test_demo_feels_three_bodies_and_four_swatches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from hapscene.errors import ViewError
    from hapscene.recording import Recording

    def write_picture(*arguments: object) -> None:
        raise ViewError("not drawn in this test")

    monkeypatch.setattr("hapscene.view.picture.write_picture", write_picture)
    assert main(["demo", "--out", str(tmp_path / "demo")]) == 0
    said = capsys.readouterr().out
    assert "without scene.png: not drawn in this test" in said and "made:" in said
    recording = Recording.load(tmp_path / "demo" / "touch.npz")
    held = recording.touching
    assert len(np.unique(recording.body[held])) >= 3
    assert len({recording.swatch_names[i] for i in recording.swatch[held]} - {"plain"}) >= 4
    crossed = held[1:] & held[:-1] & (np.diff(recording.swatch) != 0) & (np.diff(recording.body) == 0)
    assert np.count_nonzero(crossed) >= 2
    assert not recording.flags.any()
    assert recording.depth_m.max() < 0.01
    assert 1.0 < np.abs(recording.a_m_s2).max() < 100.0


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("bunny.ply", "m"),
        ("featuretype.STL", "in"),
        ("fuze.zip", "m"),
        ("Duck.glb", None),
        ("base_interface_AP214.STEP", None),
    ],
)
def test_real_meshes_are_touched(
    tmp_path: Path, shared: Path, monkeypatch: pytest.MonkeyPatch, name: str, unit: str | None
) -> None:
    if name.endswith("STEP"):
        pytest.importorskip("cascadio", reason="cascadio, which reads STEP, is not installed")
    monkeypatch.setattr("hapscene.view.plot.write_plot", lambda *arguments: None)  # slow, and tested elsewhere
    mesh = shared / "data" / "meshes" / name
    words = ["touch", str(mesh), "--swatch", "wood", "--out", str(tmp_path / "out"), "--no-picture"]
    assert main([*words, *(["--unit", unit] if unit else [])]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["ticks_in_contact"] > 300 and summary["ticks_on_swatches"]["wood"] > 300
    assert not any(summary["flags"].values())
    assert summary["depth_max_m"] < 0.01 and summary["acceleration_max_m_s2"] > 0.1
