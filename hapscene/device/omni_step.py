"""The simulated Phantom Omni in time: arm, structure, tool and hand, one step.

The integrator is a drift of half a step, a kick, and a drift of half a step (position Verlet: Hairer, Lubich & Wanner
2003, eq. 1.8), of second order and one look at the mechanism per step. Within the kick

- the tool's springs and dampers, of the structure and of the hand, are taken by the implicit midpoint rule, stable for
  any stiffness and any grip;
- what depends on the arm's speed (Coriolis, structural damping) is taken at the speed in mid-step, extrapolated from
  the change over the last step;
- dry friction is implicit in the speed after (`omni_friction`): a stopped joint has a speed of exactly 0.

`STEP_MAX_S` is 0.1 ms, the period of the acceleration channel: the fastest mode, the tool on the structure, turns by
0.057 rad in it. Where a hand taps and strokes a wall of 500 N/m, friction and all, halving the step moves the tip by
less than 0.3 µm and the wall's force by less than 0.1 mN, with a light, a medium and a firm grip
(tests/device/test_omni_step.py). With encoders that count, a count may fall into the next tick: that is the tick's
doing, and stays below a count.
"""

import math
from typing import Any, Final

from hapscene.contact.geometry import Vector
from hapscene.device.omni_dynamics import K6, K7, Slopes, coriolis_at, gravity_at, slopes_at
from hapscene.device.omni_friction import Symmetric, slow
from hapscene.device.omni_kinematics import (
    ELBOW_RAD,
    FOREARM_M,
    SHOULDER_RAD,
    UPPER_M,
    WAIST_RAD,
    Matrix,
    Turns,
    lever,
    tip,
    turns_at,
)
from hapscene.device.omni_record import OmniFlag
from hapscene.device.omni_tool import Grip, kick_tool, pull_rigid
from hapscene.native import native

STEP_MAX_S: Final = 1e-4
"""Longest step of the integrator [s]; a longer call is divided. Ten times longer, and the structure's mode is lost."""

STOP_NM_RAD: Final = 50.0
"""Stiffness of a joint's stop [N·m/rad]: 3.3 N at the tip reach 9 mrad into it. Real stops are stiffer; ten times
stiffer would need a finer step and no scene would feel it."""

STOP_NMS: Final = 0.3
"""Damping of a stop, while it is driven in [N·m·s/rad]: 0.4 of the critical damping of the shoulder."""

STOP_OVER_RAD: Final = 0.1
"""How far a stop gives at most [rad]. There a joint is stopped dead, whatever pushes."""

SPEED_MAX_RAD_S: Final = 100.0
"""Fastest joint that is simulated [rad/s]: 13 m/s at the tip, ten times a fast hand. Keeps every input finite."""

_AT_STOP = int(OmniFlag.AT_STOP)
_SPEED_LIMITED = int(OmniFlag.SPEED_LIMITED)


@native
def step(omni: Any, grip: Grip, h_s: float) -> None:
    """One step of at most `STEP_MAX_S` under a hand that is constant over it."""
    q, w = omni.q, omni.dq
    half = 0.5 * h_s
    q1, q2, q3 = q[0] + half * w[0], q[1] + half * w[1], q[2] + half * w[2]
    if omni.compliant == 1:
        now = _kick_compliant(omni, grip, (q1, q2, q3), h_s)
    else:
        now = _kick_rigid(omni, grip, (q1, q2, q3), h_s)
    q[0], q[1], q[2] = q1 + half * now[0], q2 + half * now[1], q3 + half * now[2]
    for i in range(3):
        omni.ddq[i] = (now[i] - w[i]) / h_s
        w[i] = now[i]
    _keep(omni)
    if omni.compliant == 0:
        turns = turns_at(q[0], q[1], q[2])
        p, J = tip(turns), lever(turns)
        for i in range(3):
            omni.p_DT_m[i] = p[i]
            omni.v_DT_m_s[i] = J[i][0] * w[0] + J[i][1] * w[1] + J[i][2] * w[2]


