"""What is typed after an option: refused in a sentence where it is none."""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import pytest
import trimesh

from hapscene.cli import _parser, main
from hapscene.command.options import UNITLESS, UNITS, base_name, check_scene, check_there, number, whole
from hapscene.errors import HapsceneError, MeshError
from hapscene.scene import mesh, mesh_file

ODD = ("abc", "", " ", "nan", "-inf", "inf", "1e999", "-1e999", "0x10", "1.5.2", "²", "-1", "9" * 5000, "1," * 9, "a:b")


def options(parser: argparse.ArgumentParser, name: str) -> Iterator[tuple[str, argparse.Action]]:
    """All options of a parser and of its commands, with the words that lead to them."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, command in action.choices.items():
                yield from options(command, f"{name} {word}")
        elif callable(action.type):
            yield f"{name} {'/'.join(action.option_strings)}", action


TYPED = dict(options(_parser(), "hapscene"))


@pytest.mark.parametrize("option", TYPED)
def test_what_is_no_value_is_told_in_words(option: str) -> None:
    """argparse turns other errors into "invalid _port value", or lets them through."""
    kind = TYPED[option].type
    assert kind not in (int, float), "use hapscene.command.options.whole or number"
    for text in ODD:
        try:
            value = kind(text)  # type: ignore[operator]
        except argparse.ArgumentTypeError as error:
            assert len(str(error)) > 10
        else:
            assert not isinstance(value, float) or math.isfinite(value)


def test_there_are_numbers_among_the_options() -> None:
    assert {"hapscene paint --port", "hapscene view --turn", "hapscene view --seconds"} <= set(TYPED)
    assert len(TYPED) > 40


@pytest.mark.parametrize(
    ("kind", "good", "bad", "told"),
    [
        (whole("a port", 0, 9), ("0", "9", " 7 "), ("-1", "10", "x"), "a port is a whole number from 0 to 9, not "),
        (whole("a seed", 0), ("0", "999"), ("-1", "1.5"), "a seed is a whole number, 0 or more, not "),
        (whole("a grip"), ("-5",), ("x",), "a grip is a whole number, not "),
        (number("a rate is a number of Hz", above=0.0), ("1e-9",), ("0", "nan"), "a rate is a number of Hz, above 0"),
        (number("a share is a number", 0.0, 1.0), ("0", "1"), ("-.1", "1.1"), "a share is a number from 0 to 1, not "),
        (
            number("a film lasts a number of seconds", high=9.0, above=0.0),
            ("9",),
            ("0", "9.1"),
            "a film lasts a number of seconds, above 0 and at most 9, not ",
        ),
        (number("an angle is a number of degrees"), ("-720", "1e3"), ("inf", "nan", ""), "an angle is a number of deg"),
    ],
)
def test_kinds_of_numbers(kind, good: tuple[str, ...], bad: tuple[str, ...], told: str) -> None:
    assert [kind(text) for text in good] == [float(text) for text in good]
    for text in bad:
        with pytest.raises(argparse.ArgumentTypeError) as error:
            kind(text)
        assert str(error.value).startswith(told) and repr(text) in str(error.value)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["view", "a.ply", "--out", "a.gif", "--turn", "nan"], "--turn: an angle is a number of degrees, not 'nan'"),
        (["view", "a.ply", "--out", "a.gif", "--seconds", "abc"], "above 0 and at most 3600, not 'abc'"),
        (["paint", "--port", "abc"], "--port: a port is a whole number from 0 to 65535, not 'abc'"),
    ],
)
def test_it_is_said_without_a_traceback(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(words)
    assert told in capsys.readouterr().err


def test_what_is_kept_twice_is_the_same() -> None:
    assert UNITLESS == mesh_file.UNITLESS and tuple(mesh.UNIT_M) == UNITS


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        ("bnny.ply", "bnny.ply: no such file; did you mean bunny.ply?"),
        ("bunny.stl", "bunny.stl: no such file; did you mean bunny.ply?"),
        ("desk.scen.json", "desk.scen.json: no such file; did you mean desk.scene.json?"),
        ("none.ply", "none.ply: no such file"),
        ("none.scene.json", "none.scene.json: no such file"),
        ("no/bunny.ply", "no/bunny.ply: no such file: there is no folder no"),
        ("folder", "folder: is a folder; expected a file"),
    ],
)
def test_a_missing_file_names_the_one_that_was_meant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, typed: str, told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    for name in ("bunny.ply", "desk.scene.json", ".bnny.ply"):
        (tmp_path / name).touch()
    check_there("bunny.ply")
    check_there(None)
    check_there("folder", what="file or folder")
    with pytest.raises(MeshError) as error:
        check_there(Path(typed), MeshError)
    assert str(error.value).replace("\\", "/") == told
    with pytest.raises(HapsceneError, match=r"^--docs bunny\.ply: is a file; expected a folder$"):
        check_there("bunny.ply", what="folder", prefix="--docs ")


def test_a_painted_ply_says_its_unit(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text("ply\nformat ascii 1.0\ncomment hapscene scene 1\n")
    (tmp_path / "b.PLY").write_text("ply\nformat ascii 1.0\ncomment made elsewhere\n")
    check_scene(str(tmp_path / "a.ply"))
    with pytest.raises(MeshError, match="PLY files carry no unit of length"):
        check_scene(str(tmp_path / "b.PLY"))
    check_scene(str(tmp_path / "b.PLY"), "inch")
    with pytest.raises(MeshError, match="no unit of length 'mmm'"):
        check_scene(str(tmp_path / "b.PLY"), "mmm")


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("meshes/bunny.ply", "bunny"),
        ("bunny.scene.json", "bunny"),
        ("v1.2.scene.json", "v1.2"),
        ("v1.2.stl", "v1.2"),
        ("wood", "wood"),
        ("part", "part"),
    ],
)
def test_the_name_of_what_a_file_holds(path: str, name: str) -> None:
    assert base_name(path) == name


@pytest.mark.parametrize(
    ("command", "inside"), [("serve", "bridge.server.BridgeServer"), ("tune", "fidelity.tune.tune")]
)
def test_a_size_that_is_none_for_a_hand_is_told_before_the_work(command, inside, tmp_path, monkeypatch, capsys):
    def stop(*_, **__):
        raise HapsceneError("enough")

    trimesh.creation.box((5.0, 4.0, 3.0)).export(tmp_path / "crate.stl")
    monkeypatch.setattr(f"hapscene.{inside}", stop)
    assert main([command, str(tmp_path / "crate.stl"), "--unit", "m", "--swatch", "wood"]) == 2
    assert "crate.stl is 5 × 4 × 3 m in size" in capsys.readouterr().out
