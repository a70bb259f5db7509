"""Bodies that move: their poses taken over as a tick begins, checked, and the proxy let go where they jump."""

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.constants import REACH_MAX_M
from hapscene.contact.deformation import reshape_bodies
from hapscene.contact.passing import hold_again
from hapscene.contact.planes import copy_plane
from hapscene.contact.proxy import put
from hapscene.contact.world import place_ball

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["MENDED", "is_pose", "place_bodies"]

EXACT: Final = 1e-12
"""How far a matrix may be from a rotation and still be taken as it is [1]: a few roundings of float64."""

MENDED: Final = 1e-2
"""How far a matrix may be from a rotation and still be mended [1]: float32 that is multiplied on at 60 Hz is there
after an hour at the worst. Beyond, it scales or shears, and is refused."""

LAST_TICK: Final = 2
"""Value of `moved` while a tick begins: it moved in the last one, and has no pose for this one yet."""


@native
def place_bodies(
    world: "World",
    surface: "Surface",
    moving: NDArray[Any],
    X_WB: NDArray[Any],
    teleported: NDArray[Any],
    count: int,
    k: int,
) -> int:
    """Take over the poses `X_WB[k]` (m, 4, 4) of the first `count` of the bodies `moving` (m,); all others stand still.

    In the first tick after a reset, and where `teleported` (m,) is not 0, bodies appear where they are, without moving
    there; it is set to 0. A pose that is not finite or no rotation and translation is left out
    (`world.proxy[0].refused`): the body stays at its last one. Returns no flags.
    """
    proxy = world.proxy[0]
    proxy.refused = 0
    if count > 0 or world.moved[0] > 0:
        _place(world, surface, moving, X_WB, teleported, count, k)
    if proxy.reshaped > 0:
        reshape_bodies(world, surface)
    return 0


@native
def _place(
    world: "World",
    surface: "Surface",
    moving: NDArray[Any],
    X_WB: NDArray[Any],
    teleported: NDArray[Any],
    count: int,
    k: int,
) -> None:
    """The same, where bodies move or moved in the last tick."""
    proxy, moved = world.proxy[0], world.moved
    last = moved[0]
    for i in range(1, last + 1):
        world.bodies[moved[i]].moved = LAST_TICK
    nearer, jumps, fresh = 0.0, 0, surface.memory[0].fresh
    for m in range(count):
        body = world.bodies[moving[m]]
        for i in range(3):
            for j in range(3):
                body.was_R_WB[i, j] = body.R_WB[i, j]
            body.was_p_WB_m[i] = body.p_WB_m[i]
            if body.lead_s > 0.0:
                body.p_WB_m[i] -= body.lead_W_m[i]
        if not _take(body, X_WB[k, m]):
            proxy.refused = 1
        body.moved = 1
        if fresh == 1 or teleported[m] != 0:
            _stop(body)
            body.lead_s = 0.0
            for i in range(3):
                body.lead_W_m[i] = 0.0
        if teleported[m] != 0:
            jumps += 1
        nearer = max(nearer, place_ball(body, world.ball_W_m[moving[m]]))
    proxy.near_room_m -= nearer
    for i in range(1, last + 1):
        body = world.bodies[moved[i]]
        if body.moved == LAST_TICK:
            _stop(body)
            place_ball(body, world.ball_W_m[moved[i]])
    moved[0] = 0
    for m in range(count):
        if world.bodies[moving[m]].moved == 1:
            moved[0] += 1
            moved[moved[0]] = moving[m]
    if count > 0 and fresh == 1:
        _start(world, surface)
    elif jumps > 0:
        _let_go(world, surface, moving[:count], teleported)
    for m in range(count if jumps > 0 else 0):
        teleported[m] = 0


@native
def _stop(body: np.record) -> None:
    """It stands where it is."""
    body.moved = 0
    for i in range(3):
        for j in range(3):
            body.was_R_WB[i, j] = body.R_WB[i, j]
        body.was_p_WB_m[i] = body.p_WB_m[i]


@native
def _take(body: np.record, X: NDArray[np.float64]) -> bool:
    """Set a body's pose from (4, 4), its rotation mended; False, and nothing set, where it is none."""
    if not is_pose(X):
        return False
    R = body.R_WB
    for i in range(3):
        for j in range(3):
            R[i, j] = X[i, j]
        body.p_WB_m[i] = X[i, 3]
    while _off(R) > EXACT:  # the error is squared each time
        _mend(R)
    return True


@native
def is_pose(X: NDArray[np.float64]) -> bool:
    """Whether (4, 4) is a rotation, give or take what is mended, and a translation within reach."""
    far = max(abs(X[0, 3]), abs(X[1, 3]), abs(X[2, 3]))
    row = max(abs(X[3, 0]), abs(X[3, 1]), abs(X[3, 2]), abs(X[3, 3] - 1.0))  # a transposed pose has its place there
    fits = _off(X) <= MENDED and row <= MENDED and far <= REACH_MAX_M  # NaN is neither
    return bool(fits and _determinant(X) > 0.0)


@native
def _off(R: NDArray[np.float64]) -> float:
    """How far R Rᵀ is from 1, NaN where R is not finite."""
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
def _mend(R: NDArray[np.float64]) -> None:
    """One step towards the nearest rotation: R ← (3 − R Rᵀ) R / 2 (Newton & Schulz; Higham 1986)."""
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
def _start(world: "World", surface: "Surface") -> None:
    """Put the proxy where the tool was last, off what is there."""
    at = surface.memory[0].p_WT_m
    put(world, (at[0], at[1], at[2]))


@native
def _let_go(world: "World", surface: "Surface", moving: NDArray[Any], teleported: NDArray[Any]) -> None:
    """Have the bodies that jump hold proxy and shaft no more; where no plane is left, the proxy begins at the tool."""
    proxy, touch = world.proxy[0], surface.touch[0]
    if _jumps(touch.left_body, moving, teleported):
        touch.left_body = -1
    if _jumps(touch.body, moving, teleported):
        surface.memory[0].jumped = 1
    for i in range(proxy.passed_count - 1, -1, -1):
        if _jumps(proxy.passed[i], moving, teleported):
            hold_again(world, proxy.passed[i])
    kept, count = 0, proxy.count
    for i in range(count):
        if not _jumps(proxy.body[i], moving, teleported):
            copy_plane(proxy, i, kept)
            kept += 1
    proxy.count = kept
    if kept == 0 < count:
        _start(world, surface)


@native
def _jumps(index: int, moving: NDArray[Any], teleported: NDArray[Any]) -> bool:
    """Whether this body is among those that jump."""
    for m in range(len(moving)):
        if moving[m] == index and teleported[m] != 0:
            return True
    return False
