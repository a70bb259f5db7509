"""The command line interface."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene import __version__, load_touch
from hapscene.cli import COMMANDS, main
from tests.cli.command_lines import all_commands

PATH = "t,x,y,z\n" + "".join(f"{k / 1000},0,0,{0.012 - 0.00001 * k:.6f}\n" for k in range(300))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a mesh and a path."""
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "cube.ply")
    trimesh.creation.box((20, 20, 20)).export(tmp_path / "cube.stl")
    (tmp_path / "path.csv").write_text(PATH)
    monkeypatch.chdir(tmp_path)
    return tmp_path


TOUCH = ["touch", "cube.ply", "--unit", "m", "--out", "out", "--no-picture"]


def test_touch_along_a_path(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TOUCH, "--path", "path.csv", "--seed", "5", "--effects", "wall", "--rate", "5000"]) == 0
    output = capsys.readouterr().out
    assert "rendering 0.3 s of path … " in output and output.splitlines()[-1].strip().startswith("out")
    summary = json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["effects"] == ["wall"] and summary["seed"] == 5 and summary["a_rate_Hz"] == 5000
    assert summary["ticks"] == 300 and summary["ticks_in_contact"] > 50


def test_touch_sets_effects_of_the_scene(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--set", "weight.mass_kg=0.2", "--set", "guide.points_m=[[0, 0, 1]]", "--set", "guide.bodies=cube"]
    assert main([*TOUCH, "--path", "path.csv", "--effects", "wall,weight,guide", *settings]) == 0
    f_W_N = load_touch(folder / "out" / "touch.npz").f_W_N
    np.testing.assert_allclose(f_W_N[199, 2], -0.2 * 9.81, rtol=0.03)  # a millisecond before it touches
    assert main([*TOUCH, "--effects", "weight", "--set", "weight.bodies=lid"]) == 2
    assert "no body 'lid'; there are: cube" in capsys.readouterr().err


def test_touch_without_a_path(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(TOUCH) == 0
    assert "exploring the scene from above" in capsys.readouterr().out
    assert json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8"))["ticks_in_contact"] > 500


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["tuch", "cube.ply"], 'Did you mean "touch"? See `hapscene --help`'),
        (["swatch", "lst"], 'Did you mean "list"? See `hapscene swatch --help`'),
        (["touch", "cube.ply", "--untt=mm"], "Did you mean --unit? See `hapscene touch --help`"),
        (["touch"], "SCENE"),
        ([*TOUCH, "--set", "weight=1"], "weight=1"),
        ([*TOUCH, "--seed", "-1"], "--seed"),
        (["play", "demo", "--option", "colour"], "--option"),
        (["lab", "stability", "--rate", "1000,,2000"], "--rate"),
        (["lab", "stability", "--delay", "0,0.5"], "--delay"),
    ],
)
def test_usage_errors_suggest_the_nearest(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("hapscene: ") and error.count("\n") == 1 and expected in error


@pytest.mark.parametrize(
    ("words", "near"),
    [
        (["play", "demo", "--device", "omi"], "omni"),
        (["play", "demo", "--handle", "audi"], "audio"),
        (["touch", "demo", "--hand", "strok"], "stroke"),
        (["touch", "demo", "--effects", "wal"], "wall"),
        (["touch", "demo", "--swatch", "woood"], "wood"),
        (["touch", "dmo"], "demo"),
    ],
)
def test_an_unknown_name_suggests_the_nearest(words: list[str], near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert f"did you mean {near!r}?" in capsys.readouterr().err


def test_list_of_commands(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main([]) == 0
    output = capsys.readouterr().out
    names = [name for group in COMMANDS.values() for name in group]
    assert re.findall(r"^  (\w+)  +\S", output, re.MULTILINE) == names and len(names) <= 13
    assert all(f"{title}:\n" in output for title in COMMANDS)
    assert main(["--help"]) == 0 and capsys.readouterr().out == output


def test_every_command_has_help_with_examples_in_80_columns(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    commands = list(all_commands())
    assert len(commands) > 30
    for words in commands:
        assert main([*words, "--help"]) == 0
        output = capsys.readouterr().out
        assert f"examples:\n  hapscene {' '.join(words)}" in output, words
        assert all(len(line) <= 80 for line in output.splitlines()), words


@pytest.mark.parametrize(
    "arguments",
    [
        ["touch", "none.xyz"],
        ["touch", "none.scene.json"],
        ["view", "cube.ply", "--unit", "m", "--touch", "none.npz"],
        ["lab", "bench", "--from", "none.csv"],
        ["capture", "report", "wood", "none.csv"],
        ["swatch", "add", "none.swatch"],
        ["lab", "stability", "--scene", "none.scene.json"],
    ],
)
def test_missing_files_have_the_same_message(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert main(arguments) == 2
    missing = next(word for word in arguments if word.startswith("none"))
    assert capsys.readouterr() == ("", f"hapscene: {missing}: no such file\n")


def test_default_output_files_are_not_replaced(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "cube.png").write_text("theirs")
    (folder / "wood.html").write_text("theirs")
    (folder / "cube.scene.json").write_text("theirs")
    for words, name in (
        (["view", "cube.ply", "--unit", "m"], "cube.png"),
        (["capture", "report", "wood"], "wood.html"),
        (["convert", "cube.ply", "--unit", "m"], "cube.scene.json"),
    ):
        assert main(words) == 2
        assert f"{name}: exists already" in capsys.readouterr().err
        assert (folder / name).read_text() == "theirs"


def test_debug_shows_the_traceback(folder: Path) -> None:
    from hapscene.errors import HapsceneError

    for arguments in (["--debug", *TOUCH, "--path", "none.csv"], [*TOUCH, "--path", "none.csv", "--debug"]):
        with pytest.raises(HapsceneError):
            main(arguments)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0 and capsys.readouterr().out == f"hapscene {__version__}\n"


def test_demo_touches_three_bodies_and_four_swatches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from hapscene.errors import ViewError
    from hapscene.render.recording import Recording

    def write_picture(*arguments: object, **more: object) -> None:
        raise ViewError("not drawn in this test")

    monkeypatch.setattr("hapscene.view.picture.write_picture", write_picture)
    assert main(["demo", "--out", str(tmp_path / "demo")]) == 0
    output = capsys.readouterr().out
    assert "without scene.png: not drawn in this test" in output and "made:" in output
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
    "words",
    [
        ["--swatch", "oka"],
        ["--effects", "wal"],
        ["--hand", "strok"],
        ["--hand", "stroke", "--device", "ideal"],
        ["--hand", "stroke", "--compensator", "flot"],
        ["--grip", "firm"],
        ["--out", "path.csv"],
    ],
)
def test_invalid_options_of_touch_are_found_before_the_mesh_is_loaded(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.setattr("hapscene.touch.open_scene", lambda *arguments, **more: pytest.fail("loaded"))
    assert main(["touch", "cube.ply", "--unit", "m", *words]) == 2


EVIL = "e\x1b]0;title\x07\x9b2J\u202e\nhapscene: forged"
"""A name with control characters that would set the title, clear the screen, reverse text and forge a line."""


def _evil_names(folder: Path) -> None:
    for name in (f"{EVIL}.ply", "\udcff.ply"):
        (folder / name).write_bytes((folder / "cube.ply").read_bytes())
    shipped = Path(__file__).parents[2] / "swatches" / "wood.swatch"
    content = json.loads(shipped.read_text(encoding="utf-8"))
    content["provenance"] = content["licence"] = EVIL
    (folder / f"{EVIL}.swatch").write_text(json.dumps(content), encoding="utf-8")


@pytest.mark.skipif(sys.platform == "win32", reason="no file has such a name there")
@pytest.mark.parametrize(
    "words",
    [
        [EVIL],
        ["check", f"--{EVIL}"],
        ["check", EVIL],
        ["check", f"{EVIL}.ply", "--unit", "m", "--fix", f"{EVIL}_mended.ply"],
        ["check", "\udcff.ply", "--unit", "m"],
        ["swatch", "show", f"{EVIL}.swatch"],
        ["swatch", "add", f"{EVIL}.swatch", "--library", f"{EVIL}", "--name", "oak"],
    ],
)
def test_control_characters_are_escaped(folder: Path, capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    _evil_names(folder)
    main(words)
    output = capsys.readouterr()
    assert output.out + output.err
    assert all(line.isprintable() and line != "hapscene: forged" for line in (output.out + output.err).splitlines())
