"""Swatches of a painting: add, copy, tune within the limits of the device, save to the user's library."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

from hapscene.constants import TICK_S
from hapscene.device.model import DeviceLike, Limits, device_of, limits_of
from hapscene.errors import EffectError, SceneError, no_such
from hapscene.paint.model.history import SwatchDelta, SwatchState
from hapscene.paint.model.painting import Painting
from hapscene.surface.device_clipping import WALL, ClippedSwatches
from hapscene.surface.effect import Effect
from hapscene.surface.swatch import OWN_PARAMETERS, PLAIN, Swatch, SwatchLike
from hapscene.swatches.library import add, library_folder
from hapscene.view.palette import distinct_colours, rgb

__all__ = ["Parameter", "SwatchTuning", "parameters_of", "tuned"]

STIFFNESS: Final = "stiffness_N_m"

SHOWN: Final = {
    "stiffness_N_m": ("stiffness", 3000.0),
    "damping_Ns_m": ("damping", 20.0),
    "friction_static": ("static friction", 2.0),
    "friction_dynamic": ("friction", 2.0),
    "texture_gain": ("roughness", 4.0),
    "texture_life": ("texture modulation", math.inf),
    "tap_gain": ("tap", 4.0),
    "tangential_stiffness_N_m": ("stick stiffness", 3000.0),
    "tangential_damping_Ns_m": ("stick damping", 20.0),
    "hunt_crossley_Ns_m2": ("Hunt–Crossley damping", 2000.0),
    "friction_stribeck_m_s": ("Stribeck speed", 0.2),
    "friction_viscous_s_m": ("viscous friction", 2.0),
    "breakaway_1_kg": ("breakaway transient", 100.0),
    "breakaway_Hz": ("breakaway frequency", 1000.0),
    "breakaway_decay_1_s": ("breakaway decay", 500.0),
    "adhesion_N": ("adhesion", 3.0),
    "adhesion_range_m": ("adhesion range", 0.01),
}
"""Label of each parameter, and the end of its slider if the device sets no limit: about twice the stiffness that feels
rigid, the friction of rubber on rubber, 12 dB of gain. A larger value extends the slider. Parameters of other effects
are shown by their names."""

_NEEDS: Final[Mapping[str, Callable[[Swatch], bool]]] = {
    "texture_gain": lambda swatch: swatch.texture is not None,
    "texture_life": lambda swatch: swatch.texture is not None and swatch.texture.log_spread > 0.0,
    "tap_gain": lambda swatch: swatch.taps is not None,
}


@dataclass(frozen=True)
class Parameter:
    """A parameter of a swatch, as shown by a slider.

    Attributes:
        name: name for `tune`; ends in the unit.
        label: label for the user.
        value: value of the swatch.
        given: value that is rendered, within the limits of the device.
        unit: unit, such as "N/m"; "1" for a dimensionless parameter.
        minimum, maximum: range of the slider, which contains the value and ends at the limit of the device.
        meaning: description in one sentence.
        applies: whether the parameter has an effect; False for the gain of a texture that the swatch does not have.
        note: explanation if the rendered value differs from the swatch's; else "".
    """

    name: str
    label: str
    value: float
    given: float
    unit: str
    minimum: float
    maximum: float
    meaning: str
    applies: bool
    note: str


def parameters_of(swatch: Swatch, effects: list[Effect], limits: Limits) -> tuple[Parameter, ...]:
    """All parameters of a swatch that can be tuned, stiffness first.

    Args:
        swatch: the swatch.
        effects: effects that render it.
        limits: limits of the device.
    """
    alone: Any = SimpleNamespace(swatches=[swatch])
    fit = ClippedSwatches(alone, effects, limits, TICK_S)
    notes = {clip.number: str(clip) for clip in fit.clips(0)}
    rows: list[tuple[int, str, str, str, float, float]] = [
        (WALL, STIFFNESS, "N/m", "normal force divided by penetration depth", 0.0, math.inf)
    ]
    for e, effect in enumerate(effects):
        for p in effect.params:
            if p.name not in {row[1] for row in rows}:
                rows.append((e, p.name, p.unit, p.meaning, p.minimum, p.maximum))
    found = []
    for e, name, unit, meaning, low, high in rows:
        value = fit.asked[0][e, name]
        end = min(_held(name, limits), high, SHOWN.get(name, (name, high))[1])
        found.append(
            Parameter(
                name=name,
                label=SHOWN.get(name, (name,))[0],
                value=value,
                given=fit.given[0][e, name],
                unit=unit,
                minimum=min(low if math.isfinite(low) else 0.0, value),
                maximum=max(end if math.isfinite(end) else 2.0 * abs(value) + 1.0, value),
                meaning=meaning,
                applies=name not in _NEEDS or _NEEDS[name](swatch),
                note=notes.get(name, ""),
            )
        )
    return tuple(found)


def _held(name: str, limits: Limits) -> float:
    """Limit of the device for a parameter. Springs and dampers of effects have the limits of the wall."""
    if name.endswith("stiffness_N_m"):
        return limits.stiffness_N_m
    return limits.damping_Ns_m if name.endswith("damping_Ns_m") else math.inf


def tuned(swatch: Swatch, numbers: Mapping[str, float], effects: list[Effect]) -> Swatch:
    """The swatch with new values of parameters, given by name.

    If only one of the two friction coefficients is given, the other is adjusted so that dynamic friction does not
    exceed static friction. Measured intervals of changed parameters are dropped.

    Raises:
        EffectError: a parameter is unknown, or its value is out of range.
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
            raise EffectError(
                f"swatch {swatch.name!r}: {name} = {value:g} is out of range: expected {low:g} to {high:g}"
            )
        if name in OWN_PARAMETERS:
            own[name] = float(value)
            for values in by_effect.values():
                values.pop(name, None)  # a value stored for an effect would override the swatch's
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
    changed = {name for name, value in own.items() if value != getattr(swatch, name)}
    fields: dict[str, Any] = dict(own)
    return replace(
        swatch,
        **fields,
        effects={effect: values for effect, values in by_effect.items() if values},
        intervals={name: pair for name, pair in swatch.intervals.items() if name not in changed},
        absent={name: reason for name, reason in swatch.absent.items() if name not in changed},
    )


