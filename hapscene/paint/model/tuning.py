"""Swatches of a painting: add, copy, tune within the limits of the device, reset, save to the library."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

from hapscene.constants import TICK_S
from hapscene.device.model import DeviceLike, Limits, device_of, limits_of
from hapscene.errors import EffectError, SceneError, SwatchError, no_such
from hapscene.paint.model.history import SwatchDelta, SwatchState
from hapscene.paint.model.painting import Painting
from hapscene.surface.device_clipping import WALL, ClippedSwatches
from hapscene.surface.effect import Effect
from hapscene.surface.swatch import OWN_PARAMETERS, PLAIN, Swatch, SwatchLike
from hapscene.surface.swatch_file import save_swatch
from hapscene.swatches.library import add, find, library_folder
from hapscene.swatches.picture import plain_look
from hapscene.view.palette import distinct_colours, rgb

__all__ = ["Parameter", "SwatchTuning", "parameters_of", "tuned", "write_swatch"]

STIFFNESS: Final = "stiffness_N_m"

SHOWN: Final = {
    "stiffness_N_m": ("stiffness", 3000.0),
    "damping_Ns_m": ("damping", 20.0),
    "friction_static": ("friction, at rest", 2.0),
    "friction_dynamic": ("friction, sliding", 2.0),
    "texture_gain": ("texture gain", 4.0),
    "texture_life": ("texture life", math.inf),
    "tap_gain": ("tap gain", 4.0),
    "tangential_stiffness_N_m": ("stiffness while it sticks", 3000.0),
    "tangential_damping_Ns_m": ("damping while it sticks", 20.0),
    "hunt_crossley_Ns_m2": ("damping, growing with depth", 2000.0),
    "friction_stribeck_m_s": ("speed of falling friction", 0.2),
    "friction_viscous_s_m": ("friction, growing with speed", 2.0),
    "breakaway_1_kg": ("sound of breaking loose", 100.0),
    "breakaway_Hz": ("frequency of breaking loose", 1000.0),
    "breakaway_decay_1_s": ("decay of breaking loose", 500.0),
    "adhesion_N": ("adhesion", 3.0),
    "adhesion_range_m": ("range of adhesion", 0.01),
}
"""Label of each number, and the end of its slider where the device sets no limit: about twice what is called rigid, the
friction of rubber on rubber, 12 dB of gain. A larger number makes the slider longer. Numbers of other effects are shown
by their own names."""

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
    fit = ClippedSwatches(alone, effects, limits, tick_s)
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


FIXED: Final = "'plain' stays as it is, for it is what every face has until it is painted: make a copy of it to tune"

JOIN_S: Final = 1.0
"""How soon a slider must go on to stay in one step of undo [s]."""


class SwatchTuning:
    """The swatches of a painting, and their numbers.

    Args:
        painting: whose swatches.
        device: whose limits the parameters show, by its name or itself.
        tick_s: period of the force channel [s].

    Attributes:
        device, limits: name and limits of the one chosen; see `choose_device`.
        clock: tells what is done within a second, and so is one step [s].

    Raises:
        HapsceneError: no such device.
    """

    def __init__(self, painting: Painting, device: DeviceLike = "omni", tick_s: float = TICK_S) -> None:
        self._painting = painting
        self.tick_s = tick_s
        self.choose_device(device)
        self.clock: Callable[[], float] = time.monotonic
        self._effects: list[Effect] | None = None
        self._tuned_s = -math.inf

    def __repr__(self) -> str:
        names = ", ".join(state.swatch.name for state in self._painting.swatches)
        return f"<SwatchTuning of {names} within the limits of {self.device}>"

    def choose_device(self, device: DeviceLike) -> None:
        """Show the limits of another device from now on.

        Raises:
            HapsceneError: no such device.
        """
        self.limits = limits_of(device, self.tick_s)
        self.device = device_of(device).name

    def add_swatch(self, swatch: SwatchLike) -> int:
        """Put a swatch of the library, a file, or one made here into the scene, unless it is there; its index.

        Raises:
            SwatchError: it is unknown or broken.
            SceneError: another swatch of its name is in the scene.
        """
        with self._painting.lock:
            self._painting.end_step()
            scene, known = self._painting.scene, len(self._painting.swatches)
            index = scene.swatch_index(swatch)
            if index == known:
                new = SwatchState(scene.swatches[index], scene.swatch_source[index])
                self._painting.change(f"add swatch {new.swatch.name!r}", [SwatchDelta(index, None, new)])
            return index

    def copy_swatch(self, swatch: int | str, name: str) -> int:
        """A new swatch of the scene that begins as another one, in a colour of its own while there are any; its index.

        Raises:
            SwatchError: the name is none.
            SceneError: another swatch of the scene has it.
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
        """The numbers of a swatch that can be turned, with units and the limits of the device."""
        now = self._painting.swatches[self._painting.swatch_index(swatch)]
        original = (now.original or now).swatch
        found = parameters_of(now.swatch, original, self._effect_list(), self.limits, self.tick_s)
        return tuple(replace(p, applies=False, note=FIXED) for p in found) if now.swatch is PLAIN else found

    def tune(self, swatch: int | str, **numbers: float) -> Swatch:
        """Change numbers of a swatch; the swatch as it is now. What a slider does within a second is one step.

        Raises:
            EffectError: a name that nothing has, or a value outside its limits.
            SceneError: it is plain, which stays.
        """
        with self._painting.lock:
            index = self._tunable(swatch)
            old = self._painting.swatches[index].swatch
            new = tuned(old, numbers, self._effect_list())
            what = f"{', '.join(SHOWN.get(name, (name,))[0] for name in numbers)} of {old.name!r}"
            return self._alter(index, new, what, ("tune", index, *sorted(numbers)))

    def recolour(self, swatch: int | str, albedo_rgb: tuple[float, float, float]) -> Swatch:
        """Give a swatch another colour; the swatch as it is now. What a picker does within a second is one step.

        Raises:
            SwatchError: it is not three numbers from 0 to 1.
            SceneError: it is plain, which stays.
        """
        with self._painting.lock:
            index = self._tunable(swatch)
            old = self._painting.swatches[index].swatch
            return self._alter(index, replace(old, albedo_rgb=albedo_rgb), f"colour of {old.name!r}", ("colour", index))

    def set_picture(self, swatch: int | str, albedo_png: bytes) -> Swatch:
        """Have a swatch look like a picture, the content of a PNG file, and its colour be the picture's mean.

        Raises:
            SwatchError: it is no picture that a look may have.
            SceneError: it is plain, which stays.
        """
        with self._painting.lock:
            index = self._tunable(swatch)
            old = self._painting.swatches[index].swatch
            look = replace(old.look or plain_look(old), albedo_png=albedo_png)
            pixels = look.albedo()
            if pixels is None:
                raise SwatchError("the picture is damaged")
            red, green, blue = (float(c) for c in pixels.mean(axis=(0, 1)))
            new = replace(old, look=look, albedo_rgb=(red, green, blue))
            return self._alter(index, new, f"picture of {old.name!r}", ("picture", index))

    def _alter(self, index: int, swatch: Swatch, what: str, key: object) -> Swatch:
        """Put a swatch in place of what is there: one step with what was done of the same key within a second."""
        old = self._painting.swatches[index]
        now_s = self.clock()
        join, self._tuned_s = now_s - self._tuned_s <= JOIN_S, now_s
        if swatch != old.swatch:
            new = SwatchState(swatch, None, old.original or old)
            self._painting.change(what, [SwatchDelta(index, old, new)], key=key, join=join)
        return swatch

    def reset(self, swatch: int | str) -> bool:
        """Bring back the numbers and the colour that a swatch had before; whether they were others."""
        with self._painting.lock:
            index = self._painting.swatch_index(swatch)
            old = self._painting.swatches[index]
            if old.original is None:
                return False
            self._painting.change(f"reset {old.swatch.name!r}", [SwatchDelta(index, old, old.original)])
            return True

    def save_swatch_as(self, swatch: int | str, name: str, path: Path | None = None, replace_old: bool = False) -> Path:
        """Save a swatch as it is now under a new name, which it has in the scene from now on; its file.

        Undone, the scene has the old one again; the file stays.

        Args:
            swatch: which.
            name: the new name.
            path: of its file, .swatch; None for the library, where it is on every shelf.
            replace_old: write over a swatch of that name, or that file.

        Raises:
            SwatchError: the name is none, or taken; the file cannot be written.
            SceneError: another swatch of the scene has that name; or it is plain, which stays.
        """
        with self._painting.lock:
            self._painting.end_step()
            index = self._tunable(swatch)
            old = self._painting.swatches[index]
            self._check_free(name, index)
            named = replace(old.swatch, name=name)
            source, file = write_swatch(named, path, replace_old)
            what = f"save {old.swatch.name!r} as {name!r}"
            self._painting.change(what, [SwatchDelta(index, old, SwatchState(named, source))])
            return file

    def let_go_of(self, name: str) -> None:
        """Keep a swatch in the scene's own files from now on: the library's file of it has moved, or is gone."""
        with self._painting.lock:
            index = self._painting.swatch_named(name)
            old = None if index is None else self._painting.swatches[index]
            if index is not None and old is not None and isinstance(old.source, Path):
                self._painting.end_step()
                new = replace(old, source=None)
                self._painting.change(f"keep {name!r} in the scene", [SwatchDelta(index, old, new)])

    def _tunable(self, swatch: int | str) -> int:
        index = self._painting.swatch_index(swatch)
        if self._painting.swatches[index].swatch is PLAIN:
            raise SceneError(FIXED)
        return index

    def _check_free(self, name: str, index: int | None) -> None:
        if self._painting.swatch_named(name) not in (None, index):
            raise SceneError(f"another swatch named {name!r} is in the scene; choose another name")

    def _effect_list(self) -> list[Effect]:
        if self._effects is None:
            from hapscene.render.renderer import EFFECTS
            from hapscene.surface.effect_registry import load_effect

            self._effects = [load_effect(name) for name in EFFECTS]
        return self._effects


def write_swatch(swatch: Swatch, path: Path | None, replace_old: bool) -> tuple[str | Path, Path]:
    """Write a swatch to a file, or (None) into the library; what `Scene.swatch_source` calls it, and its file.

    Raises:
        SwatchError: the name or the file is taken, and not to be replaced; it cannot be written.
    """
    if path is None:
        if find(swatch.name) is not None and not replace_old:
            raise SwatchError(f"{swatch.name!r} is in the library already: choose another name")
        entry = add(swatch, replace=replace_old)
        file = library_folder() / entry.file
        return file.resolve(), file
    if path.exists() and not replace_old:
        raise SwatchError(f"{path}: is there already; save over it, or under another name")
    save_swatch(swatch, path)
    return path.resolve(), path
