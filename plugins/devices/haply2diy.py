"""Haply 2DIY, a planar pantograph, over its serial port.

The protocol is that of the board's firmware (Haply-Arduino-Firmware-Versions, Haply_M3_Firmware_V1_5): no frames, no
checksum, float32, little-endian. The device's axes H: x to the left, y towards the hand.

The board has no watchdog: it holds the last torque indefinitely. Therefore every exit path sends zero torque.
"""

import os
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from hapscene.compiled.bound_call import BoundCall
from hapscene.device.driver import Driver, Option
from hapscene.device.model import Device, Limits
from hapscene.device.serial_port import SERIAL_MODULES, SerialPort, find_ports
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.records import records
from hapscene_plugins.devices.compiled_connection import CompiledConnection
from hapscene_plugins.devices.haply2diy_board import (
    BOARD,
    HARDWARE,
    Board,
    read_board,
    run_message,
    setup_message,
    write_board,
)

BAUD: Final = 115_200
"""Speed of the port [bit/s]. The board has native USB and ignores it, except that 1,200 erases the firmware."""

HOME: Final = "move both arms to their marks"


class Haply2diyConnection(CompiledConnection):
    """An open 2DIY. Each tick sends torques and receives the angles of the arms."""

    _remedy = "check that it is the board of a 2DIY"

    def __init__(self, port: str | None = None, hardware: str = "v3", homed: bool = False) -> None:
        self._port = SerialPort("haply2diy", port, BAUD)
        super().__init__(records(1, BOARD)[0], read_board, write_board)
        self._name, self._hardware = self._port.name, HARDWARE[hardware]
        self._board.base_m, self._board.homed = self._hardware.base_m, int(homed)
        try:
            self._set_up()
        except BaseException:
            self.close()
            raise

    def _set_up(self) -> None:
        self._port.write(setup_message(self._hardware) + run_message((0.0, 0.0)))

    def _argument(self) -> tuple[Any, ...]:
        pair, message = np.zeros(2, np.float32), np.frombuffer(run_message((0.0, 0.0)), np.uint8).copy()
        return Board(self._board, self.state[0], self._port.line, pair, pair.view(np.uint8), message, self._clock)

    def home(self) -> None:
        self._board.homed, self._board.known = 1, 0
        self._set_up()

    def compiled(self) -> tuple[BoundCall, BoundCall] | None:
        return None if self._port.line.state.file < 0 else self._calls()

    def read(self) -> None:
        self._port.exchange()
        self._calls()[0]()
        self.check()

    def write(self) -> None:
        self._calls()[1]()
        self._port.exchange()
        self._port.check()

    def check(self) -> None:
        self._port.check()
        super().check()

    def close(self) -> None:
        self._port.close(run_message((0.0, 0.0)))  # until it accepts this, the board holds its last torque

    def reason(self, trouble: int) -> str:
        return f"the arm position is not calibrated: {HOME}, and press h" if trouble else ""


def release(port: str | None = None, **options: Any) -> None:
    """Send zero torque after the driver process has died."""
    device = SerialPort("haply2diy", port, BAUD, alone=False)
    try:
        device.write(run_message((0.0, 0.0)))
        device.flush()
    finally:
        device.close()


def prepare_release(port: str | None = None, **options: Any) -> Callable[[], object]:
    """Open the port a second time; returns a function that sends zero torque."""
    if os.name != "posix":
        raise DeviceError("haply2diy: a serial port is opened once only on this system")
    return partial(SerialPort("haply2diy", port, BAUD, alone=False).write, run_message((0.0, 0.0)))


DRIVER = Driver(
    name="haply2diy",
    summary="Haply 2DIY, versions 2 and 3, planar, over its serial port.",
    open=Haply2diyConnection,
    find=lambda port=None, **options: find_ports(port),
    model=Device(
        "haply2diy", PointMass(0.1, 0.1, 0.1, 60e-6), Limits(3.0, 3000.0, stiffness_N_m=500.0, damping_Ns_m=2.0)
    ),
    continuous_N=1.0,
    low_D_m=(-0.08, -0.07, -0.001),
    high_D_m=(0.08, 0.07, 0.001),
    rate_Hz=1000.0,
    needs="a serial port, and permission for it",
    home=HOME,
    imports=SERIAL_MODULES,
    options=(
        Option("port", None, "serial port, such as /dev/ttyACM0 or COM3; by default the only one that is connected"),
        Option("hardware", "v3", "hardware version", tuple(HARDWARE)),
        Option("homed", False, "whether the arms are at their marks when it is opened"),
    ),
    release=release,
    prepare_release=prepare_release,
    assumptions=(
        "It lies in front of the hand with its arms towards the hand; there is no force along z.",
        "Force, mass, damping and friction are estimates; the firmware limits torques to 0.123 N·m.",
        "Angles are measured from the marks at which the arms are at the last setup message.",
    ),
)
