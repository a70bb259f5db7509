"""Devices by name, and their limits: force, slew rate, acceleration, and the stiffness and damping of stable walls."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError, no_such
from hapscene.records import Records

if TYPE_CHECKING:
    from hapscene.device.sim.omni import Omni

__all__ = [
    "BORDER_COUNT",
    "DELAY_TICKS_MAX",
    "DEVICES",
    "IDEAL",
    "PASSIVITY_SHARE",
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
"""Type of all arguments that name a device: a name, an entry of `DEVICES`, or a simulated device. The first two include
limits. A simulated device in a hand (`Twin`, `Servo`) has no limits unless you pass them."""

DELAY_TICKS_MAX: Final = 63
"""Longest delay of the force that the passivity controller supports [ticks]: the size of its memory of forces."""


class DeviceWarning(UserWarning):
    """A property of a swatch exceeds the limits of the device, and is reduced."""


LIMIT: Final = np.dtype(
    [
        ("force_N", "f8"),
        ("slew_N_s", "f8"),
        ("acceleration_m_s2", "f8"),
        ("fold_mass_kg", "f8"),
        ("passivity_Ns_m", "f8"),
        ("quantum_m", "f8"),
        ("coupling_N_m", "f8"),
        ("coupling_Ns_m", "f8"),
        ("delay_ticks", "i8"),
    ],
    align=True,
)


@dataclass(frozen=True)
class Limits:
    """Limits of a device and parameters of its stabilisers.

    By default there are no limits (infinite) and no stabilisers (0). `limits_of` computes the limits of a device.

    Attributes:
        force_N: largest force of the base motors. A larger force is scaled down in its direction.
        slew_N_s: largest rate of change of the force.
        acceleration_m_s2: largest acceleration of the actuator in the handle.
        fold_mass_kg: for a device without an actuator in the handle, the mass that converts the mean acceleration of a
            block into a force along the normal; 0 for a device with one.
        own_damping_Ns_m: damping of the device, which limits the acceleration that is converted into force
            (`hapscene.surface.device_clipping`); infinite for no limit.
        stiffness_N_m: stiffest wall. A stiffer swatch is rendered with this stiffness.
        damping_Ns_m: largest damping of a wall.
        undamped_N_m: stiffest wall without damping, and stiffest spring of other effects, such as friction.
        damping_time_s: damping added to a wall, per stiffness above `undamped_N_m`.
        passivity_Ns_m: largest damping of the passivity controller (`hapscene.device.stabilisers`).
        quantum_m: resolution of the encoders, for the passivity controller.
        coupling_N_m, coupling_Ns_m: spring and damper of the virtual coupling (`hapscene.device.stabilisers`).
        delay_ticks: delay of the force output.
        device: name of the device in messages.

    Raises:
        HapsceneError: a limit that is negative or NaN, a stabiliser or mass that is infinite, or a delay that is not an
            integer from 0 to `DELAY_TICKS_MAX`.
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
    passivity_Ns_m: float = 0.0
    quantum_m: float = 0.0
    coupling_N_m: float = 0.0
    coupling_Ns_m: float = 0.0
    delay_ticks: int = 0
    device: str = "device"

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "device" and not value >= 0.0:
                raise HapsceneError(f"limits: {name} must be at least 0, is {value}")
        if self.delay_ticks % 1 != 0 or self.delay_ticks > DELAY_TICKS_MAX:
            raise HapsceneError(
                f"limits: delay_ticks must be an integer, 0 to {DELAY_TICKS_MAX}, is {self.delay_ticks}"
            )
        for name in ("fold_mass_kg", "damping_time_s", "quantum_m", "coupling_N_m", "coupling_Ns_m"):
            if math.isinf(getattr(self, name)):
                raise HapsceneError(f"limits: {name} must be finite, is infinite; 0 disables it")

    def record(self) -> Records:
        """The limits as a record (1,) LIMIT for the compiled tick."""
        row = np.zeros(1, LIMIT).view(np.recarray)
        for name in LIMIT.names or ():
            row[name] = getattr(self, name)
        return row


IDEAL: Final = Limits()
"""A device without limits, the default of recordings."""


# Stable walls of a device, for a given period and delay of the tick.
#
# A wall of stiffness K and damping B (backward difference), rendered with period T and a delay of d ticks to a mass m
# with damping b, is at the border of stability if for some frequency θ = ωT in (0, π), z = e^(iθ),
#
#     K + (B/T)(1 − z⁻¹) = −z^d / G(z),    G(z) = (p z + r)/((z − 1)(z − a)), a = e^(−bT/m)
#
# where G is the mass behind a zero-order hold. The imaginary part gives B(θ), the real part K(θ): the border in closed
# form. Special cases are the limits without virtual damping (K → 2b/T at d = 0, b/(T/2 + T) at d = 1) and with virtual
# damping only (b = 0: K T²/m = 2β(2 − β)/(2 + β), β = BT/m).
#
# Two properties of real devices are added. Coulomb friction c dissipates as much energy of an oscillation of peak speed
# v as a damper of 4c/(πv), evaluated at v = `TOUCH_SPEED_M_S`. At rest, friction must exceed the change of the force
# between two encoder counts, (K + B/T)Δ ≤ 2c (Abbott & Okamura 2005, IEEE Trans. Robotics
# 21(5), 952–964, for B = 0).


