"""Connection to a USB device that compiled code reads and writes. Not a driver."""

import time
from collections.abc import Callable
from typing import Any

from hapscene.clock import now_ns
from hapscene.compiled.bound_call import BoundCall
from hapscene.compiled.native import INTERPRETED
from hapscene.device.response_timeout import PAUSE_S
from hapscene.device.serial_port import DISCONNECTED, WRITE_S
from hapscene.errors import DeviceError
from hapscene_plugins.devices.compiled_connection import CompiledConnection
from hapscene_plugins.devices.usb_device import UsbDevice
from hapscene_plugins.devices.usb_transfers import Transfers


class UsbConnection(CompiledConnection):
    """Base class of an open device on USB that compiled code reads and writes."""

    _transfers: Transfers

    def __init__(self, usb: UsbDevice, board: Any, reads: Callable[[Any], None], writes: Callable[[Any], None]) -> None:
        super().__init__(board, reads, writes)
        self._usb = usb

    def _submit(self, ends: tuple[int, int]) -> None:
        """Start the transfers from and to a pair of endpoints."""
        self._transfers, self._bound = self._usb.transfers(ends), None

    def compiled(self) -> tuple[BoundCall, BoundCall] | None:
        return None if INTERPRETED else self._calls()

    def read(self) -> None:
        """Update the state. After a pause, wait for a new position; buffered ones are from before it."""
        end_s, count = time.perf_counter() + WRITE_S, int(self.state.count[0])
        paused, force_N = now_ns(self._clock) - self._board.polled_ns > PAUSE_S * 1e9, self.state.f_D_N.copy()
        self._calls()[0]()
        while paused and self.state.count[0] == count and time.perf_counter() < end_s:
            self.state.f_D_N = 0.0
            self.write()  # some devices send a position only as an answer
            time.sleep(1e-3)
            self._calls()[0]()
        self.state.f_D_N = force_N
        self.check()

    def write(self) -> None:
        self._transfers.wait(WRITE_S, 2)
        self._calls()[1]()
        self.check()

    def check(self) -> None:
        problem = self._transfers.line.state.problem
        if problem:
            reason = "disconnected" if problem == DISCONNECTED else "accepts no data"
            raise DeviceError(f"{self._name}: {reason}; reconnect it")
        super().check()
