"""Constraint solver of the proxy: the point closest to the device position that a set of planes allows.

Zilles & Salisbury 1995 (eq. 6 to 8) minimise the distance to the device with Lagrange multipliers for a given set of
active planes. This solver also finds the active set, so that no plane ever pulls: it takes the smallest set whose
multipliers are all positive and whose solution violates no other plane. The problem is convex, so the first such set
is the only one. With at most four planes, all subsets of one, two and three are tried in closed form.
"""

from typing import TYPE_CHECKING

import numpy as np

from hapscene.compiled.native import inlined, native
from hapscene.contact.cast import SATISFIED
from hapscene.contact.triangle import lies_over
from hapscene.contact.world import DROPPED, SAVED
from hapscene.geometry import Vector

if TYPE_CHECKING:
    from hapscene.contact.world import World

__all__ = [
    "PARALLEL",
    "copy_plane",
    "drop_idle",
    "drop_oldest",
    "drop_planes_of",
    "drop_unsupported",
    "nearest",
    "restore_plane",
    "trust",
]

TOLERANCE = 1e-3
"""How far behind a plane a solution may lie and still count as allowed [skins]."""

PARALLEL = 1e-12
"""Squared sine of the angle between two planes below which they count as parallel [1]."""


@native
def nearest(proxy: np.record, tool: Vector, skins: float) -> tuple[bool, Vector]:
    """Return the point closest to `tool` in front of all planes of `proxy`, each moved outwards by `skins` of its skin.

    Writes the multiplier of each plane to `proxy.push_m`, 0 for inactive planes. Returns False and `tool` if there is
    no such point: the planes enclose nothing, or they are dependent to within `PARALLEL`, such as two planes that face
    each other and would meet a kilometre away.
    """
    count = proxy.count
    behind = 0
    slack = 0.0
    for i in range(count):
        n = proxy.nhat_W[i]
        short = proxy.offset_m[i] + skins * proxy.skin_m[i] - (n[0] * tool[0] + n[1] * tool[1] + n[2] * tool[2])
        proxy.short_m[i] = short
        proxy.push_m[i] = 0.0
        slack = max(slack, TOLERANCE * proxy.skin_m[i])
        if short > 0.0:
            behind += 1
    if behind == 0:
        return True, tool
    for i in range(count):
        for j in range(i + 1, count):
            a, b = proxy.nhat_W[i], proxy.nhat_W[j]
            g = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
            proxy.gram[i, j] = g
            proxy.gram[j, i] = g
    if _one(proxy, count, slack) or _two(proxy, count, slack) or _three(proxy, count, slack):
        x, y, z = tool
        for i in range(count):
            push = proxy.push_m[i]
            if push != 0.0:
                x += push * proxy.nhat_W[i, 0]
                y += push * proxy.nhat_W[i, 1]
                z += push * proxy.nhat_W[i, 2]
        return True, (x, y, z)
    return False, tool


@native
def _one(proxy: np.record, count: int, slack: float) -> bool:
    """Try each plane alone: project the device position onto it."""
    for i in range(count):
        push = proxy.short_m[i]
        if push <= 0.0:
            continue
        allowed = True
        for k in range(count):
            if k != i and proxy.short_m[k] - push * proxy.gram[i, k] > slack:
                allowed = False
        if allowed:
            proxy.push_m[i] = push
            return True
    return False


@native
def _two(proxy: np.record, count: int, slack: float) -> bool:
    """Try each pair of planes: project the device position onto their common line."""
    r = proxy.short_m
    for i in range(count):
        for j in range(i + 1, count):
            g = proxy.gram[i, j]
            sine2 = 1.0 - g * g
            if sine2 < PARALLEL:
                continue
            a = (r[i] - g * r[j]) / sine2
            b = (r[j] - g * r[i]) / sine2
            # one step of iterative refinement: planes that nearly face each other are ill-conditioned
            u, v = r[i] - a - g * b, r[j] - g * a - b
            a += (u - g * v) / sine2
            b += (v - g * u) / sine2
            if a < 0.0 or b < 0.0:
                continue
            allowed = True
            for k in range(count):
                if k != i and k != j and r[k] - a * proxy.gram[i, k] - b * proxy.gram[j, k] > slack:
                    allowed = False
            if allowed:
                proxy.push_m[i] = a
                proxy.push_m[j] = b
                return True
    return False


@native
def _three(proxy: np.record, count: int, slack: float) -> bool:
    """Try each triple of planes: their common corner, by Cramer's rule on their Gram matrix."""
    r = proxy.short_m
    for i in range(count):
        for j in range(i + 1, count):
            for k in range(j + 1, count):
                p, q, s = proxy.gram[i, j], proxy.gram[i, k], proxy.gram[j, k]
                det = 1.0 + 2.0 * p * q * s - p * p - q * q - s * s
                if det < PARALLEL:
                    continue
                a, b, c = _cramer(p, q, s, det, r[i], r[j], r[k])
                u, v, w = r[i] - a - p * b - q * c, r[j] - p * a - b - s * c, r[k] - q * a - s * b - c
                u, v, w = _cramer(p, q, s, det, u, v, w)
                a, b, c = a + u, b + v, c + w
                if a < 0.0 or b < 0.0 or c < 0.0:
                    continue
                allowed = True
                for m in range(count):
                    if m != i and m != j and m != k:
                        left = r[m] - a * proxy.gram[i, m] - b * proxy.gram[j, m] - c * proxy.gram[k, m]
                        if left > slack:
                            allowed = False
                if allowed:
                    proxy.push_m[i] = a
                    proxy.push_m[j] = b
                    proxy.push_m[k] = c
                    return True
    return False


