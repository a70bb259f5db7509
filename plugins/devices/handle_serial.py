"""A handle of one's own on a serial port, or USB's own (CDC): docs/handle-protocol.md, examples/handle_firmware."""

from typing import Any, Final

from hapscene.device.driver import Driver, Option
from hapscene.errors import HandleError
from hapscene.handle.live_board import LiveBoard
from hapscene.handle.serial_handle import SerialWire
from hapscene.io.files import refusing
from hapscene.io.wire.port import BAUD
from hapscene_plugins.devices.serial_port import find_ports

BOARD: Final = (
    Option("limit_N", 3.0, "largest force that it is sent [N]"),
    Option("ahead_s", 0.015, "how much force it has in hand [s]"),
    Option("watchdog_s", 0.02, "after how long without a word it puts out none [s]"),
    Option("highpass_Hz", 15.0, "what is lower is left out [Hz]; 0 for nothing"),
    Option("lag_s", 0.005, "how much of the channel is kept in hand beside that [s]"),
)
"""Options of a board, whatever it hangs on."""

UNTRIED: Final = ("The sketch in examples/handle_firmware was tried on a computer, on no board.",)


def open_handle(port: str, baud: int, **board: Any) -> LiveBoard:
    """Opens the port and waits for the board.

    Raises:
        HandleError: no such port, silence, or something else than a handle that plays live.
    """
    if not port:
        raise HandleError("which port? option port=/dev/ttyACM0, COM3, …")
    with refusing(HandleError):
        wire = SerialWire(port, baud)
    return LiveBoard(port, wire, **board)


DRIVER = Driver(
    name="serial",
    summary="A board with a current amplifier on a serial port (a handle).",
    open_handle=open_handle,
    find=lambda port="", **options: find_ports(port),
    force=False,
    needs="a port, and permission for it (Linux: group dialout)",
    options=(
        Option("port", "", "of the board: /dev/ttyACM0, COM3, …"),
        Option("baud", BAUD, "speed of the port [bit/s]; USB's own ports ignore it"),
        *BOARD,
    ),
    watchdog_s=0.02,
    assumptions=UNTRIED,
)
