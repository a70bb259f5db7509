"""`hapscene play`."""

import math
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import ANY, MagicMock, call

import numpy as np
import pytest

from hapscene.cli import main, play
from hapscene.cli.options import PageOptions
from hapscene.cli.play import _devices
from hapscene.compiled.native import INTERPRETED
from hapscene.device.driver_registry import DeviceChoice
from hapscene.errors import DeviceError
from hapscene.loop.session_log import Replay
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
    assert "ticks, " in output and "deadline misses" in output


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

    mode, alive = "running", True

    def __init__(self) -> None:
        self.asked: list[str] = []

    def home(self) -> None:
        raise DeviceError("no home")

    def recover(self) -> None:
        self.asked.append("recover")

    def session_log(self, reason: str) -> str:
        return reason

    def stop_force(self) -> None: ...

    def handle_report(self) -> dict[str, float]:
        return {"latency_s": 0.02}

    def pause(self) -> None:
        self.asked.append("pause")

    def resume(self) -> None:
        self.asked.append("resume")


class FakeMonitor:
    faults = 0

    def lines(self) -> list[str]:
        if self.faults:
            self.faults -= 1
            raise DeviceError("unplugged")
        return ["0 ticks/s", "w" * 100]

    def summary(self) -> list[str]:
        return ["3 ticks"]

    def close(self) -> None: ...


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
    slept = list[float]()
    monkeypatch.setattr(play, "time", SimpleNamespace(sleep=slept.append, monotonic=time.monotonic))
    servo, monitor = FakeServo(), FakeMonitor()
    shown, notes = list[str](), list[str]()
    monkeypatch.setattr(play, "print_in_place", shown.append)
    monkeypatch.setattr(play, "print_note", notes.append)
    monkeypatch.setattr("hapscene.loop.session_log.write_log", lambda log, folder: f"{folder}: {log}")
    with pressed_keys() as keys:
        looks = iter([(b"", 0), (b"  rf", 0), (b" r ", 1), (b"", 0), (b"hq", 0)])

        def noted() -> bool:
            pressed, monitor.faults = next(looks)
            servo.mode = "error" if monitor.faults else "running"
            os.write(terminal, pressed)
            return False

        play._show_until_end(servo, monitor, keys, noted, Path("logs"), math.inf)  # type: ignore[arg-type]
    assert servo.asked == ["pause", "resume", "recover", "resume"]
    assert notes == ["logs: key f was pressed", "no home"] and slept == [play.POLL_S] * 5
    assert len(shown) == 4 and all(len(line) < 80 for line in shown) and "unplugged" in shown[2]
    assert termios.tcgetattr(sys.stdin)[3] & termios.ICANON


