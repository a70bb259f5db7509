"""The study of held-out parts: what it says of recordings, of simulated surfaces, and as a command."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.capture import load_recording
from hapscene_experiments import held_out

RECORDINGS = {  # file, modulation [1] and spread of the levels [dB] of its halves, measured by others
    "wood": ("cdp_wood.csv", 0.28, 3.7),
    "paper": ("cdp_paper.csv", 0.27, 2.2),
    "leather": ("cdp_leather.csv", 0.27, 2.4),
    "epoxy": ("lmt108_G1EpoxyRasterPlate_Movement_X_test1.txt", 0.65, 6.2),
}
UNITS = {"acceleration": "m/s2", "force": "N", "speed": "mm/s"}


def test_recordings_come_alive_on_the_half_that_was_not_fitted(shared: Path) -> None:
    off = []
    for file, modulation, spread_dB in RECORDINGS.values():
        path = shared / "data" / "recordings" / file
        columns = {"acceleration": "accel"} if path.suffix == ".csv" else None
        recording = load_recording(path, 10_000.0, columns=columns, units=UNITS)
        found = held_out.scores(recording, 2, seeds=5, order=20)
        real = np.mean([score.lively[0] for score in found], axis=0)
        assert real[0] == pytest.approx(modulation, rel=0.08) and real[1] == pytest.approx(spread_dB, rel=0.04)
        off.append(np.mean([score.off for score in found], axis=0))
        assert max(score.shape_dB[1] - score.shape_dB[0] for score in found) < 0.35
    lifeless, alive, _ = np.mean(off, axis=0)
    assert lifeless[0] > 0.8 and lifeless[1] > 0.8
    assert alive[0] <= 0.45 and alive[1] <= 0.45


def test_a_steady_surface_is_left_steady() -> None:
    (score, _) = held_out.scores(held_out.simulated("steady", 2.0)[0], 2, seeds=2, order=6)
    assert np.array_equal(score.lively[1], score.lively[2])
    assert score.shape_dB[1] < score.shape_dB[2] + 0.5 and abs(score.level_dB[0]) < 1.0


def test_the_command_prints_a_line_for_each_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(held_out, "ORDERS", (8,))
    channels, _ = held_out.simulated("bursts", 2.0)
    streams = np.stack([channels.acceleration_m_s2, channels.force_N, channels.speed_m_s], axis=1)
    np.savetxt(tmp_path / "oak.csv", streams, delimiter=",", header="acceleration,force,speed", comments="")
    units = "acceleration=m/s2,force=N,speed=m/s"
    (tmp_path / "ash.csv").write_text("a,b\n1,2\n")
    assert held_out.main([str(tmp_path), "--quick", "--rate", "5000", "--units", units]) == 0  # the other goes on
    told = capsys.readouterr()
    lines = told.out.splitlines()
    assert told.err.count("\n") == 1 and "ash.csv" in told.err
    (tmp_path / "oak.csv").unlink()
    for folder in (tmp_path, tmp_path / "none"):
        assert held_out.main([str(folder), "--rate", "5000", "--units", units]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1 and str(folder) in told
    assert lines[-1].startswith("| oak, 2 parts | ") and lines[-1].count("|") == lines[-2].count("|")
