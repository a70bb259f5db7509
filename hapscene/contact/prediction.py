"""Bodies between two frames of a program that moves them, 60 times a second and not 1,000: where they are in each tick.

A frame says where a body is, how fast it goes, and how much of what the tool gave it (`World.impulse`) it had got by
then. From there, tick by tick of T, it goes on:

    v ← v + ΔJ/m + a T        x ← x + v T

ΔJ is what the tool gives in a tick, m the mass, a the acceleration by all else (weight, friction, what it leans on):
the part of the frames' change of velocity that the tool's impulse does not explain; of the last two the smaller where
they agree in sign, so that a knock is not taken for a steady force. Turning goes likewise, about the centre of mass. A
body without a mass goes on as fast as it is said to.

The next frame is never where the body was thought to be. The difference is taken back evenly over the time between two
frames, so that nothing jumps; a body that is said no velocity so goes straight from frame to frame, one behind.
"""

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import now_ns
from hapscene.compiled.native import native
from hapscene.contact.moving import is_pose
from hapscene.contact.triangle import turn_to_body, turn_to_world
from hapscene.geometry import Vector, along, cross, dot, norm
from hapscene.records import Records

if TYPE_CHECKING:
    pass

__all__ = ["FRAME", "HORIZON_S", "PREDICTED", "predict_bodies"]

FRAME: Final = np.dtype(
    [
        ("count", "i8"),  # odd while the frame is being written, 0 before the first
        ("jumps", "i8"),  # how often the body was teleported
        ("time_ns", "i8"),  # when it was so, by the clock of the ticks
        ("lasts_s", "f8"),  # how long it may go on without another frame
        ("X_WB", "f8", (4, 4)),
        ("v", "f8", (6,)),  # velocity of the centre of mass [m/s], and of turning [rad/s], in W
        ("seen", "f8", (6,)),  # impulse of the tool that this contains, as `World.impulse` has it
        ("lightness", "f8"),  # 1/mass [1/kg]; 0 for a body that the tool does not push
        ("com_B_m", "f8", (3,)),
        ("yields_B", "f8", (3, 3)),  # inverse of the inertia about the centre of mass [1/(kg·m²)]
    ],
    align=True,
)
"""What the program says of a body."""

PREDICTED: Final = np.dtype(
    [
        ("count", "i8"),  # of the frame it goes on from
        ("jumps", "i8"),
        ("refused", "i8"),  # 1 while the last frame had an invalid pose
        ("time_ns", "i8"),  # of that frame
        ("period_s", "f8"),  # from frame to frame, in the mean of the last few
        ("left_s", "f8"),  # until nothing is left of the last difference
        ("com_B_m", "f8", (3,)),  # as the frame it goes on from had it
        ("com_W_m", "f8", (3,)),  # as predicted: without what is left of the last difference
        ("R_WB", "f8", (3, 3)),
        ("v", "f8", (6,)),
        ("given", "f8", (6,)),  # the tool's impulse so far
        ("frame_v", "f8", (6,)),  # the last frame's velocities,
        ("frame_seen", "f8", (6,)),  # and what it contains of the impulse, about the centre of mass
        ("last_other", "f8", (6,)),  # acceleration by all but the tool between the last two frames [m/s², rad/s²],
        ("other", "f8", (6,)),  # and what is taken of it
        ("off_m", "f8", (3,)),  # what is left of the difference to the last frame
        ("off_rad", "f8", (3,)),
        ("shown_R", "f8", (3, 3)),  # scratch: the rotation with it
    ],
    align=True,
)
"""What the ticks make of it."""

HORIZON_S: Final = 0.1
"""How long a body goes on without a new frame [s]: six of them at 60 Hz. Then it stands where it is."""

SHARE: Final = 0.2
"""Share of the newest in the mean time between frames [1]: of two that come at once, late, the second is no jump."""

PERIOD_S: Final = 1.0 / 60.0
"""Time between two frames until there were two [s]."""


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
    """Poses `X_WB[0]` (m, 4, 4) of the bodies `moving` (m,) in the tick that begins `now`, and which of them jump (m,).

    `frames`, `predicted` and `impulse` are those of all bodies.
    """
    for m in range(len(moving)):
        frame, body, given = frames[moving[m]], predicted[moving[m]], impulse[moving[m]]
        count = frame.count
        if body.count > 0 and now - body.time_ns < 1e9 * frame.lasts_s:
            _go_on(frame, body, given, tick_s)  # also where a frame comes: what it is held against is of this tick
        if count != body.count and count % 2 == 0:
            now_ns(clock)  # keeps the two looks at the count apart
            body.refused, jumps = 0 if is_pose(frame.X_WB) else 1, frame.jumps
            if body.refused == 0:
                _begin(frame, body, given, now)
            now_ns(clock)
            if frame.count == count:  # else it was being written, and is taken again in the next tick
                body.count = count
                if body.refused == 0 and jumps != body.jumps:
                    body.jumps = jumps
                    teleported[m] = 1
        for i in range(6):
            body.given[i] = given[i]
        fades = teleported[m] == 0 and body.left_s > tick_s
        fade = (body.left_s - tick_s) / body.left_s if fades else 0.0
        body.left_s -= tick_s
        for i in range(3):
            body.off_m[i] *= fade
            body.off_rad[i] *= fade
        _show(body, X_WB[0, m])
        if body.refused == 1:
            X_WB[0, m, 0, 3] = math.nan  # has it flagged, and the body left where it is


