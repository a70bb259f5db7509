"""Arrays of the compiled tick, filled in Python: swatches, effects, parameters and states, packed side by side."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import new_clock
from hapscene.compiled.block import by_pointer
from hapscene.constants import SLIP_CUTOFF_HZ
from hapscene.device.model import DELAY_TICKS_MAX, Limits
from hapscene.dsp.noise import seeded_state
from hapscene.errors import EffectError
from hapscene.records import OUTPUT, TOUCH, Records, pack_small_arrays, records
from hapscene.surface.device_clipping import WALL, Numbers
from hapscene.surface.effect import POSE_SIZE, Effect, FieldSetting
from hapscene.surface.effect_compile import compile_effect

Rows = Sequence[NDArray[np.generic]]

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene
    from hapscene.surface.swatch import Swatch

__all__ = [
    "BALL",
    "CLEARED",
    "COUPLE",
    "FADE",
    "FAILED",
    "FIELDS",
    "GUARD",
    "PLACE",
    "SHADE",
    "SWITCHED_OFF",
    "TICK",
    "Surface",
    "build_surface",
    "clear_states",
    "put_numbers",
]

MEMORY: Final = np.dtype(
    [
        ("p_WT_m", "f8", (3,)),  # device position in the last tick
        ("p_WP_m", "f8", (3,)),  # reported proxy in the last tick
        ("slip_m_s", "f8", (3,)),  # low-passed slip velocity
        ("f_W_N", "f8", (3,)),  # force sent in the last tick
        ("nhat_W", "f8", (3,)),  # normal in the last tick
        ("drag_m_s", "f8", (3,)),  # velocity of the touched body at the proxy, 0 without contact
        ("smoothing", "f8"),  # weight of a new value in a low-pass at SLIP_CUTOFF_HZ; constant
        # measured device position in the last tick; differs from p_WT_m with a virtual coupling
        ("tool_W_m", "f8", (3,)),
        ("made_J", "f8"),  # energy that the wall generated so far
        ("stored_J", "f8"),  # energy stored in the spring of the wall in the last tick
        ("f_body_W_N", "f8", (3,)),  # force on the touched body in this tick, 0 without contact
        ("left_B_m", "f8", (3,)),  # where the tool last left a body, in the frame of `touch.left_body`
        ("now_W_m", "f8", (3,)),  # device position in this tick: measured, then coupled
        ("fading_W_N", "f8", (3,)),  # force that the removal of a touched body has ended, and that fades out
        ("fading_s", "f8"),  # remaining time of it, see `hapscene.surface.mixer`
        ("jumped", "i8"),  # 1 if the touched body teleported or was removed, so that the tool did not leave it
        ("fresh", "i8"),  # 1 in the first tick after a reset, when no velocities exist yet
        # two swatches at once, see `hapscene.surface.blending`
        ("bank", "i8"),  # state bank of `touch.swatch`; the other bank belongs to `touch.other`
        ("other_crossed", "i8"),  # `touch.crossed` of the other swatch
        ("gain", "f8", (2,)),  # gain of each bank's acceleration at the end of the last tick
        ("held_N", "f8", (DELAY_TICKS_MAX + 1, 3)),  # normal part of the force sent in the last ticks
    ],
    align=True,
)


LEAF: Final = np.dtype([("path", "i8"), ("edge", "i8"), ("paint", "i8")])
"""A leaf of `hapscene.scene.fine_paint.FinePaint`, which explains the fields, in signed integers for compiled code."""

COPIED: Final = 1
"""State of an effect when a second swatch is blended in: the second swatch starts with a copy."""

CLEARED: Final = 2
"""State of an effect when a second swatch is blended in: the second swatch starts from zero."""

COPIED_MAX_B: Final = 4096
"""Largest state of an effect that is copied within a tick [bytes]. Larger ones belong to audio filters, which fade in
from silence anyway."""

FAILED: Final = 1
"""Reason for a muted effect: it returned a value that is not finite."""

TICK, PLACE, COUPLE, GUARD, SHADE, FIELDS, BALL, FADE = range(8)
"""Indices into `Surface.entries`: the whole tick, and phases that are compiled only for scenes that use them."""

PHASE_COUNT: Final = 8

SWITCHED_OFF: Final = 2
"""Reason for a muted effect: the user disabled it (`Renderer.mute`)."""


@by_pointer
class Surface(NamedTuple):
    """All arrays that the describe phase, the effects and the mixer read and write: s swatches, e effects.

    Effects of contact come first, then effects of the scene. Parameters and tables of effects of the scene are stored
    as those of one more swatch after the last.
    """

    stiffness_N_m: NDArray[np.float64]  # (s,)
    # swatch of each face, body after body; −1 − index into leaf_start for finely painted faces
    paint: NDArray[np.int32]
    paint_start: NDArray[np.int64]  # (b,)
    leaf: Records  # (k,) LEAF
    leaf_start: NDArray[np.int64]  # (f + 1,) first leaf of each finely painted face
    effects: NDArray[np.int64]  # (e,) addresses of compiled effects
    contact_count: NDArray[np.int64]  # (1,) number of effects of contact
    params: NDArray[np.uint8]
    param_start: NDArray[np.int64]  # (s + 1, e)
    tables: NDArray[np.float64]
    table_start: NDArray[np.int64]  # (s + 1, e + 1)
    frame_body: NDArray[np.int64]  # (k,) bodies with poses that are written to `tables`
    frame_at: NDArray[np.int64]  # (k,) offsets of these poses in `tables`
    states: NDArray[np.uint8]  # two banks, one after the other
    state_start: NDArray[np.int64]  # (e + 1,) offsets in a bank
    passed_on: NDArray[np.int64]  # (k, 3) byte ranges of a bank, and COPIED or CLEARED
    muted: NDArray[np.int64]  # (e,) 0, or the reason: FAILED, SWITCHED_OFF
    touch: Records  # (1,) TOUCH
    part: Records  # (1,) OUTPUT of one effect
    total: Records  # (1,) OUTPUT of all effects
    memory: Records  # (1,) MEMORY
    limits: Records  # (1,) LIMIT
    fold_mass_kg: NDArray[np.float64]  # (s,) effective mass that converts a swatch's acceleration to motor force
    clock: NDArray[np.int64]
    entries: NDArray[np.int64]  # (PHASE_COUNT,) addresses of compiled phases of the tick, 0 if not used


HOT: Final = (
    *("touch", "memory", "clock", "entries", "paint_start", "stiffness_N_m", "contact_count", "muted", "effects"),
    *("state_start", "param_start", "table_start", "params", "fold_mass_kg", "limits", "part", "total", "states"),
    "tables",
)
"""Arrays that every tick touches; `build_surface` places them side by side in memory."""


def build_surface(
    scene: "Scene",
    effects: Sequence[Effect],
    tick_s: float,
    a_rate_Hz: float,
    limits: Limits,
    fields: Sequence[FieldSetting] = (),
) -> Surface:
    """Compile the effects and pack the swatches of a scene with their parameters.

    Args:
        scene: scene with swatches and painted faces.
        effects: effects of contact, then effects of the scene.
        tick_s, a_rate_Hz, limits: see `Renderer`.
        fields: settings of the effects of the scene.

    Raises:
        EffectError: an effect does not compile.
    """
    swatches = scene.swatches
    paint, leaf, leaf_start = _leaves(scene)
    contact = effects[: len(effects) - len(fields)]
    params = _params(swatches, contact, effects[len(contact) :], fields)
    tables = _by_row(
        [[_table(effect, swatch, a_rate_Hz) for effect in contact] for swatch in swatches],
        [field.table for field in fields],
        np.float64,
    )
    param_start, table_start = _starts(map(len, params)), _starts(map(len, tables))
    last = table_start[len(effects) * np.arange(1, len(swatches) + 2)]  # end of the tables of each swatch
    state_start = _starts(effect.state_dtype.itemsize for effect in effects)
    frames = _frames(fields, table_start[-1 - len(fields) : -1])
    surface = Surface(
        stiffness_N_m=np.array([swatch.stiffness_N_m for swatch in swatches], np.float64),
        paint=paint,
        leaf=leaf,
        leaf_start=leaf_start,
        paint_start=_starts(len(body.face_swatch) for body in scene.bodies),
        effects=np.array([compile_effect(effect) for effect in effects], np.int64),
        contact_count=np.array([len(contact)]),
        params=np.concatenate([np.zeros(0, np.uint8), *params]),
        param_start=param_start[:-1].reshape(len(swatches) + 1, len(effects)),
        tables=np.concatenate([np.zeros(0), *tables]),
        table_start=np.column_stack((table_start[:-1].reshape(len(swatches) + 1, len(effects)), last)),
        frame_body=np.array([body for body, _ in frames], np.int64),
        frame_at=np.array([at for _, at in frames], np.int64),
        states=np.zeros(2 * state_start[-1], np.uint8),
        state_start=state_start,
        passed_on=_passed_on(contact, state_start),
        muted=np.zeros(len(effects), np.int64),
        touch=records(1, TOUCH),
        part=records(1, OUTPUT),
        total=records(1, OUTPUT),
        memory=records(1, MEMORY),
        limits=limits.record(),
        fold_mass_kg=np.full(len(swatches), limits.fold_mass_kg),
        clock=new_clock(),
        entries=np.zeros(PHASE_COUNT, np.int64),
    )
    return _ready(surface, tick_s, a_rate_Hz)


def _frames(fields: Sequence[FieldSetting], starts: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Return each body whose pose an effect of the scene reads, and where the pose is stored in the tables."""
    each = zip(fields, starts, strict=True)
    return [(body, start + POSE_SIZE * i) for field, start in each for i, body in enumerate(field.bodies)]


