"""A handle of one's own on a serial port, or USB's own (CDC): docs/handle-protocol.md, examples/handle_firmware."""

from hapscene.errors import HandleError
from hapscene.files import refusing
from hapscene.handle.live_board import LiveBoard
from hapscene.handle.serial_handle import SerialWire
from hapscene.wire.port import BAUD


class SerialHandle(LiveBoard):
    """Plays on a board with a current amplifier, as a `HandleOutput`."""

    def __init__(
        self,
        port: str = "",
        baud: int = BAUD,
        limit_N: float = 3.0,
        ahead_s: float = 0.015,
        watchdog_s: float = 0.02,
        highpass_Hz: float = 15.0,
        lag_s: float = 0.005,
    ) -> None:
        """Opens the port and waits for the board; `port` and `baud` are the port's, the others `LiveBoard`'s.

        Raises:
            HandleError: no such port, silence, or something else than a handle that plays live.
        """
        if not port:
            raise HandleError("which port? option port=/dev/ttyACM0, COM3, …")
        with refusing(HandleError):
            wire = SerialWire(port, baud)
        super().__init__(port, wire, limit_N, ahead_s, watchdog_s, highpass_Hz, lag_s)
