"""A board on USB's bulk endpoints, behind a backend of pyusb that has one plugged in."""

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("usb", reason="no pyusb: extra `usb`")
from hapscene.handle import live_board, usb_simulator
from hapscene.handle.live_process import open_output
from tests.until import PATIENCE_S, until

BACKEND = "hapscene.handle.usb_simulator"


@pytest.fixture(autouse=True)
def plugged_in(monkeypatch: pytest.MonkeyPatch) -> Iterator[usb_simulator.Backend]:
    backend = usb_simulator.Backend()
    monkeypatch.setattr(usb_simulator, "_BACKEND", backend)
    yield backend


def test_a_board_that_is_torn_out_is_told(plugged_in: usb_simulator.Backend) -> None:
    handle = open_output("usb", {"backend": BACKEND})
    handle.start(Silence())
    plugged_in.unplugged = True
    until(lambda: handle.fault)
    handle.close()
    assert "no such device" in handle.fault or "handle went away" in handle.fault


class FullPackets(usb_simulator.Backend):
    """Its board sends no short packet: a read ends when its buffer is full.

    Its time goes on with what is read, and once it plays stands still until the last read was answered: a computer that
    answers at once, however busy it is.
    """

    def __init__(self) -> None:
        super().__init__()
        self._answered, self._plays, self.over = threading.Event(), False, False
        self._answered.set()

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        size = super().bulk_write(dev_handle, ep, intf, data, timeout)
        self._plays = not bytes(data).startswith(b"#")
        self._answered.set()
        return size

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        until(lambda: self.over or self._answered.wait(0.05))
        if self._plays:
            self._answered.clear()
        while len(self._rest) < len(buff):
            self._rest += self.peer.give(10)
        part, self._rest = self._rest[: len(buff)], self._rest[len(buff) :]
        memoryview(buff).cast("B")[:] = part
        return len(part)


def test_a_board_that_sends_full_packets_plays_without_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usb_simulator, "_BACKEND", backend := FullPackets())
    monkeypatch.setattr(live_board, "AGAIN_S", PATIENCE_S)
    monkeypatch.setattr(live_board, "GONE_S", PATIENCE_S)
    handle = open_output("usb", {"backend": BACKEND, "watchdog_s": "0.5"})
    handle.start(feed := Silence(0.1))
    until(lambda: sum(map(len, feed.heard)) > 5000)
    backend.over = True
    handle.close()
    force = np.concatenate(feed.heard)
    assert handle.counts == dict.fromkeys(handle.counts, 0)
    assert not np.any(force[np.flatnonzero(force)[0] :] == 0.0)


class Silence:
    def __init__(self, level: float = 0.0) -> None:
        self.level = level
        self.heard: list[np.ndarray] = []

    def pull(self, out: np.ndarray) -> None:
        out[:] = self.level

    def fade_in(self) -> None:
        pass

    def hear(self, numbers: np.ndarray, force: np.ndarray, acceleration: np.ndarray) -> None:
        self.heard.append(np.nan_to_num(force))
