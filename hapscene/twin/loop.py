"""The closed loop, compiled. One tick of it:

    read       the device's encoders                                    device/
    tick       the real one                                             tick.py
    wait       the force goes out `delay` ticks later
    hold       it, until the next tick                                  device/
    move       device, hand and handle, a sample of the acceleration channel at a time

The force of a tick is computed from the position read at its start, and held over it (at no delay).
"""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.contact.geometry import Vector
from hapscene.device.hand import pull
from hapscene.device.point import advance_point, hold_point, read_point
from hapscene.native import native
from hapscene.tick import tick

DELAY_MAX: Final = 256
"""Longest delay between a tick and its force [ticks]."""


class Plant(NamedTuple):
    """What the tick's commands act on."""

    point: Any  # (1,) POINT
    hand: Any  # (1,) HAND
    wait_N: NDArray[np.float64]  # (DELAY_MAX, 3) forces on their way
    ticks: NDArray[np.int64]  # (1,) so far
    delay: int


@native
def live(
    world: Any,
    surface: Any,
    plant: Any,
    target_W_m: NDArray[np.float64],
    grip: NDArray[np.float64],
    push_W_N: NDArray[np.float64],
    rows: Any,
    a_m_s2: NDArray[np.float64],
    felt: Any,
    a_handle_m_s2: NDArray[np.float64],
) -> None:
    """n ticks of an `Intent`. Fills `rows` (n,) ROW, `felt` (n,) FELT and the samples (n, block)."""
    n = len(target_W_m)
    touch, hand = surface.touch[0], plant.hand[0]
    h_s = touch.tick_s / touch.block
    for k in range(n):
        x, y, z = read(plant)
        tick(world, surface, x, y, z, rows[k], a_m_s2[k])
        _intend(hand, target_W_m, grip, push_W_N, k, touch.tick_s)
        _send(plant, rows[k].f_W_N, felt[k])
        _note(plant, felt[k])
        for i in range(touch.block):
            a_handle_m_s2[k, i] = a_m_s2[k, i]
            advance(plant, h_s)
        _close(plant, felt[k])


@native
def read(plant: Any) -> Vector:
    """The tool's position as the encoders have it, in W [m]."""
    return read_point(plant.point[0])


@native
def advance(plant: Any, h_s: float) -> None:
    """Move device and hand on by `h_s`."""
    advance_point(plant.point[0], plant.hand[0], h_s)


@native
def _intend(hand: Any, target: Any, grip: Any, push: Any, k: int, tick_s: float) -> None:
    """The hand's intention for a tick: its target moves straight to that of the next."""
    after = min(k + 1, len(target) - 1)
    hand.k_N_m, hand.b_Ns_m, hand.mass_kg = grip[k, 0], grip[k, 1], grip[k, 2]
    for i in range(3):
        hand.target_m[i] = target[k, i]
        hand.target_m_s[i] = (target[after, i] - target[k, i]) / tick_s
        hand.push_N[i] = push[k, i]


@native
def _send(plant: Any, f_N: Any, felt: Any) -> None:
    """Put a force on its way; hold the one that arrives."""
    k = plant.ticks[0]
    enter, leave = k % DELAY_MAX, (k - plant.delay) % DELAY_MAX
    for i in range(3):
        plant.wait_N[enter, i] = f_N[i]
    for i in range(3):
        felt.f_motor_W_N[i] = plant.wait_N[leave, i] if k >= plant.delay else 0.0
    hold_point(plant.point[0], felt.f_motor_W_N[0], felt.f_motor_W_N[1], felt.f_motor_W_N[2])
    plant.ticks[0] = k + 1


@native
def _note(plant: Any, felt: Any) -> None:
    """The tick's start as it truly is."""
    point, hand = plant.point[0], plant.hand[0]
    for i in range(3):
        felt.p_W_m[i] = point.x_m[i]
        felt.v_W_m_s[i] = point.v_m_s[i]
        felt.f_hand_W_N[i] = pull(hand, i, point.x_m[i], point.v_m_s[i])


@native
def _close(plant: Any, felt: Any) -> None:
    """The work of the motors: exact, since their force is held."""
    work = 0.0
    for i in range(3):
        work += felt.f_motor_W_N[i] * (plant.point[0].x_m[i] - felt.p_W_m[i])
    felt.work_J = work
