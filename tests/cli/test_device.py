"""`hapscene device`, as typed."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.cli import main
from hapscene.cli.device import _desired
from hapscene.cli.options import RecordingOptions
from hapscene.handle.handle_file import load_handle
from hapscene.motion.hand_path import explore
from hapscene.render.renderer import Renderer
from hapscene.touch import open_scene

SHORT = ["--rate", "3000", "--high", "500", "--seconds", "4", "--grips", "2"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated handle, identified."""
    out = tmp_path_factory.mktemp("handle") / "out"
    assert main(["device", "identify", "--simulated", *SHORT, "--name", "ours", "--out", str(out)]) == 0
    return out


def test_a_simulated_handle_is_identified(folder: Path) -> None:
    found = load_handle(folder / "ours.handle")
    assert found.plant.m_h_kg == pytest.approx(0.12, rel=0.02) and found.plant.k_s_N_m == pytest.approx(250.0, rel=0.1)
    assert "simulated handle, seed 0; swept sine, 10 to 500 Hz" in found.provenance
    assert {file.name for file in folder.iterdir()} >= {"bode.png", "grip-1.npz", "grip-2.npz"}


def test_identification_from_recordings(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grips = [str(folder / f"grip-{i}.npz") for i in (1, 2)]
    assert main(["device", "identify", "--from", *grips, "--high", "500", "-o", str(tmp_path / "b.handle")]) == 0
    first, second = load_handle(folder / "ours.handle"), load_handle(tmp_path / "b.handle")
    assert first.plant.m_h_kg == pytest.approx(second.plant.m_h_kg, rel=1e-5)
    assert [grip.name for grip in second.grips] == ["grip-1", "grip-2"]
    tables = [str(tmp_path / f"grip-{i}.csv") for i in (1, 2)]
    for grip, table in zip(grips, tables, strict=True):
        with np.load(grip) as stored:
            rows = np.column_stack((stored["force"] * 1e3, stored["acceleration"]))
        np.savetxt(table, rows, delimiter=",", header="coil,a", comments="")
    stated = ["--columns", "force=coil,acceleration=a", "--units", "force=mN,acceleration=m/s2", "--rate", "3000"]
    where = ["--high", "500", "-o", str(tmp_path / "c.handle")]
    assert main(["device", "identify", "--from", *tables, *stated, *where]) == 0
    assert load_handle(tmp_path / "c.handle").plant.m_h_kg == pytest.approx(first.plant.m_h_kg, rel=1e-5)
    assert "b.handle  (" in capsys.readouterr().out


def test_play_file_writes_the_simulated_vibration(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    np.savetxt(tmp_path / "a.csv", rng.standard_normal(8000), header="acceleration", comments="")
    words = ["device", "play-file", str(tmp_path / "a.csv"), "--rate", "10000", "--units", "acceleration=m/s2"]
    errors = []
    for compensator in ("naive", "flat"):
        out = tmp_path / compensator
        expected = ["--handle-file", str(folder / "ours.handle"), "--compensator", compensator]
        assert main([*words, *expected, "--out", str(out)]) == 0
        assert {file.name for file in out.iterdir()} == {"felt.wav"}
        errors.append(float(capsys.readouterr().out.split("spectrogram error ")[1].split(" %")[0]))
    assert errors[1] < 10.0 < errors[0] < 100.0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["identify", "--simulated", "--grips", "0", "-o", "a.handle"], "--grips"),
        (["identify", "--simulated", "--rate", "1000", "-o", "a.handle"], "400 Hz"),
        (["identify", "--simulated", "--force", "-1", "-o", "a.handle"], "--force"),
        (["identify", "--simulated", "--port", "COM1"], "source"),
        (["identify", "--from", "none.csv", "-o", "a.handle"], "none.csv: no such file"),
        (["identify", "--port", "/dev/none", "-o", "a.handle"], "cannot open the port"),
        (["play-file", "none.csv", "--out", "o"], "none.csv: no such file"),
        (["play-file", __file__, "--out", "o", "--compensator", "flot"], "no compensator 'flot'"),
        (["try", "flacon"], "did you mean 'falcon'?"),
        (["check", "audio"], "--handle audio"),
        (["check", "no_module:DRIVER"], "no_module"),
        (["check", "tests.device.test_check:Board"], "expected a Driver"),
        (["check", "simulated", "--option", "grip=light", "--option", "grip=firm"], "grip=firm"),
    ],
)
def test_invalid_options(words: list[str], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["device", *words]) == 2
    error = capsys.readouterr().err
    assert expected in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("count", "rate", "expected"), [(3, "10000", "short"), (9999, "10000", "power"), (9999, "100", "rate_Hz")]
)
def test_invalid_recordings(
    count: int, rate: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "still.csv"
    path.write_text("acceleration\n" + "0\n" * count)
    given = ["--rate", rate, "--units", "acceleration=m/s2"]
    assert main(["device", "play-file", str(path), *given, "--out", str(tmp_path / "o")]) == 2
    error = capsys.readouterr().err
    assert f"{path}: " in error and expected in error


@pytest.fixture
def texture(tmp_path: Path) -> str:
    t_s = np.arange(3000) / 1e4
    rows = "".join(f"{a:.6f}\n" for a in 4.0 * np.sin(2.0 * np.pi * 200.0 * t_s))
    (tmp_path / "texture.csv").write_text("acceleration\n" + rows)
    return str(tmp_path / "texture.csv")


READ = ["--rate", "10000", "--units", "acceleration=m/s2"]


def test_play_on_a_real_handle(texture: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A simulated USB board, with the compensator of an identified handle."""
    pytest.importorskip("usb", reason="no pyusb: extra `usb`")
    words = ["device", "play-file", texture, *READ, "--handle", "usb", "--handle-file", str(folder / "ours.handle")]
    assert main([*words, "--handle-option", "backend=tests.handle.usb_board,watchdog_s=0.5"]) == 0
    output = capsys.readouterr().out
    assert "playing texture.csv, 0.3 s, on usb 16c0:05dc" in output and "latency" in output


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["--handle", "serial", "--out", "o"], "--out"),
        (["--handle", "serial", "--handle-option", "tempo=1"], "no option 'tempo'; there are:"),
        (["--handle", "serial"], "option port"),
    ],
)
def test_invalid_options_of_a_real_handle(
    texture: str, words: list[str], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["device", "play-file", texture, *READ, *words]) == 2
    assert error in capsys.readouterr().err


def test_list(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["device", "list"]) == 0
    output = capfd.readouterr().out
    assert "openhaptics" in output and "library=PATH" in output and "built in: ready" in output


def test_check_with_options_given_in_two_ways(capfd: pytest.CaptureFixture[str]) -> None:
    file = str(Path("assets", "none.npz"))
    for options in (["--option", f"file={file}", "--option", "again=yes"], ["--option", f"file={file},again=yes"]):
        assert main(["device", "check", "replay", *options]) == 1
        output = capfd.readouterr().out
        assert "ok       options: file, origin, again" in output and "failed   open: " in output and file in output


def test_play_file_of_a_touch(tmp_path: Path) -> None:
    trimesh.creation.box((0.05, 0.05, 0.02)).export(tmp_path / "a.ply")
    scene = open_scene(str(tmp_path / "a.ply"), "m", "wood", False)
    recording = Renderer(scene).run(explore(scene, 1e-3)[:600])
    recording.save(tmp_path / "touch.npz")
    desired, rate_Hz = _desired(tmp_path / "touch.npz", RecordingOptions())
    np.testing.assert_array_equal(desired, recording.a_m_s2.ravel())
    assert rate_Hz == recording.a_rate_Hz
