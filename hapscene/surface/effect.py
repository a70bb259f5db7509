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
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import EffectError
from hapscene.plugin_registry import PluginRegistry
from hapscene.records import Record

__all__ = ["EFFECTS", "Effect", "Param", "State", "check_range", "load_effect"]

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

    `needs` names a parameter that disables the effect while it is 0: a renderer warns if no swatch sets it.

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
    needs: str = ""

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


EFFECTS: Final = PluginRegistry("hapscene.effects", "effect", Effect, EffectError)
"""Installed effects, found through their entry-point group."""


def load_effect(name: str) -> Effect:
    """Return an effect by name.

    Raises:
        EffectError: the effect is unknown, offered by two packages, not importable, or not an `Effect` of that name.
    """
    return EFFECTS.load(name)
