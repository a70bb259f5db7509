"""USB transfers for compiled code, which sends and receives packets without waiting. Not a driver.

libusb submits a transfer to the system, which completes it while the tick goes on. Reads are always submitted, so that
a packet that arrives between two ticks is in memory at the next. libnifalcon transfers packets in the same way
(src/comm/FalconCommLibUSB.cpp).
"""

import ctypes
import time
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from hapscene.compiled.entry import c_caller
from hapscene.compiled.native import INTERPRETED, native
from hapscene.device.driver import clip_force
from hapscene.device.serial_port import DISCONNECTED, REFUSED, WRITE_S
from hapscene.errors import DeviceError
from hapscene.geometry import Vector
from hapscene.records import Record, records

__all__ = ["PACKET", "PACKETS_MAX", "Transfers", "UsbLine", "clip", "discard", "receive", "send"]

PACKET: Final = 64
"""Largest packet of an endpoint at full speed [bytes]."""

PACKETS_MAX: Final = 8
"""Most packets that a tick processes [count]."""

TRANSFER: Final = np.dtype(
    [
        ("device_handle", "u8"),
        ("flags", "u1"),
        ("endpoint", "u1"),
        ("type", "u1"),
        ("timeout_ms", "u4"),
        ("status", "i4"),  # written by libusb when the transfer ends
        ("length", "i4"),
        ("actual_length", "i4"),
        ("callback", "u8"),  # 0: none
        ("user_data", "u8"),
        ("buffer", "u8"),
        ("packet_count", "i4"),
    ],
    align=True,
)
"""`struct libusb_transfer` of libusb 1.0."""

PENDING: Final = -1
"""Status of a transfer that the system has not completed; not a value of libusb."""

COMPLETED, TIMED_OUT, OVERFLOW = 0, 2, 6

LINE: Final = np.dtype(
    [
        ("submit", "u8"),  # address of libusb_submit_transfer
        ("handle_events", "u8"),  # of libusb_handle_events_timeout_completed
        ("context", "u8"),  # of libusb
        ("turn", "i8"),  # the read that completes next
        ("received", "i8"),  # number of bytes in `UsbLine.packet`
        ("accepted_ns", "i8"),  # time at which the device last accepted a packet
        ("problem", "i8"),  # DISCONNECTED or REFUSED; 0: no problem
    ],
    align=True,
)
"""State of a `UsbLine`."""


class UsbLine(NamedTuple):
    """Two endpoints of an open USB device."""

    state: Record  # LINE
    transfers: tuple[Record, Record, Record]  # TRANSFER, in the memory of libusb: two reads and a write
    addresses: NDArray[np.uint64]  # (3,) of the transfers
    buffers: NDArray[np.uint8]  # (3, PACKET) of the transfers
    packet: NDArray[np.uint8]  # (PACKET,) the last packet
    wait: NDArray[np.int64]  # (2,) a `struct timeval`


_submit: Any
_handle_events: Any

if INTERPRETED:

    def _submit(address: int, arguments: tuple[int, ...]) -> int:
        kind = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * len(arguments))
        return int(kind(int(address))(*map(int, arguments)))

    _handle_events = _submit
else:
    _submit = c_caller(types.int32, types.uintp)
    _handle_events = c_caller(types.int32, types.uintp, types.uintp, types.uintp)


@native
def _start(line: UsbLine, k: int) -> None:
    """Submit a transfer."""
    line.transfers[k].status = PENDING
    if _submit(np.uintp(line.state.submit), (np.uintp(line.addresses[k]),)) != 0:
        line.state.problem = DISCONNECTED


@native
def receive(line: UsbLine, wait_ns: int) -> bool:
    """Copy the next packet to `line.packet`; False if none arrives within a time [ns]."""
    state, k = line.state, line.state.turn
    if state.problem != 0:  # the transfers may have been released
        return False
    transfer = line.transfers[k]
    if transfer.status == PENDING:
        line.wait[1] = wait_ns // 1000
        arguments = np.uintp(state.context), np.uintp(line.wait.ctypes.data), np.uintp(0)
        _handle_events(np.uintp(state.handle_events), arguments)
    if transfer.status == PENDING:
        return False
    if transfer.status != COMPLETED and transfer.status != TIMED_OUT and transfer.status != OVERFLOW:
        state.problem = DISCONNECTED
        return False
    state.received = transfer.actual_length
    for i in range(state.received):
        line.packet[i] = line.buffers[k, i]
    _start(line, k)
    state.turn = 1 - k
    return True


