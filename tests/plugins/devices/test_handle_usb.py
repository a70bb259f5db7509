"""A board on USB's bulk endpoints, behind a backend of pyusb that has one plugged in."""

import errno
import sys
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("usb", reason="no pyusb: extra `usb`")
import usb.core

from hapscene.errors import DeviceError, HandleError
from hapscene.handle import board as live_board
from hapscene.handle.live_process import compensator_of, open_output, play_recording
from hapscene.handle.live_stream import LiveStream
from hapscene_plugins.devices.handle_usb import DRIVER
from hapscene_plugins.devices.usb_device import UsbDevice
from tests.handle import usb_board
from tests.virtual_clock import PATIENCE_S

BACKEND = "tests.handle.usb_board"


class FullPackets(usb_board.Backend):
    """A board that sends no short packets, so that a read ends when its buffer is full.

    Its time advances with the reads. While it plays, its time waits for the answer to the last read, so the test does
    not depend on the load of the computer.
    """

    def __init__(self) -> None:
        super().__init__()
        self._answered, self._plays = threading.Event(), False
        self._answered.set()

    def end(self) -> None:
        """Stop waiting for answers."""
        self._plays = False
        self._answered.set()

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        size = super().bulk_write(dev_handle, ep, intf, data, timeout)
        self._plays = not bytes(data).startswith(b"#")
        self._answered.set()
        return size

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        assert self._answered.wait(PATIENCE_S)
        if self._plays:
            self._answered.clear()
        while len(self._rest) < len(buff):
            self._rest += self.peer.give(10)
        part, self._rest = self._rest[: len(buff)], self._rest[len(buff) :]
        memoryview(buff).cast("B")[:] = part
        return len(part)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> FullPackets:
    """A board of this kind, without timeouts."""
    monkeypatch.setattr(usb_board, "_BACKEND", backend := FullPackets())
    monkeypatch.setattr(live_board, "AGAIN_S", PATIENCE_S)
    monkeypatch.setattr(live_board, "GONE_S", PATIENCE_S)
    return backend


@pytest.fixture(autouse=True)
def plugged_in(monkeypatch: pytest.MonkeyPatch) -> Iterator[usb_board.Backend]:
    backend = usb_board.Backend()
    monkeypatch.setattr(usb_board, "_BACKEND", backend)
    yield backend