@pytest.mark.parametrize("alive", [True, False])
def test_a_failed_servo_has_a_log(
    alive: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    servo, monitor, written = FakeServo(), FakeMonitor(), list[str]()
    monkeypatch.setattr("hapscene.play.monitor.Monitor", lambda servo: monitor)
    monkeypatch.setattr("hapscene.loop.session_log.write_log", lambda log, folder: written.append(log) or "")
    play._watch(servo, Path(), 0.0)  # type: ignore[arg-type]
    assert capsys.readouterr().out.splitlines() == ["", "3 ticks"]
    monkeypatch.setattr(play, "QUIET_S", 0.0)
    servo.alive, monitor.faults = alive, 1
    with pytest.raises(DeviceError, match="unplugged"):
        play._watch(servo, Path(), math.inf)  # type: ignore[arg-type]
    assert written == ["unplugged"] * (not alive)


def test_play_on_the_page_or_with_a_device(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    found: dict[str, object] = {}

    @contextmanager
    def on_page(scene: object, title: str, page: object, kiosk_s: float, **made: object) -> Iterator[object]:
        found.update(made, title=title, page=page, kiosk_s=kiosk_s)
        yield FakeServo()

    @contextmanager
    def with_devices(scene: object, devices: object, at: object, **made: object) -> Iterator[object]:
        found.update(made, at=at)
        yield FakeServo()

    monkeypatch.setattr(play, "_on_page", on_page)
    monkeypatch.setattr(play, "_with_devices", with_devices)
    monkeypatch.setattr(play, "_watch", lambda servo, logs, seconds: found.update(seconds=seconds))
    for options, given in (
        (["--no-browser"], {"kiosk_s": math.inf, "page": PageOptions(no_browser=True), "seconds": math.inf}),
        (["--kiosk", "--seconds", "3"], {"kiosk_s": play.KIOSK_S, "page": PageOptions(), "seconds": 3.0}),
        (["--log", "here", "--force", "2"], {"log_folder": "here", "force_N": 2.0, "ring_s": play.LOG_S}),
        (["--device", "omni", "--handle", "audio"], {"at": None, "handle": DeviceChoice("audio")}),
        (["--device", "omni", "--at", "0", "0", "0.1"], {"at": (0.0, 0.0, 0.1)}),
    ):
        found.clear()
        assert main(["play", DEMO, *options]) == 0
        assert found == found | given and ("kiosk_s" in found) == ("--device" not in options)
        assert ("latency of audio: 20 ms" in capsys.readouterr().out) == ("--handle" in options)


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    """Notes what is opened, used and closed."""
    system = MagicMock()
    bridge = ("orders.Orders", "server.BridgeServer", "websocket.WebSocketBridge")
    places = ("loop.Servo", "play.page_server.PageServer", *(f"bridge.{place}" for place in bridge))
    for place in places:
        made = getattr(system, place.rpartition(".")[2])
        made.return_value.__enter__.return_value = made.return_value
        monkeypatch.setattr(f"hapscene.{place}", made)
    monkeypatch.setattr("webbrowser.open", system.browse)
    monkeypatch.setattr(play, "middle_of_top", lambda scene: (0.0, 0.0, 9.0))
    monkeypatch.setattr(play, "load_input", lambda *given: "scene")
    return system


def acts(system: MagicMock) -> list[Any]:
    return [act[0] if act[0].endswith("__") else act for act in system.mock_calls]


@pytest.mark.parametrize("shown", [True, False])
def test_a_page_is_shown_and_then_the_servo_starts(
    shown: bool, system: MagicMock, capsys: pytest.CaptureFixture[str]
) -> None:
    page, servo, scene = system.PageServer(), system.Servo(), system.scene
    page.url, page.public, page.devices, page.tools = "http://x", shown, ["a", "b"], 2
    servo.handle_report.return_value = {"latency_s": 0.02} if shown else {}
    system.reset_mock()
    with play._on_page(scene, "title", PageOptions(no_browser=not shown), 60.0, force_N=1.0):
        if shown:
            page.sound(True, 0.5)
            page.sound(False, 0.5)
    turned = call.Servo().turn_handle
    assert [act for act in acts(system) if act != call.Servo().handle_report()] == [
        call.PageServer(scene, tools=2, title="title", host="127.0.0.1", port=0, kiosk_s=60.0),
        *("PageServer().__enter__", *([call.browse("http://x")] if shown else [])),
        *(call.Servo(scene, ["a", "b"], force_N=1.0), "Servo().__enter__"),
        *(call.Servo().start([(0.0, 0.0, 0.0)] * 2), *([turned(0.0)] if shown else [])),
        *(call.PageServer().attach(servo), *([turned(0.5), turned(0.0)] if shown else [])),
        *("Servo().__exit__", "PageServer().__exit__"),
    ]
    output = capsys.readouterr().out
    assert "http://x" in output and ("network" in output) == shown


@pytest.mark.parametrize("at", [(1.0, 2.0, 3.0), None])
def test_devices_start_at_a_place_or_at_the_top(at: Any, system: MagicMock) -> None:
    with play._with_devices(system.scene, ["omni", "omni"], at, ring_s=3.0):
        assert acts(system) == [
            *(call.Servo(system.scene, ["omni", "omni"], ring_s=3.0), "Servo().__enter__"),
            call.Servo().start([at or (0.0, 0.0, 9.0)] * 2),
        ]


@pytest.mark.parametrize(("host", "ws"), [("127.0.0.1", None), ("10.0.0.1", 5)])
def test_serve_opens_its_ports_and_reports_what_came(
    host: str, ws: int | None, system: MagicMock, capsys: pytest.CaptureFixture[str]
) -> None:
    server, orders, servo = system.BridgeServer(), system.Orders(), system.Servo()
    server.address, system.WebSocketBridge().address = (host, 7), (host, 8)
    orders.counts = {"tune": 1200, "add": 1} if ws else {}
    system.reset_mock()
    assert main(["serve", DEMO, "--host", host, "--tools", "2", *([] if ws is None else ["--ws", str(ws)])]) == 0
    assert acts(system)[: -3 - bool(ws)] == [
        call.Servo("scene", ["omni"] * 2, progress=play.print_progress, tip_radius_m=0.0),
        *(call.Orders(servo), call.BridgeServer(orders, host, play.PORT), "BridgeServer().__enter__"),
        *([call.WebSocketBridge(server, host, ws)] if ws else []),
        *("Servo().__enter__", "Orders().__enter__"),
        *(*(["WebSocketBridge().__enter__"] if ws else []), call.BridgeServer().serve(ANY)),
    ]
    output = capsys.readouterr().out
    assert f"udp {host}:7" in output and (f"ws://{host}:8" in output) == ("network" in output) == bool(ws)
    assert output.endswith("ended; add 1, tune 1,200\n") == bool(ws) and not output.endswith("ended; \n")
    assert main(["serve", DEMO, "--tools", "0"]) == 2


@pytest.mark.parametrize("unlike", [[], [7]])
def test_a_replay_is_negative_if_forces_differ(
    unlike: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = Replay(3, 5, np.array(unlike), "why")
    monkeypatch.setattr("hapscene.loop.session_log.replay_log", lambda path: found)
    assert main(["play", "--replay", "log"]) == len(unlike)
    assert capsys.readouterr().out.splitlines() == ["reason of the log: why", str(found)]


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
