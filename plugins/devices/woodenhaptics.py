"""WoodenHaptics, to be built by oneself, over USB: reports of eight bytes each way, as the firmware 1.5 has them
(WoodenHaptics/woody-experimental, mbed-code/WoodenHapticsHID/main.cpp): counts of three encoders, currents in mA.

Geometry, and which way encoders and motors turn, are those of the published plans and of its makers' library (Forsslund
Systems: `default_woody`, `computePosition`). Its axes, CHAI3D's: x towards the hand, y to the right, z up. The
amplifiers switch themselves off half a second after the last report.
"""

import math
import struct
from typing import Any, Final

from hapscene.device.driver import Connection, Driver, Option, clip_force
from hapscene.device.model import Device, Limits
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.geometry import Vector
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.silence import Silence
from hapscene_plugins.devices.usb_device import BACKEND, USB_MODULES, UsbDevice, find_usb

VENDOR, PRODUCT = 0x1234, 0x0006
"""What mbed's USBHID calls itself unless it is told another name."""

REPORT: Final = struct.Struct("<3hH")
"""Three counts or currents, and a number for the maker's own use."""

COLUMN_M, UPPER_M, LOWER_M = 0.080, 0.205, 0.245
MIDDLE_M: Final = (0.220, 0.000, 0.080)
"""D's origin in the device's own axes."""

GEAR: Final = (0.010 / 0.160, 0.010 / 0.120, 0.010 / 0.120)
"""Diameter of each capstan over that of the body it turns."""

COUNTS: Final = 2000.0
"""Of an encoder in a turn of its motor."""

TORQUE_N_m_A: Final = 0.0259
"""Of a motor, by its current."""

CURRENT_MAX_mA: Final = 3000
"""What the firmware gives at most."""

FORCE_N: Final = 5.0

JUMP: Final = 1000
"""Counts that an encoder cannot have gone since the last report: 20 ms of the fastest hand."""


def body_angles(counts: tuple[int, int, int]) -> tuple[float, float, float]:
    """Column, upper arm from upright, lower arm from hanging [rad]; at the counts 0 the lower arm is level."""
    a, b, c = (-2.0 * math.pi * count / COUNTS * gear for count, gear in zip(counts, GEAR, strict=True))
    return a, b, c + 0.5 * math.pi


def forward(angles: tuple[float, float, float]) -> Vector:
    """The tool in the device's axes [m], from the middle."""
    a, b, c = angles
    reach = UPPER_M * math.sin(b) + LOWER_M * math.sin(c)
    height = COLUMN_M + UPPER_M * math.cos(b) - LOWER_M * math.cos(c)
    return math.cos(a) * reach - MIDDLE_M[0], math.sin(a) * reach - MIDDLE_M[1], height - MIDDLE_M[2]


def currents(force: Vector, angles: tuple[float, float, float], signs: str) -> tuple[int, int, int]:
    """Currents [mA] for a force in the device's axes: Jᵀ f, the direction kept where one would be too large."""
    a, b, c = angles
    out = math.cos(a) * force[0] + math.sin(a) * force[1]
    around = -math.sin(a) * force[0] + math.cos(a) * force[1]
    torques = (
        around * (UPPER_M * math.sin(b) + LOWER_M * math.sin(c)),
        UPPER_M * (math.cos(b) * out - math.sin(b) * force[2]),
        LOWER_M * (math.cos(c) * out + math.sin(c) * force[2]),
    )
    wanted = [
        1000.0 * torque * gear / TORQUE_N_m_A * (-1.0 if sign == "-" else 1.0)
        for torque, gear, sign in zip(torques, GEAR, signs, strict=True)
    ]
    share = min(1.0, CURRENT_MAX_mA / max(map(abs, [*wanted, 1.0])))
    x, y, z = (round(share * part) for part in wanted)
    return x, y, z


