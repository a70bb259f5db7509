"""`hapscene view`."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from hapscene.cli import main


@pytest.fixture
def plate(tmp_path: Path) -> str:
    trimesh.creation.box((0.1, 0.06, 0.02)).export(tmp_path / "plate.stl")
    return str(tmp_path / "plate.stl")


def test_size(tmp_path: Path, plate: str, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "plate.png"
    code = main(["view", plate, "--unit", "m", "--swatch", "wood", "--size", "300", "240", "--dark", "--out", str(out)])
    output = capsys.readouterr()
    if code == 2 and "no GL" in output.err:
        pytest.skip(output.err)
    assert code == 0 and "plate.png" in output.out
    with Image.open(out) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert pixels.shape == (240, 300, 3) and pixels[0, 0].max() < 50
    assert (pixels[..., 0] > pixels[..., 2] + 50).mean() > 0.1  # wood


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--out", "a.bmp"], ".bmp"),
        (["--out", "none/a.png"], "none/a.png"),
        (["--out", "a.png", "--seconds", "9"], "--seconds"),
        (["--out", "a.gif", "--touch", "none.npz"], "none.npz: no such file"),
        (["--out", "a.png", "--swatch", "wood", "--size", "4000", "160"], "is too small"),
    ],
)
def test_errors_are_one_line(plate: str, arguments: list[str], error: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", plate, "--unit", "m", *arguments]) == 2
    output = capsys.readouterr().err
    assert error in output and output.count("\n") == 1
    assert not Path(arguments[1]).exists()


@pytest.mark.parametrize("words", [["--seconds", "0"], ["--size", "800x600"], ["--size", "159", "600"]])
def test_numbers_out_of_range(plate: str, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", plate, "--unit", "m", "--out", "a.gif", *words]) == 2
    assert words[0] in capsys.readouterr().err


@pytest.mark.parametrize("command", ["view", "check"])
def test_an_unwritable_output_is_an_error_before_the_work(
    command: str, tmp_path: Path, plate: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("hapscene.scene.mesh_file.load_mesh", lambda *arguments, **options: pytest.fail("loaded"))
    monkeypatch.setattr("hapscene.touch.open_scene", lambda *arguments: pytest.fail("loaded"))
    option, name = ("--out", "a.gif") if command == "view" else ("--fix", "a.ply")
    assert main([command, plate, "--unit", "m", option, str(tmp_path / "none" / name)]) == 2
    assert capsys.readouterr().err.endswith(f"the folder {tmp_path / 'none'} does not exist\n")
