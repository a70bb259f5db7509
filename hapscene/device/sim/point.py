"""Point-mass model of a device: mass m, damping b, Coulomb friction c, encoder resolution Δ, equal on all axes.

    m ẍ = F − b ẋ − c sgn(ẋ) + f_hand(x, ẋ)

F is held between ticks. Between two sign changes of the friction the equation is linear, and is solved exactly: by its
Taylor series to machine precision, in substeps short enough for fast convergence. The response to acceleration and jerk
is computed once for all substeps of the same length. At a sign change of the friction within a step, the step is
divided at that instant; where friction can hold the tool, it sticks. Results are therefore independent of the step
length, except that friction holds or releases the tool at the start of a step. Closed-form results for walls are met to
rounding (`hapscene.stability`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hapscene.compiled.native import native
from hapscene.errors import HapsceneError
from hapscene.geometry import Vector
from hapscene.records import Records

__all__ = ["POINT", "PointMass", "advance_point", "hold_point", "read_point"]

POINT: Final = np.dtype(
    [
        ("mass_kg", "f8"),
        ("b_Ns_m", "f8"),
        ("c_N", "f8"),
        ("quantum_m", "f8"),
        ("zero_m", "f8", (3,)),  # zero of the encoders, in W
        ("x_m", "f8", (3,)),  # tool position, in W
        ("v_m_s", "f8", (3,)),
        ("f_N", "f8", (3,)),  # motor force, held
        ("piece", "f8", (3,)),  # stiffness and damping per mass, and length, of the substeps for which `gain` holds
        ("gain", "f8", (4,)),  # position and velocity after a substep by acceleration, and by jerk
    ],
    align=True,
)

TERM_MAX: Final = 30
"""Most terms of the series [count]: 12 suffice for a substep."""

PIECE: Final = 0.5
"""Longest substep relative to the shortest time constant [1]. Each term is then at most half of the previous one."""

EVENT_MAX: Final = 8
"""Most sign changes of the friction within a step [count]. A step of 0.1 ms has one."""

BISECTIONS: Final = 60
"""Bisections for the instant at which the tool stops [count], to machine precision."""


@dataclass(frozen=True)
class PointMass:
    """A device modelled as a point mass, equal on all axes.

    Attributes:
        mass_kg: apparent mass at the tip, > 0.
        b_Ns_m: viscous damping.
        c_N: Coulomb friction of each axis.
        quantum_m: resolution of the encoders; 0 for exact encoders.

    Raises:
        HapsceneError: value out of range.
    """

    mass_kg: float
    b_Ns_m: float = 0.0
    c_N: float = 0.0
    quantum_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.mass_kg < math.inf:
            raise HapsceneError(f"point mass: mass_kg must be finite and above 0, is {self.mass_kg}")
        for name in ("b_Ns_m", "c_N", "quantum_m"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise HapsceneError(f"point mass: {name} must be finite and at least 0, is {getattr(self, name)}")

    def record(self, p_WT_m: Sequence[float], zero_m: Sequence[float] = (0.0, 0.0, 0.0)) -> Records:
        """Create a record (1,) POINT at rest at `p_WT_m` (3,), with the zero of the encoders at `zero_m` (3,)."""
        point = np.zeros(1, POINT).view(np.recarray)
        point.mass_kg, point.b_Ns_m, point.c_N, point.quantum_m = self.mass_kg, self.b_Ns_m, self.c_N, self.quantum_m
        point.x_m, point.zero_m = p_WT_m, zero_m
        return point


@native
def read_point(point: np.record) -> Vector:
    """Tool position in W as measured by the encoders [m]."""
    return _counted(point, 0), _counted(point, 1), _counted(point, 2)


@native
def hold_point(point: np.record, x_N: float, y_N: float, z_N: float) -> None:
    """Set the motor force in W [N], held until the next call."""
    point.f_N[0], point.f_N[1], point.f_N[2] = x_N, y_N, z_N


@native
def advance_point(point: np.record, hand: np.record, h_s: float, count: int = 1) -> None:
    """Advance the tool and the target of the hand by `count` steps of `h_s`."""
    mass = point.mass_kg + hand.mass_kg
    k, b = hand.k_N_m / mass, (point.b_Ns_m + hand.b_Ns_m) / mass
    pieces = max(1.0, math.ceil(max(b, math.sqrt(k)) * h_s / PIECE))
    _update_gain(point, k, b, h_s / pieces)
    for _ in range(count):
        for i in range(3):
            _advance_axis(point, hand, i, h_s, mass, pieces)
        for i in range(3):
            hand.target_m[i] += hand.target_m_s[i] * h_s


@native
def _counted(point: np.record, i: int) -> float:
    if point.quantum_m == 0.0:
        return float(point.x_m[i])
    steps = math.floor((point.x_m[i] - point.zero_m[i]) / point.quantum_m + 0.5)
    return float(point.zero_m[i] + point.quantum_m * steps)


@native
def _update_gain(point: np.record, k: float, b: float, h: float) -> None:
    """Recompute `gain` if stiffness and damping per mass, or the length of a substep, have changed."""
    piece, gain = point.piece, point.gain
    if piece[0] != k or piece[1] != b or piece[2] != h:
        piece[0], piece[1], piece[2] = k, b, h
        gain[0], gain[1] = _series(0.0, 0.0, 1.0, 0.0, k, b, h)
        gain[2], gain[3] = _series(0.0, 0.0, 0.0, 1.0, k, b, h)


@native
def _advance_axis(point: np.record, hand: np.record, i: int, h_s: float, mass: float, pieces: float) -> None:
    """Advance one axis by substeps, divided where the friction changes sign."""
    damping, spring, target_m_s = point.b_Ns_m + hand.b_Ns_m, hand.k_N_m, hand.target_m_s[i]
    k, b, piece_s, gain = point.piece[0], point.piece[1], point.piece[2], point.gain
    x, v, left, done = point.x_m[i], point.v_m_s[i], h_s, 0.0
    for _ in range(int(pieces) + EVENT_MAX):
        if left <= 0.0:
            break
        h = min(left, piece_s)
        target = hand.target_m[i] + target_m_s * done
        force = point.f_N[i] + spring * (target - x) + hand.b_Ns_m * target_m_s + hand.push_N[i]
        if v == 0.0 and abs(force) <= point.c_N:
            v1, x1 = 0.0, x
        else:
            sign = math.copysign(1.0, v if v != 0.0 else force)
            # acceleration and its derivative: m a' = spring (target' − v) − damping a
            a = (force - damping * v - sign * point.c_N) / mass
            jerk = k * (target_m_s - v) - b * a
            if h == piece_s:
                x1, v1 = x + (h * v + gain[0] * a + gain[2] * jerk), v + (gain[1] * a + gain[3] * jerk)
            else:
                x1, v1 = _series(x, v, a, jerk, k, b, h)
            if point.c_N > 0.0 and v1 * sign < 0.0:
                h = _stop(sign, v, a, jerk, k, b, h)
                x1, v1 = _series(x, v, a, jerk, k, b, h)[0], 0.0
        x, v = x1, v1
        left -= h
        done += h
    point.x_m[i], point.v_m_s[i] = x, v


@native
def _series(x: float, v: float, a: float, jerk: float, k: float, b: float, h: float) -> tuple[float, float]:
    """Position and velocity after `h`, by the Taylor series with x⁗ = −k a − b x‴ and so on (k, b per mass)."""
    s2, s3 = a, jerk  # derivatives of x
    x1, v1 = x + h * (v + h * a / 2.0), v + h * a
    power = h * h / 2.0  # h^n / n!
    for n in range(3, TERM_MAX):
        v1 += power * s3
        power *= h / n
        term = power * s3
        x1 += term
        s2, s3 = s3, -k * s2 - b * s3
        if abs(power * s3) <= 1e-18 * abs(v1) and abs(power * s2) <= 1e-18 * abs(v1):
            break
    return x1, v1


@native
def _stop(sign: float, v: float, a: float, jerk: float, k: float, b: float, h: float) -> float:
    """Time within `h` at which the velocity is zero [s]."""
    low, high = 0.0, h
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if _series(0.0, v, a, jerk, k, b, middle)[1] * sign > 0.0:
            low = middle
        else:
            high = middle
    return high
