"""`hapscene play` with the mouse, on a simulated servo."""

import os
import signal
import threading
import urllib.request
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")

from hapscene.cli import main
from hapscene.cli.play import _devices
from hapscene.errors import DeviceError
from tests.virtual_clock import PATIENCE_S


class FakeServo:
    """A servo without a process, which records the calls."""

    def __init__(self, scene: Any, devices: Any, **made: Any) -> None:
        self.scene, self.tick_s, self.tools, self.closed = scene, 1e-3, len(devices), False
        self.pages: list[bytes] = []
        self.volumes: list[float] = []
        made_servos.append(self)

    def __enter__(self) -> "FakeServo":
        return self

    def __exit__(self, *error: object) -> None:
        self.closed = True

    def handle_report(self) -> dict[str, float]:
        return {"latency_s": 0.02}

    def turn_handle(self, volume: float) -> None:
        self.volumes.append(volume)

    def stop_force(self) -> None:
        """There is no force."""

    def start(self, places: Any) -> None:
        assert len(places) == self.tools

    def state(self, tool: int = 0) -> Any:
        return None


class FakeMonitor:
    """Fetches the page at the first poll, and ends the command."""

    def __init__(self, servo: FakeServo) -> None:
        self._servo = servo

    def lines(self) -> list[str]:
        if not self._servo.pages:
            (url,) = urls
            self._servo.pages.append(urllib.request.urlopen(url).read())
            os.kill(os.getpid(), signal.SIGINT)
        return []

    def summary(self) -> list[str]:
        return []

    def close(self) -> None:
        """Nothing is open."""


made_servos: list[FakeServo] = []
urls: list[str] = []


def test_play_serves_the_page_and_writes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.play.start.Servo", FakeServo)
    monkeypatch.setattr("hapscene.play.monitor.Monitor", FakeMonitor)
    monkeypatch.setattr("hapscene.cli.play.QUIET_S", 0.0)
    monkeypatch.setattr("hapscene.play.page_server.scene_json", lambda scene, title: "{}")
    monkeypatch.setattr("webbrowser.open", urls.append)
    before = set(threading.enumerate())
    assert main(["play"]) == 0
    (servo,) = made_servos
    assert b"<canvas" in servo.pages[0]
    assert servo.closed
    assert servo.volumes == [0.0]  # until the user starts it
    others = "Dask"  # another test's
    for thread in set(threading.enumerate()) - before:
        if not thread.name.startswith(others):
            thread.join(PATIENCE_S)
            assert not thread.is_alive()
    with pytest.raises(OSError):
        urllib.request.urlopen(urls[0])


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
