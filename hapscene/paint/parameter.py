"""The numbers of a swatch that can be turned: names, units, limits of the device, and the swatch with them turned."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, Final

from hapscene.device.model import Limits
from hapscene.errors import EffectError, no_such
from hapscene.surface.device_clipping import WALL, Fit
from hapscene.surface.effect import Effect
from hapscene.surface.swatch import OWN_PARAMETERS, Swatch

STIFFNESS: Final = "stiffness_N_m"

LABELS: Final = {
    "stiffness_N_m": "stiffness",
    "damping_Ns_m": "damping",
    "friction_static": "friction, at rest",
    "friction_dynamic": "friction, sliding",
    "texture_gain": "texture gain",
    "texture_life": "texture life",
    "tap_gain": "tap gain",
    "tangential_stiffness_N_m": "stiffness while it sticks",
    "tangential_damping_Ns_m": "damping while it sticks",
    "hunt_crossley_Ns_m2": "damping, growing with depth",
    "friction_stribeck_m_s": "speed of falling friction",
    "friction_viscous_s_m": "friction, growing with speed",
    "breakaway_1_kg": "sound of breaking loose",
    "breakaway_Hz": "frequency of breaking loose",
    "breakaway_decay_1_s": "decay of breaking loose",
    "adhesion_N": "adhesion",
    "adhesion_range_m": "range of adhesion",
}
"""What the painter calls them; another effect's number is called by its own name."""

ENDS: Final = {
    "stiffness_N_m": 3000.0,
    "damping_Ns_m": 20.0,
    "friction_static": 2.0,
    "friction_dynamic": 2.0,
    "texture_gain": 4.0,
    "tap_gain": 4.0,
    "tangential_stiffness_N_m": 3000.0,
    "tangential_damping_Ns_m": 20.0,
    "hunt_crossley_Ns_m2": 2000.0,
    "friction_stribeck_m_s": 0.2,
    "friction_viscous_s_m": 2.0,
    "breakaway_1_kg": 100.0,
    "breakaway_Hz": 1000.0,
    "breakaway_decay_1_s": 500.0,
    "adhesion_N": 3.0,
    "adhesion_range_m": 0.01,
}
"""Where a slider ends when the device sets no limit: about twice what is called rigid, the friction of rubber on
rubber, 12 dB of gain. A number that is over its end makes the slider longer."""

_NEEDS: Final[Mapping[str, Callable[[Swatch], bool]]] = {
    "texture_gain": lambda swatch: swatch.texture is not None,
    "texture_life": lambda swatch: swatch.texture is not None and swatch.texture.log_spread > 0.0,
    "tap_gain": lambda swatch: swatch.taps is not None,
}


@dataclass(frozen=True)
class Parameter:
    """A number of a swatch as a slider shows it.

    Attributes:
        name: as `tune` takes it; ends in its unit.
        label: for the eye.
        value: what the swatch has.
        given: what the device is rendered with.
        unit: "N/m", "1" for none.
        minimum, maximum: ends of the slider, value within; maximum is what the device holds, where that is less.
        reset: what `reset` brings back.
        meaning: in a sentence.
        applies: False where it does nothing, as the gain of a texture that is not there.
        note: what the device makes of the value, where that is another one; else "".
    """

    name: str
    label: str
    value: float
    given: float
    unit: str
    minimum: float
    maximum: float
    reset: float
    meaning: str
    applies: bool
    note: str


def parameters_of(
    swatch: Swatch, original: Swatch, effects: list[Effect], limits: Limits, tick_s: float
) -> tuple[Parameter, ...]:
    """All numbers of a swatch that can be turned, stiffness first.

    Args:
        swatch: as it is.
        original: as it was before it was turned.
        effects: that render it.
        limits: of the device.
        tick_s: period of the force channel [s].
    """
    alone: Any = SimpleNamespace(swatches=[swatch])
    fit = Fit(alone, effects, limits, tick_s)
    notes = {clip.number: str(clip) for clip in fit.clips(0)}
    rows: list[tuple[int, str, str, str, float, float, float]] = [
        (WALL, STIFFNESS, "N/m", "force over depth: how hard it is to press in", 0.0, math.inf, 0.0)
    ]
    for e, effect in enumerate(effects):
        for p in effect.params:
            if p.name not in {row[1] for row in rows}:
                rows.append((e, p.name, p.unit, p.meaning, p.minimum, p.maximum, p.default))
    found = []
    for e, name, unit, meaning, low, high, default in rows:
        value = fit.asked[0][e, name]
        effect_name = "" if e == WALL else effects[e].name
        end = min(_held(name, limits), high, ENDS.get(name, high))
        found.append(
            Parameter(
                name=name,
                label=LABELS.get(name, name),
                value=value,
                given=fit.given[0][e, name],
                unit=unit,
                minimum=min(low if math.isfinite(low) else 0.0, value),
                maximum=max(end if math.isfinite(end) else 2.0 * abs(value) + 1.0, value),
                reset=original.stiffness_N_m if e == WALL else original.parameter(effect_name, name, default),
                meaning=meaning,
                applies=name not in _NEEDS or _NEEDS[name](swatch),
                note=notes.get(name, ""),
            )
        )
    return tuple(found)


def _held(name: str, limits: Limits) -> float:
    """How much of a number the device holds: an effect's own spring is one as the wall is."""
    if name.endswith("stiffness_N_m"):
        return limits.stiffness_N_m
    return limits.damping_Ns_m if name.endswith("damping_Ns_m") else math.inf


def tuned(swatch: Swatch, numbers: Mapping[str, float], effects: list[Effect]) -> Swatch:
    """The swatch with other numbers, by the names of its parameters.

    Of the two frictions the one that is not given follows, so that sliding never takes more than breaking away. What
    was measured of a number is no longer said of it.

    Raises:
        EffectError: a name that nothing has, or a value outside its limits.
    """
    own: dict[str, float] = {}
    by_effect = {effect: dict(values) for effect, values in swatch.effects.items()}
    for name, value in numbers.items():
        holders = [(e.name, p) for e in effects for p in e.params if p.name == name]
        if not holders and name not in OWN_PARAMETERS:
            known = {p.name for e in effects for p in e.params} | set(OWN_PARAMETERS)
            raise EffectError(no_such("parameter", name, known))
        low = max([p.minimum for _, p in holders], default=0.0)
        high = min([p.maximum for _, p in holders], default=math.inf)
        if not (low <= value <= high and math.isfinite(value)):
            raise EffectError(f"{name} of swatch {swatch.name!r} must lie between {low:g} and {high:g}, is {value:g}")
        if name in OWN_PARAMETERS:
            own[name] = float(value)
            for values in by_effect.values():
                values.pop(name, None)  # an effect's own number would hide the swatch's
        else:
            for effect, _ in holders:
                by_effect.setdefault(effect, {})[name] = float(value)
    static = own.get("friction_static", swatch.friction_static)
    dynamic = own.get("friction_dynamic", swatch.friction_dynamic)
    if dynamic > static:
        if "friction_dynamic" in own:
            own["friction_static"] = dynamic
        else:
            own["friction_dynamic"] = static
    gone = {name for name, value in own.items() if value != getattr(swatch, name)}
    fields: dict[str, Any] = dict(own)
    return replace(
        swatch,
        **fields,
        effects={effect: values for effect, values in by_effect.items() if values},
        intervals={name: pair for name, pair in swatch.intervals.items() if name not in gone},
        absent={name: reason for name, reason in swatch.absent.items() if name not in gone},
    )
