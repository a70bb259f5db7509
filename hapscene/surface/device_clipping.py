"""A swatch's numbers as a device can take them: what was asked, what is given, and where the two differ."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.model import Limits
from hapscene.errors import EffectError, no_such
from hapscene.surface.effect import Effect, check_range

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene
    from hapscene.surface.swatch import Swatch
    from hapscene.surface.texture import Texture

__all__ = ["STIFFNESS", "WALL", "Clip", "Fit", "Numbers", "clip_to_device", "clips", "share_of"]


STIFFNESS: Final = "stiffness_N_m"
DAMPING: Final = "damping_Ns_m"
HUNT_CROSSLEY: Final = "hunt_crossley_Ns_m2"
VISCOUS: Final = "friction_viscous_s_m"
ADHESION: Final = "adhesion_N"
ADHESION_RANGE: Final = "adhesion_range_m"

UNITS: Final = {HUNT_CROSSLEY: "N·s/m²", VISCOUS: "s/m", ADHESION: "N", ADHESION_RANGE: "m"}
"""Of numbers whose name does not end in `STIFFNESS` or `DAMPING`."""

WALL: Final = -1
"""Stands for the swatch itself where effects stand by their index: it has the stiffness that all press with."""

Numbers = dict[tuple[int, str], float]
"""Numbers of one swatch by effect (`WALL`, or its index) and name."""


@dataclass(frozen=True)
class Clip:
    """A number of a swatch, or of an effect of the scene, that the device does not take.

    Attributes:
        swatch: its name.
        number: its name, with the unit at its end.
        asked: what the swatch has.
        given: what it is rendered with.
        device: what messages call the device.
        rate_Hz: of the tick.
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
        """Whether it is felt as another surface, and so worth a warning: what keeps a spring at rest is not."""
        if self.number in UNITS:
            return self.given != self.asked
        return self.number in (STIFFNESS, DAMPING) and self.given < self.asked

    def __str__(self) -> str:
        unit = UNITS.get(self.number, "N·s/m" if self.number.endswith(DAMPING) else "N/m")
        rate = f"{self.rate_Hz / 1000.0:g} kHz"
        if self.given > self.asked:
            needs = f"{self.number} of {self.asked:.3g} {unit} is too little for the {self.device} at {rate}"
            return f"{self.whose} {self.swatch!r}: {needs}: rendered with {self.given:.3g} {unit}"
        what = "" if self.number == STIFFNESS else f"{self.number} of "
        holds = f"is more than the {self.device} holds at {rate} ({_figure(self.given)} {unit})"
        return (
            f"{self.whose} {self.swatch!r}: {what}{_figure(self.asked)} {unit} {holds}: "
            f"rendered at {_figure(self.given)} {unit}"
        )


def _figure(value: float) -> str:
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def clip_to_device(limits: Limits, effects: Sequence[Effect], asked: Mapping[tuple[int, str], float]) -> Numbers:
    """What a device takes of a swatch's numbers.

    A spring beyond what the device holds undamped is given the damping that it needs there: the wall by any effect's
    `damping_Ns_m`, an effect's own `…_stiffness_N_m` by its `…_damping_Ns_m`. Where nothing damps it, it is softer.
    Damping goes as far as the device holds it: also that which grows with depth, as deep as the device can be pressed,
    and that of friction, under as much force as it has. Adhesion is made weaker and wider alike, until it is as soft
    as what the device holds undamped: tearing it off takes the same work.
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
        self.given = [clip_to_device(limits, effects, numbers) for numbers in self.asked]

    def tune(self, swatch: int, changes: Mapping[str, float]) -> None:
        """Ask for other numbers: stiffness, or parameters of effects by name.

        Raises:
            EffectError: a name that nothing has, or a value outside its limits. Then nothing is changed.
        """
        self.asked[swatch] = changed(self._effects, self.asked[swatch], changes)
        self.given[swatch] = clip_to_device(self._limits, self._effects, self.asked[swatch])

    def clips(self, swatch: int) -> list[Clip]:
        """Where what a swatch is given is not what it asks for."""
        return clips(self.names[swatch], self.asked[swatch], self.given[swatch], self._limits, self._tick_s)


def clips(
    name: str, asked: Numbers, taken: Numbers, limits: Limits, tick_s: float, whose: str = "swatch"
) -> list[Clip]:
    """Where what somebody is given is not what it asks for."""
    return [
        Clip(name, number, value, taken[effect, number], limits.device, 1.0 / tick_s, whose)
        for (effect, number), value in asked.items()
        if taken[effect, number] != value
    ]


def changed(effects: Sequence[Effect], numbers: Numbers, changes: Mapping[str, float]) -> Numbers:
    """A swatch's numbers with changes to its stiffness, or to parameters of effects by name.

    Raises:
        EffectError: a name that nothing has, or a value outside its limits.
    """
    result = dict(numbers)
    for name, given_value in changes.items():
        try:
            value = float(given_value)
        except (TypeError, ValueError, OverflowError):
            raise EffectError(f"{name} must be a number, is {given_value!r:.40}") from None
        if name == STIFFNESS:
            if not 0.0 <= value < math.inf:
                raise EffectError(f"stiffness_N_m must be finite and not negative, is {value:g} N/m")
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


# How much of a texture the base motors may have, on a device without an actuator in its handle.
#
# Rendered every T to a device of damping b, a lateral grating of wavelength l is passive up to an amplitude of b l/(πT)
# in force, and a height field that is pressed on with N up to b l²/(2π²NT) in height: beyond, its slope is a spring
# stiffer than 2b/T. A texture is no grating, but a stroke at speed v plays it as one, of wavelength v/f with f its
# root-mean-square frequency as the motors have it: block by block, at most 1/(2T). Its force is the mass it is folded
# in by times its acceleration a, its height that by which such a mass moves, a/(2πf)².


SPEED_MIN_M_S: Final = 0.02
"""Slowest stroke that counts [m/s]. A texture is silent at rest, and a stroke that slow has a wavelength of 0.2 mm at
100 Hz; at half of it the motors have a third of what they have now, at twice of it twice as much."""

SPEED_COUNT: Final = 16
"""Speeds that are tried, up to the texture's highest [count]."""

