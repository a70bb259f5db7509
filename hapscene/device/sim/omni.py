"""The simulated Phantom Omni: what its data sheet and its published dynamics say, in the loop.

    record = Omni().record(p_WT_m)        one device, its tip at p_WT_m
    read_omni(record[0])                  the tip in W as the encoders see it
    hold_omni(record[0], fx, fy, fz)      the force wanted at the tip, in W, held until the next call
    advance_omni(record[0], hand[0], h_s) arm, structure, tool and hand move on
    tip_omni(record[0])                   where the tool really is

**Two masses.** The tool is a mass of 7.9 g on the arm's end, by springs of 1.26, 2.31 and 1.02 N/mm along x, y, z of D
(the data sheet's stiffness) with a damping ratio of 0.05 (assumed). With orthogonal arms the published dynamics show
37.1 g in the arm's lightest direction, and with the tool the data sheet's 45 g. Tool against arm is one resonance per
axis, at 66, 91 and 61 Hz, lower with a hand's mass on the tool. Encoders and motors are on the arm's side: what they
see lags the tool by the structure's deflection, at rest f/k, so that a wall of 1 N/mm feels like 0.5 N/mm along z.

**Friction** is dry in each joint, 0.26 N at the tip in the nominal posture along each joint's way, and viscous,
0.1 N·s/m (assumed).

**Encoders** count in joint space, so many counts to a joint's turn that a count moves the tip by 0.055 mm in the
nominal posture: 21,347, 15,308 and 15,137. Over the workspace a count of the waist is 0.045 to 0.069 mm.

**Motors** give 3.3 N in the nominal posture for a short time, 0.88 N for any time. Each warms by its torque squared
with one time constant (60 s, assumed), to 1 at continuous torque; from a warmth of 0.9, 4 s into full force, its limit
comes down, to be the continuous torque at 1. Where a motor is at its limit the whole force is scaled, its direction
kept. Gravity acts, and the motors carry it, as the user's driver has them do, at the cost of a part of their torque.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

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

# Where the simulated Phantom Omni stands.


def stand(p_WT_m: Sequence[float]) -> NDArray[np.float64]:
    """X_WD (4, 4) of a device whose tip is at `p_WT_m` (3,) in the nominal posture; z of W is up, its user at −y."""
    X = np.eye(4)
    X[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    X[:3, 3] = np.asarray(p_WT_m, float) - X[:3, :3] @ forward(NOMINAL_RAD)
    return X


def out_of_reach(p_WT_m: Sequence[float], p_DT_m: NDArray[np.float64]) -> str:
    """The one sentence for a start that the arm cannot reach."""
    middle = ", ".join(f"{v:.3f}" for v in forward(NOMINAL_RAD))
    there = ", ".join(f"{v:.3f}" for v in p_DT_m)
    return (
        f"omni: p_WT_m {tuple(float(v) for v in p_WT_m)} is ({there}) m in the device's frame, out of its reach; "
        f"the middle of its workspace is ({middle}) m, about which it reaches 80, 60, 35 mm along x, y, z"
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
"""Warmth of a motor from which its torque limit comes down, to be continuous at a warmth of 1 [1]. Closer to 1 the
force drops faster, felt as a step."""

WANTED_MAX_N: Final = 1e6
"""Largest force that is looked at [N]; more is cut to this before it is scaled to what the motors have."""

_FORCE_NOT_FINITE = int(OmniFlag.FORCE_NOT_FINITE)
_TORQUE_LIMITED = int(OmniFlag.TORQUE_LIMITED)
_HOT = int(OmniFlag.HOT)
_SINGULAR = int(OmniFlag.SINGULAR)


@dataclass(frozen=True)
class Omni:
    """A Phantom Omni's parameters; the defaults are the data sheet's, and assumed where the module says so.

    Attributes:
        friction_N: dry friction at the tip in the nominal posture; 0 for none.
        damping_Ns_m: viscous damping there; 0 for none.
        resolution_m: step of the encoders there; 0 for exact encoders.
        peak_N: most force there for a short time; may be infinite.
        continuous_N: and for any time.
        thermal_s: time constant of the motors' warming; infinite for motors that stay cold.
        compliant: False for a tool rigidly at the arm's end.
        stiffness_N_m: of the structure between arm and tool, along x, y, z of D.
        damping_ratio: of the tool against the arm, in the nominal posture.
        tool_kg: mass of the tool.
        gravity: whether weight and counterbalance act.
        gravity_compensated: whether the motors carry them.

    Raises:
        HapsceneError: a number out of range.
    """

    friction_N: float = 0.26
    damping_Ns_m: float = 0.1
    resolution_m: float = 5.5e-5
    peak_N: float = 3.3
    continuous_N: float = 0.88
    thermal_s: float = 60.0
    compliant: bool = True
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
            raise HapsceneError(f"omni: stiffness_N_m must be three numbers, x, y, z, is {self.stiffness_N_m}")
        if self.continuous_N > self.peak_N:
            raise HapsceneError(f"omni: continuous_N {self.continuous_N} is over peak_N {self.peak_N}")

    @property
    def counts(self) -> tuple[int, int, int]:
        """Encoder counts to one turn of each joint; 0 where `resolution_m` is."""
        if self.resolution_m == 0.0:
            return 0, 0, 0
        q1, q2, q3 = (round(2.0 * math.pi * lever_m / self.resolution_m) for lever_m in NOMINAL_LEVER_M)
        return q1, q2, q3

    @property
    def resonance_Hz(self) -> NDArray[np.float64]:
        """(3,) frequencies of the tool against the arm along x, y, z of D, nominal posture, no hand, joints free."""
        return np.asarray(np.sqrt(np.array(self.stiffness_N_m) / self._reduced_kg()) / (2.0 * math.pi))

    def record(self, p_WT_m: Sequence[float], X_WD: ArrayLike | None = None) -> Any:
        """(1,) OMNI, at rest with its tip at `p_WT_m` (3,); `X_WD` (4, 4) is where it stands, by default `stand`.

        Raises:
            HapsceneError: `X_WD` is no pose, or the tip is out of the workspace.
        """
        X = stand(p_WT_m) if X_WD is None else rigid(X_WD, "omni: X_WD")
        p_DT_m = X[:3, :3].T @ (np.asarray(p_WT_m, float) - X[:3, 3])
        if not reachable(p_DT_m):
            raise HapsceneError(out_of_reach(p_WT_m, p_DT_m))
        omni = np.zeros(1, OMNI).view(np.recarray)
        lever_m = np.array(NOMINAL_LEVER_M)
        omni.R_WD, omni.p_WD_m = X[:3, :3], X[:3, 3]
        omni.compliant, omni.gravity, omni.compensated = self.compliant, self.gravity, self.gravity_compensated
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
        """(3,) mass of tool and arm against each other, nominal posture."""
        arm_kg = apparent_mass(NOMINAL_RAD)
        return np.asarray(arm_kg * self.tool_kg / (arm_kg + self.tool_kg))


@native
def hold_omni(omni: np.record, x_N: float, y_N: float, z_N: float) -> None:
    """Have the motors make the force (x, y, z) [N] in W at the tip from now on: τ = Jᵀ f, J at the encoders' angles.

    A force that is not finite is none, and flagged. Where a motor has too little torque, all of the force is scaled.
    """
    omni.trouble = 0
    if not (math.isfinite(x_N) and math.isfinite(y_N) and math.isfinite(z_N)):
        omni.trouble |= _FORCE_NOT_FINITE
        x_N, y_N, z_N = 0.0, 0.0, 0.0
    size = max(abs(x_N), abs(y_N), abs(z_N))
    if size > WANTED_MAX_N:
        x_N, y_N, z_N = x_N / size * WANTED_MAX_N, y_N / size * WANTED_MAX_N, z_N / size * WANTED_MAX_N
    R, q = omni.R_WD, _encoded(omni)
    f0 = R[0, 0] * x_N + R[1, 0] * y_N + R[2, 0] * z_N
    f1 = R[0, 1] * x_N + R[1, 1] * y_N + R[2, 1] * z_N
    f2 = R[0, 2] * x_N + R[1, 2] * y_N + R[2, 2] * z_N
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
    """Torques for the weight, and as much of those wanted as every motor's limit leaves room for."""
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
    """Warm a motor by the torque it held; returns the most torque it may now give [N·m]."""
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
    """Move arm, tool and hand (a `HAND` record) on by `h_s` [s] `count` times, the hand's target moving on with it."""
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
    """Where the encoders put the tip, in W [m]."""
    q = _encoded(omni)
    return _place(omni, tip(turns_at(q[0], q[1], q[2])))


@native
def tip_omni(omni: np.record) -> Vector:
    """Where the tool is, in W [m]."""
    p = omni.p_DT_m
    return _place(omni, (p[0], p[1], p[2]))


@native
def tip_velocity_omni(omni: np.record) -> Vector:
    """How fast the tool moves, in W [m/s]."""
    R, v = omni.R_WD, omni.v_DT_m_s
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@native
def _encoded(omni: np.record) -> Vector:
    """Joint angles as the encoders see them: the nearest count."""
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