MARGIN: Final = 0.5
"""Share of the stiffness at the border of stability, and of the step that friction can hold, which walls use [1]. The
factor 2 covers a device with half of the assumed damping, its least known parameter. A wall then settles within a few
bounces; at 1 it would oscillate forever."""

TOUCH_SPEED_M_S: Final = 0.5
"""Fastest touch after which a wall must come to rest by the friction of the device [m/s]: a brisk tap. Slower touches
settle sooner. Half of this speed would double the share of friction in the limits."""

PASSIVITY_SHARE: Final = 0.2
"""Largest damping of the passivity controller, relative to the largest stable damping at the delay [1]. With 0.05 it
does not stabilise a wall of 2000 N/m at a delay of two ticks, with 1 it chatters. From 0.1 to 0.4 the effect is
similar."""

BORDER_COUNT: Final = 4000
"""Points of the computed border of stability [count]. Interpolated stiffness has a relative error of 3e-6."""


@dataclass(frozen=True)
class Device:
    """A device with a name.

    Attributes:
        name: name in messages.
        point: point-mass model of the device; None for an ideal device.
        limits: limits of the data sheet and of other software for the device.
    """

    name: str
    point: PointMass | None
    limits: Limits


def _device(name: str, point: PointMass, force_N: float, stiffness_N_m: float, damping_Ns_m: float) -> Device:
    """A device whose slew rate allows the full force within a millisecond."""
    slew_N_s = 1000.0 * force_N
    return Device(name, point, Limits(force_N, slew_N_s, stiffness_N_m=stiffness_N_m, damping_Ns_m=damping_Ns_m))


DEVICES: Final[Mapping[str, Device]] = {
    "ideal": Device("ideal", None, IDEAL),
    "omni": _device("omni", PointMass(0.045, 0.1, 0.26, 55e-6), 3.3, 700.0, 5.0),
    "phantom-1.0": _device("phantom-1.0", PointMass(0.072, 0.005, 0.038, 30e-6), 6.0, 1000.0, 8.0),
    "premium-1.5": _device("premium-1.5", PointMass(0.075, 0.05, 0.04, 30e-6), 8.5, 800.0, 5.0),
}
"""Devices by name. Mass, friction and encoder resolution are from data sheets; the damping of omni and premium-1.5 is
assumed, since no values are published. Force, stiffness and damping of walls are those of CHAI3D
(src/devices/CPhantomDevices.cpp: "PHANTOM Omni", "PHANTOM Premium 1.5 6DOF", and its default for other Phantoms)."""


def device_named(name: str) -> Device:
    """Look up a device of `DEVICES`.

    Raises:
        HapsceneError: unknown name.
    """
    if name not in DEVICES:
        raise HapsceneError(no_such("device", name, DEVICES))
    return DEVICES[name]


def device_of(device: "DeviceLike") -> Device:
    """The `Device` for a name, an entry of `DEVICES`, or a simulated device.

    Raises:
        HapsceneError: unknown name, or not a device.
    """
    if isinstance(device, str):
        return device_named(device)
    if isinstance(device, Device):
        return device
    if isinstance(device, PointMass):
        return Device("point mass", device, IDEAL)
    from hapscene.device.sim.omni import Omni  # slow to import

    if isinstance(device, Omni):
        known = DEVICES["omni"]
        mass = PointMass(known.point.mass_kg, device.damping_Ns_m, device.friction_N, device.resolution_m)  # type: ignore[union-attr]
        return known if mass == known.point else replace(known, point=mass)
    raise HapsceneError(
        f"invalid device {device!r:.60}: expected a name ({', '.join(DEVICES)}), an entry of hapscene.device.DEVICES, "
        "a PointMass or an Omni"
    )