FIXED: Final = (
    "the swatch 'plain' cannot be changed, since it is the default of unpainted faces: tune a copy of it instead"
)


class SwatchTuning:
    """Edits the swatches of a painting.

    Args:
        painting: the painted scene.
        device: device whose limits apply to the parameters.

    Attributes:
        device, limits: name and limits of the device; see `choose_device`.

    Raises:
        HapsceneError: the device is unknown.
    """

    def __init__(self, painting: Painting, device: DeviceLike = "omni") -> None:
        self._painting = painting
        self.choose_device(device)
        self._effects: list[Effect] | None = None

    def choose_device(self, device: DeviceLike) -> None:
        """Choose the device whose limits apply to the parameters.

        Raises:
            HapsceneError: the device is unknown.
        """
        self.limits = limits_of(device, TICK_S)
        self.device = device_of(device).name

    def add_swatch(self, swatch: SwatchLike, with_next: bool = False) -> int:
        """Add a swatch to the scene unless it is there; returns its index.

        Args:
            swatch: name of a library swatch, a file, or a swatch.
            with_next: make the addition a part of the next step, if that step paints with the swatch.

        Raises:
            SwatchError: the swatch is unknown or damaged.
            SceneError: the scene has a different swatch of that name.
        """
        with self._painting.lock:
            self._painting.end_step()
            scene, known = self._painting.scene, len(self._painting.swatches)
            index = scene.swatch_index(swatch)
            if index == known:
                new = SwatchState(scene.swatches[index], scene.swatch_source[index])
                key = ("add", index) if with_next else None
                self._painting.change(f"add swatch {new.swatch.name!r}", [SwatchDelta(index, None, new)], key=key)
            return index

    def copy_swatch(self, swatch: int | str, name: str) -> int:
        """Copy a swatch under a new name and with a distinct colour; returns the index of the copy.

        Raises:
            SwatchError: the name is invalid.
            SceneError: another swatch of the scene has that name.
        """
        with self._painting.lock:
            self._check_free(name, None)
            index = len(self._painting.swatches)
            copied = replace(self._painting.swatches[self._painting.swatch_index(swatch)].swatch, name=name)
            colour = distinct_colours([*self._painting.scene.swatches, copied], range(index + 1))[index]
            copied = replace(copied, albedo_rgb=tuple(rgb(colour).tolist()))
            self._painting.change(f"new swatch {name!r}", [SwatchDelta(index, None, SwatchState(copied, None))])
            return index

    def parameters(self, swatch: int | str) -> tuple[Parameter, ...]:
        """Parameters of a swatch that can be tuned, with units and the limits of the device."""
        now = self._painting.scene.swatches[self._painting.swatch_index(swatch)]
        found = parameters_of(now, self._effect_list(), self.limits)
        return tuple(replace(p, applies=False, note=FIXED) for p in found) if now is PLAIN else found

    def tune(self, swatch: int | str, **numbers: float) -> Swatch:
        """Change parameters of a swatch; returns the new swatch. Changes within a second are joined into one step.

        Raises:
            EffectError: a parameter is unknown, or its value is out of range.
            SceneError: the swatch is plain, which cannot be changed.
        """
        with self._painting.lock:
            index = self._tunable(swatch)
            old = self._painting.swatches[index]
            new = tuned(old.swatch, numbers, self._effect_list())
            if new != old.swatch:
                what = f"{', '.join(SHOWN.get(name, (name,))[0] for name in numbers)} of {new.name!r}"
                delta = SwatchDelta(index, old, SwatchState(new, None))
                self._painting.change(what, [delta], key=("tune", index, *sorted(numbers)))
            return new

    def save_swatch_as(self, swatch: int | str, name: str) -> Path:
        """Save a swatch to the user's library under a new name and rename it in the scene; returns the file.

        Undo restores the old name in the scene and keeps the file.

        Raises:
            SwatchError: the name is invalid or taken, or the file cannot be written.
            SceneError: another swatch of the scene has that name, or the swatch is plain.
        """
        with self._painting.lock:
            self._painting.end_step()
            index = self._tunable(swatch)
            old = self._painting.swatches[index]
            self._check_free(name, index)
            named = replace(old.swatch, name=name)
            file = library_folder() / add(named).file
            what = f"save {old.swatch.name!r} as {name!r}"
            self._painting.change(what, [SwatchDelta(index, old, SwatchState(named, file.resolve()))])
            return file

    def _tunable(self, swatch: int | str) -> int:
        index = self._painting.swatch_index(swatch)
        if self._painting.swatches[index].swatch is PLAIN:
            raise SceneError(FIXED)
        return index

    def _check_free(self, name: str, index: int | None) -> None:
        if self._painting.swatch_named(name) not in (None, index):
            raise SceneError(f"the scene already has a swatch {name!r}: choose another name")

    def _effect_list(self) -> list[Effect]:
        if self._effects is None:
            from hapscene.render.renderer import EFFECTS
            from hapscene.surface.effect import load_effect

            self._effects = [load_effect(name) for name in EFFECTS]
        return self._effects
