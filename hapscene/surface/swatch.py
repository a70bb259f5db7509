"""The haptographic swatch: parameters of how one surface feels."""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from hapscene.constants import DAMPING_NS_M, NUMBER_MAX, STIFFNESS_N_M
from hapscene.errors import SwatchError
from hapscene.io.files import short
from hapscene.surface.look import Look
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture

__all__ = [
    "BASIC_PARAMETERS",
    "FRICTION_MAX",
    "NAME_MAX",
    "OWN_PARAMETERS",
    "PLAIN",
    "TOOL_FIELDS",
    "Swatch",
    "SwatchLike",
    "tip_radius_of",
    "touched_with",
]

FRICTION_MAX: Final = 5.0
"""Largest friction coefficient [1]. Rubber on rubber is about 2; a larger value indicates a wrong unit."""

NAME_MAX: Final = 200
"""Longest name [characters]."""

BASIC_PARAMETERS: Final = ("stiffness_N_m", "damping_Ns_m", "friction_static", "friction_dynamic")
"""Parameters that every surface has, also in formats of other programs."""

OWN_PARAMETERS: Final = (
    *BASIC_PARAMETERS,
    *("hunt_crossley_Ns_m2", "friction_stribeck_m_s", "friction_viscous_s_m"),
    *("breakaway_1_kg", "breakaway_Hz", "breakaway_decay_1_s", "adhesion_N", "adhesion_range_m"),
)
"""Parameters of a swatch that effects use if the swatch has none for the effect by name."""


TOOL_FIELDS: Final = ("tool", "tip")
"""Fields that describe the tool of a recording. The tool affects the recording as much as the surface does."""


def touched_with(known: object) -> str:
    """Return tool and tip of a swatch or library entry, as "steel probe, 3.2 mm ball"; "" if neither is known."""
    return ", ".join(filter(None, (getattr(known, what) for what in TOOL_FIELDS)))


def tip_radius_of(known: object) -> float | None:
    """Return half the diameter of the tip in a text such as "3.2 mm ball" [m]; None if the text states no ball."""
    found = re.match(r"(\d+\.?\d*) ?mm ball", getattr(known, "tip", "") or "")
    return 0.5e-3 * float(found[1]) if found and float(found[1]) > 0.0 else None