class WoodenHapticsConnection(Connection):
    """A WoodenHaptics. It sends reports by itself.

    Each report waits for the bus, up to a millisecond: in one tick one comes in, in the next one goes out. A force
    that ends does not wait for its turn.
    """

    def __init__(
        self, homed: bool = False, signs: str = "+--", backend: str | None = None, clock: Clock = CLOCK
    ) -> None:
        super().__init__()
        if len(signs) != 3 or set(signs) - {"+", "-"}:
            raise DeviceError(f"woodenhaptics: signs={signs}: expected three of + and -, as +--")
        self._homed, self._signs = homed, signs
        self._usb = UsbDevice("woodenhaptics", VENDOR, PRODUCT, backend)
        ends = {end >= 0x80: end for end in self._usb.endpoints}
        if len(ends) != 2:
            self._usb.close()
            raise DeviceError("woodenhaptics: has no endpoint each way: is it the firmware WoodenHapticsHID?")
        self._in, self._out = ends[True], ends[False]
        self._counts: tuple[int, int, int] | None = None
        self._angles, self._silence, self._listens = body_angles((0, 0, 0)), Silence(clock), False
        self._sent = (0, 0, 0)

    def read(self) -> None:
        self._listens = not self._listens
        if not self._listens:
            return
        data = self._usb.read(self._in, 64, 1)
        if len(data) == REPORT.size and self._take(REPORT.unpack(data)[:3]):
            self._silence.end()
        elif self._silence.is_over():
            self.state.ready = 0
            raise DeviceError("woodenhaptics: has said nothing of sense for half a second; check its cable")

    def _take(self, counts: Any) -> bool:
        """Whether the counts can be; then the state has them."""
        last = self._counts or counts
        jump = max(abs(now - before) for now, before in zip(counts, last, strict=True))
        if jump > JUMP and not self._silence.is_forgotten():
            return False
        self._counts, self._angles = counts, body_angles(counts)
        x, y, z = forward(self._angles)
        state = self.state[0]
        state.p_DT_m = (y, -x, z)
        state.ready, state.trouble = int(self._homed), int(not self._homed)
        state.count += 1
        return True

    def write(self) -> None:
        sent = (0, 0, 0)
        if self.state.ready[0] == 1:
            x, y, z = clip_force(self.state.f_D_N[0], FORCE_N)
            sent = currents((-y, x, z), self._angles, self._signs)
        if not self._listens or sent == (0, 0, 0) != self._sent:
            self._usb.write(self._out, REPORT.pack(*sent, 0))
            self._sent = sent

    def close(self) -> None:
        self._usb.close(self._out, REPORT.pack(0, 0, 0, 0))

    def reason(self, trouble: int) -> str:
        pose = "plug it in with its upper arm upright and its lower arm level, and say --option homed=yes"
        return f"where its arms are is not known: {pose}" if trouble else ""


def release(backend: str | None = None, **options: Any) -> None:
    """Write zero to one whose driver has died, before it does so itself."""
    usb = UsbDevice("woodenhaptics", VENDOR, PRODUCT, backend)
    usb.close(next(end for end in usb.endpoints if end < 0x80), REPORT.pack(0, 0, 0, 0))


DRIVER = Driver(
    name="woodenhaptics",
    summary="WoodenHaptics with the USB HID firmware, built by oneself.",
    open=WoodenHapticsConnection,
    find=lambda backend=None, **options: find_usb(VENDOR, PRODUCT, backend),
    model=Device(
        "woodenhaptics",
        PointMass(0.2, 0.1, 0.3, 50e-6),
        Limits(FORCE_N, 1000.0 * FORCE_N, stiffness_N_m=1000.0, damping_Ns_m=8.0),
    ),
    continuous_N=2.0,
    low_D_m=(-0.1, -0.1, -0.1),
    high_D_m=(0.1, 0.1, 0.1),
    rate_Hz=500.0,
    needs="pyusb (pip install 'hapscene[usb]'), libusb, permission",
    imports=USB_MODULES,
    options=(
        Option("homed", False, "yes where it stood at its zero as it was plugged in; without, no force is given"),
        Option("signs", "+--", "which way each motor turns for a positive current: the other way for -"),
        BACKEND,
    ),
    watchdog_s=0.5,
    release=release,
    assumptions=(
        "It is built to the published plans: lengths, capstans, encoders of 2,000 counts, motors of 25.9 mN·m/A.",
        "A report each way waits for the bus's next millisecond, so that it runs at some 500 Hz.",
        "Mass, friction and the force that it bears for ever are guessed.",
        "Motors turn as its makers' library has them; it goes the wrong way where --option signs is wrong: try 0.5 N.",
        "It was plugged in with its upper arm upright and its lower arm level.",
    ),
)