def _params(
    swatches: "Sequence[Swatch]", contact: Sequence[Effect], of_scene: Sequence[Effect], fields: Sequence[FieldSetting]
) -> Rows:
    """Return the packed parameters of all effects, in storage order."""
    of_swatches = [
        [_packed(e, {p.name: swatch.parameter(e.name, p.name, p.default) for p in e.params}) for e in contact]
        for swatch in swatches
    ]
    return _by_row(of_swatches, [_packed(e, f.numbers) for e, f in zip(of_scene, fields, strict=True)], np.uint8)


def _ready(surface: Surface, tick_s: float, a_rate_Hz: float) -> Surface:
    """Return the surface with its hot arrays side by side, and its rates set."""
    near = pack_small_arrays([getattr(surface, name) for name in HOT])
    surface = surface._replace(**dict(zip(HOT, near, strict=True)))
    touch = surface.touch[0]
    touch.tick_s, touch.rate_Hz, touch.block = tick_s, a_rate_Hz, round(a_rate_Hz * tick_s)
    touch.R_WT = np.eye(3)
    surface.memory[0].smoothing = 1.0 - math.exp(-2.0 * math.pi * SLIP_CUTOFF_HZ * tick_s)
    return surface


def _by_row(of_swatches: Sequence[Rows], of_fields: Rows, kind: type[np.generic]) -> Rows:
    """Return arrays in storage order: a row of effects of contact for each swatch, then one of effects of the scene."""
    none = [np.zeros(0, kind)]
    contact_count = len(of_swatches[0])
    return [*chain(*((*row, *none * len(of_fields)) for row in of_swatches)), *(none * contact_count), *of_fields]


