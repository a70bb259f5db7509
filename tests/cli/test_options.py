"""Paths and values on the command line: checked before anything is loaded."""

import math
from pathlib import Path

import pytest
import trimesh

from hapscene.cli import app, main
from hapscene.cli.inputs import check_scene, check_there
from hapscene.cli.options import MeshOptions
from hapscene.errors import HapsceneError, MeshError
from tests.cli.command_lines import all_commands

ODD = ("abc", "nan", "-inf", "inf", "1e999", "0x10", "1.5.2", "²", "1," * 9)


def test_number_options_require_finite_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    tried = 0
    for names in all_commands():
        command = app()
        for word in names:
            command = command[word]
        for argument in command.assemble_argument_collection():
            if argument.hint in (int, float) and argument.name.startswith("--"):
                for text in ODD:
                    try:
                        _, bound, _ = app().parse_args([*names, f"{argument.name}={text}"])
                    except Exception as error:
                        assert type(error).__name__ in ("CoercionError", "ValidationError", "MissingArgumentError")
                    else:
                        assert math.isfinite(bound.arguments.get(argument.field_info.name, 0)), (names, argument, text)
                tried += 1
    assert tried > 30


def test_files_and_folders_are_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "bunny.ply").touch()
    check_there("bunny.ply")
    check_there("folder", "file or folder")
    for name, kind, expected in (
        ("none.ply", "file", "none.ply: no such file"),
        ("folder", "file", "folder: is a folder; expected a file"),
        ("bunny.ply", "folder", "bunny.ply: is a file; expected a folder"),
    ):
        with pytest.raises(HapsceneError) as error:
            check_there(name, kind)
        assert str(error.value) == expected


def test_a_ply_needs_a_unit(tmp_path: Path) -> None:
    (tmp_path / "b.PLY").write_text("ply\nformat ascii 1.0\ncomment made elsewhere\n")
    with pytest.raises(MeshError, match="--unit"):
        check_scene(str(tmp_path / "b.PLY"))
    check_scene(str(tmp_path / "b.PLY"), MeshOptions(unit="inch"))
    with pytest.raises(MeshError, match="no unit of length 'mmm'"):
        check_scene(str(tmp_path / "b.PLY"), MeshOptions(unit="mmm"))


@pytest.mark.parametrize(
    ("command", "inside"), [("serve", "bridge.server.BridgeServer"), ("tune", "fidelity.tune.tune")]
)
def test_unsuitable_size_is_reported(command, inside, tmp_path, monkeypatch, capsys):
    def stop(*_, **__):
        raise HapsceneError("enough")

    trimesh.creation.box((5.0, 4.0, 3.0)).export(tmp_path / "crate.stl")
    monkeypatch.setattr(f"hapscene.{inside}", stop)
    assert main([command, str(tmp_path / "crate.stl"), "--unit", "m", "--swatch", "wood"]) == 2
    assert "crate.stl is 5 × 4 × 3 m in size" in capsys.readouterr().out
