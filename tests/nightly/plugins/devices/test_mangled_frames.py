"""10⁵ frames a driver, half of them mangled, in the memory of this process: a wire takes 1 ms for each."""

import ctypes
import json
import random
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.clock import VIRTUAL
from hapscene.device.serial_port import LINE as SERIAL_LINE
from hapscene.device.serial_port import SerialLine
from hapscene.errors import DeviceError
from hapscene.records import records
from hapscene_plugins.devices import falcon, falcon_board, haply2diy, haply2diy_board, inverse3, woodenhaptics
from hapscene_plugins.devices.compiled_connection import CompiledConnection
from hapscene_plugins.devices.usb_transfers import COMPLETED, LINE, PACKET, PENDING, TRANSFER, UsbLine
from tests.nightly.plugins.devices.emulators.emulator import Emulator
from tests.virtual_clock import VirtualClock

COUNT = 100_000

SOURCE = SimpleNamespace(mangled=0.5, random=random.Random(7))

accept = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)(lambda *arguments: 0)
"""In place of libusb's functions: nothing happens."""


class Usb:
    """Two endpoints whose reads complete with the given packets."""

    def __init__(self) -> None:
        state, buffers = records(1, LINE)[0], np.zeros((3, PACKET), np.uint8)
        state.submit = state.handle_events = ctypes.cast(accept, ctypes.c_void_p).value
        transfers = tuple(records(1, TRANSFER)[0] for _ in range(3))
        for transfer in transfers[:2]:
            transfer.status = PENDING
        own = np.zeros(3, np.uint64), buffers, np.zeros(PACKET, np.uint8), np.zeros(2, np.int64)
        self.line = UsbLine(state, transfers, *own)

    def put(self, frame: bytes) -> None:
        turn = int(self.line.state.turn)
        self.line.buffers[turn, : len(frame)] = np.frombuffer(frame, np.uint8)
        self.line.transfers[turn].actual_length, self.line.transfers[turn].status = len(frame), COMPLETED

    def sent(self) -> bytes:
        self.line.transfers[2].status = COMPLETED
        return self.line.buffers[2, : self.line.transfers[2].length].tobytes()


class Serial:
    """A port that has received the given bytes."""

    def __init__(self) -> None:
        self.line = SerialLine(
            records(1, SERIAL_LINE)[0], np.zeros(256, np.uint8), np.zeros(64, np.uint8), np.zeros(2, np.int32)
        )
        self.line.state.file = -1

    def put(self, frame: bytes) -> None:
        received = int(self.line.state.received)
        self.line.input[received : received + len(frame)] = np.frombuffer(frame, np.uint8)
        self.line.state.received += len(frame)

    def sent(self) -> bytes:
        unsent, self.line.state.unsent = int(self.line.state.unsent), 0
        return self.line.output[:unsent].tobytes()


def connection_of(kind: type[CompiledConnection], board: Any, port: Any, functions: Any) -> Any:
    """A connection of a driver to a port in memory."""
    device: Any = kind.__new__(kind)
    CompiledConnection.__init__(device, board, *functions)
    device._port = device._transfers = port
    device._clock[VIRTUAL] = 10**12
    return device


def falcon_parts() -> tuple[Any, Any, bytes, bytes]:
    port, board, packet = Usb(), records(1, falcon_board.BOARD)[0], np.zeros(16, np.uint8)
    board.p, board.theta = (0.0, 0.0, falcon_board.MIDDLE_M), (falcon_board.ZERO_RAD,) * 3
    falcon_board.pack(packet, (-500, -510, -520), 0)
    device = connection_of(falcon.FalconConnection, board, port, (falcon_board.read_board, falcon_board.write_board))
    return device, port, b"\x01\x60" + packet.tobytes(), falcon_board.REST


def woodenhaptics_parts() -> tuple[Any, Any, bytes, bytes]:
    port, board = Usb(), records(1, woodenhaptics.BOARD)[0]
    board.signs, board.angles = (1.0, -1.0, -1.0), woodenhaptics.body_angles((0, 0, 0))
    functions = woodenhaptics.read_board, woodenhaptics.write_board
    device = connection_of(woodenhaptics.WoodenHapticsConnection, board, port, functions)
    return device, port, woodenhaptics.REPORT.pack(500, -4000, 1000, 0), woodenhaptics.REPORT.pack(0, 0, 0, 0)


def haply2diy_parts() -> tuple[Any, Any, bytes, bytes]:
    port, board = Serial(), records(1, haply2diy_board.BOARD)[0]
    board.base_m = haply2diy_board.HARDWARE["v3"].base_m
    functions = haply2diy_board.read_board, haply2diy_board.write_board
    device = connection_of(haply2diy.Haply2diyConnection, board, port, functions)
    frame = haply2diy_board.ANSWER.pack(haply2diy_board.ID, 60.0, 120.0)
    return device, port, frame, haply2diy_board.run_message((0.0, 0.0))


@pytest.mark.parametrize("parts", [falcon_parts, woodenhaptics_parts, haply2diy_parts])
def test_mangled_frames_give_no_force_and_places_that_can_be(parts: Callable[[], Any]) -> None:
    """The device is not ready. A valid frame updates its position, and any frame leaves one that it can have."""
    device, port, frame, zero = parts()
    (read, write), state, updated = device._calls(), device.state[0], 0
    for i in range(COUNT):
        port.put(Emulator.mangle(SOURCE, frame))  # type: ignore[arg-type]
        count = int(state.count)
        read()
        updated += int(state.count) > count
        state.f_D_N = 1.0
        write()
        assert port.sent() == zero, i
        assert max(map(abs, state.p_DT_m.tolist())) < 1.0, (i, state.p_DT_m)  # not NaN either
    assert COUNT / 4 < updated < COUNT


def test_mangled_states_of_the_inverse3_give_no_force_and_places_that_can_be() -> None:
    device: Any = inverse3.Inverse3Connection.__new__(inverse3.Inverse3Connection)
    sent: list[bytes] = []
    entry = {"device_id": "05DA", "state": {"cursor_position": {"x": 0.06, "y": -0.13, "z": 0.16}, "transform": {}}}
    entry |= {"status": {"calibrated": False, "ready": True}}
    grip = {"state": {"button": False, "orientation": {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}}}
    frame = json.dumps({"session_id": 1, "inverse3": [entry], "verse_grip": [grip]}).encode()
    inverse3.Connection.__init__(device)
    device._middle, device._name, device._field, device._id = (0.05, -0.15, 0.17), "inverse3", "vector", "05DA"
    device._status, device._ignored, device._pending = {}, 0, 0
    device._timeout = inverse3.ResponseTimeout(VirtualClock())
    device._link = SimpleNamespace(send=sent.append, receive=lambda wait_s: Emulator.mangle(SOURCE, frame))  # type: ignore[arg-type]
    device.write()
    zero = sent[0]
    for i in range(COUNT):
        device._pending = 1
        try:
            device.read()
        except DeviceError:  # no valid state for long
            device._timeout.received()
        device.state.f_D_N = 1.0
        device.write()
        assert sent.pop() == zero, i
        assert max(map(abs, device.state.p_DT_m[0].tolist())) < 2.0, i
        assert np.isfinite(device.state.R_DT).all()
    assert COUNT / 4 < device.state.count[0] < COUNT
