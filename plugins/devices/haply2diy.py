"""Haply's 2DIY, a pantograph in a plane, over its serial port. The protocol is as the board's firmware has it
(Haply-Arduino-Firmware-Versions, Haply_M3_Firmware_V1_5): no frames, no checksum, float32, little-endian.

Its axes H, as it lies on a desk: x to the left, y towards the hand. The board keeps the last torque that it was told,
for ever: zero is sent on every way out.
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
from hapscene_plugins.devices.serial_port import PERMISSION, find_ports
from hapscene_plugins.devices.silence import Silence

try:
    from termios import error as PortError
except ImportError:  # Windows has none
    PortError = OSError  # type: ignore[misc,assignment]

WRITE_S: Final = 0.05
"""How long a board may take nothing [s]."""

CLOSE_S: Final = 1.0
"""And how long it is waited for when it is to be left without torque [s]."""

GONE: Final = (OSError, TypeError, PortError)
"""What pyserial raises of a port that is no more."""

ID: Final = 5
"""What the board is to call itself; each answer begins with it."""

BAUD: Final = 115_200
"""The board has USB of its own, and ignores it. (At 1,200 it would erase itself.)"""

SETUP, RUN = 1, 2
CW, CCW = 0, 1

ANSWER: Final = struct.Struct("<B2f")
TORQUES: Final = struct.Struct("<BB2f")

MIDDLE_M: Final = 0.09
"""y in H of D's origin."""

JUMP_RAD: Final = math.radians(20.0)
"""An arm that turned further since the last answer was not read right: a hand takes tens of milliseconds for it."""


class Hardware(NamedTuple):
    """One version: direction of motors and encoders, offset [°] and counts of encoders, by port: the second arm's,
    then the first's."""

    direction: tuple[int, int]
    zero_deg: tuple[float, float]
    counts: float
    base_m: float  # from the first arm's axis to the second's


HARDWARE = {
    "v3": Hardware((CCW, CCW), (12.0, 168.0), 4880.0, 0.038),
    "v2": Hardware((CW, CCW), (-61.0, 241.0), 10752.0, 0.0),
}
"""The second arm is at port 1, the first at port 2."""


def setup_message(hardware: Hardware) -> bytes:
    """What tells the board of two motors and two encoders, no sensors, no PWM pins."""
    head = bytes((SETUP, ID, 0b11, *hardware.direction, 0b11, *hardware.direction, 0, 0))
    return head + struct.pack("<4f", hardware.zero_deg[0], hardware.counts, hardware.zero_deg[1], hardware.counts)


def run_message(torques: tuple[float, float]) -> bytes:
    """The torques of the first and the second arm [N·m]."""
    return TORQUES.pack(RUN, ID, torques[1], torques[0])


def open_port(port: str | None, alone: bool = False) -> Any:
    """The board's port; for this program `alone` where the system can see to that.

    Raises:
        DeviceError: none was told and not just one is there; it is not there, is in use, or may not be opened.
    """
    import serial

    if port is None:
        found = find_ports()
        if len(found) != 1:
            names = ", ".join(place.where for place in found)
            raise DeviceError(f"haply2diy: say which port: --option port=NAME; there are: {names or 'none'}")
        port = found[0].options["port"]
    try:
        exclusive = True if alone and os.name == "posix" else None
        return serial.Serial(port, BAUD, timeout=0.0, write_timeout=0.05, exclusive=exclusive)
    except (OSError, ValueError) as error:
        if getattr(error, "errno", None) == errno.EAGAIN:  # that of a lock which another has
            raise DeviceError(f"haply2diy: {port}: another program has it: close that") from None
        remedy = f"; {PERMISSION}" if getattr(error, "errno", None) == errno.EACCES else ""
        raise DeviceError(f"haply2diy: {port}: cannot be opened: {error}{remedy}") from None


