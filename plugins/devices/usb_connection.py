"""Connection to a USB device that compiled code reads and writes. Not a driver."""

import time
from collections.abc import Callable
from typing import Any

from hapscene.clock import new_clock, now_ns
from hapscene.compiled.bound_call import BoundCall
from hapscene.compiled.native import INTERPRETED
from hapscene.device.driver import Connection
from hapscene.device.response_timeout import GONE_S, PAUSE_S, no_answer
from hapscene.device.serial_port import DISCONNECTED, WRITE_S
from hapscene.errors import DeviceError
from hapscene_plugins.devices.usb_device import UsbDevice
from hapscene_plugins.devices.usb_transfers import Transfers


class UsbConnection(Connection):
    """Base class of an open device that compiled code reads and writes.

    A driver sets `_transfers`; `board` is a record with the fields `SILENCE`.
    """

    _name, _remedy = "", ""
    _transfers: Transfers

    def __init__(
        self, usb: UsbDevice, board: Any, reads: Callable[[Any, Any], None], writes: Callable[[Any, Any], None]
    ) -> None:
        super().__init__()
        self._usb = usb
        self._board, self._functions, self._clock = board, (reads, writes), new_clock()
        self._board.polled_ns = now_ns(self._clock)
        self._bound: tuple[Any, Transfers, tuple[BoundCall, BoundCall]] | None = None

    def _argument(self) -> tuple[Any, ...]:
        """The argument of the compiled functions."""
        raise NotImplementedError

    def calls(self) -> tuple[BoundCall, BoundCall]:
        bound = self._bound
        if bound is None or bound[0] is not self.state or bound[1] is not self._transfers:  # the servo moves the state
            argument = self._argument()
            read, write = (BoundCall(function, argument) for function in self._functions)
            bound = self._bound = self.state, self._transfers, (read, write)
        return bound[2]

    def compiled(self) -> tuple[BoundCall, BoundCall] | None:
        return None if INTERPRETED else self.calls()

    def read(self) -> None:
        """Update the state. After a pause, wait for a new position; buffered ones are from before it."""
        end_s, count = time.perf_counter() + WRITE_S, int(self.state.count[0])
        paused, force_N = now_ns(self._clock) - self._board.polled_ns > PAUSE_S * 1e9, self.state.f_D_N.copy()
        self.calls()[0]()
        while paused and self.state.count[0] == count and time.perf_counter() < end_s:
            self.state.f_D_N = 0.0
            self.write()  # some devices send a position only as an answer
            time.sleep(1e-3)
            self.calls()[0]()
        self.state.f_D_N = force_N
        self.check()

    def write(self) -> None:
        self._transfers.wait(WRITE_S, 2)
        self.calls()[1]()
        self.check()

    def check(self) -> None:
        problem = self._transfers.line.state.problem
        if problem:
            reason = "disconnected" if problem == DISCONNECTED else "accepts no data"
            raise DeviceError(f"{self._name}: {reason}; reconnect it")
        if self._board.silent_ns > GONE_S * 1e9:
            raise no_answer(self._name, self._remedy)
