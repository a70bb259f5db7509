"""A simulated device and the hand that holds it: a point mass or an Omni, driven alike."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import ArrayLike

from hapscene.device.hand import HAND
from hapscene.device.model import DEVICES, device_of
from hapscene.device.omni import (
    Omni,
    advance_omni,
    hold_omni,
    read_omni,
    tip_omni,
    tip_velocity_omni,
)
from hapscene.device.omni_record import OMNI
from hapscene.device.point import POINT, PointMass, advance_point, hold_point, read_point
from hapscene.errors import HapsceneError
from hapscene.geometry import Vector
from hapscene.native import native
from hapscene.records import records

if TYPE_CHECKING:
    from hapscene.device.model import DeviceLike


class Arm(NamedTuple):
    """What acts on the tool besides the scene. One of the two devices is used; compiled code needs both to be there."""

    is_omni: int
    point: Any  # (1,) POINT
    omni: Any  # (1,) OMNI
    hand: Any  # (1,) HAND


def simulated_device(device: "DeviceLike") -> PointMass | Omni:
    """The simulation of a device, given by its name or as an object.

    Raises:
        HapsceneError: there is no such device, or it is ideal: without a mass, it cannot be moved.
    """
    if isinstance(device, PointMass | Omni):
        return device
    known = device_of(device)
    if known is DEVICES["omni"]:
        return Omni()
    if known.point is None:
        able = ", ".join(name for name, other in DEVICES.items() if other.point is not None)
        raise HapsceneError(f"device {known.name!r} has no mass that a hand could move; choose one of: {able}")
    return known.point


def new_arm(device: PointMass | Omni, p_WT_m: Sequence[float], X_WD: ArrayLike | None = None) -> Arm:
    """A device at rest with its tip at `p_WT_m` (3,), which nothing holds. An Omni stands at `X_WD` (4, 4).

    Raises:
        HapsceneError: the tip is out of the device's reach.
    """
    hand = records(1, HAND)
    if isinstance(device, PointMass):
        return Arm(0, device.record(p_WT_m), records(1, OMNI), hand)
    return Arm(1, records(1, POINT), device.record(p_WT_m, X_WD), hand)


@native
def read_arm(arm: Any) -> Vector:
    """What the encoders say: the tool in W [m]."""
    if arm.is_omni == 1:
        return read_omni(arm.omni[0])
    return read_point(arm.point[0])


@native
def drive_arm(arm: Any, f_N: Vector) -> None:
    """The force wanted of the motors from now on, in W [N]."""
    if arm.is_omni == 1:
        hold_omni(arm.omni[0], f_N[0], f_N[1], f_N[2])
    else:
        hold_point(arm.point[0], f_N[0], f_N[1], f_N[2])


@native
def advance_arm(arm: Any, h_s: float) -> None:
    """Move on by `h_s`, the hand's target with it."""
    if arm.is_omni == 1:
        advance_omni(arm.omni[0], arm.hand[0], h_s)
    else:
        advance_point(arm.point[0], arm.hand[0], h_s)


@native
def find_tip(arm: Any) -> Vector:
    """Where the tool truly is, in W [m]."""
    if arm.is_omni == 1:
        return tip_omni(arm.omni[0])
    x = arm.point[0].x_m
    return x[0], x[1], x[2]


@native
def find_tip_velocity(arm: Any) -> Vector:
    """How the tool truly moves, in W [m/s]."""
    if arm.is_omni == 1:
        return tip_velocity_omni(arm.omni[0])
    v = arm.point[0].v_m_s
    return v[0], v[1], v[2]
