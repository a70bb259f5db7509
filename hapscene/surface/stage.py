"""How the scene feels, as the compiled tick reads it: swatches, effects, parameters and memory in flat arrays."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import new_clock
from hapscene.contact.world import records
from hapscene.device.limit import Limits
from hapscene.errors import EffectError, no_such
from hapscene.records import OUTPUT, TOUCH
from hapscene.surface.compile import compile_effect
from hapscene.surface.effect import Effect, Param
from hapscene.surface.random import seeded_state

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene
    from hapscene.surface.swatch import Swatch

MEMORY: Final = np.dtype(
    [
        ("p_WT_m", "f8", (3,)),  # the tool in the last tick
        ("p_WP_m", "f8", (3,)),  # the reported proxy in the last tick
        ("slip_m_s", "f8", (3,)),  # slip velocity, low-passed
        ("f_W_N", "f8", (3,)),  # force sent in the last tick
        ("fresh", "i8"),  # 1 in the first tick after a reset: nothing has a velocity yet
    ],
    align=True,
)


class Surface(NamedTuple):
    """Everything that description, effects and mixer read and write. s swatches, e effects."""

    stiffness_N_m: NDArray[np.float64]  # (s,)
    paint: NDArray[np.int16]  # swatch of each face, body after body
    paint_start: NDArray[np.int64]  # (b,)
    effects: NDArray[np.int64]  # (e,) addresses
    params: NDArray[np.uint8]
    param_start: NDArray[np.int64]  # (s, e)
    tables: NDArray[np.float64]
    table_start: NDArray[np.int64]  # (s, e + 1)
    states: NDArray[np.uint8]
    state_start: NDArray[np.int64]  # (e,)
    muted: NDArray[np.int64]  # (e,)
    touch: Any  # (1,) TOUCH
    part: Any  # (1,) OUTPUT of one effect
    total: Any  # (1,) OUTPUT of all
    memory: Any  # (1,) MEMORY
    limits: Any  # (1,) LIMIT
    clock: NDArray[np.int64]


def build_surface(
    scene: "Scene", effects: Sequence[Effect], tick_s: float, a_rate_Hz: float, limits: Limits
) -> Surface:
    """Compile the effects and pack the swatches of a scene.

    Raises:
        EffectError: an effect that does not compile, or a parameter outside its limits.
    """
    swatches = scene.swatches
    param_start = np.zeros((len(swatches), len(effects)), np.int64)
    table_start = np.zeros((len(swatches), len(effects) + 1), np.int64)
    params: list[NDArray[np.uint8]] = []
    tables: list[NDArray[np.float64]] = []
    param_size = table_size = 0
    for s, swatch in enumerate(swatches):
        for e, effect in enumerate(effects):
            param_start[s, e], table_start[s, e] = param_size, table_size
            params.append(_params(effect, swatch))
            tables.append(_table(effect, swatch, a_rate_Hz))
            param_size += len(params[-1])
            table_size += len(tables[-1])
        table_start[s, len(effects)] = table_size
    sizes = [effect.state_dtype.itemsize for effect in effects]
    counts = [len(body.face_swatch) for body in scene.bodies]
    surface = Surface(
        stiffness_N_m=np.array([swatch.stiffness_N_m for swatch in swatches], np.float64),
        paint=np.concatenate([np.zeros(0, np.int16), *(body.face_swatch for body in scene.bodies)]),
        paint_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        effects=np.array([compile_effect(effect) for effect in effects], np.int64),
        params=np.concatenate([np.zeros(0, np.uint8), *params]),
        param_start=param_start,
        tables=np.concatenate([np.zeros(0), *tables]),
        table_start=table_start,
        states=np.zeros(sum(sizes), np.uint8),
        state_start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        muted=np.zeros(len(effects), np.int64),
        touch=records(1, TOUCH),
        part=records(1, OUTPUT),
        total=records(1, OUTPUT),
        memory=records(1, MEMORY),
        limits=limits.record(),
        clock=new_clock(),
    )
    touch = surface.touch[0]
    touch.tick_s, touch.rate_Hz, touch.block = tick_s, a_rate_Hz, round(a_rate_Hz * tick_s)
    return surface


def tune_surface(surface: Surface, effects: Sequence[Effect], swatch: int, numbers: Mapping[str, float]) -> None:
    """Change the stiffness of a swatch, or parameters of effects on it by name.

    Raises:
        EffectError: a name that nothing has, or a value outside its limits. Then nothing is changed.
    """
    changes: list[tuple[Any, Any, float]] = []
    for name, value in numbers.items():
        if name == "stiffness_N_m":
            if not 0.0 <= value < math.inf:
                raise EffectError(f"stiffness_N_m must be finite and not negative, is {value:g} N/m")
            changes.append((surface.stiffness_N_m, swatch, value))
        holders = [(e, param) for e, effect in enumerate(effects) for param in effect.params if param.name == name]
        if not holders and name != "stiffness_N_m":
            known = {param.name for effect in effects for param in effect.params} | {"stiffness_N_m"}
            raise EffectError(no_such("parameter", name, known))
        for e, param in holders:
            _check_range(effects[e], param, value)
            dtype, start = effects[e].param_dtype, surface.param_start[swatch, e]
            changes.append((surface.params[start : start + dtype.itemsize].view(dtype), name, value))
    for target, key, value in changes:
        target[key] = value


def clear_states(surface: Surface, effects: Sequence[Effect], seed: int) -> None:
    """Zero the effects' memory, unmute them, and seed their random numbers anew."""
    surface.states[:] = 0
    surface.muted[:] = 0
    for start, effect in zip(surface.state_start, effects, strict=False):
        dtype = effect.state_dtype
        record = surface.states[start : start + dtype.itemsize].view(dtype)
        for state in effect.state:
            if state.seeded:
                record[state.name] = seeded_state(seed, f"{effect.name}.{state.name}")


def _params(effect: Effect, swatch: "Swatch") -> NDArray[np.uint8]:
    row = np.zeros(1, effect.param_dtype)
    for param in effect.params:
        value = swatch.parameter(effect.name, param.name, param.default)
        _check_range(effect, param, value, f"swatch {swatch.name!r}: ")
        row[param.name] = value
    return row.view(np.uint8)


def _check_range(effect: Effect, param: Param, value: float, where: str = "") -> None:
    if not param.minimum <= value <= param.maximum:
        raise EffectError(
            f"{where}{param.name} of effect {effect.name!r} is {value:g} {param.unit}; "
            f"it must lie between {param.minimum:g} and {param.maximum:g}"
        )


def _table(effect: Effect, swatch: "Swatch", a_rate_Hz: float) -> NDArray[np.float64]:
    if effect.table is None:
        return np.zeros(0)
    table = np.ascontiguousarray(effect.table(swatch, a_rate_Hz), np.float64).ravel()
    if not np.isfinite(table).all():
        raise EffectError(f"effect {effect.name!r}: its table for swatch {swatch.name!r} holds NaN or infinity")
    return table
