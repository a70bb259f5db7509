"""Limits the parameters of swatches to what a device can render stably, and reports where they were changed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import NUMBER_MAX
from hapscene.device.model import Limits
from hapscene.errors import EffectError, no_such
from hapscene.surface.effect import Effect, check_range

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene
    from hapscene.surface.swatch import Swatch
    from hapscene.surface.texture import Texture

__all__ = ["STIFFNESS", "WALL", "Clip", "ClippedSwatches", "Numbers", "clip_to_device", "clips", "share_of"]


STIFFNESS: Final = "stiffness_N_m"
DAMPING: Final = "damping_Ns_m"
HUNT_CROSSLEY: Final = "hunt_crossley_Ns_m2"
VISCOUS: Final = "friction_viscous_s_m"
ADHESION: Final = "adhesion_N"
ADHESION_RANGE: Final = "adhesion_range_m"

UNITS: Final = {HUNT_CROSSLEY: "N·s/m²", VISCOUS: "s/m", ADHESION: "N", ADHESION_RANGE: "m"}
"""Units of parameters whose names do not end in `STIFFNESS` or `DAMPING`."""

WALL: Final = -1
"""Key of the swatch itself where effects are keyed by their index: its stiffness is shared by all effects."""

Numbers = dict[tuple[int, str], float]
"""Parameters of one swatch by effect (`WALL`, or its index) and name."""


@dataclass(frozen=True)
class Clip:
    """A parameter of a swatch, or of an effect of the scene, that was changed to suit the device.

    Attributes:
        swatch: name of the swatch or effect.
        number: name of the parameter, which ends in its unit.
        asked, given: value in the swatch, and value that is rendered.
        device, rate_Hz: name of the device in messages, and tick rate.
        whose: "swatch" or "effect".
    """

    swatch: str
    number: str
    asked: float
    given: float
    device: str
    rate_Hz: float
    whose: str = "swatch"

    @property
    def reported(self) -> bool:
        """Whether the change alters how the surface feels, so that it deserves a warning. Added damping does not."""
        if self.number in UNITS:
            return self.given != self.asked
        return self.number in (STIFFNESS, DAMPING) and self.given < self.asked

    def __str__(self) -> str:
        unit = UNITS.get(self.number, "N·s/m" if self.number.endswith(DAMPING) else "N/m")
        rate = f"{self.rate_Hz / 1000.0:g} kHz"
        if self.given > self.asked:
            low = f"{self.number} of {self.asked:.3g} {unit} is below the minimum of the {self.device} at {rate}"
            return f"{self.whose} {self.swatch!r}: {low}; rendered with {self.given:.3g} {unit}"
        limit = f"{_figure(self.given)} {unit}"
        return (
            f"{self.whose} {self.swatch!r}: {self.number} of {_figure(self.asked)} {unit} exceeds the stable limit of "
            f"the {self.device} at {rate}; rendered with {limit}"
        )


def _figure(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def clip_to_device(limits: Limits, effects: Sequence[Effect], asked: Mapping[tuple[int, str], float]) -> Numbers:
    """Return the parameters of a swatch within the limits of a device.

    - A stiffness above the limit without damping gets the damping that makes it stable (`damping_Ns_m` of any effect
      for the wall, `…_damping_Ns_m` for `…_stiffness_N_m` of an effect), or is reduced without such a parameter.
    - Damping is limited to what the device can render. Damping that grows with depth counts at the largest depth that
      the device can be pressed to, viscous friction at the largest normal force.
    - Adhesion gets weaker and wider, at the same work, until its steepest slope is below the limit without damping.
    """
    numbers = {
        (e, n): min(value, limits.damping_Ns_m) if n.endswith(DAMPING) else value for (e, n), value in asked.items()
    }
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
    held_s = limits.damping_Ns_m / max(limits.force_N, 1e-9) if limits.damping_Ns_m < math.inf else math.inf
    for (effect, name), value in asked.items():
        if name == HUNT_CROSSLEY and held_s < math.inf:
            share = 1.0 - numbers.get((effect, DAMPING), 0.0) / limits.damping_Ns_m if held_s > 0.0 else 0.0
            numbers[effect, name] = min(value, share * held_s * numbers[WALL, STIFFNESS])
        elif name == VISCOUS:
            numbers[effect, name] = min(value, held_s)
        elif name == ADHESION:
            range_m = asked.get((effect, ADHESION_RANGE), 0.0)
            if min(value, range_m, limits.undamped_N_m) == 0.0:
                continue
            wide = max(1.0, math.sqrt(math.e * value / (range_m * limits.undamped_N_m)))
            numbers[effect, name], numbers[effect, ADHESION_RANGE] = value / wide, range_m * wide
    return numbers


class ClippedSwatches:
    """The parameters of the swatches of a scene, within the limits of a device.

    Attributes:
        names: names of the swatches.
        asked, given: parameters of each swatch, and those that are rendered.

    Raises:
        EffectError: a parameter is out of range.
    """

    def __init__(self, scene: "Scene", effects: Sequence[Effect], limits: Limits, tick_s: float) -> None:
        self.names = tuple(swatch.name for swatch in scene.swatches)
        self._effects, self._limits, self._tick_s = effects, limits, tick_s
        self.asked = [_asked(swatch, effects) for swatch in scene.swatches]
        self.given = [clip_to_device(limits, effects, numbers) for numbers in self.asked]

    def tune(self, swatch: int, changes: Mapping[str, float]) -> None:
        """Change the stiffness or parameters of effects of a swatch.

        Raises:
            EffectError: a parameter is unknown or out of range. Nothing is changed.
        """
        self.asked[swatch] = changed(self._effects, self.asked[swatch], changes)
        self.given[swatch] = clip_to_device(self._limits, self._effects, self.asked[swatch])

    def clips(self, swatch: int) -> list[Clip]:
        """Return the parameters of a swatch that were changed to suit the device."""
        return clips(self.names[swatch], self.asked[swatch], self.given[swatch], self._limits, self._tick_s)


def clips(
    name: str, asked: Numbers, given: Numbers, limits: Limits, tick_s: float, whose: str = "swatch"
) -> list[Clip]:
    """Return the parameters that were changed to suit a device."""
    return [
        Clip(name, number, value, given[effect, number], limits.device, 1.0 / tick_s, whose)
        for (effect, number), value in asked.items()
        if given[effect, number] != value
    ]


def changed(effects: Sequence[Effect], numbers: Numbers, changes: Mapping[str, float]) -> Numbers:
    """Return the parameters of a swatch with changes to its stiffness or to parameters of effects.

    Raises:
        EffectError: a parameter is unknown or out of range.
    """
    result = dict(numbers)
    for name, given_value in changes.items():
        try:
            value = float(given_value)
        except (TypeError, ValueError, OverflowError):
            raise EffectError(f"{name} must be a number, is {given_value!r:.40}") from None
        if name == STIFFNESS:
            if not 0.0 <= value <= NUMBER_MAX:
                raise EffectError(f"stiffness_N_m must be from 0 to {NUMBER_MAX:g} N/m, is {value:g} N/m")
            result[WALL, name] = value
        holders = [(e, param) for e, effect in enumerate(effects) for param in effect.params if param.name == name]
        if not holders and name != STIFFNESS:
            known = {param.name for effect in effects for param in effect.params} | {STIFFNESS}
            raise EffectError(no_such("parameter", name, known))
        for e, param in holders:
            check_range(effects[e], param, value)
            result[e, name] = value
    return result


def _asked(swatch: "Swatch", effects: Sequence[Effect]) -> Numbers:
    numbers: Numbers = {(WALL, STIFFNESS): swatch.stiffness_N_m}
    for e, effect in enumerate(effects):
        for param in effect.params:
            value = swatch.parameter(effect.name, param.name, param.default)
            check_range(effect, param, value, f"swatch {swatch.name!r}: ")
            numbers[e, param.name] = value
    return numbers


# Share of a texture that motors can render, on a device without an actuator in its handle.
#
# Rendered with period T on a device of damping b, a lateral grating of wavelength l is passive up to a force amplitude
# of b l/(πT), and a height field that is pressed with force N up to a height amplitude of b l²/(2π²NT): beyond it, its
# slope is a spring stiffer than 2b/T. A texture is not a grating, but a stroke at speed v renders it like a grating of
# wavelength v/f, where f is its root-mean-square frequency after averaging over ticks, at most 1/(2T). Its force
# amplitude is the fold mass times its acceleration a; its height amplitude is a/(2πf)², the motion of a mass with that
# acceleration.


SPEED_MIN_M_S: Final = 0.02
"""Slowest stroke that is tested [m/s]. A texture is silent at rest. At this speed 100 Hz has a wavelength of 0.2 mm;
half the speed would reduce the share to a third, twice the speed would double it."""

SPEED_COUNT: Final = 16
"""Number of speeds that are tested, up to the highest of the texture [count]."""

FORCE_SHARES: Final = (0.25, 0.5, 1.0)
"""Tested normal forces, relative to the highest force of the texture [1]."""

BEYOND: Final = 2.0
"""Largest tested force and speed, relative to the highest of the texture, if its level grows beyond them [1]."""

BINS: Final = 512
"""Number of frequencies of the spectrum [count]."""


@dataclass(frozen=True)
class TextureShare:
    """Share of a texture that motors can render, and the stroke that limits it.

    Attributes:
        share: share of its acceleration [1].
        force_N, slip_m_s, wavelength_m: the limiting stroke.
        amplitude: amplitude of the whole texture, as a force [N] if `grating` is true, otherwise as a height [m].
        limit: largest passive amplitude, in the same unit.
        grating: whether the passivity limit of a grating applies, otherwise that of a height field.
    """

    share: float
    force_N: float = 0.0
    slip_m_s: float = 0.0
    wavelength_m: float = 0.0
    amplitude: float = 0.0
    limit: float = math.inf
    grating: bool = True

    def message(self, swatch: str, device: str) -> str:
        """Return the warning about a reduced texture."""
        scale, unit = (1e3, "mN") if self.grating else (1e6, "µm")
        amplitude = f"{scale * self.amplitude:.3g} {unit} at a wavelength of {1e3 * self.wavelength_m:.2g} mm"
        return (
            f"swatch {swatch!r}: at {self.slip_m_s:.2g} m/s its texture has an amplitude of {amplitude}, above the "
            f"passive limit of the {device} ({scale * self.limit:.2g} {unit}): its motors render "
            f"{100.0 * self.share:.2g} % of the texture. An actuator in the handle renders all of it"
        )


def share_of(texture: "Texture", mass_kg: float, own_damping_Ns_m: float, tick_s: float) -> TextureShare:
    """Return the share of a texture that a device can render as a motor force of `mass_kg` times the acceleration."""
    if mass_kg == 0.0 or math.isinf(own_damping_Ns_m):
        return TextureShare(1.0)
    farther = bool(np.any(texture.exponents != 0.0))
    shares = (*FORCE_SHARES, BEYOND) if farther else FORCE_SHARES
    top = (BEYOND if farther else 1.0) * texture.speed_max_m_s
    spread = texture.log_spread
    swell = math.exp(max(0.0, spread - spread**2))  # one standard deviation of the amplitude modulation above the mean
    speed = np.linspace(min(SPEED_MIN_M_S, 0.5 * top), top, SPEED_COUNT)
    worst = TextureShare(1.0)
    for part in shares:
        force = np.full(SPEED_COUNT, part * texture.force_max_N)
        rms_m_s2, frequency_Hz = _in_blocks(texture, force, speed, tick_s)
        for N, v, a, f in zip(force, speed, swell * rms_m_s2, frequency_Hz, strict=True):
            if a == 0.0:
                continue
            l = v / f  # noqa: E741 (the wavelength, as in the formulas)
            grating = math.sqrt(2.0) * mass_kg * a, own_damping_Ns_m * l / (math.pi * tick_s)
            height = (
                math.sqrt(2.0) * a / (2.0 * math.pi * f) ** 2,
                own_damping_Ns_m * l * l / (2.0 * math.pi**2 * N * tick_s),
            )
            for amplitude, limit in (grating, height):
                if limit < worst.share * amplitude:
                    first = (amplitude, limit) == grating
                    worst = TextureShare(limit / amplitude, float(N), float(v), float(l), amplitude, limit, first)
    return worst


def _in_blocks(
    texture: "Texture", force_N: NDArray[np.float64], speed_m_s: NDArray[np.float64], tick_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rms acceleration [m/s²] and rms frequency [Hz], (n,) each, of a texture after averaging over ticks."""
    bin_Hz = texture.rate_Hz / (2.0 * BINS)
    f = (np.arange(BINS) + 0.5) * bin_Hz
    power = bin_Hz * texture.density(force_N, speed_m_s, frequency_Hz=f) * np.sinc(f * tick_s) ** 2
    aliased = np.abs(f - np.round(f * tick_s) / tick_s)
    total = power.sum(axis=1)
    frequency = np.sqrt((power * aliased**2).sum(axis=1) / np.where(total > 0.0, total, 1.0))
    return np.sqrt(total), frequency
