"""Settings of an effect of the scene: parameters, arrays, and bodies whose poses it reads."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import EffectError, no_such
from hapscene.surface.effect import Effect, check_range

__all__ = ["POSE_SIZE", "FieldSetting", "field_setting"]

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
