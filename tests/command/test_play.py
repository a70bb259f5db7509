"""`hapscene play`, `replay`, `devices` as a user calls them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from hapscene.cli import main
from hapscene.native import INTERPRETED

ROOT = Path(__file__).resolve().parents[2]
DEMO = str(ROOT / "assets" / "demo.scene.json")
compiled = pytest.mark.skipif(INTERPRETED, reason="an interpreted tick takes longer than a period")


@compiled
def test_a_scene_is_played_for_a_while_and_told(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["play", DEMO, "--device", "simulated", "--seconds", "1", "--option", "grip=firm"]) == 0
    told = capfd.readouterr().out
    assert "ticks, " in told and "later than a period: " in told and "worst tick " in told


@compiled
def test_ctrl_c_ends_it_with_the_summary() -> None:
    command = [sys.executable, "-m", "hapscene", "play", DEMO, "--device", "omni"]
    playing = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    for line in playing.stdout:  # type: ignore[union-attr]
        if "ticks/s" in line:
            break
    playing.send_signal(2)
    out, errors = playing.communicate(timeout=60.0)
    assert playing.returncode == 0 and "later than a period" in out and errors == ""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--device", "omny"], "no device 'omny'"),
        (["--device", "falcon", "--option", "colour=red"], "no option 'colour'"),
        (["--device", "haply2diy", "--option", "hardware=v9"], "one of v3, v2"),
        (["--option", "red"], "expected KEY=VALUE"),
        (["--force", "-1"], "--force"),
    ],
)
def test_wrong_words_meet_one_line(words: list[str], said: str, capfd: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["play", DEMO, *words])
    except SystemExit as ended:
        code = int(ended.code or 0)
    errors = capfd.readouterr().err
    assert code == 2 and said in errors and errors.count("\n") == 1


def test_devices_are_listed_with_what_is_in_the_way(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["devices"]) == 0
    told = capfd.readouterr().out
    assert "openhaptics" in told and "library=PATH" in told and "in this computer: ready" in told
    assert main(["devices", "--json"]) == 0
    listed = {one["name"]: one for one in json.loads(capfd.readouterr().out)}
    assert listed["falcon"]["limits"]["force_N"] == 8.0 and listed["spacemouse"]["force"] is False
    assert listed["simulated"]["found"] == [{"where": "in this computer", "trouble": "", "remedy": ""}]


def test_a_device_that_is_not_there_is_told_of(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["devices", "try"]) == 2
    assert "say which one" in capfd.readouterr().err
    assert main(["replay", "nowhere"]) == 2
    assert "nowhere: no flight" in capfd.readouterr().err
