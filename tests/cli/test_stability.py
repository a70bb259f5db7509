"""`hapscene lab stability`."""

import csv
from pathlib import Path
from typing import Any

import pytest

from hapscene.cli import main
from hapscene.stability import z_width
from hapscene.stability.study import stability
from hapscene.surface.swatch import Swatch

pytestmark = pytest.mark.nightly


def test_writes_chart_tables_and_verdicts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from hapscene.device.sim.hand import grip_named

    swatches = [Swatch("steel", 20_000.0), Swatch("felt", 200.0)]
    args = ("premium-1.5", (1000.0,), (0,), grip_named("light"), swatches)
    made = stability(tmp_path / "out", *args, dampings_Ns_m=(0.0, 2.0))
    charts = {"z_width.png", "z_width-dark.png"}
    assert {file.name for file in made} == {*charts, "z_width.csv", "swatches.csv", "verdicts.txt"}
    with (tmp_path / "out" / "z_width.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["damping_Ns_m"]) for row in rows] == [0.0, 2.0]
    assert float(rows[1]["limit_N_m"]) > float(rows[0]["limit_N_m"]) > z_width.STIFFNESS_N_M[0]
    verdicts = (tmp_path / "out" / "verdicts.txt").read_text(encoding="utf-8")
    assert "steel: 20000 N/m is unstable at 1 kHz; the device limits it to" in verdicts
    assert "felt" in verdicts


def test_an_interrupted_run_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hapscene.device.sim.hand import grip_named

    args = ("premium-1.5", (1000.0,), (0, 1), grip_named("light"), [])
    traced = list[tuple[float, int]]()
    trace = z_width.trace

    def some(*args: Any) -> z_width.StableRegion:
        traced.append(args[3:5])
        if len(traced) == 2:
            raise KeyboardInterrupt
        return trace(*args)

    monkeypatch.setattr(z_width, "trace", some)
    with pytest.raises(KeyboardInterrupt):
        stability(tmp_path / "out", *args, dampings_Ns_m=(2.0,), jobs=1)
    assert not (tmp_path / "out").exists()
    stability(tmp_path / "out", *args, dampings_Ns_m=(2.0,), jobs=1)
    assert traced == [(1000.0, 0), (1000.0, 1), (1000.0, 1)]
    assert [file.name for file in tmp_path.iterdir()] == ["out"]  # the journal is deleted
    with (tmp_path / "out" / "z_width.csv").open(encoding="utf-8") as file:
        assert [row["delay_ticks"] for row in csv.DictReader(file)] == ["0", "1"]


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (["--device", "onmi"], "no device 'onmi'; there are: ideal, omni"),
        (["--device", "ideal"], "has no mass"),
        (["--grip", "soft"], "no grip 'soft'"),
    ],
)
def test_invalid_options(arguments: list[str], output: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "stability", "--out", str(tmp_path / "out"), *arguments]) == 2
    assert output in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
