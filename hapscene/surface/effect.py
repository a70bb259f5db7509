"""The effect contract: what a plugin says of itself. The smallest plugin is `examples/` away, 20 lines long.

An effect is one file with a `render` function in plain scalar Python and one `Effect` that names it, its
parameters and its state. The framework compiles it, calls it once a tick, and sums what it adds:

    def render(touch, p, table, s, out):
        if touch.touching:
            for i in range(3):
                out.f_W_N[i] += p.push_N * touch.nhat_W[i]

    EFFECT = Effect("push", "A constant push.", render, params=(Param("push_N", 0.1, "N", "how hard"),))

| argument | is |
|---|---|
| `touch` | the contact, a record of `hapscene.records.TOUCH`; read it, do not write it |
| `p` | the parameters of the touched swatch, by name |
| `table` | float64 array, what `Effect.table` made of that swatch; empty without one |
| `s` | the effect's state, by name: zero after a reset, the same record over all swatches |
| `out` | a record of `hapscene.records.OUTPUT`, zero on entry: add to it |

`render` is called in the air too (`touch.touching` is 0, `p` and `table` those of the swatch touched last), so that
what rings can ring down. It must not allocate, and reach nothing but its arguments and other compiled functions.

An effect of the scene (`scope="scene"`), a field or a fixture, belongs to no swatch: it is called in every tick, and
what it adds is felt by the hand alone, not by the body that is touched. Its parameters are set by
`Renderer(settings={name: {…}})`. Its `table` begins with poses, 12 numbers each (R_WB row by row, p_WB in metres): of
the bodies that its setting `bodies` names, or, where it names none, once that of W itself.
`hapscene.surface.field_frame` has what ours share.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import EffectError

__all__ = ["Effect", "Param", "State", "check_range"]

Render = Callable[[Any, Any, Any, Any, Any], None]
Table = Callable[[Any, float], NDArray[np.float64]]


@dataclass(frozen=True)
class Param:
    """A number that a swatch may set: its name ends in its unit, as `stiffness_N_m` does."""

    name: str
    default: float
    unit: str
    meaning: str
    minimum: float = -math.inf
    maximum: float = math.inf


@dataclass(frozen=True)
class State:
    """Memory of an effect from tick to tick: float64 numbers, or, `seeded`, the state of `dsp.noise`."""

    name: str
    shape: tuple[int, ...] = ()
    seeded: bool = False


@dataclass(frozen=True)
class Effect:
    """An effect plugin.

    `table(swatch, rate_Hz)` is called once for each swatch when a scene is built, and returns the bulk numbers
    that `render` gets as `table`: design there, in Python, what need not be computed in the tick. Of an effect of the
    scene it is `table(settings, rate_Hz)`, with the settings that `arrays` names, None where one is not given.

    Raises:
        EffectError: a name that is no identifier, or stands twice.
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
            raise EffectError(f"effect {self.name!r}: its scope is 'contact' or 'scene', not {self.scope!r}")
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
    def param_dtype(self) -> np.dtype[Any]:
        """Record layout of the parameters; never empty, since an empty record cannot be compiled."""
        return np.dtype([(p.name, "f8") for p in self.params] or [("_", "f8")], align=True)

    @property
    def state_dtype(self) -> np.dtype[Any]:
        """Record layout of the state; never empty, likewise."""
        fields: list[Any] = [(s.name, "u8", (4,)) if s.seeded else (s.name, "f8", s.shape) for s in self.state]
        return np.dtype(fields or [("_", "f8")], align=True)


def check_range(effect: Effect, param: Param, value: Any, where: str = "") -> float:
    """The value, if the parameter may have it.

    Raises:
        EffectError: it may not; `where` stands before the text.
    """
    if not isinstance(value, int | float | np.number) or not param.minimum <= value <= param.maximum:
        said = f"{value:g} {param.unit}" if isinstance(value, int | float | np.number) else repr(value)
        raise EffectError(
            f"{where}{param.name} of effect {effect.name!r} is {said}; "
            f"it must lie between {param.minimum:g} and {param.maximum:g}"
        )
    return float(value)
