"""Haply 2DIY, a planar pantograph, over its serial port.

The protocol is that of the board's firmware (Haply-Arduino-Firmware-Versions, Haply_M3_Firmware_V1_5): no frames, no
checksum, float32, little-endian. The device's axes H: x to the left, y towards the hand.

The board has no watchdog: it holds the last torque indefinitely. Therefore every exit path sends zero torque.
"""

import errno
import math
import os
import struct
from contextlib import suppress
from typing import Any, Final, NamedTuple

from hapscene.device.driver import Connection, Driver, Option
from hapscene.device.model import Device, Limits
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.haply2diy_kinematics import arm_torques, forward
from hapscene_plugins.devices.response_timeout import ResponseTimeout
from hapscene_plugins.devices.serial_port import PERMISSION, find_ports

try:
    from termios import error as PortError
except ImportError:  # Windows has none
    PortError = OSError  # type: ignore[misc,assignment]

WRITE_S: Final = 0.05
"""Longest time that a write may block [s]."""

CLOSE_S: Final = 1.0
"""Longest time that the final zero torque may block [s]."""

GONE: Final = (OSError, TypeError, PortError)
"""Exceptions of pyserial after a disconnection."""

ID: Final = 5
"""Device id that the board is given; each answer starts with it."""

BAUD: Final = 115_200
"""Speed of the port [bit/s]. The board has native USB and ignores it, except that 1,200 erases the firmware."""

SETUP, RUN = 1, 2
CW, CCW = 0, 1

ANSWER: Final = struct.Struct("<B2f")
TORQUES: Final = struct.Struct("<BB2f")

MIDDLE_M: Final = 0.09
"""y in H of the origin of D."""

JUMP_RAD: Final = math.radians(20.0)
"""Largest plausible rotation of an arm between two answers [rad]. A hand needs tens of milliseconds for it."""


class Hardware(NamedTuple):
    """Parameters of a hardware version. Pairs are by port: second arm, then first arm."""

    direction: tuple[int, int]  # of motors and encoders
    zero_deg: tuple[float, float]  # offsets of the encoders
    counts: float  # per turn of an encoder
    base_m: float  # distance between the axes of the arms


HARDWARE = {
    "v3": Hardware((CCW, CCW), (12.0, 168.0), 4880.0, 0.038),
    "v2": Hardware((CW, CCW), (-61.0, 241.0), 10752.0, 0.0),
}
"""Hardware versions by name. The second arm is connected to port 1, the first arm to port 2."""


def setup_message(hardware: Hardware) -> bytes:
    """Setup message: two motors, two encoders, no sensors, no PWM pins."""
    head = bytes((SETUP, ID, 0b11, *hardware.direction, 0b11, *hardware.direction, 0, 0))
    return head + struct.pack("<4f", hardware.zero_deg[0], hardware.counts, hardware.zero_deg[1], hardware.counts)


def run_message(torques: tuple[float, float]) -> bytes:
    """Message with the torques of the first and the second arm [N·m]."""
    return TORQUES.pack(RUN, ID, torques[1], torques[0])


def open_port(port: str | None, alone: bool = False) -> Any:
    """Open the serial port of the board, with exclusive access if `alone` and supported.

    Raises:
        DeviceError: no port was named and the number of ports is not one; or the port does not exist, is in use, or its
            permissions do not allow it.
    """
    import serial

    if port is None:
        found = find_ports()
        if len(found) != 1:
            names = ", ".join(each.where for each in found) or "not found"
            raise DeviceError(f"haply2diy: name the serial port: --option port=NAME; connected ports: {names}")
        port = found[0].options["port"]
    try:
        exclusive = True if alone and os.name == "posix" else None
        return serial.Serial(port, BAUD, timeout=0.0, write_timeout=0.05, exclusive=exclusive)
    except (OSError, ValueError) as error:
        if getattr(error, "errno", None) == errno.EAGAIN:  # another process holds the lock
            raise DeviceError(f"haply2diy: {port}: in use; close the other program that uses it") from None
        remedy = f"; {PERMISSION}" if getattr(error, "errno", None) == errno.EACCES else ""
        raise DeviceError(f"haply2diy: {port}: cannot be opened: {error}{remedy}") from None


