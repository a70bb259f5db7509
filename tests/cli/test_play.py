"""`hapscene play`."""

import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapscene.cli import main, play
from hapscene.cli.play import _devices
from hapscene.compiled.native import INTERPRETED
from hapscene.errors import DeviceError
from hapscene.play.monitor import pressed_keys

ROOT = Path(__file__).resolve().parents[2]
DEMO = str(ROOT / "assets" / "demo.scene.json")
terminals = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")
if hasattr(os, "openpty"):
    import termios
compiled = pytest.mark.skipif(INTERPRETED, reason="an interpreted tick takes longer than a period")


@pytest.mark.nightly
@compiled
def test_play_for_a_second(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["play", DEMO, "--device", "simulated", "--seconds", "1", "--option", "grip=firm"]) == 0
    output = capfd.readouterr().out
    assert "ticks, " in output and "deadline misses" in output and "longest tick " in output


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (["--device", "omny"], "no device 'omny'"),
        (["--device", "falcon", "--option", "colour=red"], "no option 'colour'"),
        (["--device", "haply2diy", "--option", "hardware=v9"], "one of v3, v2"),
        (["--option", "red"], "expected NAME=VALUE"),
        (["--force", "-1"], "--force"),
        (["--handle", "falcon"], "no vibration output 'falcon'; there are: audio"),
        (["--device", "audio"], "'audio'"),
        (["--at", "0,0,0.1"], "--at"),
    ],
)
def test_invalid_options(words: list[str], output: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["play", DEMO, *words]) == 2
    errors = capfd.readouterr().err
    assert output in errors and errors.count("\n") == 1


class FakeServo:
    """Records the calls."""

    mode = "running"

    def __init__(self) -> None:
        self.asked: list[str] = []

    def pause(self) -> None:
        self.asked.append("pause")

    def resume(self) -> None:
        self.asked.append("resume")


class FakeMonitor:
    def lines(self) -> list[str]:
        return ["0 ticks/s", "latency", "idle", "longest tick", "w" * 100]


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A terminal of 80 columns as standard input; its other end."""
    ours, theirs = os.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    with os.fdopen(theirs, "w") as out, os.fdopen(os.dup(theirs)) as into:
        monkeypatch.setattr(sys, "stdin", into)
        monkeypatch.setattr(play, "get_terminal_size", lambda: os.get_terminal_size(out.fileno()))
        yield ours
    os.close(ours)


@terminals
def test_keys_and_status_line(terminal: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp())
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setattr(play, "POLL_S", 0.01)
    servo = FakeServo()
    shown: list[str] = []
    monkeypatch.setattr(play, "print_in_place", shown.append)
    with pressed_keys() as keys:
        looks = iter([b"", b"  ", b" q"])

        def noted() -> bool:
            os.write(terminal, next(looks))
            return False

        play._show_until_end(servo, FakeMonitor(), keys, noted, Path(), math.inf)  # type: ignore[arg-type]
    assert servo.asked == ["pause", "resume", "pause"]
    assert shown and all(len(line) < 80 for line in shown)
    assert termios.tcgetattr(sys.stdin)[3] & termios.ICANON


def test_missing_log(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["play", "--replay", "nowhere"]) == 2
    assert "nowhere" in capfd.readouterr().err


def test_options_of_several_devices() -> None:
    devices = _devices(
        ["simulated", "omni", "simulated"], {"grip": "firm", "1.model": "premium-1.5", "3.grip": "light"}
    )
    assert devices[1] == "omni"
    assert [device.options for device in (devices[0], devices[2])] == [  # type: ignore[union-attr]
        {"grip": "firm", "model": "premium-1.5"},
        {"grip": "light"},
    ]
    with pytest.raises(DeviceError, match="colour"):
        _devices(["simulated"], {"1.colour": "red"})
    for names, key in ((["simulated"], "2.grip"), (["simulated", "omni"], "2.grip"), (["omni"], "grip")):
        with pytest.raises(DeviceError, match=key):  # no device reads the option
            _devices(names, {key: "light"})
    with pytest.raises(DeviceError, match="omnii"):
        _devices(["omni", "omnii"], {})