@native
def _kick_compliant(omni: Any, grip: Grip, q: Vector, h_s: float) -> Vector:
    """Joint speeds after the step, with the arm at mid-step at `q`; moves the tool, which is a mass of its own."""
    p, v = omni.p_DT_m, omni.v_DT_m_s
    turns = turns_at(q[0], q[1], q[2])
    slopes, load = slopes_at(q[1], q[2], turns), _load(omni, q, turns)
    end, J = tip(turns), lever(turns)
    before, mean = _speeds(omni, h_s)
    new, pull = kick_tool(omni, grip, end, _times(J, mean), h_s)
    torque = _transposed(J, pull)
    now = _kick_arm(omni, slopes, load, q, before, mean, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), torque, h_s)
    for i in range(3):
        p[i] += 0.5 * h_s * (v[i] + new[i])
        v[i] = new[i]
    return now


@native
def _kick_rigid(omni: Any, grip: Grip, q: Vector, h_s: float) -> Vector:
    """Joint speeds after the step where the tool, and the hand's mass with it, is part of the arm."""
    turns = turns_at(q[0], q[1], q[2])
    slopes, load = slopes_at(q[1], q[2], turns), _load(omni, q, turns)
    at, J = tip(turns), lever(turns)
    m = omni.tool_kg + grip[2]
    mass = (
        _gram(J, 0, 0, m),
        _gram(J, 1, 1, m),
        _gram(J, 2, 2, m),
        _gram(J, 0, 1, m),
        _gram(J, 0, 2, m),
        _gram(J, 1, 2, m),
    )
    before, mean = _speeds(omni, h_s)
    turn, f = _turning(turns, mean), pull_rigid(omni, grip, at, _times(J, mean))
    torque = _transposed(J, (f[0] - m * turn[0], f[1] - m * turn[1], f[2] - m * turn[2]))
    return _kick_arm(omni, slopes, load, q, before, mean, mass, torque, h_s)


@native
def _speeds(omni: Any, h_s: float) -> tuple[Vector, Vector]:
    """Joint speeds before the step, and their mean over it if they go on changing as in the last step."""
    w, rate, half = omni.dq, omni.ddq, 0.5 * h_s
    return (w[0], w[1], w[2]), (w[0] + half * rate[0], w[1] + half * rate[1], w[2] + half * rate[2])


@native
def _kick_arm(
    omni: Any,
    slopes: Slopes,
    load: Vector,
    q: Vector,
    w: Vector,
    mean: Vector,
    mass: Symmetric,
    torque: Vector,
    h_s: float,
) -> Vector:
    """Joint speeds after the step from w, under `load` and the `torque` from the tip, with `mass` added to its own."""
    bias = coriolis_at(slopes, mean[0], mean[1], mean[2])
    stop = _stops(omni, q, mean)
    drive1 = load[0] + torque[0] - bias[0] + stop[0]
    drive2 = load[1] + torque[1] - bias[1] + stop[1]
    drive3 = load[2] + torque[2] - bias[2] + stop[2]
    m11, m22, m33 = slopes[0] + mass[0], K6 + mass[1], K7 + mass[2]
    m12, m13, m23 = slopes[1] + mass[3], mass[4], slopes[2] + mass[5]
    b = omni.viscous_Nms
    lag1, lag2, lag3 = 0.5 * h_s * b[0], 0.5 * h_s * b[1], 0.5 * h_s * b[2]
    push = (
        (m11 - lag1) * w[0] + m12 * w[1] + m13 * w[2] + h_s * drive1,
        m12 * w[0] + (m22 - lag2) * w[1] + m23 * w[2] + h_s * drive2,
        m13 * w[0] + m23 * w[1] + (m33 - lag3) * w[2] + h_s * drive3,
    )
    c = omni.friction_Nm
    A = (m11 + lag1, m22 + lag2, m33 + lag3, m12, m13, m23)
    return slow(A, push, (h_s * c[0], h_s * c[1], h_s * c[2]), w)


@native
def _load(omni: Any, q: Vector, turns: Turns) -> Vector:
    """Torques [N·m] of motors and weight."""
    t = omni.torque_Nm
    if omni.gravity == 0:
        return t[0], t[1], t[2]
    weight2, weight3 = gravity_at(q[1], turns)
    return t[0], t[1] - weight2, t[2] - weight3


