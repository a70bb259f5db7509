"""Moving bodies: sets and checks their poses at the start of a tick, and releases the proxy from bodies that jump."""

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import REACH_MAX_M
from hapscene.contact.deformation import reshape_bodies
from hapscene.contact.inside import close_puncture
from hapscene.contact.planes import drop_planes_of
from hapscene.contact.proxy import place_proxy
from hapscene.contact.world import update_ball
from hapscene.flags import Flag
from hapscene.geometry import RIGID_TOLERANCE

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["ROTATION_TOLERANCE", "is_pose", "place_bodies"]

ROTATION_ROUNDING: Final = 1e-12
"""Deviation of a matrix from a rotation up to which it is used as it is [1]: a few roundings of float64."""

ROTATION_TOLERANCE: Final = 1e-2
"""Largest deviation from a rotation that is corrected [1]. A float32 matrix that is multiplied on at 60 Hz reaches it
after an hour at worst. A larger deviation means scale or shear, and the pose is refused."""

_REFUSED: Final = int(Flag.POSE_REFUSED)

MOVED_LAST_TICK: Final = 2
"""Value of `BODY.moved` while a tick begins: the body moved in the last tick and has no pose for this one yet."""


@native
def place_bodies(
    world: "World",
    surface: "Surface",
    moving: NDArray[np.int64],
    X_WB: NDArray[np.float64],
    teleported: NDArray[np.int64],
    count: int,
    k: int,
) -> int:
    """Set the poses `X_WB[k]` (m, 4, 4) of the first `count` of the bodies `moving` (m,); all other bodies rest.

    In the first tick after a reset, and where `teleported` (m,) is not 0, a body appears at its pose without motion;
    `teleported` is then set to 0. A pose that is not finite, or not a rotation and a translation, is ignored and
    reported in `world.proxy[0].moving_flags`: the body stays at its last pose. Returns no flags.
    """
    proxy, moved = world.proxy[0], world.moved
    proxy.moving_flags = 0
    if len(world.ball) > 0:
        world.ball[0].count = 0  # planes around a tip with a radius hold for resting bodies only
    last = moved[0]
    for i in range(1, last + 1):
        world.bodies[moved[i]].moved = MOVED_LAST_TICK
    nearer, jumps, fresh = 0.0, 0, surface.memory[0].fresh
    for m in range(count):
        body = world.bodies[moving[m]]
        _keep_last_pose(body)
        if body.shift_s > 0.0:  # the shift of a deforming body is not part of its pose
            for i in range(3):
                body.p_WB_m[i] -= body.shift_W_m[i]
        if not _set_pose(body, X_WB[k, m]):
            proxy.moving_flags |= _REFUSED
        body.moved = 1
        if fresh == 1 or teleported[m] != 0:
            _stop(body)
            body.shift_s = 0.0
            for i in range(3):
                body.shift_W_m[i] = 0.0
        if teleported[m] != 0:
            jumps += 1
        nearer = max(nearer, update_ball(body, world.ball_W_m[moving[m]]))
    proxy.near_margin_m -= nearer
    for i in range(1, last + 1):  # bodies that moved in the last tick and have no new pose are at rest now
        body = world.bodies[moved[i]]
        if body.moved == MOVED_LAST_TICK:
            _stop(body)
            update_ball(body, world.ball_W_m[moved[i]])
    moved[0] = 0
    for m in range(count):
        if world.bodies[moving[m]].moved == 1:
            moved[0] += 1
            moved[moved[0]] = moving[m]
    if count > 0 and fresh == 1:
        _restart_proxy(world, surface)
    elif jumps > 0:
        _release(world, surface, moving[:count], teleported)
    for m in range(count if jumps > 0 else 0):
        teleported[m] = 0
    if proxy.reshaped > 0:
        reshape_bodies(world, surface)
    return 0


@native
def _keep_last_pose(body: np.record) -> None:
    """Copy the present pose of a body to that of the last tick."""
    for i in range(3):
        for j in range(3):
            body.last_R_WB[i, j] = body.R_WB[i, j]
        body.last_p_WB_m[i] = body.p_WB_m[i]


@native
def _stop(body: np.record) -> None:
    """Mark a body as at rest at its present pose."""
    body.moved = 0
    _keep_last_pose(body)