@native
def discard(line: UsbLine) -> None:
    """Discard the packets that have arrived."""
    for _ in range(PACKETS_MAX):
        if not receive(line, 0):
            return


@native
def send(line: UsbLine, message: NDArray[np.uint8], now: int) -> None:
    """Send a packet at a time `now` [ns]. If the device has not accepted the one before, it is dropped."""
    state, transfer = line.state, line.transfers[2]
    if state.problem != 0:
        return
    if transfer.status == PENDING:
        if now - state.accepted_ns > WRITE_S * 1e9:
            state.problem = REFUSED
    elif transfer.status != COMPLETED:
        state.problem = DISCONNECTED
    else:
        state.accepted_ns = now
        for i in range(len(message)):
            line.buffers[2, i] = message[i]
        transfer.length = len(message)
        _start(line, 2)


clip: Final[Callable[[Vector, float], Vector]] = native(clip_force)
"""`clip_force` for compiled code: of a force (x, y, z)."""


class Transfers:
    """Transfers of a device that pyusb has opened, from their submission until `close`.

    Attributes:
        line: the transfers for compiled code.
    """

    def __init__(self, usb: Any, ends: tuple[int, int]) -> None:
        """Submit the reads of a device of pyusb. `ends` are the addresses of its IN and OUT endpoint.

        Raises:
            DeviceError: the backend has no such transfers.
        """
        if not hasattr(getattr(usb.backend, "lib", None), "libusb_submit_transfer"):
            raise DeviceError("a device with force needs libusb 1.0; use --option backend=libusb1")
        self._lib, self._open = usb.backend.lib, True
        allocate = self._lib["libusb_alloc_transfer"]
        allocate.restype = ctypes.c_void_p
        addresses = [allocate(0) for _ in range(3)]
        views: list[Any] = [(ctypes.c_ubyte * TRANSFER.itemsize).from_address(address) for address in addresses]
        first, second, write = (np.frombuffer(view, TRANSFER).view(np.recarray)[0] for view in views)
        state, buffers = records(1, LINE)[0], np.zeros((3, PACKET), np.uint8)
        own = np.array(addresses, np.uint64), buffers, np.zeros(PACKET, np.uint8), np.zeros(2, np.int64)
        self.line = UsbLine(state, (first, second, write), *own)
        state.submit = _address_of(self._lib.libusb_submit_transfer)
        state.handle_events = _address_of(self._lib.libusb_handle_events_timeout_completed)
        state.context = usb.backend.ctx.value
        kinds = {end.bEndpointAddress: end.bmAttributes & 3 for end in usb.get_active_configuration()[(0, 0)]}
        for k, transfer in enumerate(self.line.transfers):
            transfer.device_handle = usb._ctx.handle.handle.value  # pyusb has no public name for it
            transfer.endpoint, transfer.type = ends[k == 2], kinds[ends[k == 2]]
            transfer.length, transfer.buffer = PACKET, buffers[k].ctypes.data
            if k < 2:
                _start(self.line, k)

    def wait(self, timeout_s: float, *which: int) -> None:
        """Wait until transfers have ended; 2 is the write. After `close`, return at once."""
        line, end_s = self.line, time.monotonic() + timeout_s
        line.wait[1] = 1000
        arguments = int(line.state.context), int(line.wait.ctypes.data), 0
        while self._open and any(line.transfers[k].status == PENDING for k in which) and time.monotonic() < end_s:
            self._lib["libusb_handle_events_timeout_completed"](*map(ctypes.c_void_p, arguments))

    def close(self) -> None:
        """Release the transfers; those that have not ended are cancelled, the write after `WRITE_S`."""
        self.wait(WRITE_S, 2)
        for k, transfer in enumerate(self.line.transfers):
            pointer = ctypes.c_void_p(int(self.line.addresses[k]))
            self._lib["libusb_cancel_transfer"](pointer)
            self.wait(WRITE_S, k)
            if transfer.status != PENDING:  # otherwise the system may still write to it
                self._lib["libusb_free_transfer"](pointer)
        self._open, self.line.state.problem = False, DISCONNECTED


def _address_of(function: Any) -> int:
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)
