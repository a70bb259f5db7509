"""The command line, as a user meets it."""

import argparse
import json
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene import __version__, load_touch
from hapscene.cli import _parser, main
from hapscene.command.touch import HAND_DEFAULTS

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


def test_touch_sets_effects_of_the_scene(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--set", "weight.mass_kg=0.2", "--set", "guide.points_m=[[0, 0, 1]]", "--set", "guide.bodies=cube"]
    assert main([*TOUCH, "--path", "path.csv", "--effects", "wall,weight,guide", *settings]) == 0
    f_W_N = load_touch(folder / "out" / "touch.npz").f_W_N
    np.testing.assert_allclose(f_W_N[199, 2], -0.2 * 9.81, rtol=0.03)  # a millisecond before it touches
    assert main([*TOUCH, "--effects", "weight", "--set", "weight.bodies=lid"]) == 2
    assert "lid" in capsys.readouterr().err


def test_touch_without_a_path(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(TOUCH) == 0
    assert "a hand feels it from above" in capsys.readouterr().out
    assert json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8"))["ticks_in_contact"] > 500


@pytest.mark.parametrize(
    "arguments",
    [
        ["touch", "path.csv"],
        [*TOUCH, "--path", "none.csv"],
        [*TOUCH, "--effects", "wall,fricton"],
        [*TOUCH, "--rate", "12345"],
        [*TOUCH[:4], "--out", "path.csv"],
        ["check", "cube.ply", "--unit", "m", "--fix", "no/x.ply"],
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    before = {file: file.stat().st_mtime_ns for file in folder.iterdir()}
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("hapscene: ") and error.count("\n") == 1
    assert {file: file.stat().st_mtime_ns for file in folder.iterdir()} == before


@pytest.mark.parametrize("arguments", [["tuch"], ["touch"], [*TOUCH, "--untt", "mm"], [*TOUCH, "--seed", "-1"]])
def test_wrong_words_exit_with_2_and_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("hapscene: ") and error.count("\n") == 1


def test_alone_it_opens_with_what_one_starts_with(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    said = capsys.readouterr().out
    first, then = said.split("start with:")[1].split("then:")
    assert re.findall(r"^  (\w+)  ", first, re.MULTILINE) == ["demo", "touch", "paint", "capture", "swatch"]
    assert set(_commands()) == set(re.findall(r"^  (\w+)  ", first + then.split("options:")[0], re.MULTILINE))


@pytest.mark.parametrize("group", ["swatch", "capture", "handle", "teleoperate", "swatch import", "swatch export"])
def test_a_group_alone_prints_its_help(group: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(group.split()) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"usage: hapscene {group}") and f"hapscene {group} " in said.splitlines()[-1]


def test_every_command_has_help_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    for words in leaves(_parser(), ()):
        with pytest.raises(SystemExit, match="0"):
            main([*words, "--help"])
        assert f"for example:\n  hapscene {' '.join(words)}" in capsys.readouterr().out


def _commands() -> dict[str, argparse.ArgumentParser]:
    return dict(subparsers(_parser()))


def subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(groups[0].choices) if groups else {}


def leaves(parser: argparse.ArgumentParser, words: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """The words of each command that does something."""
    below = subparsers(parser)
    if not below:
        yield words
    for word, command in below.items():
        yield from leaves(command, (*words, word))


@pytest.mark.parametrize(
    "words",
    [
        ["touch", "none.xyz"],
        ["touch", "none.scene.json"],
        ["view", "none.xyz"],
        ["view", "cube.ply", "--unit", "m", "--touch", "none.npz"],
        ["paint", "none.xyz"],
        ["check", "none.xyz"],
        ["export", "none.xyz"],
        ["import", "none.xyz"],
        ["bench", "--from", "none.csv"],
        ["capture", "fit", "none.csv"],
        ["capture", "report", "wood", "none.csv"],
        ["capture", "report", "none.swatch"],
        ["swatch", "show", "none.swatch"],
        ["swatch", "add", "none.swatch"],
        ["swatch", "compare", "wood", "none.csv"],
        ["swatch", "export", "hjif", "none.swatch"],
        ["swatch", "gallery", "none.swatch"],
        ["handle", "show", "none.handle"],
        ["handle", "play", "none.npz"],
        ["handle", "play", "path.csv", "--handle", "none.handle"],
        ["handle", "identify", "--from", "none.csv"],
        ["stability", "--scene", "none.scene.json"],
        ["stability", "--cases", "none.json"],
    ],
)
def test_every_command_reports_a_missing_file_alike(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    assert main(words) == 2
    missing = next(word for word in words if word.startswith("none"))
    assert capsys.readouterr() == ("", f"hapscene: {missing}: no such file\n")


def test_results_go_into_a_folder_that_is_called_as_the_scene(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["touch", "cube.ply", "--unit", "m", "--path", "path.csv", "--no-picture"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"loading cube.ply \(\d+ B\) … (compiling, once; half a minute to two … )?[\d.]+ s\n", said)
    assert f"  {Path('out/cube/touch.npz')}  (" in said and "\r" not in said and "\b" not in said
    assert (folder / "out" / "cube" / "summary.json").is_file()


def test_a_file_written_by_default_replaces_none(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "cube.png").write_text("theirs")
    (folder / "wood.html").write_text("theirs")
    (folder / "cube.glb").write_text("theirs")
    for words, name in (
        (["view", "cube.ply", "--unit", "m"], "cube.png"),
        (["capture", "report", "wood"], "wood.html"),
        (["export", "cube.ply", "--unit", "m"], "cube.glb"),
    ):
        assert main(words) == 2
        assert f"{name}: is there already" in capsys.readouterr().err
        assert (folder / name).read_text() == "theirs"


def test_one_grip_everywhere() -> None:
    from hapscene.constants import DEFAULT_GRIP
    from hapscene.device.hand import GRIPS

    assert DEFAULT_GRIP in GRIPS
    for words in (["paint"], ["stability"], ["teleoperate", "leader"]):
        assert _parser().parse_args(words).grip == DEFAULT_GRIP
    assert HAND_DEFAULTS["grip"] == DEFAULT_GRIP


def test_debug_shows_the_traceback(folder: Path) -> None:
    from hapscene.errors import PathError

    for arguments in (["--debug", *TOUCH, "--path", "none.csv"], [*TOUCH, "--path", "none.csv", "--debug"]):
        with pytest.raises(PathError):
            main(arguments)


def test_interrupt_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*arguments: object, **more: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hapscene.view.plot.write_plot", interrupt)
    assert main([*TOUCH, "--swatch", "wood"]) == 130
    assert capsys.readouterr().err == "hapscene: interrupted; nothing was written\n"
    assert not (folder / "out").exists()


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0 and capsys.readouterr().out == f"hapscene {__version__}\n"


def test_plugins_are_listed_with_units(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plugins"]) == 0
    said = capsys.readouterr().out
    assert "wall" in said and "damping_Ns_m" in said and "N·s/m" in said
    assert main(["plugins", "--json"]) == 0
    listed = {item["name"]: item for item in json.loads(capsys.readouterr().out)}
    assert {"friction", "lpc_texture", "tap", "wall"} <= set(listed)
    assert (listed["wall"]["scope"], listed["guide"]["scope"]) == ("contact", "scene")
    assert listed["guide"]["arrays"] == ["points_m", "normal"]
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

    def write_picture(*arguments: object, **more: object) -> None:
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
        ("featuretype.STL", "in"),
        ("Duck.glb", None),
        ("base_interface_AP214.STEP", None),
    ],
)
def test_real_meshes_are_touched(
    tmp_path: Path, shared: Path, monkeypatch: pytest.MonkeyPatch, name: str, unit: str | None
) -> None:
    if name.endswith("STEP"):
        pytest.importorskip("cascadio", reason="cascadio, which reads STEP, is not installed")
    monkeypatch.setattr("hapscene.view.plot.write_plot", lambda *arguments, **more: None)  # slow, and tested elsewhere
    mesh = shared / "data" / "meshes" / name
    words = ["touch", str(mesh), "--swatch", "wood", "--out", str(tmp_path / "out"), "--no-picture"]
    assert main([*words, *(["--unit", unit] if unit else [])]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert summary["ticks_in_contact"] > 300 and summary["ticks_on_swatches"]["wood"] > 300
    assert not any(summary["flags"].values())
    assert summary["depth_max_m"] < 0.01 and summary["acceleration_max_m_s2"] > 0.1


@pytest.mark.parametrize(
    "words",
    [
        ["--swatch", "oka"],
        ["--effects", "wal"],
        ["--effects", "weight", "--set", "weight.mass_kg=-1"],
        ["--hand", "strok"],
        ["--hand", "stroke", "--device", "ideal"],
        ["--hand", "stroke", "--compensator", "flot"],
        ["--out", "path.csv"],
    ],
)
def test_invalid_options_of_touch_are_found_before_the_mesh_is_loaded(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.setattr("hapscene.touch.open_scene", lambda *arguments, **more: pytest.fail("loaded"))
    assert main(["touch", "cube.ply", "--unit", "m", *words]) == 2


EVIL = "e\x1b]0;title\x07\x9b2J\u202e\nhapscene: forged"
"""A name that sets a terminal's title, empties its screen, turns its writing and makes a line of its own."""


def _evil_names(folder: Path) -> None:
    mesh = (folder / "cube.ply").read_bytes()
    for name in (f"{EVIL}.ply", "\udcff.ply"):
        (folder / name).write_bytes(mesh)
    (folder / "groups.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
        + "".join(f"o part{i}\x1b]0;t\x07\u202e\nusemtl m{i}\x1b[2J\nf {f}\n" for i, f in enumerate(("1 3 2", "1 2 4")))
    )
    shipped = Path(__file__).parents[1] / "swatches" / "wood.swatch"
    content = json.loads(shipped.read_text(encoding="utf-8"))
    content["provenance"] = content["licence"] = EVIL
    (folder / f"{EVIL}.swatch").write_text(json.dumps(content), encoding="utf-8")
    (folder / f"{EVIL}.csv").write_text("t,acceleration\n0,nan\n")


@pytest.mark.skipif(sys.platform == "win32", reason="no file has such a name there")
@pytest.mark.parametrize(
    "words",
    [
        [EVIL],
        ["check", f"--{EVIL}"],
        ["check", f"{EVIL}.ply", "--unit", "m", "--fix", f"{EVIL}_mended.ply"],
        ["check", "\udcff.ply", "--unit", "m"],
        ["check", "groups.obj", "--unit", "m"],
        ["import", "groups.obj", "--unit", "m"],
        ["swatch", "show", f"{EVIL}.swatch"],
        ["swatch", "show", f"{EVIL}.swatch", "--json"],
        ["swatch", "add", f"{EVIL}.swatch", "--library", f"{EVIL}", "--name", "oak"],
        ["swatch", "compare", f"{EVIL}.swatch", f"{EVIL}.csv"],
        ["capture", "fit", f"{EVIL}.csv", "-o", "a.swatch"],
        ["handle", "show", f"{EVIL}.ply"],
    ],
)
def test_nothing_from_outside_steers_the_terminal(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    _evil_names(folder)
    with suppress(SystemExit):
        main(words)
    said = capsys.readouterr()
    assert said.out + said.err
    assert all(line.isprintable() and line != "hapscene: forged" for line in (said.out + said.err).splitlines())
    if "--json" in words:
        assert json.loads(said.out)["provenance"] == EVIL
