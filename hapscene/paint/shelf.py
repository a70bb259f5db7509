"""The shelf: every swatch to paint with: the scene's first, the user's library's, the shipped, the computed ones."""

import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.fit.synthesis import synthesize
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.errors import SwatchError
from hapscene.scene.scene import Scene
from hapscene.surface import library
from hapscene.surface.library import LibraryEntry, entry_of, load_swatch
from hapscene.surface.swatch import Swatch, touched_with
from hapscene.surface.swatch_summary import FORCE_N, SPEED_M_S, TAP_M_S, figures, words
from hapscene.view.sound import FADE_S, PEAK_DBFS

# A swatch in words, each with the figure that it stands for: what a designer reads on its card.


LOUDNESS: Final = ((1.5, "faint"), (4.0, "soft"), (12.0, "clear"), (np.inf, "loud"))
"""Taps by their amplitude at 0.1 m/s [m/s²]: steps of 9 dB, three to four of those that are surely told apart (2 to 3
dB, Israr et al. 2006); under the first a tap is hardly more than ten times what can be felt (about 0.1 m/s²)."""

PITCH: Final = ((42.0, "dull"), (173.0, "knocking"), (np.inf, "ringing"))
"""Taps by their frequency [Hz]: the bounds lie half way, in octaves, between the rubber (18 Hz), wood (100 Hz) and
aluminium (300 Hz) of Okamura, Cutkosky & Dennerlein 2001."""


class Phrase(NamedTuple):
    """One thing that is said of a swatch.

    Attributes:
        quality: what it is about: "hardness", "texture", "friction", "taps".
        word: "firm".
        figure: with its unit: "650 N/m".
    """

    quality: str
    word: str
    figure: str


def phrases(swatch: Swatch) -> tuple[Phrase, ...]:
    """Hardness, texture, friction and taps of a swatch, as it is tuned."""
    found = figures(swatch)
    (hard,) = words({"stiffness_N_m": swatch.stiffness_N_m})
    (slick,) = words({"friction_dynamic": swatch.friction_dynamic})
    said = [
        Phrase("hardness", hard, f"{swatch.stiffness_N_m:.3g} N/m"),
        _texture(swatch, found),
        Phrase("friction", slick, f"µ {swatch.friction_dynamic:.2g}, {swatch.friction_static:.2g} at rest"),
        _taps(swatch, found),
    ]
    return tuple(said)


def _texture(swatch: Swatch, found: dict[str, float]) -> Phrase:
    texture = swatch.texture
    gain = swatch.parameter("lpc_texture", "texture_gain", 1.0)
    if texture is None or gain == 0.0:
        return Phrase("texture", "silent", "no texture" if texture is None else "texture gain 0")
    roughness = gain * found["roughness_m_s2"]
    (word,) = words({"roughness_m_s2": roughness})
    force_N, speed_m_s = min(FORCE_N, texture.force_max_N), min(SPEED_M_S, texture.speed_max_m_s)
    return Phrase("texture", word, f"{roughness:.2g} m/s² at {force_N:.2g} N, {speed_m_s:.2g} m/s")


def _taps(swatch: Swatch, found: dict[str, float]) -> Phrase:
    gain = swatch.parameter("tap", "tap_gain", 1.0)
    if swatch.taps is None or gain == 0.0:
        return Phrase("taps", "no taps", "none" if swatch.taps is None else "tap gain 0")
    amplitude, frequency = gain * found["tap_m_s2"], found["tap_Hz"]
    word = f"{_step(LOUDNESS, amplitude)} {_step(PITCH, frequency)} taps"
    return Phrase("taps", word, f"{amplitude:.2g} m/s², {frequency:.3g} Hz at {TAP_M_S:g} m/s")


def _step(steps: tuple[tuple[float, str], ...], value: float) -> str:
    return next(word for bound, word in steps if value < bound)


Place = Literal["scene", "yours", "shipped", "computed"]

SORTS: Final = ("place", "name", "recently used", "roughness", "loudness")
"""What cards are sorted by: place is as `shelf` gives them; roughness and loudness (of taps) from the least."""

GREY: Final = (0.7, 0.7, 0.7)
"""Colour of a swatch that cannot be loaded."""


