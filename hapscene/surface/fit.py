"""A swatch's numbers as a device can take them: what was asked, what is given, and where the two differ."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from hapscene.device.limit import Limits
from hapscene.errors import EffectError, no_such
from hapscene.surface.effect import Effect, Param

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene
    from hapscene.surface.swatch import Swatch

STIFFNESS: Final = "stiffness_N_m"
DAMPING: Final = "damping_Ns_m"

WALL: Final = -1
"""Stands for the swatch itself where effects stand by their index: it has the stiffness that all press with."""

Numbers = dict[tuple[int, str], float]
"""Numbers of one swatch by effect (`WALL`, or its index) and name."""


@dataclass(frozen=True)
class Clip:
    """A number of a swatch that the device does not take.

    Attributes:
        swatch: its name.
        number: its name, with the unit at its end.
        asked: what the swatch has.
        given: what it is rendered with.
        device: what messages call the device.
        rate_Hz: of the tick.
    """

    swatch: str
    number: str
    asked: float
    given: float
    device: str
    rate_Hz: float

    @property
    def reported(self) -> bool:
        """Whether it is felt as another surface, and so worth a warning: what keeps a spring at rest is not."""
        return self.number in (STIFFNESS, DAMPING) and self.given < self.asked

    def __str__(self) -> str:
        unit = "N·s/m" if self.number.endswith(DAMPING) else "N/m"
        rate = f"{self.rate_Hz / 1000.0:g} kHz"
        if self.given > self.asked:
            needs = f"{self.number} of {self.asked:.3g} {unit} is too little for the {self.device} at {rate}"
            return f"swatch {self.swatch!r}: {needs}: rendered with {self.given:.3g} {unit}"
        what = "" if self.number == STIFFNESS else f"{self.number} of "
        holds = f"is more than the {self.device} holds at {rate} ({_figure(self.given)} {unit})"
        return (
            f"swatch {self.swatch!r}: {what}{_figure(self.asked)} {unit} {holds}: "
            f"rendered at {_figure(self.given)} {unit}"
        )


def _figure(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def given(limits: Limits, effects: Sequence[Effect], asked: Mapping[tuple[int, str], float]) -> Numbers:
    """What a device takes of a swatch's numbers.

    A spring beyond what the device holds undamped is given the damping that it needs there: the wall by any effect's
    `damping_Ns_m`, an effect's own `…_stiffness_N_m` by its `…_damping_Ns_m`. Where nothing damps it, it is softer.
    """
    numbers = dict(asked)
    for (effect, name), value in asked.items():
        if not name.endswith(STIFFNESS):
            continue
        damping = name.removesuffix(STIFFNESS) + DAMPING
        dampers = [key for key in asked if key[1] == damping and effect in (WALL, key[0])]
        stiffness = min(value, limits.stiffness_N_m if dampers else limits.undamped_N_m)
        numbers[effect, name] = stiffness
        least = limits.damping_time_s * max(0.0, stiffness - limits.undamped_N_m)
        for key in dampers:
            most = next(param.maximum for param in effects[key[0]].params if param.name == damping)
            numbers[key] = min(max(asked[key], least), limits.damping_Ns_m, most)
    return numbers


class Fit:
    """The numbers of a scene's swatches, and what a device takes of them.

    Attributes:
        names: of the swatches.
        asked, given: their numbers, a swatch after the other.

    Raises:
        EffectError: a parameter outside its limits.
    """

    def __init__(self, scene: "Scene", effects: Sequence[Effect], limits: Limits, tick_s: float) -> None:
        self.names = tuple(swatch.name for swatch in scene.swatches)
        self._effects, self._limits, self._tick_s = effects, limits, tick_s
        self.asked = [_asked(swatch, effects) for swatch in scene.swatches]
        self.given = [given(limits, effects, numbers) for numbers in self.asked]

    def tune(self, swatch: int, changes: Mapping[str, float]) -> None:
        """Ask for other numbers: stiffness, or parameters of effects by name.

        Raises:
            EffectError: a name that nothing has, or a value outside its limits. Then nothing is changed.
        """
        self.asked[swatch] = changed(self._effects, self.asked[swatch], changes)
        self.given[swatch] = given(self._limits, self._effects, self.asked[swatch])

    def clips(self, swatch: int) -> list[Clip]:
        """Where what a swatch is given is not what it asks for."""
        asked, taken = self.asked[swatch], self.given[swatch]
        return [
            Clip(self.names[swatch], name, value, taken[effect, name], self._limits.device, 1.0 / self._tick_s)
            for (effect, name), value in asked.items()
            if taken[effect, name] != value
        ]


def changed(effects: Sequence[Effect], numbers: Numbers, changes: Mapping[str, float]) -> Numbers:
    """A swatch's numbers with changes to its stiffness, or to parameters of effects by name.

    Raises:
        EffectError: a name that nothing has, or a value outside its limits.
    """
    result = dict(numbers)
    for name, value in changes.items():
        if name == STIFFNESS:
            if not 0.0 <= value < math.inf:
                raise EffectError(f"stiffness_N_m must be finite and not negative, is {value:g} N/m")
            result[WALL, name] = value
        holders = [(e, param) for e, effect in enumerate(effects) for param in effect.params if param.name == name]
        if not holders and name != STIFFNESS:
            known = {param.name for effect in effects for param in effect.params} | {STIFFNESS}
            raise EffectError(no_such("parameter", name, known))
        for e, param in holders:
            _check_range(effects[e], param, value)
            result[e, name] = value
    return result


def _asked(swatch: "Swatch", effects: Sequence[Effect]) -> Numbers:
    numbers: Numbers = {(WALL, STIFFNESS): swatch.stiffness_N_m}
    for e, effect in enumerate(effects):
        for param in effect.params:
            value = swatch.parameter(effect.name, param.name, param.default)
            _check_range(effect, param, value, f"swatch {swatch.name!r}: ")
            numbers[e, param.name] = value
    return numbers


def _check_range(effect: Effect, param: Param, value: float, where: str = "") -> None:
    if not param.minimum <= value <= param.maximum:
        raise EffectError(
            f"{where}{param.name} of effect {effect.name!r} is {value:g} {param.unit}; "
            f"it must lie between {param.minimum:g} and {param.maximum:g}"
        )