@dataclass(frozen=True)
class Swatch:
    """Parameters of how a surface feels.

    Attributes:
        name: name of the surface, such as "oak".
        stiffness_N_m: normal force over penetration depth, ≥ 0.
        damping_Ns_m: normal force over approach speed, ≥ 0.
        friction_static: static Coulomb coefficient, friction_dynamic ≤ friction_static ≤ 5.
        friction_dynamic: dynamic Coulomb coefficient, ≥ 0.
        hunt_crossley_Ns_m2: damping proportional to depth, per depth, ≥ 0 (Hunt & Crossley 1975).
        friction_stribeck_m_s: Stribeck speed, over which friction falls from static to dynamic; 0 for a step.
        friction_viscous_s_m: growth of the friction coefficient with speed, ≥ 0.
        breakaway_1_kg, breakaway_Hz, breakaway_decay_1_s: vibration when stiction breaks: amplitude per released
            force, frequency and decay rate; disabled if one of them is 0.
        adhesion_N, adhesion_range_m: largest adhesive force on a tool that leaves, and the distance at which it
            occurs; disabled if one of them is 0.
        texture: vibration while sliding, or None.
        taps: vibration on contact, or None.
        leaving: vibration when the tool leaves, over its speed, or None.
        albedo_rgb: colour, three numbers from 0 to 1.
        provenance: source of the parameters, as text.
        licence: licence of the parameters.
        effects: parameters of effects by name, {"effect": {"param": number}}.
        intervals: 95 % confidence interval of a measured parameter by its name, {"friction_dynamic": (low, high)}.
        look: pictures of the surface, or None for its colour alone.
        tool: holder of the tip that the surface was recorded with, such as "steel probe"; "" if unknown.
        tip: tip that the surface was recorded with, such as "3.2 mm ball".
        absent: why a parameter was not measured, by its name, {"stiffness_N_m": "the recording has no depth"}; the
            swatch then holds a default or no value.

    Raises:
        SwatchError: a number is not finite or out of range, or a text is invalid.
    """

    name: str
    stiffness_N_m: float = STIFFNESS_N_M
    damping_Ns_m: float = DAMPING_NS_M
    friction_static: float = 0.0
    friction_dynamic: float = 0.0
    texture: Texture | None = None
    taps: Taps | None = None
    albedo_rgb: tuple[float, float, float] = (0.7, 0.7, 0.7)
    provenance: str = ""
    licence: str = ""
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    absent: Mapping[str, str] = field(default_factory=dict)
    hunt_crossley_Ns_m2: float = 0.0
    friction_stribeck_m_s: float = 0.0
    friction_viscous_s_m: float = 0.0
    breakaway_1_kg: float = 0.0
    breakaway_Hz: float = 0.0
    breakaway_decay_1_s: float = 0.0
    adhesion_N: float = 0.0
    adhesion_range_m: float = 0.0
    leaving: Taps | None = None
    look: Look | None = None
    tool: str = ""
    tip: str = ""

    def __post_init__(self) -> None:
        if not 1 <= len(self.name) <= NAME_MAX or not self.name.isprintable():
            raise SwatchError(f"swatch name must be 1 to {NAME_MAX} printable characters, is {self.name[:50]!r}")
        for part, kind in (("texture", Texture), ("taps", Taps), ("leaving", Taps), ("look", Look)):
            value = getattr(self, part)
            if not isinstance(value, kind | None):
                raise SwatchError(f"swatch {self.name!r}: {part} must be {kind.__name__} or None, is {short(value)}")
        for parameter in OWN_PARAMETERS:
            object.__setattr__(self, parameter, self._checked(parameter, getattr(self, parameter)))
        if not self.friction_dynamic <= self.friction_static <= FRICTION_MAX:
            raise SwatchError(
                f"swatch {self.name!r}: friction must be dynamic ≤ static ≤ {FRICTION_MAX:g}, "
                f"is {self.friction_dynamic:g} and {self.friction_static:g}"
            )
        colour = tuple(self._checked("albedo_rgb", c) for c in self.albedo_rgb)
        if len(colour) != 3 or max(colour) > 1.0:
            raise SwatchError(f"swatch {self.name!r}: albedo_rgb must be three numbers from 0 to 1, is {colour}")
        object.__setattr__(self, "albedo_rgb", colour)
        effects = {effect: dict(numbers) for effect, numbers in self.effects.items()}
        for effect, numbers in effects.items():
            for param, value in numbers.items():
                if not math.isfinite(value):
                    raise SwatchError(f"swatch {self.name!r}: effects.{effect}.{param} must be finite, is {value}")
                numbers[param] = float(value)
        object.__setattr__(self, "effects", effects)
        self._check_measured()
        self._check_texts()

    def __repr__(self) -> str:
        parts = [f"{self.stiffness_N_m:g} N/m", f"friction {self.friction_static:g}/{self.friction_dynamic:g}"]
        if self.texture is not None:
            parts.append(f"texture of order {self.texture.order} at {self.texture.rate_Hz:g} Hz")
        if self.taps is not None:
            parts.append(f"taps at {len(self.taps.approach_m_s)} speeds")
        return f"<Swatch {self.name!r}: {', '.join(parts)}>"

    def _check_measured(self) -> None:
        """Check intervals and reasons, and store copies."""
        intervals = {name: tuple(map(float, pair)) for name, pair in self.intervals.items()}
        for name, pair in intervals.items():
            if len(pair) != 2 or not (math.isfinite(pair[0]) and math.isfinite(pair[1]) and pair[0] <= pair[1]):
                raise SwatchError(f"swatch {self.name!r}: intervals.{name} must be two numbers, low ≤ high, is {pair}")
        object.__setattr__(self, "intervals", intervals)
        object.__setattr__(self, "absent", dict(self.absent))

    def _check_texts(self) -> None:
        """Check that texts can be written as UTF-8: JSON can contain a lone surrogate, which UTF-8 cannot."""
        for what in TOOL_FIELDS:
            value = getattr(self, what)
            if not isinstance(value, str) or len(value) > NAME_MAX or not value.isprintable():
                raise SwatchError(
                    f"swatch {self.name!r}: {what} must be at most {NAME_MAX} printable characters, is {short(value)}"
                )
        texts = {
            "provenance": (self.provenance,),
            "licence": (self.licence,),
            "effects": (*self.effects, *(param for numbers in self.effects.values() for param in numbers)),
            "intervals": tuple(self.intervals),
            "absent": (*self.absent, *self.absent.values()),
        }
        for what, found in texts.items():
            for text in found:
                try:
                    text.encode()
                except UnicodeEncodeError as error:
                    raise SwatchError(
                        f"swatch {self.name!r}: {what} contains {text[error.start]!r}, which is not a valid character: "
                        "remove it"
                    ) from None

    @property
    def own_numbers(self) -> dict[str, float]:
        """Parameters of the swatch by name: those of every surface, and others that are not 0."""
        found = {name: float(getattr(self, name)) for name in OWN_PARAMETERS}
        return {name: value for name, value in found.items() if value != 0.0 or name in BASIC_PARAMETERS}

    def parameter(self, effect: str, param: str, default: float) -> float:
        """Return the value of parameter `param` for the effect named `effect`.

        It is `effects[effect][param]`; otherwise the swatch's own value for `OWN_PARAMETERS`; otherwise `default`.
        """
        numbers = self.effects.get(effect, {})
        if param in numbers:
            return numbers[param]
        return float(getattr(self, param)) if param in OWN_PARAMETERS else default

    def _checked(self, what: str, value: float) -> float:
        if not 0.0 <= value <= NUMBER_MAX:  # also true for NaN
            raise SwatchError(f"swatch {self.name!r}: {what} must be from 0 to {NUMBER_MAX:g}, is {value:g}")
        return float(value)

    def __hash__(self) -> int:
        return hash(self.name)


PLAIN: Final = Swatch("plain")
"""Swatch of bodies that are not painted: stiff, without friction, texture or taps."""


SwatchLike = Swatch | str | os.PathLike[str]
"""A swatch, its name, or the path of its file."""
