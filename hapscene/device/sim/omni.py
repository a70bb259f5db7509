"""The simulated Phantom Omni, from its data sheet and published dynamics.

    record = Omni().record(p_WT_m)        create a device with its tip at p_WT_m
    read_omni(record[0])                  tip position in W as measured by the encoders
    hold_omni(record[0], fx, fy, fz)      set the force at the tip in W, held until the next call
    advance_omni(record[0], hand[0], h_s) advance arm, structure, tool and hand
    tip_omni(record[0])                   true tool position

**Two masses.** The tool is a mass of 7.9 g, connected to the arm by springs of 1.26, 2.31 and 1.02 N/mm along x, y, z
of D (data sheet) with a damping ratio of 0.05 (assumed). With orthogonal arms, the published dynamics have 37.1 g in
the arm's lightest direction, and 45 g together with the tool, as in the data sheet. Tool and arm have one resonance per
axis, at 66, 91 and 61 Hz; the mass of a hand lowers them. Encoders and motors are on the arm's side. The measured
position differs from the tool by the deflection of the structure, f/k at rest. A wall of 1 N/mm therefore feels like
0.5 N/mm along z.

**Friction** of each joint: Coulomb friction of 0.26 N at the tip in the nominal posture, and viscous friction of
0.1 N·s/m (assumed).

**Encoders** measure joint angles with 21,347, 15,308 and 15,137 counts per turn, so that one count moves the tip by
0.055 mm in the nominal posture. Over the workspace, a count of the waist is 0.045 to 0.069 mm.

**Motors** have a peak force of 3.3 N and a continuous force of 0.88 N in the nominal posture. Each heats up with its
squared torque and one time constant (60 s, assumed), to 1 at continuous torque. From a temperature of 0.9, after 4 s of
full force, its limit falls to the continuous torque at 1. If a motor reaches its limit, the whole force is scaled down
in its direction. The motors compensate gravity, as with the vendor's driver, which uses a part of their torque.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.native import native
from hapscene.device.sim.omni_kinematics import (
    NOMINAL_LEVER_M,
    NOMINAL_RAD,
    SINGULAR,
    forward,
    inverse,
    lever,
    leverage,
    reachable,
    tip,
    turns_at,
)
from hapscene.device.sim.omni_record import OMNI, OmniFlag
from hapscene.device.sim.omni_step import STEP_MAX_S, ahead, apparent_mass, gravity_at, grip_in_D, step
from hapscene.errors import HapsceneError
from hapscene.geometry import Vector, rigid
from hapscene.records import Records


def stand(p_WT_m: ArrayLike) -> NDArray[np.float64]:
    """Pose X_WD (4, 4) of a device whose tip is at `p_WT_m` (3,) in the nominal posture. z of W is up, the user is at
    −y."""
    X = np.eye(4)
    X[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    X[:3, 3] = np.asarray(p_WT_m, float) - X[:3, :3] @ forward(NOMINAL_RAD)
    return X


def out_of_reach(p_WT_m: Sequence[float], p_DT_m: NDArray[np.float64]) -> str:
    """Error message for a start position that is out of reach."""
    middle = ", ".join(f"{v:.3f}" for v in forward(NOMINAL_RAD))
    position = ", ".join(f"{v:.3f}" for v in p_DT_m)
    return (
        f"omni: p_WT_m {tuple(float(v) for v in p_WT_m)} is out of reach: ({position}) m in the device frame; "
        f"the workspace extends by 80, 60, 35 mm along x, y, z around its middle ({middle}) m"
    )


__all__ = [
    "OMNI",
    "Omni",
    "OmniFlag",
    "advance_omni",
    "hold_omni",
    "read_omni",
    "stand",
    "tip_omni",
    "tip_velocity_omni",
]

WARM: Final = 0.9
"""Motor temperature at which the torque limit starts to fall, to the continuous torque at 1 [1]. Closer to 1, the force
would drop perceptibly."""

_FORCE_NOT_FINITE = int(OmniFlag.FORCE_NOT_FINITE)
_TORQUE_LIMITED = int(OmniFlag.TORQUE_LIMITED)
_HOT = int(OmniFlag.HOT)
_SINGULAR = int(OmniFlag.SINGULAR)


@dataclass(frozen=True)
class Omni:
    """Parameters of a Phantom Omni. The defaults are those of the data sheet, or assumed (see the module).

    Attributes:
        friction_N: Coulomb friction at the tip in the nominal posture.
        damping_Ns_m: viscous damping at the tip in the nominal posture.
        resolution_m: resolution of the encoders at the tip in the nominal posture; 0 for exact encoders.
        peak_N: peak force in the nominal posture; may be infinite.
        continuous_N: continuous force in the nominal posture.
        thermal_s: thermal time constant of the motors; infinite for no heating.
        stiffness_N_m: stiffness of the structure between arm and tool, along x, y, z of D.
        damping_ratio: damping ratio of the tool on the structure, in the nominal posture.
        tool_kg: mass of the tool.
        gravity: whether gravity and counterbalance act.
        gravity_compensated: whether the motors compensate them.

    Raises:
        HapsceneError: value out of range.
    """

    friction_N: float = 0.26
    damping_Ns_m: float = 0.1
    resolution_m: float = 5.5e-5
    peak_N: float = 3.3
    continuous_N: float = 0.88
    thermal_s: float = 60.0
    stiffness_N_m: tuple[float, float, float] = (1260.0, 2310.0, 1020.0)
    damping_ratio: float = 0.05
    tool_kg: float = 0.0079
    gravity: bool = True
    gravity_compensated: bool = True

    def __post_init__(self) -> None:
        above = ("peak_N", "continuous_N", "thermal_s", "tool_kg")
        endless = ("peak_N", "continuous_N", "thermal_s")
        for field in fields(self):
            for value in np.ravel(getattr(self, field.name)):
                least = "above" if field.name in (*above, "stiffness_N_m") else "at least"
                enough = value > 0.0 if least == "above" else value >= 0.0
                if not (enough and (value < math.inf or field.name in endless)):
                    raise HapsceneError(f"omni: {field.name} must be finite and {least} 0, is {value}")
        if len(self.stiffness_N_m) != 3:
            raise HapsceneError(f"omni: stiffness_N_m must be three numbers (x, y, z), is {self.stiffness_N_m}")
        if self.continuous_N > self.peak_N:
            raise HapsceneError(f"omni: continuous_N must be at most peak_N {self.peak_N}, is {self.continuous_N}")

    @property
    def counts(self) -> tuple[int, int, int]:
        """Encoder counts per turn of each joint; 0 for exact encoders."""
        if self.resolution_m == 0.0:
            return 0, 0, 0
        q1, q2, q3 = (round(2.0 * math.pi * lever_m / self.resolution_m) for lever_m in NOMINAL_LEVER_M)
        return q1, q2, q3

    def record(self, p_WT_m: Sequence[float], X_WD: ArrayLike | None = None) -> Records:
        """Create a record (1,) OMNI at rest with its tip at `p_WT_m` (3,) and the pose `X_WD` (4, 4), by default
        `stand`.

        Raises:
            HapsceneError: `X_WD` is not a rigid transform, or the tip is out of reach.
        """
        X = stand(p_WT_m) if X_WD is None else rigid(X_WD, "omni: X_WD")
        p_DT_m = X[:3, :3].T @ (np.asarray(p_WT_m, float) - X[:3, 3])
        if not reachable(p_DT_m):
            raise HapsceneError(out_of_reach(p_WT_m, p_DT_m))
        omni = np.zeros(1, OMNI).view(np.recarray)
        lever_m = np.array(NOMINAL_LEVER_M)
        omni.R_WD, omni.p_WD_m = X[:3, :3], X[:3, 3]
        omni.gravity, omni.compensated = self.gravity, self.gravity_compensated
        omni.stiffness_N_m, omni.tool_kg = self.stiffness_N_m, self.tool_kg
        omni.damping_Ns_m = 2.0 * self.damping_ratio * np.sqrt(np.array(self.stiffness_N_m) * self._reduced_kg())
        omni.friction_Nm, omni.viscous_Nms = self.friction_N * lever_m, self.damping_Ns_m * lever_m**2
        omni.quantum_rad = [2.0 * math.pi / n if n else 0.0 for n in self.counts]
        omni.peak_Nm, omni.continuous_Nm = self.peak_N * lever_m, self.continuous_N * lever_m
        omni.thermal_s = self.thermal_s
        omni.q, omni.p_DT_m = inverse(p_DT_m), p_DT_m
        hold_omni(omni[0], 0.0, 0.0, 0.0)
        return omni

    def _reduced_kg(self) -> NDArray[np.float64]:
        """(3,) reduced mass of tool and arm in the nominal posture."""
        arm_kg = apparent_mass(NOMINAL_RAD)
        return np.asarray(arm_kg * self.tool_kg / (arm_kg + self.tool_kg))


@native
def hold_omni(omni: np.record, x_N: float, y_N: float, z_N: float) -> None:
    """Set the force (x, y, z) [N] in W at the tip: τ = Jᵀ f, with J at the measured angles.

    A force that is not finite is replaced by 0 and flagged. If a motor has too little torque, the whole force is
    scaled.
    """
    omni.trouble = 0
    R, q = omni.R_WD, _encoded(omni)
    f0 = R[0, 0] * x_N + R[1, 0] * y_N + R[2, 0] * z_N
    f1 = R[0, 1] * x_N + R[1, 1] * y_N + R[2, 1] * z_N
    f2 = R[0, 2] * x_N + R[1, 2] * y_N + R[2, 2] * z_N
    if not (math.isfinite(f0) and math.isfinite(f1) and math.isfinite(f2)):
        omni.trouble |= _FORCE_NOT_FINITE
        f0, f1, f2 = 0.0, 0.0, 0.0
    turns = turns_at(q[0], q[1], q[2])
    J = lever(turns)
    if abs(leverage(turns)) < SINGULAR:
        omni.trouble |= _SINGULAR
    weight2, weight3 = gravity_at(q[1], turns) if omni.gravity * omni.compensated == 1 else (0.0, 0.0)
    wanted = (
        J[0][0] * f0 + J[1][0] * f1 + J[2][0] * f2,
        J[0][1] * f0 + J[1][1] * f1 + J[2][1] * f2,
        J[0][2] * f0 + J[1][2] * f1 + J[2][2] * f2,
    )
    _set_torques(omni, wanted, (0.0, weight2, weight3))


@native
def _set_torques(omni: np.record, wanted: Vector, weight: Vector) -> None:
    """Set the torques: gravity compensation first, then the wanted torques, scaled by a common factor to the limits."""
    kept = math.exp(-omni.held_s / omni.thermal_s)
    omni.held_s = 0.0
    share = 1.0
    for i in range(3):
        most = _warm(omni, i, kept)
        base = min(max(weight[i], -most), most)
        omni.torque_Nm[i] = base
        room = most - base if wanted[i] > 0.0 else most + base
        if abs(wanted[i]) > room:
            share = min(share, room / abs(wanted[i]))
    if share < 1.0:
        omni.trouble |= _TORQUE_LIMITED
    for i in range(3):
        omni.torque_Nm[i] += share * wanted[i]


@native
def _warm(omni: np.record, i: int, kept: float) -> float:
    """Update the temperature of a motor by the torque it held. Returns its current torque limit [N·m]."""
    load = omni.torque_Nm[i] / omni.continuous_Nm[i]
    heat = load * load
    heat += (omni.heat[i] - heat) * kept
    omni.heat[i] = heat
    peak, continuous = omni.peak_Nm[i], omni.continuous_Nm[i]
    if heat <= WARM:
        return float(peak)
    omni.trouble |= _HOT
    return float(max(continuous, peak - (peak - continuous) * (heat - WARM) / (1.0 - WARM)))


@native
def advance_omni(omni: np.record, hand: np.record, h_s: float, count: int = 1) -> None:
    """Advance arm, tool, hand (a `HAND` record) and the target of the hand by `count` steps of `h_s` [s]."""
    if not 0.0 < h_s < math.inf:
        return
    steps = math.ceil(h_s / STEP_MAX_S - 1e-6)
    h = h_s / steps
    grip, rate = grip_in_D(omni, hand)
    for k in range(count * steps):
        step(omni, ahead(grip, rate, (k + 0.5) * h), h)
    omni.held_s += count * h_s
    for i in range(3):
        hand.target_m[i] += hand.target_m_s[i] * (count * h_s)


@native
def read_omni(omni: np.record) -> Vector:
    """Tip position in W as measured by the encoders [m]."""
    q = _encoded(omni)
    return _place(omni, tip(turns_at(q[0], q[1], q[2])))


@native
def tip_omni(omni: np.record) -> Vector:
    """True tool position in W [m]."""
    p = omni.p_DT_m
    return _place(omni, (p[0], p[1], p[2]))


@native
def tip_velocity_omni(omni: np.record) -> Vector:
    """True tool velocity in W [m/s]."""
    R, v = omni.R_WD, omni.v_DT_m_s
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@native
def _encoded(omni: np.record) -> Vector:
    """Joint angles rounded to encoder counts."""
    return _counted(omni, 0), _counted(omni, 1), _counted(omni, 2)


@native
def _counted(omni: np.record, i: int) -> float:
    quantum = omni.quantum_rad[i]
    if quantum == 0.0:
        return float(omni.q[i])
    return float(quantum * math.floor(omni.q[i] / quantum + 0.5))


@native
def _place(omni: np.record, p_DT: Vector) -> Vector:
    """p_WT of p_DT."""
    R, o = omni.R_WD, omni.p_WD_m
    return (
        o[0] + R[0, 0] * p_DT[0] + R[0, 1] * p_DT[1] + R[0, 2] * p_DT[2],
        o[1] + R[1, 0] * p_DT[0] + R[1, 1] * p_DT[1] + R[1, 2] * p_DT[2],
        o[2] + R[2, 0] * p_DT[0] + R[2, 1] * p_DT[1] + R[2, 2] * p_DT[2],
    )
