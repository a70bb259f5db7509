"""Predicts the poses of moving bodies in each tick from frames that a program sends about 60 times a second.

A frame holds the pose and velocity of a body and the part of the tool's impulse (`World.impulse`) that the program had
applied to the body by then. From the latest frame, each tick of length T integrates (semi-implicit Euler)

    v ← v + ΔJ/m + a T        x ← x + v T

where ΔJ is the impulse of the tool in the tick, m the mass, and a the acceleration by everything else, such as weight,
friction and supports. The estimate of a is the change of velocity between frames that the tool's impulse does not
explain. Of the last two estimates the smaller is used, and only if they agree in sign, so that a collision is not
taken for a steady force. Rotation is integrated in the same way about the centre of mass. A body without mass keeps
the velocity that the frame states.

The next frame never lies exactly where the body was predicted. The difference is removed linearly over the time
between two frames, so the pose never jumps. A body whose frames state no velocity is thus interpolated from frame to
frame, with a delay of one frame. A program that applies the tool's impulse one frame later states a velocity that lacks
this impulse and what it causes, so a is integrated over the lag too. Its poses lag as well: the difference is removed
over `LAG_FRAMES` frames, since a contact that follows the lag at once gains energy.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns
from hapscene.compiled.native import native
from hapscene.contact.moving import is_pose
from hapscene.contact.triangle import turn_to_body, turn_to_world
from hapscene.geometry import Vector, along, cross, dot, norm
from hapscene.records import Records

__all__ = ["FRAME", "HORIZON_S", "PREDICTED", "predict_bodies"]

FRAME: Final = np.dtype(
    [
        ("count", "i8"),  # odd while the frame is being written, 0 before the first frame
        ("teleport_count", "i8"),  # how often the body was teleported so far
        ("time_ns", "i8"),  # time of the pose, by the clock of the ticks
        ("lifetime_s", "f8"),  # how long the prediction may continue without another frame
        ("X_WB", "f8", (4, 4)),
        ("v", "f8", (6,)),  # linear velocity of the centre of mass [m/s] and angular velocity [rad/s], in W
        ("applied", "f8", (6,)),  # part of `World.impulse` that the pose already contains
        ("inverse_mass", "f8"),  # 1/mass [1/kg]; 0 for a body that the tool does not push
        ("com_B_m", "f8", (3,)),
        ("inverse_inertia_B", "f8", (3, 3)),  # inverse of the inertia about the centre of mass [1/(kg·m²)]
    ],
    align=True,
)
"""Frame of one body, written by the program that moves it."""

PREDICTED: Final = np.dtype(
    [
        ("count", "i8"),  # of the frame that the prediction starts from
        ("teleport_count", "i8"),
        ("refused", "i8"),  # 1 while the last frame has an invalid pose
        ("time_ns", "i8"),  # of that frame
        ("period_s", "f8"),  # time between frames, exponential mean
        ("left_s", "f8"),  # time until the last difference is removed
        ("com_B_m", "f8", (3,)),  # as in the frame that the prediction starts from
        ("com_W_m", "f8", (3,)),  # predicted, without the remaining difference
        ("R_WB", "f8", (3, 3)),
        ("v", "f8", (6,)),
        ("given", "f8", (6,)),  # impulse of the tool up to the last tick
        ("frame_v", "f8", (6,)),  # velocities of the last frame
        ("frame_applied", "f8", (6,)),  # impulse that the last frame contains, about the centre of mass
        ("last_other", "f8", (6,)),  # acceleration by all but the tool between the last two frames [m/s², rad/s²]
        ("other", "f8", (6,)),  # the estimate of it that is used
        ("off_m", "f8", (3,)),  # remaining difference to the last frame
        ("off_rad", "f8", (3,)),
        ("shown_R", "f8", (3, 3)),  # scratch: the rotation with the remaining difference
    ],
    align=True,
)
"""State of the prediction of one body."""

HORIZON_S: Final = 0.1
"""Longest time that a body moves on without a new frame [s]: six frames at 60 Hz. After it the body stops."""

SHARE: Final = 0.2
"""Weight of the newest interval in the mean time between frames [1]. It is small because a delayed frame arrives
together with the next one, and that interval of 0 must not count as a jump."""

LAG_FRAMES: Final = 4.0
"""Number of frames in which the difference to a lagging frame is removed [1]. With a spring K, a mass m and a lag of
one frame T, an oscillation grows by 10 % per frame at K T²/m = 0.9 if this is 1, and decays by 2 % if it is 4
(eigenvalues); at 0.1 it grows by 2 % or 0.8 %, which the wall damps."""

PERIOD_S: Final = 1.0 / 60.0
"""Time between frames that is assumed until two have arrived [s]."""


@native
def predict_bodies(
    frames: Records,
    predicted: Records,
    moving: NDArray[np.int64],
    impulse: NDArray[np.float64],
    X_WB: NDArray[np.float64],
    teleported: NDArray[np.int64],
    now: int,
    clock: NDArray[np.int64],
    tick_s: float,
) -> None:
    """Write the poses `X_WB[0]` (m, 4, 4) of the bodies `moving` (m,) in the tick that begins `now`.

    Sets `teleported` (m,) for the bodies that jump. `frames`, `predicted` and `impulse` cover all bodies of the scene.
    """
    for m in range(len(moving)):
        frame, body, given = frames[moving[m]], predicted[moving[m]], impulse[moving[m]]
        count = frame.count
        if body.count > 0 and now - body.time_ns < 1e9 * frame.lifetime_s:
            # also if a new frame has arrived: it is compared with the prediction for the same tick
            _integrate(frame, body, given, tick_s)
        if count != body.count and count % 2 == 0:
            now_ns(clock)  # a call that orders the two reads of the count (sequence lock)
            body.refused, teleports = 0 if is_pose(frame.X_WB) else 1, frame.teleport_count
            if body.refused == 0:
                _start_from_frame(frame, body, given, now)
            now_ns(clock)
            if frame.count == count:  # otherwise the frame was being written; it is read again in the next tick
                body.count = count
                if body.refused == 0 and teleports != body.teleport_count:
                    body.teleport_count = teleports
                    teleported[m] = 1
        for i in range(6):
            body.given[i] = given[i]
        fades = teleported[m] == 0 and body.left_s > tick_s
        fade = (body.left_s - tick_s) / body.left_s if fades else 0.0
        body.left_s -= tick_s
        for i in range(3):
            body.off_m[i] *= fade
            body.off_rad[i] *= fade
        _write_pose(body, X_WB[0, m])
        if body.refused == 1:
            X_WB[0, m, 0, 3] = math.nan  # `place_bodies` flags the invalid pose and leaves the body where it is


@native
def _start_from_frame(frame: np.record, body: np.record, given: NDArray[np.float64], now: int) -> None:
    """Start the prediction from a frame, extrapolated to the present time."""
    known = body.count > 0
    age_s = min(max(1e-9 * (now - frame.time_ns), 0.0), frame.lifetime_s)
    span_s = 1e-9 * (frame.time_ns - body.time_ns) if known else 0.0
    if span_s > 0.0:
        body.period_s += (span_s - body.period_s) * (SHARE if body.period_s > 0.0 else 1.0)
    body.left_s = min(body.period_s, HORIZON_S) if body.period_s > 0.0 else PERIOD_S
    lag_s = _lag_s(frame, body, given)
    body.left_s *= LAG_FRAMES if lag_s > 0.5 * body.period_s else 1.0
    body.time_ns = frame.time_ns
    _rotate(body.shown_R, (body.off_rad[0], body.off_rad[1], body.off_rad[2]), body.R_WB)
    for i in range(3):
        # the pose in use so far, from which the difference to the new prediction is computed below
        body.off_m[i] += body.com_W_m[i]
        for j in range(3):
            body.off_m[i] += body.shown_R[i, j] * (frame.com_B_m[j] - body.com_B_m[j])
            body.R_WB[i, j] = frame.X_WB[i, j]
    for i in range(3):
        body.com_B_m[i] = frame.com_B_m[i]
    _estimate_other_acceleration(frame, body, span_s)
    for i in range(6):
        body.v[i] = frame.v[i]
    _add_impulse(frame, body, frame.applied, given)
    for i in range(6):
        body.v[i] += body.other[i] * (age_s + lag_s)
    arm, mean_s = _com_offset(body), 0.5 * age_s
    for i in range(3):
        body.com_W_m[i] = frame.X_WB[i, 3] + arm[i] + mean_s * (frame.v[i] + body.v[i])
    w = (frame.v[3] + body.v[3], frame.v[4] + body.v[4], frame.v[5] + body.v[5])
    _rotate(body.R_WB, (mean_s * w[0], mean_s * w[1], mean_s * w[2]), body.R_WB)
    off = _rotation_between(body.R_WB, body.shown_R)
    for i in range(3):
        body.off_m[i] -= body.com_W_m[i]
        body.off_rad[i] = off[i]
    total = body.off_m[0] + body.off_m[1] + body.off_m[2] + off[0] + off[1] + off[2]
    if not (known and math.isfinite(total)):  # the difference to a frame that is not finite is dropped
        for i in range(3):
            body.off_m[i] = body.off_rad[i] = 0.0


@native
def _lag_s(frame: np.record, body: np.record, given: NDArray[np.float64]) -> float:
    """Return the time by which a frame lacks the tool's impulse, from what it contains more than the last one [s]."""
    lacks2 = gains2 = 0.0
    for i in range(3):
        lacks2 += (given[i] - frame.applied[i]) ** 2
        gains2 += (frame.applied[i] - body.frame_applied[i]) ** 2
    return float(body.period_s * min(math.sqrt(lacks2 / gains2), 1.0) if gains2 > 0.0 else 0.0)


