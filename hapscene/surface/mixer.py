"""The render and mix phases of the tick: call effects, sum their outputs, and limit the sum to the device."""

import math
from typing import TYPE_CHECKING

import numpy as np

from hapscene.compiled.native import inlined, native
from hapscene.flags import Flag
from hapscene.surface.effect_compile import call_effect
from hapscene.surface.surface_arrays import FAILED

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["FADE_S", "fade_removed", "limit", "render_contact", "render_fields"]

_MUTED = int(Flag.EFFECT_MUTED)
_FORCE = int(Flag.FORCE_LIMITED)
_SLEW = int(Flag.SLEW_LIMITED)
_ACCELERATION = int(Flag.ACCELERATION_LIMITED)


_REMOVED = int(Flag.BODY_REMOVED)

FADE_S = 5e-3
"""Time in which the force of a removed body fades out [s]: a jump would be felt as a click."""

_ADDED = -1
"""Result of `_call` for an effect that wrote an output."""


@inlined
def render_contact(surface: "Surface") -> int:
    """Call the effects of contact with the parameters of the touched swatch; sum to `surface.total[0]`; return flags.

    Each effect writes to a cleared record. One that returns NaN or infinity is muted until the next reset.

    Where two swatches are blended, the effects are called for each. Forces are summed by weight, accelerations by the
    square root of the weight: the signals are independent, so that power spectra are summed by weight.
    """
    touch, part, total, memory = surface.touch[0], surface.part[0], surface.total[0], surface.memory[0]
    swatch, bank, blended = touch.swatch, memory.bank, touch.other >= 0
    _clear(total, touch)
    flags = 0
    if swatch < 0:
        return 0
    heavier, crossed = touch.swatch, touch.crossed
    weight, gain, rise = 1.0, 1.0, 0.0
    for turn in range(2 if blended else 1):
        if turn == 1:
            # the second pass renders the other swatch of a blend, with its state bank
            swatch, bank = touch.other, 1 - bank
            touch.swatch, touch.crossed = swatch, memory.other_crossed
        if blended:
            weight = touch.weight if turn == 1 else 1.0 - touch.weight
            gain, memory.gain[bank] = memory.gain[bank], math.sqrt(weight)
            rise = (memory.gain[bank] - gain) / touch.block
        for e in range(surface.contact_count[0]):
            outcome = _call(surface, e, swatch, bank * (len(surface.states) // 2))
            if outcome != _ADDED:
                flags |= outcome
                continue
            for i in range(3):
                total.f_W_N[i] += weight * part.f_W_N[i]
                for k in range(touch.inside):
                    total.f_inside_W_N[k, i] += weight * part.f_inside_W_N[k, i]
            if blended:
                for i in range(touch.block):
                    part.a_m_s2[i] *= gain + rise * (i + 1)
            for i in range(touch.block):
                total.a_m_s2[i] += part.a_m_s2[i]
            if weight >= 0.5:
                total.release |= part.release
    touch.swatch, touch.crossed = heavier, crossed
    return flags


@native
def render_fields(world: "World", surface: "Surface") -> int:
    """Call the effects of the scene and add their outputs to `surface.total[0]`; return flags."""
    touch, part, total = surface.touch[0], surface.part[0], surface.total[0]
    for k in range(len(surface.frame_body)):  # poses that these effects read from their tables
        start, body = surface.frame_at[k], world.bodies[surface.frame_body[k]]
        for i in range(3):
            for j in range(3):
                surface.tables[start + 3 * i + j] = body.R_WB[i, j]
            surface.tables[start + 9 + i] = body.p_WB_m[i]
    flags = 0
    for e in range(surface.contact_count[0], len(surface.effects)):
        outcome = _call(surface, e, len(surface.stiffness_N_m), 0)
        if outcome != _ADDED:
            flags |= outcome
            continue
        for i in range(3):
            total.f_W_N[i] += part.f_W_N[i]
            for k in range(touch.inside):
                total.f_inside_W_N[k, i] += part.f_inside_W_N[k, i]
        for i in range(touch.block):
            total.a_m_s2[i] += part.a_m_s2[i]
        total.release |= part.release
    return flags


@inlined
def _call(surface: "Surface", e: int, swatch: int, first_state: int) -> int:
    """Call an effect with output `surface.part[0]`; return `_ADDED`, or flags if it is muted."""
    touch, part = surface.touch[0], surface.part[0]
    if surface.muted[e] != 0:
        return _MUTED if surface.muted[e] == FAILED else 0
    _clear(part, touch)
    call_effect(
        surface.effects[e],
        touch,
        surface.params,
        surface.param_start[swatch, e],
        surface.tables[surface.table_start[swatch, e] : surface.table_start[swatch, e + 1]],
        surface.states,
        first_state + surface.state_start[e],
        part,
    )
    if not _finite(part, touch):
        surface.muted[e] = FAILED
        return _MUTED
    return _ADDED


@native
def fade_removed(surface: "Surface") -> int:
    """Fade out the force that ended because a touched body was removed (`Renderer.remove`); return flags."""
    total, memory = surface.total[0], surface.memory[0]
    if memory.fading_s <= 0.0:
        return 0
    for i in range(3):
        if memory.fading_s == FADE_S:  # the first tick without the body
            memory.fading_W_N[i] = memory.f_W_N[i] - total.f_W_N[i]
    memory.fading_s = max(0.0, memory.fading_s - surface.touch[0].tick_s)
    for i in range(3):
        total.f_W_N[i] += memory.fading_s / FADE_S * memory.fading_W_N[i]
    return _REMOVED


@inlined
def limit(surface: "Surface") -> int:
    """Limit the sum to the device: acceleration, force and slew rate. Returns flags."""
    limits, total, touch, memory = surface.limits[0], surface.total[0], surface.touch[0], surface.memory[0]
    f, a = total.f_W_N, total.a_m_s2
    flags = 0
    most = limits.acceleration_m_s2
    mean = 0.0
    for i in range(touch.block):
        if abs(a[i]) > most:
            a[i] = math.copysign(most, a[i])
            flags |= _ACCELERATION
        mean += a[i] / touch.block
    # a device without an actuator in the handle plays the acceleration, averaged over the tick, with its motors
    if limits.fold_mass_kg > 0.0 and touch.swatch >= 0:
        fold_kg = surface.fold_mass_kg[touch.swatch]
        if touch.other >= 0:
            fold_kg += touch.weight * (surface.fold_mass_kg[touch.other] - fold_kg)
        for i in range(3):
            f[i] += fold_kg * mean * touch.nhat_W[i]
    magnitude = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    if magnitude > limits.force_N:
        for i in range(3):
            f[i] *= limits.force_N / magnitude
        flags |= _FORCE
    last = memory.f_W_N
    x, y, z = f[0] - last[0], f[1] - last[1], f[2] - last[2]
    change = math.sqrt(x * x + y * y + z * z)
    step = limits.slew_N_s * touch.tick_s
    if change > step:
        f[0], f[1], f[2] = last[0] + x * step / change, last[1] + y * step / change, last[2] + z * step / change
        flags |= _SLEW
    for i in range(3):
        last[i] = f[i]
    return flags


@native
def _clear(out: np.record, touch: np.record) -> None:
    out.release = 0
    for i in range(3):
        out.f_W_N[i] = 0.0
        for k in range(touch.inside):
            out.f_inside_W_N[k, i] = 0.0
    for i in range(touch.block):
        out.a_m_s2[i] = 0.0


@native
def _finite(out: np.record, touch: np.record) -> bool:
    """Return whether the output is finite: 0 times NaN or infinity makes the sum NaN."""
    check = 0.0 * out.f_W_N[0] + 0.0 * out.f_W_N[1] + 0.0 * out.f_W_N[2]
    for i in range(touch.block):
        check += 0.0 * out.a_m_s2[i]
    for k in range(touch.inside):
        for i in range(3):
            check += 0.0 * out.f_inside_W_N[k, i]
    return bool(check == 0.0)
