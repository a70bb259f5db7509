"""Devices by name, and what each can take: limits of the two channels, and of the walls that it holds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError, no_such

if TYPE_CHECKING:
    from hapscene.device.sim.omni import Omni

__all__ = [
    "BORDER_COUNT",
    "DELAY_MAX",
    "DEVICES",
    "GUARD_SHARE",
    "IDEAL",
    "TOUCH_SPEED_M_S",
    "Device",
    "DeviceLike",
    "DeviceWarning",
    "Limits",
    "damping_for",
    "damping_max",
    "device_named",
    "device_of",
    "limits_of",
    "stability_border",
    "wall_limit",
]


DeviceLike: TypeAlias = "str | Device | PointMass | Omni"
"""A device wherever one is taken: by its name, as one of `DEVICES`, or as a simulated one. The first two bring limits
along; a simulated one that a hand holds (`Twin`, `Servo`) has none unless they are given."""

DELAY_MAX: Final = 63
"""Longest delay that the passivity controller reckons with [ticks]. Sets the size of its memory of forces sent."""


class DeviceWarning(UserWarning):
    """The device takes less of a swatch than it asks for."""


LIMIT: Final = np.dtype(
    [
        ("force_N", "f8"),
        ("slew_N_s", "f8"),
        ("acceleration_m_s2", "f8"),
        ("fold_mass_kg", "f8"),
        ("guard_Ns_m", "f8"),
        ("quantum_m", "f8"),
        ("coupling_N_m", "f8"),
        ("coupling_Ns_m", "f8"),
        ("delay_ticks", "i8"),
    ],
    align=True,
)


@dataclass(frozen=True)
class Limits:
    """Limits of a device, infinite where it has none, and the stabilisers that the tick has for it, 0 for none.

    `hapscene.device.model.limits_of` finds those of a device.

    Attributes:
        force_N: largest force of the base motors. Over it the magnitude is cut, the direction kept.
        slew_N_s: fastest change of that force.
        acceleration_m_s2: largest acceleration of the handle's actuator.
        fold_mass_kg: for a device without an actuator in the handle, the mass by which the block's mean acceleration
            is folded into the force, along the normal; 0 for a device with one.
        own_damping_Ns_m: the device's own damping, by which a swatch's acceleration is folded in no further than
            motors hold it (`hapscene.surface.device_clipping`); infinite to fold in all of it.
        stiffness_N_m: stiffest wall. A swatch over it is rendered at it.
        damping_Ns_m: most damping of a wall.
        undamped_N_m: stiffest wall without damping, and stiffest spring of any other kind, as friction's.
        damping_time_s: damping that a wall is given for what it is stiffer than `undamped_N_m`, by the stiffness.
        guard_Ns_m: most damping that the passivity controller injects (`hapscene.device.stabilisers`).
        quantum_m: step of the encoders, which that controller reckons with.
        coupling_N_m, coupling_Ns_m: spring and damper of a virtual coupling (`hapscene.device.stabilisers`).
        delay_ticks: how many ticks later than its tick a force goes out.
        device: what messages call it.

    Raises:
        HapsceneError: a limit that is negative or NaN, a stabiliser or mass that is infinite, a delay that is not 0 to
            `DELAY_MAX`.
    """

    force_N: float = math.inf
    slew_N_s: float = math.inf
    acceleration_m_s2: float = math.inf
    fold_mass_kg: float = 0.0
    own_damping_Ns_m: float = math.inf
    stiffness_N_m: float = math.inf
    damping_Ns_m: float = math.inf
    undamped_N_m: float = math.inf
    damping_time_s: float = 0.0
    guard_Ns_m: float = 0.0
    quantum_m: float = 0.0
    coupling_N_m: float = 0.0
    coupling_Ns_m: float = 0.0
    delay_ticks: int = 0
    device: str = "device"

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "device" and not value >= 0.0:
                raise HapsceneError(f"limits: {name} must be at least 0, is {value}")
        if self.delay_ticks % 1 != 0 or self.delay_ticks > DELAY_MAX:
            raise HapsceneError(f"limits: delay_ticks must be a whole number up to {DELAY_MAX}, is {self.delay_ticks}")
        for name in ("fold_mass_kg", "damping_time_s", "quantum_m", "coupling_N_m", "coupling_Ns_m"):
            if math.isinf(getattr(self, name)):
                raise HapsceneError(f"limits: {name} must be finite; 0 is none")

    def __repr__(self) -> str:
        return (
            f"<Limits of {self.device!r}: {self.force_N:g} N, walls to {self.stiffness_N_m:g} N/m and "
            f"{self.damping_Ns_m:g} N·s/m, delay of {self.delay_ticks} ticks>"
        )

    def record(self) -> Any:
        """The limits as the compiled tick reads them, (1,) LIMIT."""
        row = np.zeros(1, LIMIT).view(np.recarray)
        for name in LIMIT.names or ():
            row[name] = getattr(self, name)
        return row


IDEAL: Final = Limits()
"""A device that can do anything: what a recording holds when no device is named."""


# Devices by name: what each is made of, and the walls it holds at a tick's period and delay.
#
# A wall of stiffness K and damping B (backward difference), rendered every T with a delay of d ticks to a mass m with
# damping b, is at the border of stability where for some frequency θ = ωT in (0, π), z = e^(iθ),
#
#     K + (B/T)(1 − z⁻¹) = −z^d / G(z),    G(z) = (p z + r)/((z − 1)(z − a)), a = e^(−bT/m)
#
# with G the mass behind a zero-order hold. Its imaginary part gives B(θ), its real part K(θ): the whole border in
# closed form. It holds the limits without damping (K → 2b/T at d = 0, b/(T/2 + T) at d = 1) and those of virtual
# damping alone (b = 0: K T²/m = 2β(2 − β)/(2 + β), β = BT/m) as special cases.
#
# Two things of real devices are added. Coulomb friction c takes as much energy from a swing of peak speed v as a damper
# of 4c/(πv) does; at v = `TOUCH_SPEED_M_S` that damper stands for it. And where the tool comes to rest, friction must
# hold the step that the force makes from one encoder count to the next, (K + B/T)Δ ≤ 2c (Abbott & Okamura 2005, IEEE
# Trans. Robotics 21(5), 952–964, for B = 0).


MARGIN: Final = 0.5
"""What walls use of the stiffness that is just stable, and of the step that friction just holds [1]. A factor 2 covers
a device half as damped as its data say (its own damping is the number that is known worst), and brings a wall to rest
within few bounces, where at 1 it would ring for ever."""

TOUCH_SPEED_M_S: Final = 0.5
"""Fastest touch after which a wall must come to rest by the device's own friction [m/s]: a brisk tap. Slower
touches rest the sooner; half of it would double the share of friction in the limits."""

GUARD_SHARE: Final = 0.2
"""Most damping that the passivity controller injects, over the largest that is stable at the delay [1]. At 0.05 it
does not catch a wall of 2000 N/m at a delay of two ticks, at 1 it chatters; from 0.1 to 0.4 nothing much changes."""

BORDER_COUNT: Final = 4000
"""Points at which the border of stability is computed [count]: K to 3e-6 between them."""


@dataclass(frozen=True)
class Device:
    """A device by name.

    Attributes:
        name: what messages call it.
        point: the device as a point mass; None for an ideal one.
        limits: what its data sheet, and others who drive it, allow.
    """

    name: str
    point: PointMass | None
    limits: Limits

    def __repr__(self) -> str:
        mass = "no mass" if self.point is None else f"{self.point.mass_kg:g} kg"
        return f"<Device {self.name!r}: {mass}, {self.limits.force_N:g} N, walls to {self.limits.stiffness_N_m:g} N/m>"


def _device(name: str, point: PointMass, force_N: float, stiffness_N_m: float, damping_Ns_m: float) -> Device:
    """A device that may go to its full force within a millisecond."""
    slew_N_s = 1000.0 * force_N
    return Device(name, point, Limits(force_N, slew_N_s, stiffness_N_m=stiffness_N_m, damping_Ns_m=damping_Ns_m))


DEVICES: Final[Mapping[str, Device]] = {
    "ideal": Device("ideal", None, IDEAL),
    "omni": _device("omni", PointMass(0.045, 0.1, 0.26, 55e-6), 3.3, 700.0, 5.0),
    "phantom-1.0": _device("phantom-1.0", PointMass(0.072, 0.005, 0.038, 30e-6), 6.0, 1000.0, 8.0),
    "premium-1.5": _device("premium-1.5", PointMass(0.075, 0.05, 0.04, 30e-6), 8.5, 800.0, 5.0),
}
"""Mass, friction and encoder step by data sheet; the damping of omni and premium-1.5 is assumed, as nobody publishes
it. Force, stiffness and damping are what CHAI3D drives them at (src/devices/CPhantomDevices.cpp: "PHANTOM Omni",
"PHANTOM Premium 1.5 6DOF", and what it takes any other Phantom for)."""


def device_named(name: str) -> Device:
    """A device of `DEVICES`.

    Raises:
        HapsceneError: no device of this name.
    """
    if name not in DEVICES:
        raise HapsceneError(no_such("device", name, DEVICES))
    return DEVICES[name]


def device_of(device: "DeviceLike") -> Device:
    """What is known of a device, given by its name, as one of `DEVICES`, or as a simulated one.

    Raises:
        HapsceneError: no device of this name, or not a device.
    """
    if isinstance(device, str):
        return device_named(device)
    if isinstance(device, Device):
        return device
    if isinstance(device, PointMass):
        return Device("point mass", device, IDEAL)
    from hapscene.device.sim.omni import Omni  # itself heavy to import

    if isinstance(device, Omni):
        known = DEVICES["omni"]
        mass = PointMass(known.point.mass_kg, device.damping_Ns_m, device.friction_N, device.resolution_m)  # type: ignore[union-attr]
        return known if mass == known.point else replace(known, point=mass)
    raise HapsceneError(
        f"a device is a name ({', '.join(DEVICES)}), one of hapscene.device.DEVICES, a PointMass or an Omni, "
        f"not {device!r:.60}"
    )


def limits_of(device: "DeviceLike", tick_s: float, delay_ticks: int = 0) -> Limits:
    """Limits of a device at a tick's period and delay: no wall beyond `wall_limit`, and the passivity controller below.

    Args:
        device: its name, or itself.
        tick_s: period of the force channel [s].
        delay_ticks: how many ticks later than its tick a force goes out.

    Raises:
        HapsceneError: there is no such device; a period or a delay that no loop has.
    """
    device = device_of(device)
    if not 0.0 < tick_s < math.inf:
        raise HapsceneError(f"limits: tick_s must be finite and above 0, is {tick_s}")
    if not 0 <= delay_ticks <= DELAY_MAX:
        raise HapsceneError(f"limits: delay_ticks must be a whole number from 0 to {DELAY_MAX}, is {delay_ticks}")
    known, point = device.limits, device.point
    if point is None:
        return replace(known, device=device.name, delay_ticks=delay_ticks)
    stiffness, damping = wall_limit(device, tick_s, delay_ticks)
    bare = wall_limit(device, tick_s, delay_ticks, damped=False)[0]
    needed = damping_for(device, stiffness, tick_s, delay_ticks=delay_ticks)
    guard = GUARD_SHARE * damping_max(point.mass_kg, tick_s, delay_ticks)
    if point.c_N > 0.0 and point.quantum_m > 0.0:  # a count more or less must not be felt as a kick
        guard = min(guard, point.c_N * tick_s / point.quantum_m)
    return replace(
        known,
        device=device.name,
        delay_ticks=delay_ticks,
        own_damping_Ns_m=point.b_Ns_m,
        stiffness_N_m=stiffness,
        damping_Ns_m=damping,
        undamped_N_m=min(bare, stiffness),
        damping_time_s=needed / (stiffness - bare) if stiffness > bare else 0.0,
        guard_Ns_m=guard,
        quantum_m=point.quantum_m,
    )


def wall_limit(
    device: "DeviceLike", tick_s: float, delay_ticks: int = 0, *, damped: bool = True
) -> tuple[float, float]:
    """The stiffest wall [N/m] that a device holds with a margin, and the most damping [N·s/m] that it holds with it.

    `MARGIN` of the border of stability, with friction at `TOUCH_SPEED_M_S`, and of the step that friction holds; and
    never more than the device's own limits allow. The stiffest wall needs a damper (`damping_for`); without one
    (`damped` False) it is softer. Infinite for an ideal device.

    Raises:
        HapsceneError: there is no device of this name.
    """
    device = device_of(device)
    point = device.point
    if point is None:
        return device.limits.stiffness_N_m, device.limits.damping_Ns_m
    K, B = _border(device, tick_s, delay_ticks)
    step = _step_limit(point)
    if not damped:
        return min(float(np.interp(0.0, B, K)), step, device.limits.stiffness_N_m), 0.0
    few = slice(0, int(np.searchsorted(B, device.limits.damping_Ns_m, "right")))
    K, B = np.minimum(K, step - B / tick_s)[few], B[few]
    stiffness = min(float(K.max()), device.limits.stiffness_N_m)
    return stiffness, float(B[np.flatnonzero(stiffness <= K)[-1]])


def damping_for(device: "DeviceLike", stiffness_N_m: float, tick_s: float, *, delay_ticks: int = 0) -> float:
    """Least damping [N·s/m] with which a device holds, with the margin, a wall no stiffer than its `wall_limit`."""
    device = device_of(device)
    K, B = _border(device, tick_s, delay_ticks)
    rising = slice(0, int(np.argmax(K)) + 1)
    return max(0.0, float(np.interp(stiffness_N_m, K[rising], B[rising])))


def damping_max(mass_kg: float, tick_s: float, delay_ticks: int = 0) -> float:
    """Largest stable damping of a mass without stiffness [N·s/m]: 2 tan(π/(4(d + 1))) m/T, so 2 m/T without delay."""
    return 2.0 * math.tan(math.pi / (4.0 * (delay_ticks + 1))) * mass_kg / tick_s


def stability_border(
    mass_kg: float, damping_Ns_m: float, tick_s: float, delay_ticks: int = 0, count: int = BORDER_COUNT
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The border of stability: stiffness (n,) [N/m] and damping (n,) [N·s/m], ascending, of walls that are just stable.

    From K = 0 at B = −b, over the stiffest, to K = 0 at the largest damping.
    """
    delta = damping_Ns_m * tick_s / mass_kg
    a, e = math.exp(-delta), -math.expm1(-delta)
    if delta > 1e-3:
        p, r = (delta - e) / delta**2, (e - a * delta) / delta**2
    else:  # the same, without the difference of nearly equal numbers
        p = 0.5 - delta / 6 + delta**2 / 24 - delta**3 / 120
        r = 0.5 - delta / 3 + delta**2 / 8 - delta**3 / 30
    theta_end = math.pi / (delay_ticks + 1)  # beyond the largest damping's frequency, π/(d + 1) at b = 0
    theta = theta_end * np.linspace(1e-6, 1.0 - 1e-9, count) ** 2
    z = np.exp(1j * theta)
    wall = -(z**delay_ticks) * (z - 1.0) * (z - a) / (p * z + r) * mass_kg / tick_s**2
    B = tick_s * wall.imag / np.sin(theta)
    K = wall.real - B / tick_s * (1.0 - np.cos(theta))
    end = int(np.argmax(K < 0.0)) if (K[1:] < 0.0).any() else count
    return K[:end], B[:end]


def _border(device: Device, tick_s: float, delay_ticks: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The border with friction, and with the margin; damping from 0 to half of the largest."""
    point = device.point
    assert point is not None
    own = point.b_Ns_m + 4.0 * point.c_N / (math.pi * TOUCH_SPEED_M_S)
    K, B = stability_border(point.mass_kg, own, tick_s, delay_ticks)
    grid = np.linspace(0.0, MARGIN * float(B[-1]), BORDER_COUNT)
    return MARGIN * np.interp(grid, B, K), grid


def _step_limit(point: PointMass) -> float:
    """Largest K + B/T [N/m] whose step from count to count friction holds."""
    if point.quantum_m == 0.0 or point.c_N == 0.0:
        return math.inf
    return MARGIN * 2.0 * point.c_N / point.quantum_m