class Haply2diyConnection(Connection):
    """A 2DIY. Torques go out each tick, and the arms' angles come back."""

    def __init__(
        self, port: str | None = None, hardware: str = "v3", homed: bool = False, clock: Clock = CLOCK
    ) -> None:
        super().__init__()
        self._clock = clock
        self._hardware, self._homed = HARDWARE[hardware], homed
        self._port = open_port(port, alone=True)
        self._name = f"haply2diy: {self._port.port}"
        self._tail, self._theta, self._p, self._silence = b"", (0.0, 0.0), (0.0, 0.0), Silence(clock)
        self._left, self._known, self._garbled = b"", False, False
        try:
            self._send(setup_message(self._hardware) + run_message((0.0, 0.0)))
        except BaseException:
            self.close()
            raise

    def _send(self, data: bytes) -> None:
        try:
            if self._garbled:  # what is still to come begins somewhere: the next answer is whole
                self._port.reset_input_buffer()
                self._tail, self._garbled = b"", False
            self._put(data, WRITE_S)
        except GONE as error:
            raise DeviceError(f"{self._name}: is gone ({error}); plug it in again") from None

    def _put(self, data: bytes, patience_s: float) -> None:
        """Write it, after what the board has not taken yet: it tells messages apart by their lengths alone.

        Raises:
            OSError: the board takes nothing more for so long; what is left then goes before whatever is next.
        """
        self._left += data
        end_s = self._clock.now_s() + patience_s
        while self._left:
            if os.name == "posix":
                with suppress(BlockingIOError):
                    self._left = self._left[os.write(self._port.fileno(), self._left) :]
            else:
                self._port.write(self._left)
                self._left = b""
            if self._left:
                if self._clock.now_s() > end_s:
                    raise TimeoutError("it takes nothing more")
                self._clock.sleep_s(5e-4)

    def read(self) -> None:
        try:
            if self._known and self._silence.is_forgotten():  # what still waits is of before a pause
                self._port.reset_input_buffer()
                self._tail, self._known = b"", False
            data = self._tail + self._port.read(max(ANSWER.size - len(self._tail), self._port.in_waiting))
        except GONE as error:
            raise DeviceError(f"{self._name}: is gone ({error}); plug it in again") from None
        self._garbled = len(data) > 4 * ANSWER.size
        while len(data) >= ANSWER.size and not self._garbled:
            self._garbled = not self._take(*ANSWER.unpack_from(data))
            data = data[ANSWER.size :]
        self._tail = b"" if self._garbled else data
        if self._silence.is_over():
            self.state.ready = 0
            raise DeviceError(f"{self._name}: has said nothing of sense for half a second: is it a 2DIY's board?")

    def _take(self, name: int, second_deg: float, first_deg: float) -> bool:
        """Whether an answer can be one; then the state has it."""
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
        self._silence.end()
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
                self._put(run_message((0.0, 0.0)), CLOSE_S)  # a board that is busy keeps its last torque until then
        with suppress(*GONE):
            self._port.close()

    def reason(self, trouble: int) -> str:
        marks = "put its arms to their marks, and open it with --option homed=yes"
        return f"where its arms are is not known: {marks}" if trouble else ""


def release(port: str | None = None, **options: Any) -> None:
    """Write zero torque to a board whose driver has died."""
    device = open_port(port)
    try:
        device.write(run_message((0.0, 0.0)))
        device.flush()
    except GONE as error:
        raise DeviceError(f"haply2diy: {port}: is gone ({error})") from None
    finally:
        device.close()


DRIVER = Driver(
    name="haply2diy",
    summary="Haply's 2DIY, versions 2 and 3, over its serial port: it moves in a plane.",
    open=Haply2diyConnection,
    find=lambda port=None, **options: find_ports(port),
    model=Device(
        "haply2diy", PointMass(0.1, 0.1, 0.1, 60e-6), Limits(3.0, 3000.0, stiffness_N_m=500.0, damping_Ns_m=2.0)
    ),
    continuous_N=1.0,
    low_D_m=(-0.08, -0.07, -0.001),
    high_D_m=(0.08, 0.07, 0.001),
    rate_Hz=1000.0,
    needs="a serial port, and the permission to open it",
    imports=("serial", "serial.tools.list_ports"),
    options=(
        Option("port", None, "the serial port: /dev/ttyACM0, COM3; where one alone is there, that"),
        Option("hardware", "v3", "which version it is", tuple(HARDWARE)),
        Option("homed", False, "yes where its arms stand at their marks as it is opened; without, no force is given"),
    ),
    release=release,
    assumptions=(
        "It lies before the hand with its arms towards it; z is not felt.",
        "Force, mass, damping and friction are guessed; the firmware cuts torques to 0.123 N·m.",
        "Angles are counted from the marks at which its arms stand when it is set up.",
    ),
)
