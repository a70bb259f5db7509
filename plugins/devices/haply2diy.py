"""Haply 2DIY, a planar pantograph, over its serial port.

The protocol is that of the board's firmware (Haply-Arduino-Firmware-Versions, Haply_M3_Firmware_V1_5): no frames, no
checksum, float32, little-endian. The device's axes H: x to the left, y towards the hand.

The board has no watchdog: it holds the last torque indefinitely. Therefore every exit path sends zero torque.
"""

import math
import os
import struct
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple

from hapscene.device.driver import Connection, Driver, Option
from hapscene.device.model import Device, Limits
from hapscene.device.response_timeout import ResponseTimeout
from hapscene.device.serial_port import SERIAL_MODULES, SerialPort, chosen_port, find_ports
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.haply2diy_kinematics import arm_torques, forward

ID: Final = 5
"""Device id that the board is given; each answer starts with it."""

BAUD: Final = 115_200
"""Speed of the port [bit/s]. The board has native USB and ignores it, except that 1,200 erases the firmware."""

HOME: Final = "move both arms to their marks"

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


class Haply2diyConnection(Connection):
    """An open 2DIY. Each tick sends torques and receives the angles of the arms."""

    def __init__(
        self, port: str | None = None, hardware: str = "v3", homed: bool = False, clock: Clock = CLOCK
    ) -> None:
        super().__init__()
        self._hardware, self._homed = HARDWARE[hardware], homed
        self._port = SerialPort("haply2diy", port, BAUD, clock=clock)
        self._tail, self._theta, self._p, self._timeout = b"", (0.0, 0.0), (0.0, 0.0), ResponseTimeout(clock)
        self._known, self._garbled = False, False
        try:
            self._send(setup_message(self._hardware) + run_message((0.0, 0.0)))
        except BaseException:
            self.close()
            raise

    def _send(self, data: bytes) -> None:
        if self._garbled:  # lost synchronisation: the next answer starts afresh
            self._port.discard_input()
            self._tail, self._garbled = b"", False
        self._port.write(data)

    def home(self) -> None:
        self._homed, self._known = True, False
        self._send(setup_message(self._hardware) + run_message((0.0, 0.0)))

    def read(self) -> None:
        if self._known and self._timeout.was_paused():  # buffered answers are from before a pause
            self._port.discard_input()
            self._tail, self._known = b"", False
        data = self._tail + self._port.read()
        self._garbled = len(data) > 4 * ANSWER.size
        while len(data) >= ANSWER.size and not self._garbled:
            self._garbled = not self._take(*ANSWER.unpack_from(data))
            data = data[ANSWER.size :]
        self._tail = b"" if self._garbled else data
        self._timeout.check(self, self._port.name, "check that it is the board of a 2DIY")

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
    """Open the port a second time for writing; returns a function that sends zero torque."""
    if os.name != "posix":
        raise DeviceError("haply2diy: a serial port is opened once only on this system")
    file = os.open(chosen_port("haply2diy", port), os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
    return partial(os.write, file, run_message((0.0, 0.0)))


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
