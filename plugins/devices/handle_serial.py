"""A handle on a serial port or USB CDC: docs/reference/handle-protocol.md, firmware in examples/handle_firmware."""

from typing import Any, Final

from hapscene.device.driver import Driver, Option
from hapscene.device.serial_port import find_ports
from hapscene.errors import HandleError
from hapscene.handle.board import LiveBoard, SerialWire
from hapscene.io.files import refusing
from hapscene.io.probe_port import BAUD

BOARD: Final = (
    Option("limit_N", 3.0, "force limit [N]"),
    Option("ahead_s", 0.015, "force in the board's buffer, the latency [s]"),
    Option("watchdog_s", 0.02, "time without data after which the board stops the force [s]"),
    Option("highpass_Hz", 15.0, "corner of the high-pass filter [Hz]; 0 disables the filter"),
    Option("lag_s", 0.005, "reserve of the channel against delayed ticks [s]"),
)
"""Options of a board on any connection."""

UNTRIED: Final = ("The firmware in examples/handle_firmware was tested on a computer, not on a board.",)


def open_handle(port: str, baud: int, **board: Any) -> LiveBoard:
    """Open the port and wait for the board.

    Raises:
        HandleError: no such port, no answer, or the device is not a handle that plays live.
    """
    if not port:
        raise HandleError("option port is missing: name the serial port, such as port=/dev/ttyACM0 or port=COM3")
    with refusing(HandleError):
        wire = SerialWire(port, baud)
    return LiveBoard(port, wire, **board)


DRIVER = Driver(
    name="serial",
    summary="Handle: a board with a current amplifier on a serial port.",
    open_handle=open_handle,
    find=lambda port="", **options: find_ports(port),
    force=False,
    needs="a serial port, and permission for it (Linux: group dialout)",
    options=(
        Option("port", "", "serial port of the board, such as /dev/ttyACM0 or COM3"),
        Option("baud", BAUD, "speed of the port [bit/s]; ignored by USB CDC ports"),
        *BOARD,
    ),
    watchdog_s=0.02,
    assumptions=UNTRIED,
)
