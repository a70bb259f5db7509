"""WoodenHaptics, an open-hardware device, over USB HID.

Reports of eight bytes in both directions, as in firmware 1.5 (WoodenHaptics/woody-experimental,
mbed-code/WoodenHapticsHID/main.cpp): counts of three encoders, currents in mA.

Geometry and signs of encoders and motors follow the published plans and the makers' library (Forsslund Systems:
`default_woody`, `computePosition`). The device's axes are those of CHAI3D: x towards the hand, y to the right, z up.
The amplifiers switch off half a second after the last report.
"""

import math
import struct
from typing import Any, Final

from hapscene.device.driver import Connection, Driver, Option, clip_force
from hapscene.device.model import Device, Limits
from hapscene.device.response_timeout import ResponseTimeout
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.geometry import Vector
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.usb_device import BACKEND, USB_MODULES, UsbDevice, find_usb

VENDOR, PRODUCT = 0x1234, 0x0006
"""Default USB ids of mbed's USBHID."""

HOME: Final = "hold the upper arm upright, the lower arm horizontal, both straight ahead"

REPORT: Final = struct.Struct("<3hH")
"""Three counts or currents, and a number that is not used."""

COLUMN_M, UPPER_M, LOWER_M = 0.080, 0.205, 0.245
MIDDLE_M: Final = (0.220, 0.000, 0.080)
"""Origin of D in the device's axes."""

GEAR: Final = (0.010 / 0.160, 0.010 / 0.120, 0.010 / 0.120)
"""Gear ratios: diameter of each capstan over that of the body it drives."""

COUNTS: Final = 2000.0
"""Encoder counts per turn of a motor."""

TORQUE_N_m_A: Final = 0.0259
"""Torque constant of a motor."""

CURRENT_MAX_mA: Final = 3000
"""Current limit of the firmware."""

FORCE_N: Final = 5.0

JUMP: Final = 1000
"""Largest plausible change of an encoder between two reports [counts]: 20 ms of the fastest hand."""


def body_angles(counts: tuple[int, int, int]) -> tuple[float, float, float]:
    """Angles of column, upper arm (0: upright), lower arm (0: hanging) [rad]. At count 0 the lower arm is
    horizontal."""
    a, b, c = (-2.0 * math.pi * count / COUNTS * gear for count, gear in zip(counts, GEAR, strict=True))
    return a, b, c + 0.5 * math.pi


def forward(angles: tuple[float, float, float]) -> Vector:
    """Tool position in the device's axes, relative to `MIDDLE_M` [m]."""
    a, b, c = angles
    reach = UPPER_M * math.sin(b) + LOWER_M * math.sin(c)
    height = COLUMN_M + UPPER_M * math.cos(b) - LOWER_M * math.cos(c)
    return math.cos(a) * reach - MIDDLE_M[0], math.sin(a) * reach - MIDDLE_M[1], height - MIDDLE_M[2]


def currents(force: Vector, angles: tuple[float, float, float], signs: str) -> tuple[int, int, int]:
    """Currents [mA] for a force in the device's axes, Jᵀ f. Scaled down together if one exceeds the limit."""
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
    """An open WoodenHaptics. The device sends reports continuously.

    Each report waits for the USB frame, up to a millisecond. Therefore ticks alternate between receiving and sending. A
    change to zero force is sent at once.
    """

    def __init__(
        self, homed: bool = False, signs: str = "+--", backend: str | None = None, clock: Clock = CLOCK
    ) -> None:
        super().__init__()
        if len(signs) != 3 or set(signs) - {"+", "-"}:
            raise DeviceError(f"woodenhaptics: option signs={signs}: expected three characters + or -, such as +--")
        self._homed, self._signs = homed, signs
        self._usb = UsbDevice("woodenhaptics", VENDOR, PRODUCT, backend)
        self._in, self._out = self._usb.endpoint_pair("the firmware WoodenHapticsHID")
        self._counts: tuple[int, int, int] | None = None  # raw, of the last report
        self._zero = (0, 0, 0)  # raw counts in the home position
        self._angles, self._timeout, self._receiving = body_angles((0, 0, 0)), ResponseTimeout(clock), False
        self._sent = (0, 0, 0)

    def home(self) -> None:
        if self._counts is not None:
            self._homed, self._zero, self._counts = True, self._counts, None

    def read(self) -> None:
        self._receiving = not self._receiving
        if not self._receiving:
            return
        data = self._usb.read(self._in, 64, 1)
        if len(data) == REPORT.size and self._take(REPORT.unpack(data)[:3]):
            self._timeout.received()
        else:
            self._timeout.check(self, "woodenhaptics", "check the cable")

    def _take(self, counts: Any) -> bool:
        """Update the state by encoder counts. Returns False if they are implausible."""
        last = self._counts or counts
        jump = max(abs(now - before) for now, before in zip(counts, last, strict=True))
        if jump > JUMP and not self._timeout.was_paused():
            return False
        self._counts = counts
        a, b, c = (now - zero for now, zero in zip(counts, self._zero, strict=True))
        self._angles = body_angles((a, b, c))
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
        if not self._receiving or sent == (0, 0, 0) != self._sent:
            self._usb.write(self._out, REPORT.pack(*sent, 0))
            self._sent = sent

    def close(self) -> None:
        self._usb.close(self._out, REPORT.pack(0, 0, 0, 0))

    def reason(self, trouble: int) -> str:
        return f"the arm position is not calibrated: {HOME}, and press h" if trouble else ""


def release(backend: str | None = None, **options: Any) -> None:
    """Send zero current after the driver process has died, before the amplifiers switch off by themselves."""
    usb = UsbDevice("woodenhaptics", VENDOR, PRODUCT, backend)
    usb.close(next(end for end in usb.endpoints if end < 0x80), REPORT.pack(0, 0, 0, 0))


DRIVER = Driver(
    name="woodenhaptics",
    summary="WoodenHaptics (open hardware) with the USB HID firmware.",
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
    needs="pyusb (pip install 'hapscene[usb]'), libusb, permission for the device",
    home=HOME,
    imports=USB_MODULES,
    options=(
        Option("homed", False, "whether it was connected in its home position"),
        Option("signs", "+--", "direction of each motor for a positive current, three characters + or -"),
        BACKEND,
    ),
    watchdog_s=0.5,
    release=release,
    assumptions=(
        "Built to the published plans: lengths, capstans, encoders of 2,000 counts, motors of 25.9 mN·m/A.",
        "Reports wait for the next USB frame of 1 ms in both directions, so the loop runs at about 500 Hz.",
        "Mass, friction and continuous force are estimates.",
        "The directions of the motors are those of the makers' library. With wrong --option signs the force has the "
        "wrong direction: test with 0.5 N first.",
    ),
)