@native
def _cramer(p: float, q: float, s: float, det: float, x: float, y: float, z: float) -> Vector:
    """Solve the Gram matrix [[1, p, q], [p, 1, s], [q, s, 1]] for the right-hand side (x, y, z)."""
    return (
        (x * (1.0 - s * s) + y * (q * s - p) + z * (p * s - q)) / det,
        (x * (q * s - p) + y * (1.0 - q * q) + z * (p * q - s)) / det,
        (x * (p * s - q) + y * (p * q - s) + z * (1.0 - p * p)) / det,
    )


# Bookkeeping of the active planes. A plane is dropped when it no longer pushes or when its face no longer lies below
# the proxy, and is restored if the search returns to it within the same tick.

NEARBY = 10.0
"""Distance that the proxy moves before a restored plane must lie below it again [skins]."""


@native
def trust(proxy: np.record, first: int, moved_m: float) -> None:
    """Clear the `met` flag of planes before `first`: the proxy has moved, so no ray from its present position met them.

    A restored plane keeps its flag until the proxy has moved `NEARBY` skins. Otherwise the search could drop and
    restore it for ever near a corner.
    """
    for i in range(first):
        if proxy.met[i] == 1 or moved_m > NEARBY * proxy.skin_m[i]:
            proxy.met[i] = 0


@native
def drop_idle(proxy: np.record) -> None:
    """Drop the planes that do not push; at most three remain."""
    kept = 0
    for i in range(proxy.count):
        if proxy.push_m[i] > 0.0:
            if kept != i:
                copy_plane(proxy, i, kept)
                proxy.push_m[kept] = proxy.push_m[i]
            kept += 1
    proxy.count = kept


@inlined
def drop_unsupported(world: "World", p_W: Vector) -> bool:
    """Drop the planes whose faces do not extend below the proxy; return whether any was dropped.

    A plane is always kept if a ray from the present proxy position has hit its face: in a narrow groove, the face below
    the proxy may be a different one.
    """
    proxy = world.proxy[0]
    kept = 0
    count = proxy.count
    for i in range(count):
        body = world.bodies[proxy.body[i]]
        if proxy.met[i] != 0 or lies_over(world, body, proxy.face[i], p_W, proxy.skin_m[i]):
            if kept != i:
                copy_plane(proxy, i, kept)
            kept += 1
        else:
            copy_plane(proxy, i, DROPPED + proxy.dropped_count % (SAVED - DROPPED))
            proxy.dropped_count += 1
    proxy.count = kept
    return bool(kept < count)


@inlined
def restore_plane(world: "World", p_W: Vector, goal_W: Vector) -> bool:
    """Restore a dropped plane if the next goal lies below it and on its face while the proxy is still above it.

    This happens at concave edges of a fraction of a degree, which are too flat for a ray one skin above one face to
    meet the other.
    """
    proxy = world.proxy[0]
    for k in range(min(proxy.dropped_count, SAVED - DROPPED)):
        i = DROPPED + k
        skin = proxy.skin_m[i]
        if _above(proxy, i, goal_W) >= (1.0 - SATISFIED) * skin or _above(proxy, i, p_W) < 0.0 or _holds(proxy, i):
            continue
        if lies_over(world, world.bodies[proxy.body[i]], proxy.face[i], goal_W, skin):
            copy_plane(proxy, i, proxy.count)
            proxy.met[proxy.count] = 2
            proxy.count += 1
            return True
    return False


@native
def _above(proxy: np.record, slot: int, p_W: Vector) -> float:
    """Return the height of a point above the plane in a slot [m]."""
    n = proxy.nhat_W[slot]
    return float(n[0] * p_W[0] + n[1] * p_W[1] + n[2] * p_W[2] - proxy.offset_m[slot])


@native
def _holds(proxy: np.record, slot: int) -> bool:
    """Return whether the face in a slot is among the active planes."""
    for i in range(proxy.count):
        if proxy.face[i] == proxy.face[slot] and proxy.body[i] == proxy.body[slot]:
            return True
    return False


@native
def drop_oldest(proxy: np.record) -> None:
    """Drop the plane that has been active longest."""
    for i in range(proxy.count - 1):
        copy_plane(proxy, i + 1, i)
    proxy.count -= 1


@native
def drop_planes_of(proxy: np.record, index: int) -> None:
    """Drop the planes of one body."""
    kept = 0
    for i in range(proxy.count):
        if proxy.body[i] != index:
            copy_plane(proxy, i, kept)
            kept += 1
    proxy.count = kept


@native
def copy_plane(proxy: np.record, source: int, target: int) -> None:
    for k in range(3):
        proxy.nhat_W[target, k] = proxy.nhat_W[source, k]
    proxy.offset_m[target] = proxy.offset_m[source]
    proxy.skin_m[target] = proxy.skin_m[source]
    proxy.body[target] = proxy.body[source]
    proxy.face[target] = proxy.face[source]
    proxy.side[target] = proxy.side[source]
    proxy.met[target] = proxy.met[source]