@native
def _estimate_other_acceleration(frame: np.record, body: np.record, span_s: float) -> None:
    """Estimate the acceleration by all but the tool between two frames `span_s` apart; 0 for the first frame."""
    for i in range(6):
        body.v[i] = 0.0
    _add_impulse(frame, body, body.frame_applied, frame.applied)
    for i in range(6):
        new = 0.0
        if span_s > 0.0 and frame.inverse_mass > 0.0:
            new = (frame.v[i] - body.frame_v[i] - body.v[i]) / span_s
        last = body.last_other[i]
        body.other[i] = math.copysign(min(abs(new), abs(last)), new) if new * last > 0.0 else 0.0
        body.last_other[i] = new
        body.frame_v[i], body.frame_applied[i] = frame.v[i], frame.applied[i]


@native
def _integrate(frame: np.record, body: np.record, given: NDArray[np.float64], tick_s: float) -> None:
    """Integrate one tick."""
    _add_impulse(frame, body, body.given, given)
    v = body.v
    for i in range(6):
        v[i] += body.other[i] * tick_s
    for i in range(3):
        body.com_W_m[i] += v[i] * tick_s
    _rotate(body.R_WB, (v[3] * tick_s, v[4] * tick_s, v[5] * tick_s), body.R_WB)


@native
def _add_impulse(frame: np.record, body: np.record, before: NDArray[np.float64], after: NDArray[np.float64]) -> None:
    """Add the change of velocity by the tool's impulse between two totals to the velocities of a body."""
    if frame.inverse_mass == 0.0:
        return
    J = (after[0] - before[0], after[1] - before[1], after[2] - before[2])
    # the totals are about the origin of the body; move them to its centre of mass
    about = cross(_com_offset(body), J)
    L = (after[3] - before[3] - about[0], after[4] - before[4] - about[1], after[5] - before[5] - about[2])
    L_B = turn_to_body(body, L)
    Y = frame.inverse_inertia_B
    spin = turn_to_world(
        body,
        (
            Y[0, 0] * L_B[0] + Y[0, 1] * L_B[1] + Y[0, 2] * L_B[2],
            Y[1, 0] * L_B[0] + Y[1, 1] * L_B[1] + Y[1, 2] * L_B[2],
            Y[2, 0] * L_B[0] + Y[2, 1] * L_B[1] + Y[2, 2] * L_B[2],
        ),
    )
    for i in range(3):
        body.v[i] += frame.inverse_mass * J[i]
        body.v[3 + i] += spin[i]


