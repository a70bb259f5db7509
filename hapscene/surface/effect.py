"""The effect contract: how a plugin declares an effect. `examples/third_party_effect` is a complete plugin.

An effect is one file with a `render` function in scalar Python and one `Effect` that declares its name, parameters and
state. The framework compiles the function, calls it once per tick, and sums the outputs:

    def render(touch, p, table, s, out):
        if touch.touching:
            for i in range(3):
                out.f_W_N[i] += p.push_N * touch.nhat_W[i]

    EFFECT = Effect("push", "A constant push.", render, params=(Param("push_N", 0.1, "N", "force"),))

| argument | meaning |
|---|---|
| `touch` | the contact, a record of `hapscene.records.TOUCH`; read-only |
| `p` | parameters of the touched swatch, by name |
| `table` | float64 array that `Effect.table` computed for that swatch; empty without one |
| `s` | state of the effect, by name: zero after a reset, one record for all swatches |
| `out` | a record of `hapscene.records.OUTPUT`, zero on entry: add to it |

`render` is also called without contact (`touch.touching` is 0, `p` and `table` are those of the last swatch), so that
vibrations can decay. It must not allocate memory, and may use only its arguments and other compiled functions.

An effect of the scene (`scope="scene"`), such as a force field or a virtual fixture, belongs to no swatch. It is called
in every tick, and its output acts on the hand only, not on the touched body. Its parameters are set with
`Renderer(settings={name: {…}})`. Its `table` begins with poses of 12 numbers (R_WB row by row, p_WB in metres): those
of the bodies in its setting `bodies`, or the identity without them. `hapscene.surface.field_frame` has helper
functions for such effects."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import EffectError, no_such
from hapscene.plugin_registry import PluginRegistry
from hapscene.records import Record

__all__ = [
    "EFFECTS",
    "POSE_SIZE",
    "Effect",
    "FieldSetting",
    "Param",
    "State",
    "check_range",
    "field_setting",
    "load_effect",
]

Render = Callable[[Record, Record, NDArray[np.float64], Record, Record], None]
Table = Callable[[Any, float], NDArray[np.float64]]


@dataclass(frozen=True)
class Param:
    """A parameter that a swatch can set. Its name ends in its unit, as `stiffness_N_m` does."""

    name: str
    default: float
    unit: str
    meaning: str
    minimum: float = -math.inf
    maximum: float = math.inf


@dataclass(frozen=True)
class State:
    """State of an effect, kept from tick to tick: float64 numbers, or a random state of `dsp.noise` if `seeded`."""

    name: str
    shape: tuple[int, ...] = ()
    seeded: bool = False


@dataclass(frozen=True)
class Effect:
    """An effect plugin.

    `table(swatch, rate_Hz)` is called once for each swatch when a scene is built, and returns the array that `render`
    gets as `table`: use it to compute in Python what need not be computed in every tick. For an effect of the scene
    the call is `table(settings, rate_Hz)`, with the settings listed in `arrays`, None for those that are not given.

    Raises:
        EffectError: a name is not an identifier, or is declared twice.
    """

    name: str
    summary: str
    render: Render
    params: tuple[Param, ...] = ()
    state: tuple[State, ...] = ()
    table: Table | None = None
    scope: Literal["contact", "scene"] = "contact"
    arrays: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.scope not in ("contact", "scene"):
            raise EffectError(f"effect {self.name!r}: scope must be 'contact' or 'scene', is {self.scope!r}")
        for kind, names in (("parameter", [p.name for p in self.params]), ("state", [s.name for s in self.state])):
            for name in names:
                if not name.isidentifier():
                    raise EffectError(f"effect {self.name!r}: {kind} {name!r} is not a Python identifier")
                if names.count(name) > 1:
                    raise EffectError(f"effect {self.name!r}: {kind} {name!r} is declared twice")

    def __repr__(self) -> str:
        params = ", ".join(param.name for param in self.params) or "no parameters"
        return f"<Effect {self.name!r}: {self.summary} ({params})>"

    @property
    def param_dtype(self) -> np.dtype[np.void]:
        """Record type of the parameters; never empty, because numba cannot compile an empty record."""
        return np.dtype([(p.name, "f8") for p in self.params] or [("_", "f8")], align=True)

    @property
    def state_dtype(self) -> np.dtype[np.void]:
        """Record type of the state; never empty, as `param_dtype`."""
        fields = [(s.name, "u8", (4,)) if s.seeded else (s.name, "f8", s.shape) for s in self.state]
        return np.dtype(fields or [("_", "f8", ())], align=True)


def check_range(effect: Effect, param: Param, value: object, where: str = "") -> float:
    """Return the value of a parameter as float if it is in range.

    Raises:
        EffectError: the value is not a number or out of range; `where` is the start of the message.
    """
    if not isinstance(value, int | float | np.number) or not param.minimum <= value <= param.maximum:
        found = f"{value:g} {param.unit}" if isinstance(value, int | float | np.number) else repr(value)
        raise EffectError(
            f"{where}{param.name} of effect {effect.name!r} is {found}; "
            f"expected {param.minimum:g} to {param.maximum:g} {param.unit} ({param.meaning})"
        )
    return float(value)


# Settings of an effect of the scene: parameters, arrays, and bodies whose poses it reads.


POSE_SIZE: Final = 12
"""Numbers of a pose in a table [count]: R_WB row by row, then p_WB."""

_WORLD: Final = np.concatenate((np.eye(3).ravel(), np.zeros(3)))


class FieldSetting(NamedTuple):
    """Checked settings of an effect of the scene.

    Attributes:
        numbers: parameters by name.
        bodies: indices of the bodies whose poses are at the start of its table.
        table: poses (12 numbers each; the identity without bodies), then the result of `Effect.table`.
    """

    numbers: dict[str, float]
    bodies: tuple[int, ...]
    table: NDArray[np.float64]


def field_setting(
    effect: Effect, given: Mapping[str, object], body_names: Sequence[str], a_rate_Hz: float
) -> FieldSetting:
    """Check the settings of an effect of the scene.

    Raises:
        EffectError: a setting or body is unknown, a number is out of range, or an array is invalid.
    """
    known = {param.name: param for param in effect.params}
    where = f"settings of effect {effect.name!r}: "
    if not isinstance(given, Mapping):
        raise EffectError(
            where + f"must map names to numbers, as {{'{next(iter(known), 'mass_kg')}': 0.2}}, not {given!r:.40}"
        )
    for name in given:
        if name not in known and name not in effect.arrays and name != "bodies":
            raise EffectError(where + no_such("setting", name, [*known, *effect.arrays, "bodies"]))
    numbers = {}
    for name, param in known.items():
        numbers[name] = param.default
        if name in given:
            numbers[name] = check_range(effect, param, given[name])
    names = given.get("bodies") or ()
    bodies = []
    for name in map(str, names if isinstance(names, Iterable) and not isinstance(names, str) else [names]):
        if name not in body_names:
            raise EffectError(where + no_such("body", name, body_names))
        bodies.append(list(body_names).index(name))
    arrays = {name: given.get(name) for name in effect.arrays}
    own = np.zeros(0) if effect.table is None else np.asarray(effect.table(arrays, a_rate_Hz), np.float64).ravel()
    if not np.isfinite(own).all():
        raise EffectError(where + "its table contains NaN or infinity")
    return FieldSetting(numbers, tuple(bodies), np.concatenate((np.tile(_WORLD, max(1, len(bodies))), own)))


EFFECTS: Final = PluginRegistry("hapscene.effects", "effect", Effect, EffectError)
"""Installed effects, found through their entry-point group."""


def load_effect(name: str) -> Effect:
    """Return an effect by name.

    Raises:
        EffectError: the effect is unknown, offered by two packages, not importable, or not an `Effect` of that name.
    """
    return EFFECTS.load(name)
