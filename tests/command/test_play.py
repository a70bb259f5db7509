"""`hapscene play`, `replay`, `devices` as a user calls them."""

import json
import os
import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapscene.cli import main
from hapscene.command import play
from hapscene.native import INTERPRETED

ROOT = Path(__file__).resolve().parents[2]
DEMO = str(ROOT / "assets" / "demo.scene.json")
terminals = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")
if hasattr(os, "openpty"):
    import termios
compiled = pytest.mark.skipif(INTERPRETED, reason="an interpreted tick takes longer than a period")


@pytest.mark.nightly
@compiled
def test_a_scene_is_played_for_a_while_and_told(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["play", DEMO, "--device", "simulated", "--seconds", "1", "--option", "grip=firm"]) == 0
    told = capfd.readouterr().out
    assert "ticks, " in told and "later than a period: " in told and "worst tick " in told


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--device", "omny"], "no device 'omny'"),
        (["--device", "falcon", "--option", "colour=red"], "no option 'colour'"),
        (["--device", "haply2diy", "--option", "hardware=v9"], "one of v3, v2"),
        (["--option", "red"], "expected KEY=VALUE"),
        (["--force", "-1"], "--force"),
        (["--handle", "falcon"], "'falcon' plays no acceleration"),
        (["--device", "audio"], "'audio' has no position"),
    ],
)
def test_wrong_words_meet_one_line(words: list[str], said: str, capfd: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["play", DEMO, *words])
    except SystemExit as ended:
        code = int(ended.code or 0)
    errors = capfd.readouterr().err
    assert code == 2 and said in errors and errors.count("\n") == 1


class FakeServo:
    """What is asked of it, in order."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def pause(self) -> None:
        self.asked.append("pause")

    def resume(self) -> None:
        self.asked.append("resume")


class FakeMonitor:
    def lines(self) -> list[str]:
        return ["0 ticks/s", "late", "empty", "worst tick", "w" * 100]


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
def test_no_key_is_lost_and_no_line_is_broken_by_the_terminal(terminal: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp())
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setattr(play, "LOOK_S", 0.01)
    servo, options = FakeServo(), Namespace(seconds=10.0, flights=None)
    shown: list[list[str]] = []
    monkeypatch.setattr(play, "tell", lambda lines: shown.append(list(lines)))
    with play._keys() as keys:
        looks = iter([b"", b"  ", b" q"])

        def noted() -> bool:
            os.write(terminal, next(looks))
            return False

        play._watch(servo, FakeMonitor(), keys, noted, options)  # type: ignore[arg-type]
    assert servo.asked == ["pause", "resume", "pause"]
    assert shown and all(len(line) < 80 for lines in shown for line in lines)
    assert termios.tcgetattr(sys.stdin)[3] & termios.ICANON


@terminals
def test_in_the_background_the_terminal_is_left_alone(terminal: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp() + 1)
    with play._keys() as keys:
        assert termios.tcgetattr(sys.stdin)[3] & termios.ICANON
        assert keys() == ""


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
    assert "nowhere" in capfd.readouterr().err