@native
def _write_pose(body: np.record, X_WB: NDArray[np.float64]) -> None:
    """Write the pose including the remaining difference."""
    _rotate(body.shown_R, (body.off_rad[0], body.off_rad[1], body.off_rad[2]), body.R_WB)
    for i in range(3):
        turned = 0.0
        for j in range(3):
            X_WB[i, j] = body.shown_R[i, j]
            turned += body.shown_R[i, j] * body.com_B_m[j]
        X_WB[i, 3] = body.com_W_m[i] + body.off_m[i] - turned


@native
def _com_offset(body: np.record) -> Vector:
    """Return the vector from the origin of the body to its centre of mass, in W [m]."""
    c = body.com_B_m
    return turn_to_world(body, (c[0], c[1], c[2]))


@native
def _rotate(out: NDArray[np.float64], by_rad: Vector, R: NDArray[np.float64]) -> None:
    """Compute out = exp(by) R for a rotation vector (Rodrigues' formula); `out` may be `R`."""
    angle = norm(by_rad)
    s = math.sin(angle) / angle if angle > 0.0 else 1.0
    c = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-8 else 0.5
    for j in range(3):
        v = (R[0, j], R[1, j], R[2, j])
        one = cross(by_rad, v)
        two = cross(by_rad, one)
        for i in range(3):
            out[i, j] = v[i] + s * one[i] + c * two[i]


@native
def _rotation_between(A: NDArray[np.float64], B: NDArray[np.float64]) -> Vector:
    """Return the rotation vector that turns A into B, or 0 near half a turn, where it is ambiguous."""
    r = (0.0, 0.0, 0.0)
    trace = 0.0
    for k in range(3):
        a, b = (A[0, k], A[1, k], A[2, k]), (B[0, k], B[1, k], B[2, k])
        r = along(r, 0.5, cross(a, b))
        trace += dot(a, b)
    sine, cosine = norm(r), 0.5 * (trace - 1.0)
    if sine < 1e-12 or cosine < -0.99:
        return 0.0, 0.0, 0.0
    scale = math.atan2(sine, cosine) / sine
    return scale * r[0], scale * r[1], scale * r[2]
