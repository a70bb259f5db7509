"""One interface for the device that holds the tool: a simulated point mass or Omni in a hand, or a real device."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.device.driver import Connection, new_state
from hapscene.device.model import DEVICES, DeviceLike, device_of
from hapscene.device.sim.hand import HAND
from hapscene.device.sim.omni import Omni, advance_omni, hold_omni, read_omni, tip_omni, tip_velocity_omni
from hapscene.device.sim.omni_record import OMNI
from hapscene.device.sim.point import POINT, PointMass, advance_point, hold_point, read_point
from hapscene.errors import HapsceneError
from hapscene.geometry import Vector
from hapscene.records import Records, records

__all__ = [
    "CONNECTED",
    "SIMULATED_OMNI",
    "Arm",
    "advance_arm",
    "drive_arm",
    "find_tip",
    "find_tip_velocity",
    "new_arm",
    "read_arm",
    "simulated_device",
    "write_orientation",
]

SIMULATED_POINT: Final = 0
SIMULATED_OMNI: Final = 1
CONNECTED: Final = 2


class Arm(NamedTuple):
    """The device that holds the tool. `kind` selects the record that is used; compiled code needs all of the fields."""

    kind: int  # SIMULATED_POINT, SIMULATED_OMNI, CONNECTED
    point: Records  # (1,) POINT
    omni: Records  # (1,) OMNI
    hand: Records  # (1,) HAND, for simulated devices
    state: Records  # (1,) DEVICE_STATE, for real devices
    X_WD: NDArray[np.float64]  # (4, 4) pose of the real device


def simulated_device(device: DeviceLike) -> PointMass | Omni:
    """The simulation of a device, given by name or as an object.

    Raises:
        HapsceneError: unknown device, or the ideal device, which has no mass and cannot be simulated.
    """
    if isinstance(device, PointMass | Omni):
        return device
    known = device_of(device)
    if known is DEVICES["omni"]:
        return Omni()
    if known.point is None:
        names = ", ".join(name for name, other in DEVICES.items() if other.point is not None)
        raise HapsceneError(f"device {known.name!r} has no mass and cannot be simulated; choose one of: {names}")
    return known.point


def new_arm(device: PointMass | Omni | Connection, p_WT_m: Sequence[float], X_WD: ArrayLike | None = None) -> Arm:
    """An `Arm` for a device, at rest with its tip at `p_WT_m` (3,) and without a hand.

    `X_WD` (4, 4) is the pose of an Omni or of a real device. By default the middle of a real device's workspace is at
    `p_WT_m`, with the axes of W.

    Raises:
        HapsceneError: the tip is out of reach of the simulated device.
    """
    hand, point, omni, place = records(1, HAND), records(1, POINT), records(1, OMNI), np.eye(4)
    if isinstance(device, PointMass):
        return Arm(SIMULATED_POINT, device.record(p_WT_m), omni, hand, new_state(), place)
    if isinstance(device, Omni):
        return Arm(SIMULATED_OMNI, point, device.record(p_WT_m, X_WD), hand, new_state(), place)
    place[:3, 3] = p_WT_m
    place = place if X_WD is None else np.array(X_WD, np.float64)
    return Arm(CONNECTED, point, omni, hand, device.state, place)


@native
def read_arm(arm: "Arm") -> Vector:
    """The tool position in W as measured by the encoders [m]."""
    if arm.kind == CONNECTED:
        return _read_connected(arm)
    if arm.kind == SIMULATED_OMNI:
        return read_omni(arm.omni[0])
    return read_point(arm.point[0])


@native
def _read_connected(arm: "Arm") -> Vector:
    p, X = arm.state[0].p_DT_m, arm.X_WD
    return (
        X[0, 0] * p[0] + X[0, 1] * p[1] + X[0, 2] * p[2] + X[0, 3],
        X[1, 0] * p[0] + X[1, 1] * p[1] + X[1, 2] * p[2] + X[1, 3],
        X[2, 0] * p[0] + X[2, 1] * p[1] + X[2, 2] * p[2] + X[2, 3],
    )


@native
def write_orientation(arm: "Arm", R_WT: NDArray[np.float64]) -> None:
    """Write the orientation (3, 3) in W of the tool of a real device."""
    R_DT, X = arm.state[0].R_DT, arm.X_WD
    for i in range(3):
        for j in range(3):
            R_WT[i, j] = X[i, 0] * R_DT[0, j] + X[i, 1] * R_DT[1, j] + X[i, 2] * R_DT[2, j]


@native
def drive_arm(arm: "Arm", f_N: Vector) -> None:
    """Set the motor force in W [N], which is held until the next call."""
    if arm.kind == CONNECTED:
        for i in range(3):
            arm.state[0].f_D_N[i] = arm.X_WD[0, i] * f_N[0] + arm.X_WD[1, i] * f_N[1] + arm.X_WD[2, i] * f_N[2]
    elif arm.kind == SIMULATED_OMNI:
        hold_omni(arm.omni[0], f_N[0], f_N[1], f_N[2])
    else:
        hold_point(arm.point[0], f_N[0], f_N[1], f_N[2])


@native
def advance_arm(arm: "Arm", h_s: float, count: int = 1) -> None:
    """Advance a simulated device and the target of the hand by `count` steps of `h_s`. No effect on a real device."""
    if arm.kind == SIMULATED_OMNI:
        advance_omni(arm.omni[0], arm.hand[0], h_s, count)
    elif arm.kind == SIMULATED_POINT:
        advance_point(arm.point[0], arm.hand[0], h_s, count)


@native
def find_tip(arm: "Arm") -> Vector:
    """The true tool position in W [m]; the measured one for a real device."""
    if arm.kind == CONNECTED:
        return _read_connected(arm)
    if arm.kind == SIMULATED_OMNI:
        return tip_omni(arm.omni[0])
    x = arm.point[0].x_m
    return x[0], x[1], x[2]


@native
def find_tip_velocity(arm: "Arm") -> Vector:
    """The true tool velocity in W [m/s]; 0 for a real device, whose velocity is unknown."""
    if arm.kind == CONNECTED:
        return 0.0, 0.0, 0.0
    if arm.kind == SIMULATED_OMNI:
        return tip_velocity_omni(arm.omni[0])
    v = arm.point[0].v_m_s
    return v[0], v[1], v[2]