@dataclass(frozen=True, eq=False)
class Card:
    """A swatch on the shelf.

    Attributes:
        entry: what is known of it without loading it: name, provenance, licence, figures.
        place: where it is from.
        index: in the scene; None where it is not in it.
        source: what `Session.add_swatch` takes.
        own: the library folder of the user's that holds it; None where none does.
        folder: its name within the library; "" for the library itself.
    """

    entry: LibraryEntry
    place: Place
    index: int | None
    source: Swatch | str | Path
    own: Path | None = None
    folder: str = ""

    def __repr__(self) -> str:
        return f"<Card {self.name!r}, {self.place}>"

    @property
    def name(self) -> str:
        """What the surface is called."""
        return self.entry.name

    @cached_property
    def swatch(self) -> Swatch:
        """The swatch itself, loaded when it is asked for.

        Raises:
            SwatchError: its file is gone or broken.
        """
        return self.source if isinstance(self.source, Swatch) else _loaded(self.source, self.entry.sha256)

    @property
    def phrases(self) -> tuple[Phrase, ...]:
        """What it feels like."""
        return phrases(self.swatch)

    @property
    def albedo_rgb(self) -> tuple[float, float, float]:
        """Its colour, 0 to 1 each; grey where it cannot be loaded."""
        try:
            return self.swatch.albedo_rgb
        except SwatchError:
            return GREY


def scene_cards(scene: Scene) -> list[Card]:
    """Those of the scene's swatches."""
    return [Card(entry_of(swatch, b""), "scene", index, swatch) for index, swatch in enumerate(scene.swatches)]


def shelf(scene: Scene) -> list[Card]:
    """All cards. One of the scene hides those of its name in the library: it may be tuned.

    Raises:
        SwatchError: the index of the library is damaged.
    """
    cards = scene_cards(scene)
    homes = library.own_folders()
    mine = {entry.name: (home, entry) for home in reversed(homes) for entry in library.own_entries(home)}
    computed = {entry.name: entry for entry in library.computed_entries()}
    for i, card in enumerate(cards):
        if card.name in computed and card.entry.provenance == computed[card.name].provenance:
            cards[i] = replace(card, entry=replace(card.entry, tags=computed[card.name].tags))
        if card.name in mine:
            home, entry = mine[card.name]
            tagged = replace(card.entry, tags=entry.tags)
            cards[i] = replace(card, entry=tagged, own=home, folder=_folder_of(home, homes[0]))
    taken = {card.name for card in cards}
    own = [(home, entry) for home, entry in mine.values() if entry.name not in taken]
    own.sort(key=lambda pair: (_folder_of(pair[0], homes[0]), pair[1].name))
    cards += [Card(e, "yours", None, home / e.file, home, _folder_of(home, homes[0])) for home, e in own]
    taken |= set(mine)
    cards += [Card(entry, "shipped", None, entry.name) for entry in _shipped() if entry.name not in taken]
    return cards + [Card(entry, "computed", None, name) for name, entry in computed.items() if name not in taken]


def _folder_of(home: Path, root: Path) -> str:
    return "" if home == root else home.name


def ordered(cards: Iterable[Card], by: str, recent: Sequence[str] = ()) -> list[Card]:
    """Cards sorted by one of `SORTS`; `recent` are names, the one used last first."""
    if by == "place":
        return list(cards)
    if by == "recently used":
        place = {name: i for i, name in enumerate(recent)}
        return sorted(cards, key=lambda card: place.get(card.name, len(place)))
    figure = {"roughness": "roughness_m_s2", "loudness": "tap_m_s2"}.get(by)
    if figure is None:
        return sorted(cards, key=lambda card: card.name.casefold())
    return sorted(cards, key=lambda card: (card.entry.figures.get(figure, 0.0), card.name.casefold()))


@lru_cache(maxsize=1024)
def _loaded(source: str | Path, sha256: str) -> Swatch:
    """A swatch's file, read once as long as its content is the same."""
    return load_swatch(source)


def matching(cards: Iterable[Card], text: str) -> list[Card]:
    """The cards that meet all words and bounds of a search: "wood", "grippy", "friction<0.3", "loud stiffness>=500".

    Raises:
        SwatchError: a malformed bound, or one on an unknown figure.
    """
    every = list(cards)
    text = re.sub(r"\s*([<>]=?)\s*", r"\1", text)
    bounds = [term for term in text.split() if set(term) & set("<>") or term.casefold().startswith(("tool:", "tip:"))]
    words = [term for term in text.split() if term not in bounds]
    held = {id(entry) for entry in library.search([card.entry for card in every], bounds)}
    return [card for card in every if id(card.entry) in held and all(_has(card, w.casefold()) for w in words)]