@native
def _begin(frame: np.record, body: np.record, given: NDArray[np.float64], now: int) -> None:
    """Go on from a frame, from what has become of it by now."""
    known = body.count > 0
    age_s = min(max(1e-9 * (now - frame.time_ns), 0.0), frame.lasts_s)
    span_s = 1e-9 * (frame.time_ns - body.time_ns) if known else 0.0
    if span_s > 0.0:
        body.period_s += (span_s - body.period_s) * (SHARE if body.period_s > 0.0 else 1.0)
    body.left_s = min(body.period_s, HORIZON_S) if body.period_s > 0.0 else PERIOD_S
    body.time_ns = frame.time_ns
    _turn(body.shown_R, (body.off_rad[0], body.off_rad[1], body.off_rad[2]), body.R_WB)
    for i in range(3):
        body.off_m[i] += body.com_W_m[i]  # where it is shown, until it is known where it should be
        for j in range(3):
            body.off_m[i] += body.shown_R[i, j] * (frame.com_B_m[j] - body.com_B_m[j])
            body.R_WB[i, j] = frame.X_WB[i, j]
    for i in range(3):
        body.com_B_m[i] = frame.com_B_m[i]
    _note_others(frame, body, span_s)
    for i in range(6):
        body.v[i] = frame.v[i]
    _push(frame, body, frame.seen, given)
    for i in range(6):
        body.v[i] += body.other[i] * age_s
    arm, mean_s = _arm(body), 0.5 * age_s
    for i in range(3):
        body.com_W_m[i] = frame.X_WB[i, 3] + arm[i] + mean_s * (frame.v[i] + body.v[i])
    w = (frame.v[3] + body.v[3], frame.v[4] + body.v[4], frame.v[5] + body.v[5])
    _turn(body.R_WB, (mean_s * w[0], mean_s * w[1], mean_s * w[2]), body.R_WB)
    off, check = _between(body.R_WB, body.shown_R), 0.0
    for i in range(3):
        body.off_m[i] -= body.com_W_m[i]
        body.off_rad[i] = off[i]
        check += 0.0 * body.off_m[i] + 0.0 * off[i]
    if not (known and check == 0.0):  # a frame that led to infinity is not held against the next
        for i in range(3):
            body.off_m[i] = body.off_rad[i] = 0.0


@native
def _note_others(frame: np.record, body: np.record, span_s: float) -> None:
    """What all but the tool has done to a body between two frames, `span_s` apart; 0 for the first."""
    for i in range(6):
        body.v[i] = 0.0
    _push(frame, body, body.frame_seen, frame.seen)
    for i in range(6):
        new = 0.0
        if span_s > 0.0 and frame.lightness > 0.0:
            new = (frame.v[i] - body.frame_v[i] - body.v[i]) / span_s
        last = body.last_other[i]
        body.other[i] = math.copysign(min(abs(new), abs(last)), new) if new * last > 0.0 else 0.0
        body.last_other[i] = new
        body.frame_v[i], body.frame_seen[i] = frame.v[i], frame.seen[i]


@native
def _go_on(frame: np.record, body: np.record, given: NDArray[np.float64], tick_s: float) -> None:
    """One tick further."""
    _push(frame, body, body.given, given)
    v = body.v
    for i in range(6):
        v[i] += body.other[i] * tick_s
    for i in range(3):
        body.com_W_m[i] += v[i] * tick_s
    _turn(body.R_WB, (v[3] * tick_s, v[4] * tick_s, v[5] * tick_s), body.R_WB)


@native
def _push(frame: np.record, body: np.record, before: NDArray[np.float64], after: NDArray[np.float64]) -> None:
    """Add to a body's velocities what the tool's impulse between two totals gives."""
    if frame.lightness == 0.0:
        return
    J = (after[0] - before[0], after[1] - before[1], after[2] - before[2])
    about = cross(_arm(body), J)
    L = (after[3] - before[3] - about[0], after[4] - before[4] - about[1], after[5] - before[5] - about[2])
    L_B = turn_to_body(body, L)
    Y = frame.yields_B
    spin = turn_to_world(
        body,
        (
            Y[0, 0] * L_B[0] + Y[0, 1] * L_B[1] + Y[0, 2] * L_B[2],
            Y[1, 0] * L_B[0] + Y[1, 1] * L_B[1] + Y[1, 2] * L_B[2],
            Y[2, 0] * L_B[0] + Y[2, 1] * L_B[1] + Y[2, 2] * L_B[2],
        ),
    )
    for i in range(3):
        body.v[i] += frame.lightness * J[i]
        body.v[3 + i] += spin[i]


@native
def _show(body: np.record, X_WB: Any) -> None:
    """The pose, with what is left of the last difference."""
    _turn(body.shown_R, (body.off_rad[0], body.off_rad[1], body.off_rad[2]), body.R_WB)
    for i in range(3):
        turned = 0.0
        for j in range(3):
            X_WB[i, j] = body.shown_R[i, j]
            turned += body.shown_R[i, j] * body.com_B_m[j]
        X_WB[i, 3] = body.com_W_m[i] + body.off_m[i] - turned


@native
def _arm(body: np.record) -> Vector:
    """From the body's origin to its centre of mass, in W."""
    c = body.com_B_m
    return turn_to_world(body, (c[0], c[1], c[2]))


@native
def _turn(out: NDArray[np.float64], by_rad: Vector, R: NDArray[np.float64]) -> None:
    """out = exp(by) R, for a rotation vector (Rodrigues); `out` may be `R`."""
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
def _between(A: NDArray[np.float64], B: NDArray[np.float64]) -> Vector:
    """The rotation vector that turns A into B; 0 near half a turn, which has two."""
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