def limits_of(device: "DeviceLike", tick_s: float, delay_ticks: int = 0) -> Limits:
    """Limits of a device for a given tick: walls up to `wall_limit`, and the damping of the passivity controller.

    Args:
        device: name or device.
        tick_s: period of the tick [s].
        delay_ticks: delay of the force output [ticks].

    Raises:
        HapsceneError: unknown device, or a period or delay out of range.
    """
    device = device_of(device)
    if not 0.0 < tick_s < math.inf:
        raise HapsceneError(f"limits: tick_s must be finite and above 0, is {tick_s}")
    if not 0 <= delay_ticks <= DELAY_TICKS_MAX:
        raise HapsceneError(f"limits: delay_ticks must be an integer from 0 to {DELAY_TICKS_MAX}, is {delay_ticks}")
    known, point = device.limits, device.point
    if point is None:
        return replace(known, device=device.name, delay_ticks=delay_ticks)
    stiffness, damping = wall_limit(device, tick_s, delay_ticks)
    bare = wall_limit(device, tick_s, delay_ticks, damped=False)[0]
    needed = damping_for(device, stiffness, tick_s, delay_ticks=delay_ticks)
    damping_cap = PASSIVITY_SHARE * damping_max(point.mass_kg, tick_s, delay_ticks)
    if point.c_N > 0.0 and point.quantum_m > 0.0:  # one encoder count must not cause a perceptible force step
        damping_cap = min(damping_cap, point.c_N * tick_s / point.quantum_m)
    return replace(
        known,
        device=device.name,
        delay_ticks=delay_ticks,
        own_damping_Ns_m=point.b_Ns_m,
        stiffness_N_m=stiffness,
        damping_Ns_m=damping,
        undamped_N_m=min(bare, stiffness),
        damping_time_s=needed / (stiffness - bare) if stiffness > bare else 0.0,
        passivity_Ns_m=damping_cap,
        quantum_m=point.quantum_m,
    )


def wall_limit(
    device: "DeviceLike", tick_s: float, delay_ticks: int = 0, *, damped: bool = True
) -> tuple[float, float]:
    """The stiffest stable wall of a device [N/m], with a margin, and the largest stable damping of that wall [N·s/m].

    The result uses the share `MARGIN` of the border of stability, with friction at `TOUCH_SPEED_M_S`, and of the step
    that friction can hold. It does not exceed the limits of the device. The stiffest wall needs a damper
    (`damping_for`); with `damped=False` the result is the stiffest wall without one. An ideal device has no limit.

    Raises:
        HapsceneError: unknown device.
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
    """Smallest damping [N·s/m] that makes a wall up to `wall_limit` stable, with the margin."""
    device = device_of(device)
    K, B = _border(device, tick_s, delay_ticks)
    rising = slice(0, int(np.argmax(K)) + 1)
    return max(0.0, float(np.interp(stiffness_N_m, K[rising], B[rising])))


def damping_max(mass_kg: float, tick_s: float, delay_ticks: int = 0) -> float:
    """Largest stable damping of a mass without stiffness [N·s/m]: 2 tan(π/(4(d + 1))) m/T; 2 m/T without delay."""
    return 2.0 * math.tan(math.pi / (4.0 * (delay_ticks + 1))) * mass_kg / tick_s


def stability_border(
    mass_kg: float, damping_Ns_m: float, tick_s: float, delay_ticks: int = 0, count: int = BORDER_COUNT
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The border of stability: stiffness (n,) [N/m] and damping (n,) [N·s/m] of marginally stable walls.

    Ordered by damping, from K = 0 at B = −b through the stiffest wall to K = 0 at the largest damping.
    """
    delta = damping_Ns_m * tick_s / mass_kg
    a, e = math.exp(-delta), -math.expm1(-delta)
    if delta > 1e-3:
        p, r = (delta - e) / delta**2, (e - a * delta) / delta**2
    else:  # series expansion, which avoids cancellation
        p = 0.5 - delta / 6 + delta**2 / 24 - delta**3 / 120
        r = 0.5 - delta / 3 + delta**2 / 8 - delta**3 / 30
    theta_end = math.pi / (delay_ticks + 1)  # beyond the frequency at the largest damping
    theta = theta_end * np.linspace(1e-6, 1.0 - 1e-9, count) ** 2
    z = np.exp(1j * theta)
    wall = -(z**delay_ticks) * (z - 1.0) * (z - a) / (p * z + r) * mass_kg / tick_s**2
    B = tick_s * wall.imag / np.sin(theta)
    K = wall.real - B / tick_s * (1.0 - np.cos(theta))
    end = int(np.argmax(K < 0.0)) if (K[1:] < 0.0).any() else count
    return K[:end], B[:end]


def _border(device: Device, tick_s: float, delay_ticks: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The border with friction and margin, for damping from 0 to `MARGIN` of the largest."""
    point = device.point
    assert point is not None
    own = point.b_Ns_m + 4.0 * point.c_N / (math.pi * TOUCH_SPEED_M_S)
    K, B = stability_border(point.mass_kg, own, tick_s, delay_ticks)
    grid = np.linspace(0.0, MARGIN * float(B[-1]), BORDER_COUNT)
    return MARGIN * np.interp(grid, B, K), grid


def _step_limit(point: PointMass) -> float:
    """Largest K + B/T [N/m] for which friction holds the force step between two encoder counts, with margin."""
    if point.quantum_m == 0.0 or point.c_N == 0.0:
        return math.inf
    return MARGIN * 2.0 * point.c_N / point.quantum_m