def _starts(sizes: Iterable[int]) -> NDArray[np.int64]:
    """Return the offsets (n + 1,) of consecutive arrays of these sizes (n,)."""
    return np.cumsum([0, *sizes], dtype=np.int64)


def put_numbers(surface: Surface, effects: Sequence[Effect], swatch: int, numbers: Numbers) -> None:
    """Set parameters from the next tick on; the index after the last swatch selects effects of the scene."""
    for (e, name), value in numbers.items():
        if e == WALL:
            surface.stiffness_N_m[swatch] = value
        else:
            start, dtype = surface.param_start[swatch, e], effects[e].param_dtype
            surface.params[start : start + dtype.itemsize].view(dtype)[name] = value


def clear_states(surface: Surface, effects: Sequence[Effect], seed: int) -> None:
    """Clear the states of effects, unmute those that failed, and reset their random numbers to the seed."""
    surface.states[:] = 0
    surface.muted[surface.muted == FAILED] = 0
    for states, bank in zip(np.split(surface.states, 2), ("", ".2"), strict=True):
        for numbers, name in _random_states(states, effects, surface.state_start):
            numbers[:] = seeded_state(seed, name + bank)


def _random_states(
    states: NDArray[np.uint8], effects: Sequence[Effect], state_start: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.uint64], str]]:
    """Yield views of the random states (4,) in a bank, and their names."""
    for start, effect in zip(state_start, effects, strict=False):
        record = states[start : start + effect.state_dtype.itemsize].view(effect.state_dtype)
        for state in effect.state:
            if state.seeded:
                yield record[state.name][0], f"{effect.name}.{state.name}"


