"""The haptographic swatch: all that is known of how one surface feels."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from hapscene.constants import DAMPING_NS_M, STIFFNESS_N_M
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
    "touched_with",
]

FRICTION_MAX: Final = 5.0
"""Largest friction coefficient [1]. Rubber on rubber is about 2; more is a slip of the unit."""

NAME_MAX: Final = 200
"""Longest name [characters]."""

BASIC_PARAMETERS: Final = ("stiffness_N_m", "damping_Ns_m", "friction_static", "friction_dynamic")
"""The numbers that every surface has, and formats of other programs too."""

OWN_PARAMETERS: Final = (
    *BASIC_PARAMETERS,
    *("hunt_crossley_Ns_m2", "friction_stribeck_m_s", "friction_viscous_s_m"),
    *("breakaway_1_kg", "breakaway_Hz", "breakaway_decay_1_s", "adhesion_N", "adhesion_range_m"),
)
"""The swatch's own numbers, which effects get where the swatch says nothing for them by name."""


TOOL_FIELDS: Final = ("tool", "tip")
"""What is known of what a surface was touched with: as large a difference as that between surfaces."""


def touched_with(known: Any) -> str:
    """Tool and tip of a swatch, or of its entry in a library: "steel probe, 3.2 mm ball"; "" where neither is known."""
    return ", ".join(filter(None, (getattr(known, what) for what in TOOL_FIELDS)))


@dataclass(frozen=True)
class Swatch:
    """How a surface feels.

    Attributes:
        name: what the surface is called, as in "oak".
        stiffness_N_m: force over depth, ≥ 0.
        damping_Ns_m: force over speed into the surface, ≥ 0.
        friction_static: Coulomb coefficient that holds the tool, friction_dynamic ≤ friction_static ≤ 5.
        friction_dynamic: Coulomb coefficient while it slips, ≥ 0.
        hunt_crossley_Ns_m2: damping that grows with the depth, over that depth, ≥ 0 (Hunt & Crossley 1975).
        friction_stribeck_m_s: speed over which friction falls from static to dynamic, 0 at once.
        friction_viscous_s_m: what friction's coefficient grows by with the speed, ≥ 0.
        breakaway_1_kg, breakaway_Hz, breakaway_decay_1_s: vibration when friction breaks loose: its amplitude over the
            force that is set free, its frequency and its decay; silent where one of them is 0.
        adhesion_N, adhesion_range_m: largest pull on a tool that leaves, and the distance at which it pulls so; none
            where one of them is 0.
        texture: vibration while sliding, or None.
        taps: vibration when touched, or None.
        leaving: vibration when the tool leaves, over the speed at which it does, or None.
        albedo_rgb: colour to paint with, three numbers from 0 to 1.
        provenance: where the numbers come from, for a reader.
        licence: what may be done with them.
        effects: parameters for effects by name, {"effect": {"param": number}}.
        intervals: 95 % interval of a measured number by its name, {"friction_dynamic": (low, high)}.
        look: pictures of it, or None for its colour alone.
        tool: what held the tip that the surface was touched with, as in "steel probe"; "" where it is not known.
        tip: what touched it, as in "3.2 mm ball".
        absent: why a number was not measured by its name, {"stiffness_N_m": "the recording holds no depth"}; the
            swatch then has a default, or none.

    Raises:
        SwatchError: a number that is not finite or out of range, a text that cannot be written.
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
            raise SwatchError(f"a swatch's name must be 1 to {NAME_MAX} printable characters, is {self.name[:50]!r}")
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
        """Intervals are pairs in order, reasons are texts."""
        intervals = {name: tuple(map(float, pair)) for name, pair in self.intervals.items()}
        for name, pair in intervals.items():
            if len(pair) != 2 or not (math.isfinite(pair[0]) and math.isfinite(pair[1]) and pair[0] <= pair[1]):
                raise SwatchError(f"swatch {self.name!r}: intervals.{name} must be two numbers, low ≤ high, is {pair}")
        object.__setattr__(self, "intervals", intervals)
        object.__setattr__(self, "absent", dict(self.absent))

    def _check_texts(self) -> None:
        """Texts can be written: half a character (a lone surrogate), which JSON can escape, cannot."""
        for what in TOOL_FIELDS:
            said = getattr(self, what)
            if not isinstance(said, str) or len(said) > NAME_MAX or not said.isprintable():
                raise SwatchError(
                    f"swatch {self.name!r}: {what} must be at most {NAME_MAX} printable characters, is {short(said)}"
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
                        f"swatch {self.name!r}: {what} has half a character, which UTF-8 cannot hold: "
                        f"leave {text[error.start]!r} out"
                    ) from None

    @property
    def own_numbers(self) -> dict[str, float]:
        """Its own numbers by name: those that every surface has, and those beyond them that are not 0."""
        found = {name: float(getattr(self, name)) for name in OWN_PARAMETERS}
        return {name: value for name, value in found.items() if value != 0.0 or name in BASIC_PARAMETERS}

    def parameter(self, effect: str, param: str, default: float) -> float:
        """The number that the effect named `effect` gets for its parameter `param`.

        That of `effects[effect][param]`; else, for `OWN_PARAMETERS`, the swatch's own; else `default`.
        """
        numbers = self.effects.get(effect, {})
        if param in numbers:
            return numbers[param]
        return float(getattr(self, param)) if param in OWN_PARAMETERS else default

    def _checked(self, what: str, value: float) -> float:
        if not (math.isfinite(value) and value >= 0.0):
            raise SwatchError(f"swatch {self.name!r}: {what} must be finite and not negative, is {value}")
        return float(value)

    def __hash__(self) -> int:
        return hash(self.name)


PLAIN: Final = Swatch("plain")
"""The surface of bodies that nothing was painted on: stiff, smooth, silent."""


SwatchLike = Swatch | str | os.PathLike[str]
"""A swatch wherever one is taken: itself, by its name, or by the path of its file."""