@native
def _stops(omni: Any, q: Vector, w: Vector) -> Vector:
    """Torques of the mechanical stops [N·m]: waist, shoulder, and the elbow, which couples shoulder and forearm."""
    waist = _stop(q[0], w[0], WAIST_RAD[0], WAIST_RAD[1])
    shoulder = _stop(q[1], w[1], SHOULDER_RAD[0], SHOULDER_RAD[1])
    elbow = _stop(q[2] - q[1], w[2] - w[1], ELBOW_RAD[0], ELBOW_RAD[1])
    if waist != 0.0 or shoulder != 0.0 or elbow != 0.0:
        omni.trouble |= _AT_STOP
    return waist, shoulder - elbow, elbow


@native
def _stop(angle: float, speed: float, low: float, high: float) -> float:
    """A spring past each limit, with a damper while it is driven in: it never pulls."""
    if angle > high:
        return -STOP_NM_RAD * (angle - high) - STOP_NMS * max(speed, 0.0)
    if angle < low:
        return STOP_NM_RAD * (low - angle) - STOP_NMS * min(speed, 0.0)
    return 0.0


@native
def _keep(omni: Any) -> None:
    """Keep joints within what the stops give at most, and their speeds within `SPEED_MAX_RAD_S`."""
    q, w = omni.q, omni.dq
    for i in range(3):
        if abs(w[i]) > SPEED_MAX_RAD_S:
            w[i] = math.copysign(SPEED_MAX_RAD_S, w[i])
            omni.trouble |= _SPEED_LIMITED
    _hold_within(omni, 0, 0.0, WAIST_RAD[0], WAIST_RAD[1])
    _hold_within(omni, 1, 0.0, SHOULDER_RAD[0], SHOULDER_RAD[1])
    _hold_within(omni, 2, q[1], ELBOW_RAD[0], ELBOW_RAD[1])


@native
def _hold_within(omni: Any, i: int, base: float, low: float, high: float) -> None:
    """Stop a joint dead where its stop gives no more."""
    q = omni.q
    least, most = base + low - STOP_OVER_RAD, base + high + STOP_OVER_RAD
    if q[i] < least or q[i] > most:
        q[i] = min(max(q[i], least), most)
        omni.dq[i] = 0.0


@native
def _times(J: Matrix, w: Vector) -> Vector:
    """J w."""
    return (
        J[0][0] * w[0] + J[0][1] * w[1] + J[0][2] * w[2],
        J[1][1] * w[1] + J[1][2] * w[2],
        J[2][0] * w[0] + J[2][1] * w[1] + J[2][2] * w[2],
    )


@native
def _transposed(J: Matrix, f: Vector) -> Vector:
    """Jᵀ f."""
    return (
        J[0][0] * f[0] + J[2][0] * f[2],
        J[0][1] * f[0] + J[1][1] * f[1] + J[2][1] * f[2],
        J[0][2] * f[0] + J[1][2] * f[1] + J[2][2] * f[2],
    )


@native
def _gram(J: Matrix, i: int, j: int, m: float) -> float:
    """Element of m JᵀJ."""
    return m * (J[0][i] * J[0][j] + J[1][i] * J[1][j] + J[2][i] * J[2][j])


@native
def _turning(turns: Turns, w: Vector) -> Vector:
    """(dJ/dt) w, the tip's acceleration at constant joint speeds [m/s²]."""
    s1, c1, s2, c2, s3, c3 = turns
    r = UPPER_M * c2 + FOREARM_M * s3
    rate = -UPPER_M * s2 * w[1] + FOREARM_M * c3 * w[2]
    out = -UPPER_M * c2 * w[1] * w[1] - FOREARM_M * s3 * w[2] * w[2] - r * w[0] * w[0]
    up = -UPPER_M * s2 * w[1] * w[1] + FOREARM_M * c3 * w[2] * w[2]
    side = 2.0 * rate * w[0]
    return out * s1 + side * c1, up, out * c1 - side * s1