def test_an_acceleration_is_played_by_a_compensator_and_measured(
    patient: FullPackets, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hand of the simulated handle differs from the assumed one, which matters little at 200 Hz."""
    output: Any = open_output("usb", {"backend": BACKEND, "watchdog_s": "0.2", "ahead_s": "0.05"})
    wanted = 5.0 * np.sin(2.0 * np.pi * 200.0 * np.arange(6000) / 1e4)
    read: list[np.ndarray] = []
    monkeypatch.setattr(LiveStream, "receive_feedback", lambda stream, numbers, *values: read.append(np.array(values)))
    stream = play_recording(wanted, 1e4, output, compensator_of(output, None))
    force, acceleration = np.hstack(read)
    strong = acceleration[np.flatnonzero(np.abs(force) > 0.3)[0] :][750:2250]
    assert np.sqrt(2.0 * np.mean(strong**2)) == pytest.approx(5.0, rel=0.1)
    assert output.counts["restarts"] == output.counts["lost"] == 0 and stream.counts["clipped"] == 0


def test_a_disconnected_board_is_reported(plugged_in: usb_board.Backend) -> None:
    handle = open_output("usb", {"backend": BACKEND})
    handle.start(ConstantFeed())
    plugged_in.unplugged = True
    handle._thread.join(PATIENCE_S)
    handle.close()
    assert "disconnected" in handle.fault


def test_a_board_that_sends_full_packets_plays_without_gaps(patient: FullPackets) -> None:
    handle = open_output("usb", {"backend": BACKEND, "watchdog_s": "0.5"})
    handle.start(feed := ConstantFeed(0.1))
    assert feed.enough.wait(PATIENCE_S)
    patient.end()
    handle.close()
    force = np.concatenate(feed.forces)
    assert handle.counts == dict.fromkeys(handle.counts, 0)
    assert not np.any(force[np.flatnonzero(force)[0] :] == 0.0)


class ConstantFeed:
    def __init__(self, level: float = 0.0) -> None:
        self.level = level
        self.forces: list[np.ndarray] = []
        self.enough = threading.Event()  # 5,000 measurements were received

    def pull(self, out: np.ndarray) -> None:
        out[:] = self.level

    def fade_in(self) -> None:
        pass

    def receive_feedback(self, numbers: np.ndarray, force: np.ndarray, acceleration: np.ndarray) -> None:
        self.forces.append(np.nan_to_num(force))
        if sum(map(len, self.forces)) > 5000:
            self.enough.set()


@pytest.mark.parametrize(
    ("options", "name"),
    [({"id": "1234:5678", "backend": BACKEND}, "1234:5678"), ({"backend": "json"}, "backend=json")],
)
def test_a_missing_device_or_backend_is_named(options: dict[str, str], name: str) -> None:
    with pytest.raises(HandleError, match=name):
        open_output("usb", options)


def test_a_board_with_one_endpoint_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usb_board.Backend, "ends", (0x81,))
    with pytest.raises(HandleError, match="endpoint"):
        open_output("usb", {"backend": BACKEND})


@pytest.mark.parametrize(
    ("error", "system", "words"),
    [
        (usb.core.USBError("Resource busy", errno=errno.EBUSY), "linux", "close the other program"),
        (usb.core.USBError("Access denied", errno=errno.EACCES), "linux", '"16c0", ATTR{idProduct}=="05dc"'),
        (NotImplementedError("Operation not supported"), "win32", "install the driver WinUSB"),
    ],
)
def test_an_error_on_opening_names_a_remedy(
    error: Exception, system: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*given: Any) -> None:
        raise error

    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(usb_board.Backend, "set_configuration", refuse)
    with pytest.raises(HandleError) as caught:
        open_output("usb", {"backend": BACKEND})
    assert str(caught.value).startswith(f"usb: cannot be opened: {error}; ") and words in str(caught.value)
    monkeypatch.setattr(usb_board.Backend, "get_configuration", refuse)
    (found,) = DRIVER.find(backend=BACKEND)
    assert found.trouble == f"USB 1:1: cannot be opened: {error}" and words in found.remedy


def test_a_device_is_taken_from_the_system_and_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    for name in (
        *("open_device", "detach_kernel_driver", "set_configuration", "claim_interface", "bulk_write"),
        *("release_interface", "close_device"),
    ):
        monkeypatch.setattr(usb_board.Backend, name, lambda *given, name=name: calls.append(name) or 1, raising=False)
    monkeypatch.setattr(usb_board.Backend, "is_kernel_driver_active", lambda *given: True)
    device = UsbDevice("toy", *usb_board.Backend.ids, BACKEND)
    device.close(0x02, b"0")
    device.close(0x02, b"0")  # does not open it again
    taken = ["open_device", "detach_kernel_driver", "set_configuration", "claim_interface"]
    assert calls == [*taken, "bulk_write", "release_interface", "close_device"]
    calls.clear()
    (found,) = DRIVER.find(backend=BACKEND)
    assert (found.where, found.trouble, found.remedy) == ("USB 1:1", "", "")
    assert calls == ["open_device", "close_device"]


def test_errors_of_a_transfer(plugged_in: usb_board.Backend, monkeypatch: pytest.MonkeyPatch) -> None:
    device = UsbDevice("toy", *plugged_in.ids, BACKEND)
    asked: list[tuple[Any, ...]] = []
    monkeypatch.setattr(plugged_in, "ctrl_transfer", lambda handle, *given: asked.append(given[:4]) or 0)
    device.control(3, 0x4138)
    assert asked == [(0x40, 3, 0x4138, 0)]
    monkeypatch.setattr(plugged_in, "bulk_write", lambda *given: 2)
    with pytest.raises(DeviceError, match="toy: accepted only 2 of 3 bytes"):
        device.write(0x02, b"abc")
    with pytest.raises(DeviceError, match=r"toy: .*libusb1"):
        device.transfers((0x81, 0x02))
    plugged_in.unplugged = True
    monkeypatch.undo()
    for call in (lambda: device.read(0x81, 64, 1), lambda: device.write(0x02, b"abc")):
        with pytest.raises(DeviceError, match="toy: disconnected"):
            call()
    device.close(0x02, b"last")  # raises nothing


def test_a_board_is_listed_and_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    (found,) = DRIVER.find(backend=BACKEND)
    assert found.trouble == ""
    monkeypatch.setitem(sys.modules, "usb.core", None)
    with pytest.raises(HandleError, match=r"pip install 'hapscene\[usb\]'"):
        open_output("usb", {"backend": BACKEND})