FORCE_SHARES: Final = (0.25, 0.5, 1.0)
"""Normal forces that are tried, over the texture's highest [1]."""

BEYOND: Final = 2.0
"""Up to how many times the highest force and speed a texture is tried whose level goes on beyond them [1]."""

BINS: Final = 512
"""Frequencies of the spectrum [count]."""


@dataclass(frozen=True)
class Share:
    """What motors may have of a texture, and the stroke that limits it.

    Attributes:
        share: of its acceleration [1].
        force_N, slip_m_s, wavelength_m: the stroke.
        amplitude: what all of it would be, and limit: what is passive; in force [N] for a grating, in height [m].
        grating: which of the two limits it.
    """

    share: float
    force_N: float = 0.0
    slip_m_s: float = 0.0
    wavelength_m: float = 0.0
    amplitude: float = 0.0
    limit: float = math.inf
    grating: bool = True

    def message(self, swatch: str, device: str) -> str:
        """The warning."""
        scale, unit = (1e3, "mN") if self.grating else (1e6, "µm")
        return (
            f"swatch {swatch!r}: at {self.slip_m_s:.2g} m/s its texture is {scale * self.amplitude:.3g} {unit} of "
            f"{1e3 * self.wavelength_m:.2g} mm waves, and the motors of the {device} hold {scale * self.limit:.2g} "
            f"{unit}: they get {100.0 * self.share:.2g} % of it; an actuator in the handle takes all"
        )


def share_of(texture: "Texture", mass_kg: float, own_damping_Ns_m: float, tick_s: float) -> Share:
    """The share of a texture that may be folded, by `mass_kg`, into the force of a device."""
    if mass_kg == 0.0 or math.isinf(own_damping_Ns_m):
        return Share(1.0)
    farther = bool(np.any(texture.exponents != 0.0))
    shares = (*FORCE_SHARES, BEYOND) if farther else FORCE_SHARES
    top = (BEYOND if farther else 1.0) * texture.speed_max_m_s
    spread = 0.0 if texture.life is None else texture.life.log_spread
    swell = math.exp(max(0.0, spread - spread**2))  # its slow gain, a standard deviation up
    speed = np.linspace(min(SPEED_MIN_M_S, 0.5 * top), top, SPEED_COUNT)
    worst = Share(1.0)
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
                    worst = Share(limit / amplitude, float(N), float(v), float(l), amplitude, limit, first)
    return worst


def _in_blocks(
    texture: "Texture", force_N: NDArray[np.float64], speed_m_s: NDArray[np.float64], tick_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Root mean square [m/s²] and root-mean-square frequency [Hz], each (n,), of a texture averaged by ticks."""
    bin_Hz = texture.rate_Hz / (2.0 * BINS)
    f = (np.arange(BINS) + 0.5) * bin_Hz
    power = bin_Hz * texture.density(force_N, speed_m_s, frequency_Hz=f) * np.sinc(f * tick_s) ** 2
    heard = np.abs(f - np.round(f * tick_s) / tick_s)
    total = power.sum(axis=1)
    frequency = np.sqrt((power * heard**2).sum(axis=1) / np.where(total > 0.0, total, 1.0))
    return np.sqrt(total), frequency
