"""The closest point to the tool that the proxy's planes allow.

Zilles & Salisbury 1995 (eq. 6 to 8) find it with Lagrange multipliers for the planes that hold; which of them do is
found here as well, so that no plane ever pulls: the smallest set whose pushes are all positive and whose solution
lies behind no other plane. The problem is convex, so the first such set is the only one.
"""

from typing import Any

from hapscene.contact.geometry import Vector
from hapscene.native import native

TOLERANCE = 1e-3
"""How far behind a plane a solution may lie and still be allowed, in skins [1]."""

PARALLEL = 1e-12
"""Squared sine of the angle below which two planes count as one [1]."""


@native
def nearest(proxy: Any, tool: Vector, skins: float) -> tuple[bool, Vector]:
    """The point closest to `tool` in front of all planes of `proxy`, each moved out by `skins` of its skin.

    Leaves the pushes of the planes in `proxy.push_m`, 0 for a plane that does not hold. Returns False and the tool
    where no such point was found: the planes enclose nothing, or rounding hides the answer.
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
def _one(proxy: Any, count: int, slack: float) -> bool:
    """Try each plane alone."""
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
def _two(proxy: Any, count: int, slack: float) -> bool:
    """Try each pair: the foot of the tool on their common line."""
    r = proxy.short_m
    for i in range(count):
        for j in range(i + 1, count):
            g = proxy.gram[i, j]
            sine2 = 1.0 - g * g
            if sine2 < PARALLEL:
                continue
            a = (r[i] - g * r[j]) / sine2
            b = (r[j] - g * r[i]) / sine2
            u, v = r[i] - a - g * b, r[j] - g * a - b  # what is left: planes that nearly face each other need it
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
def _three(proxy: Any, count: int, slack: float) -> bool:
    """Try each triple: the corner they meet in (Cramer's rule on their Gram matrix)."""
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
    """Solve the Gram matrix [[1, p, q], [p, 1, s], [q, s, 1]] for (x, y, z)."""
    return (
        (x * (1.0 - s * s) + y * (q * s - p) + z * (p * s - q)) / det,
        (x * (q * s - p) + y * (1.0 - q * q) + z * (p * q - s)) / det,
        (x * (p * s - q) + y * (p * q - s) + z * (1.0 - p * p)) / det,
    )