def _passed_on(contact: Sequence[Effect], state_start: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return `Surface.passed_on`: byte ranges of all states of effects of contact, except random numbers."""
    sizes = np.array([effect.state_dtype.itemsize for effect in contact], np.int64)
    fate = np.repeat(np.where(sizes > COPIED_MAX_B, CLEARED, COPIED), sizes).astype(np.uint8)
    for numbers, _ in _random_states(fate, contact, state_start):
        numbers[:] = 0
    ends = np.flatnonzero(np.diff(fate, prepend=0, append=0))
    rows = np.column_stack((ends[:-1], ends[1:], fate[ends[:-1]])).astype(np.int64)
    return np.ascontiguousarray(rows[rows[:, 2] > 0])


def _leaves(scene: "Scene") -> tuple[NDArray[np.int32], Records, NDArray[np.int64]]:
    """Return `paint`, `leaf` and `leaf_start` of a `Surface`."""
    paint = np.concatenate([np.zeros(0, np.int32), *(body.face_swatch for body in scene.bodies)]).astype(np.int32)
    fine = [body.fine for body in scene.bodies if body.fine is not None]
    leaf = records(sum(map(len, fine)), LEAF)
    first = [np.zeros(0, np.int64)]
    at = face = 0
    for body in scene.bodies:
        if body.fine is not None:
            new = np.flatnonzero(np.diff(body.fine.face, prepend=-1))
            paint[face + body.fine.face[new]] = -1 - sum(map(len, first)) - np.arange(len(new))
            first.append(at + new)
            for name in LEAF.names or ():
                leaf[name][at : at + len(body.fine)] = getattr(body.fine, name).astype(np.int64)
            at += len(body.fine)
        face += len(body.face_swatch)
    return paint, leaf, np.concatenate([*first, [at]])


def _packed(effect: Effect, numbers: Mapping[str, float]) -> NDArray[np.uint8]:
    row = np.zeros(1, effect.param_dtype)
    for name, value in numbers.items():
        row[name] = value
    return row.view(np.uint8)


def _table(effect: Effect, swatch: "Swatch", a_rate_Hz: float) -> NDArray[np.float64]:
    if effect.table is None:
        return np.zeros(0)
    table = np.ascontiguousarray(effect.table(swatch, a_rate_Hz), np.float64).ravel()
    if not np.isfinite(table).all():
        raise EffectError(f"effect {effect.name!r}: its table for swatch {swatch.name!r} contains NaN or infinity")
    return table