def _has(card: Card, word: str) -> bool:
    """Whether a word is in the name, begins one of what it feels like, or is one of where it comes from."""
    try:
        said = [phrase.word for phrase in card.phrases]
    except SwatchError:
        said = card.entry.words
    if word in card.name.casefold() or any(token.startswith(word) for token in _tokens(*said)):
        return True
    entry = card.entry
    return word in _tokens(touched_with(entry), entry.provenance, entry.licence, card.folder, *entry.tags)


def _tokens(*texts: str) -> list[str]:
    return re.findall(r"\w+", " ".join(texts).casefold())


@cache
def _shipped() -> tuple[LibraryEntry, ...]:
    """The shipped ones, read once: they do not change."""
    return tuple(library.shipped_entries())


# A swatch by ear: tapped once, then stroked at a stated force and speed, as WAV.


STROKE_S: Final = 1.5
"""Length of a stroke unless told otherwise [s]: long enough to tell two textures apart."""

START_S: Final = 0.25
"""From the tap to where the stroke begins [s]: the tap is heard by itself."""

EASE_S: Final = 0.15
"""How long the stroke takes to reach its speed, and to end [s]."""

PAUSE_S: Final = 0.4
"""Between two swatches that are compared [s]."""

FULL_SCALE_M_S2: Final = 20.0
"""Acceleration at full scale [m/s²]: a rough texture (2 m/s² rms) sounds at −20 dBFS, the usual level of speech. The
same for all swatches, so that a smooth one is heard to be quieter; what is louder than full scale is turned down."""


@dataclass(frozen=True, eq=False)
class Sound:
    """An acceleration (n,) [m/s²] at a rate [Hz]."""

    a_m_s2: NDArray[np.float64]
    rate_Hz: float

    def __repr__(self) -> str:
        return f"<Sound: {len(self.a_m_s2) / self.rate_Hz:.3g} s at {self.rate_Hz:g} Hz>"


def swatch_sound(
    swatch: Swatch,
    force_N: float = FORCE_N,
    speed_m_s: float = SPEED_M_S,
    seconds: float = STROKE_S,
    approach_m_s: float = TAP_M_S,
    rate_Hz: float = ACCELERATION_RATE_HZ,
) -> Sound:
    """What a tool's handle does that taps a swatch, then strokes it; with the swatch's own gains.

    Args:
        swatch: as it is tuned.
        force_N: pressed with while it is stroked; clamped to what its texture was made for.
        speed_m_s: stroked at, likewise.
        seconds: how long.
        approach_m_s: tapped at; 0 for no tap.
        rate_Hz: of the samples.
    """
    start, count = round(START_S * rate_Hz), round(seconds * rate_Hz)
    a = np.zeros(start + count)
    if swatch.texture is not None:
        t_s = np.arange(count) / rate_Hz
        ease = np.clip(np.minimum(t_s, seconds - t_s) / EASE_S, 0.0, 1.0)
        slide = 0.5 - 0.5 * np.cos(np.pi * ease)
        gain = swatch.parameter("lpc_texture", "texture_gain", 1.0)
        life = swatch.parameter("lpc_texture", "texture_life", 1.0)
        force, speed = np.full(count, force_N), speed_m_s * slide
        a[start:] += gain * synthesize(swatch, force, speed, rate_Hz=rate_Hz, life=life)
    if swatch.taps is not None and approach_m_s > 0.0:
        tap = swatch.parameter("tap", "tap_gain", 1.0) * swatch.taps.transient(approach_m_s, rate_Hz)
        length = min(len(tap), len(a))
        a[:length] += tap[:length]
    return Sound(a, rate_Hz)


def concatenated(sounds: Sequence[Sound], pause_s: float = PAUSE_S) -> Sound:
    """Sounds of one rate, one after the other."""
    rate_Hz = sounds[0].rate_Hz
    gap = np.zeros(round(pause_s * rate_Hz))
    return Sound(np.concatenate([part for sound in sounds for part in (gap, sound.a_m_s2)][1:]), rate_Hz)


def wav_bytes(sound: Sound) -> bytes:
    """A sound as WAV, mono, 16 bit, its end faded. Silence stays silent."""
    a_m_s2 = sound.a_m_s2.copy()
    ramp = np.linspace(0.0, 1.0, round(FADE_S * sound.rate_Hz), endpoint=False)
    a_m_s2[len(a_m_s2) - len(ramp) :] *= ramp[::-1]
    scale = max(FULL_SCALE_M_S2, float(np.abs(a_m_s2).max(initial=0.0)) / 10 ** (PEAK_DBFS / 20))
    file = io.BytesIO()
    scipy.io.wavfile.write(file, round(sound.rate_Hz), np.rint(a_m_s2 / scale * 32767).astype(np.int16))
    return file.getvalue()