@native
def _set_pose(body: np.record, X: NDArray[np.float64]) -> bool:
    """Set the pose of a body from (4, 4) and correct its rotation; return False and set nothing if it is invalid."""
    if not is_pose(X):
        return False
    R = body.R_WB
    for i in range(3):
        for j in range(3):
            R[i, j] = X[i, j]
        body.p_WB_m[i] = X[i, 3]
    while _rotation_error(R) > ROTATION_ROUNDING:  # quadratic convergence: one or two steps
        _correct_rotation(R)
    return True


@native
def is_pose(X: NDArray[np.float64]) -> bool:
    """Return whether (4, 4) is a rotation, to within `ROTATION_TOLERANCE`, and a translation within `REACH_MAX_M`."""
    far = max(abs(X[0, 3]), abs(X[1, 3]), abs(X[2, 3]))
    row = max(abs(X[3, 0]), abs(X[3, 1]), abs(X[3, 2]), abs(X[3, 3] - 1.0))  # not 0 in a transposed pose
    fits = _rotation_error(X) <= ROTATION_TOLERANCE and row <= RIGID_TOLERANCE and far <= REACH_MAX_M
    # `fits` is False if an element is NaN
    return bool(fits and _determinant(X) > 0.0)


@native
def _rotation_error(R: NDArray[np.float64]) -> float:
    """Return the largest deviation of R Rᵀ from the identity, or NaN if R is not finite."""
    off = 0.0
    for i in range(3):
        for j in range(i + 1):
            g = R[i, 0] * R[j, 0] + R[i, 1] * R[j, 1] + R[i, 2] * R[j, 2] - (1.0 if i == j else 0.0)
            if math.isnan(g):
                return math.nan
            off = max(off, abs(g))
    return off


@native
def _determinant(R: NDArray[np.float64]) -> float:
    return float(
        R[0, 0] * (R[1, 1] * R[2, 2] - R[1, 2] * R[2, 1])
        - R[0, 1] * (R[1, 0] * R[2, 2] - R[1, 2] * R[2, 0])
        + R[0, 2] * (R[1, 0] * R[2, 1] - R[1, 1] * R[2, 0])
    )


@native
def _correct_rotation(R: NDArray[np.float64]) -> None:
    """Make one Newton–Schulz step towards the nearest rotation, R ← (3 − R Rᵀ) R / 2 (Higham 1986)."""
    a, b, c = R[0, 0], R[0, 1], R[0, 2]
    d, e, f = R[1, 0], R[1, 1], R[1, 2]
    g, h, i = R[2, 0], R[2, 1], R[2, 2]
    aa, dd, gg = a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i
    ad, ag, dg = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
    for k in range(3):
        x, y, z = (a, d, g) if k == 0 else (b, e, h) if k == 1 else (c, f, i)
        R[0, k] = 0.5 * ((3.0 - aa) * x - ad * y - ag * z)
        R[1, k] = 0.5 * ((3.0 - dd) * y - ad * x - dg * z)
        R[2, k] = 0.5 * ((3.0 - gg) * z - ag * x - dg * y)


@native
def _restart_proxy(world: "World", surface: "Surface") -> None:
    """Place the proxy at the last device position, outside the skins of nearby faces."""
    at = surface.memory[0].p_WT_m
    place_proxy(world, (at[0], at[1], at[2]))


@native
def _release(world: "World", surface: "Surface", moving: NDArray[np.int64], teleported: NDArray[np.int64]) -> None:
    """Drop the planes and punctures of bodies that jump; restart the proxy at the device if no plane is left."""
    proxy, touch = world.proxy[0], surface.touch[0]
    if _jumps(touch.left_body, moving, teleported):
        touch.left_body = -1
    if _jumps(touch.body, moving, teleported):
        surface.memory[0].jumped = 1
    for i in range(proxy.puncture_count - 1, -1, -1):
        if _jumps(proxy.punctured[i], moving, teleported):
            close_puncture(world, proxy.punctured[i])
    count = proxy.count
    for m in range(len(moving)):
        if teleported[m] != 0:
            drop_planes_of(proxy, moving[m])
    if proxy.count == 0 < count:
        _restart_proxy(world, surface)


@native
def _jumps(index: int, moving: NDArray[np.int64], teleported: NDArray[np.int64]) -> bool:
    """Return whether a body is among those that jump."""
    for m in range(len(moving)):
        if moving[m] == index and teleported[m] != 0:
            return True
    return False
