"""Dry friction in three coupled joints, implicit in the speed at the end of a step: it sticks, and never chatters.

    A (w − w*) + λ = 0,   |λᵢ| ≤ Λᵢ,   wᵢ > 0 ⇒ λᵢ = Λᵢ,   wᵢ < 0 ⇒ λᵢ = −Λᵢ

is Coulomb friction as a set-valued law under backward Euler (Kikuuwe et al. 2006, eq. 12, there for one mass), and the
least value of ½ (w − w*)ᵀ A (w − w*) + Σ Λᵢ |wᵢ|: one answer, since A is positive definite. It is found by changing
one joint at a time, the first that violates the law, which ends for every positive definite A (Murty 1974).
"""

from typing import Final

from hapscene.contact.geometry import Vector
from hapscene.native import native

TRIES: Final = 27
"""Most combinations of sliding and sticking that are tried [count]: all of them. Two or three are needed."""

Symmetric = tuple[float, float, float, float, float, float]
"""A11, A22, A33, A12, A13, A23."""


@native
def solve(A: Symmetric, b: Vector) -> Vector:
    """x with A x = b, by cofactors. A is positive definite."""
    a11, a22, a33, a12, a13, a23 = A
    c11, c12, c13 = a22 * a33 - a23 * a23, a13 * a23 - a12 * a33, a12 * a23 - a13 * a22
    c22, c23, c33 = a11 * a33 - a13 * a13, a12 * a13 - a11 * a23, a11 * a22 - a12 * a12
    scale = 1.0 / (a11 * c11 + a12 * c12 + a13 * c13)
    return (
        (c11 * b[0] + c12 * b[1] + c13 * b[2]) * scale,
        (c12 * b[0] + c22 * b[1] + c23 * b[2]) * scale,
        (c13 * b[0] + c23 * b[1] + c33 * b[2]) * scale,
    )


@native
def _moving(A: Symmetric, b: Vector, s: Vector) -> Vector:
    """x with A x = b over the joints with s ≠ 0, and 0 for the others."""
    m1, m2, m3 = abs(s[0]), abs(s[1]), abs(s[2])
    reduced = (
        A[0] * m1 + 1.0 - m1,
        A[1] * m2 + 1.0 - m2,
        A[2] * m3 + 1.0 - m3,
        A[3] * m1 * m2,
        A[4] * m1 * m3,
        A[5] * m2 * m3,
    )
    return solve(reduced, (b[0] * m1, b[1] * m2, b[2] * m3))


@native
def _turned(s: float, w: float, held: float, most: float) -> float:
    """What a joint does instead: the same where it keeps to the law. `held` is the impulse that would hold it."""
    if s == 0.0:
        if held > most:
            return 1.0
        if held < -most:
            return -1.0
        return 0.0
    return 0.0 if s * w < 0.0 else s


@native
def _sign(x: float) -> float:
    return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0)


@native
def slow(A: Symmetric, push: Vector, most: Vector, before: Vector) -> Vector:
    """Speeds w after a step under dry friction.

    `push` is A w*, the momentum [N·m·s] without friction; `most` the largest friction impulse Λ of each joint [N·m·s];
    `before` the speeds before the step, whose signs are tried first. A joint without friction (Λ = 0) never sticks.
    """
    s1, s2, s3 = _sign(before[0]), _sign(before[1]), _sign(before[2])
    w = before
    for _ in range(TRIES):
        drive = (push[0] - s1 * most[0], push[1] - s2 * most[1], push[2] - s3 * most[2])
        w = _moving(A, drive, (s1, s2, s3))
        t = _turned(s1, w[0], push[0] - A[3] * w[1] - A[4] * w[2], most[0])
        if t != s1:
            s1 = t
            continue
        t = _turned(s2, w[1], push[1] - A[3] * w[0] - A[5] * w[2], most[1])
        if t != s2:
            s2 = t
            continue
        t = _turned(s3, w[2], push[2] - A[4] * w[0] - A[5] * w[1], most[2])
        if t != s3:
            s3 = t
            continue
        break
    return w