class Haply2diyConnection(Connection):
    """An open 2DIY. Each tick sends torques and receives the angles of the arms."""

    def __init__(
        self, port: str | None = None, hardware: str = "v3", homed: bool = False, clock: Clock = CLOCK
    ) -> None:
        super().__init__()
        self._clock = clock
        self._hardware, self._homed = HARDWARE[hardware], homed
        self._port = open_port(port, alone=True)
        self._name = f"haply2diy: {self._port.port}"
        self._tail, self._theta, self._p, self._timeout = b"", (0.0, 0.0), (0.0, 0.0), ResponseTimeout(clock)
        self._unsent, self._known, self._garbled = b"", False, False
        try:
            self._send(setup_message(self._hardware) + run_message((0.0, 0.0)))
        except BaseException:
            self.close()
            raise

    def _send(self, data: bytes) -> None:
        try:
            if self._garbled:  # lost synchronisation: the next answer starts afresh
                self._port.reset_input_buffer()
                self._tail, self._garbled = b"", False
            self._put(data, WRITE_S)
        except GONE as error:
            raise DeviceError(f"{self._name}: disconnected ({error}); reconnect it") from None

    def _put(self, data: bytes, timeout_s: float) -> None:
        """Write `data` after all unsent bytes. Messages must stay complete: the board separates them by length only.

        Raises:
            OSError: the board accepted nothing for `timeout_s`. The unsent bytes precede the next message.
        """
        self._unsent += data
        end_s = self._clock.now_s() + timeout_s
        while self._unsent:
            if os.name == "posix":
                with suppress(BlockingIOError):
                    self._unsent = self._unsent[os.write(self._port.fileno(), self._unsent) :]
            else:
                self._port.write(self._unsent)
                self._unsent = b""
            if self._unsent:
                if self._clock.now_s() > end_s:
                    raise TimeoutError("it accepts no data")
                self._clock.sleep_s(5e-4)

    def read(self) -> None:
        try:
            if self._known and self._timeout.is_stale():  # buffered answers are from before a pause
                self._port.reset_input_buffer()
                self._tail, self._known = b"", False
            data = self._tail + self._port.read(max(ANSWER.size - len(self._tail), self._port.in_waiting))
        except GONE as error:
            raise DeviceError(f"{self._name}: disconnected ({error}); reconnect it") from None
        self._garbled = len(data) > 4 * ANSWER.size
        while len(data) >= ANSWER.size and not self._garbled:
            self._garbled = not self._take(*ANSWER.unpack_from(data))
            data = data[ANSWER.size :]
        self._tail = b"" if self._garbled else data
        self._timeout.check(self, self._name, "check that it is the board of a 2DIY")

    def _take(self, name: int, second_deg: float, first_deg: float) -> bool:
        """Update the state by an answer. Returns False if the answer is invalid or implausible."""
        if name != ID or not (abs(first_deg) < 720.0 and abs(second_deg) < 720.0):
            return False
        theta = math.radians(first_deg), math.radians(second_deg)
        turned = max(abs(theta[0] - self._theta[0]), abs(theta[1] - self._theta[1]))
        if self._known and turned > JUMP_RAD:
            return False
        p = forward(theta, self._hardware.base_m)
        if p is None:
            return False
        self._theta, self._p, self._known = theta, p, True
        self._timeout.received()
        state = self.state[0]
        state.p_DT_m = (0.5 * self._hardware.base_m - p[0], MIDDLE_M - p[1], 0.0)
        state.ready, state.trouble = int(self._homed), int(not self._homed)
        state.count += 1
        return True

    def write(self) -> None:
        x, y, _ = self.state.f_D_N[0].tolist()
        if self.state.ready[0] == 1 and math.isfinite(x) and math.isfinite(y):
            self._send(run_message(arm_torques((-x, -y), self._p, self._theta, self._hardware.base_m)))
        else:
            self._send(run_message((0.0, 0.0)))

    def close(self) -> None:
        if self._port.is_open:
            with suppress(*GONE):
                self._put(run_message((0.0, 0.0)), CLOSE_S)  # until it accepts this, the board holds its last torque
        with suppress(*GONE):
            self._port.close()

    def reason(self, trouble: int) -> str:
        remedy = "move the arms to their marks, and use --option homed=yes"
        return f"the arm position is not calibrated: {remedy}" if trouble else ""


def release(port: str | None = None, **options: Any) -> None:
    """Send zero torque after the driver process has died."""
    device = open_port(port)
    try:
        device.write(run_message((0.0, 0.0)))
        device.flush()
    except GONE as error:
        raise DeviceError(f"haply2diy: {port}: disconnected ({error})") from None
    finally:
        device.close()


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
    imports=("serial", "serial.tools.list_ports"),
    options=(
        Option("port", None, "serial port, such as /dev/ttyACM0 or COM3; by default the only one that is connected"),
        Option("hardware", "v3", "hardware version", tuple(HARDWARE)),
        Option("homed", False, "whether the arms are at their marks now; without homed=yes it gives no force"),
    ),
    release=release,
    assumptions=(
        "It lies in front of the hand with its arms towards the hand; there is no force along z.",
        "Force, mass, damping and friction are estimates; the firmware limits torques to 0.123 N·m.",
        "Angles are measured from the marks at which the arms are when it is opened.",
    ),
)
