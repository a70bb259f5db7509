"""Cards: swatches that the painter offers, from the scene, the user's library and the shipped libraries."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Final, Literal

from hapscene.errors import SwatchError
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import Phrase, phrases
from hapscene.swatches import library
from hapscene.swatches.library import LibraryEntry, entry_of, load_swatch

__all__ = ["Card", "all_cards", "matching", "scene_cards"]

Place = Literal["scene", "yours", "shipped", "computed"]

GREY: Final = (0.7, 0.7, 0.7)
"""Colour shown for a swatch that cannot be loaded."""


@dataclass(frozen=True, eq=False)
class Card:
    """A swatch that the painter offers.

    Attributes:
        entry: metadata that is read without loading the swatch: name, provenance, licence, figures.
        place: where the swatch comes from.
        index: index in the scene; None if the scene does not use the swatch.
        source: argument for `Session.add_swatch`.
    """

    entry: LibraryEntry
    place: Place
    index: int | None
    source: Swatch | str | Path

    @property
    def name(self) -> str:
        """Name of the swatch."""
        return self.entry.name

    @cached_property
    def swatch(self) -> Swatch:
        """The swatch, loaded on first use.

        Raises:
            SwatchError: the file is missing or damaged.
        """
        return self.source if isinstance(self.source, Swatch) else _loaded(self.source, self.entry.sha256)

    @property
    def phrases(self) -> tuple[Phrase, ...]:
        """Words and figures that describe how the swatch feels."""
        return phrases(self.swatch)

    @property
    def words(self) -> Iterable[str]:
        """Words of the phrases; those of the entry if the swatch cannot be loaded."""
        try:
            return [phrase.word for phrase in self.phrases]
        except SwatchError:
            return self.entry.words

    @property
    def albedo_rgb(self) -> tuple[float, float, float]:
        """Colour, each channel 0 to 1; `GREY` if the swatch cannot be loaded."""
        try:
            return self.swatch.albedo_rgb
        except SwatchError:
            return GREY


def scene_cards(scene: Scene) -> list[Card]:
    """Cards of the swatches in a scene."""
    return [Card(entry_of(swatch, b""), "scene", index, swatch) for index, swatch in enumerate(scene.swatches)]


def all_cards(scene: Scene) -> list[Card]:
    """Cards of the scene, the user's library, the shipped and the computed swatches.

    Names are unique: a swatch of the scene, which may have been tuned, hides library swatches of the same name.

    Raises:
        SwatchError: the index of the library is damaged.
    """
    cards = scene_cards(scene)
    mine = {
        entry.name: (home, entry) for home in reversed(library.own_folders()) for entry in library.own_entries(home)
    }
    computed = {entry.name: entry for entry in library.computed_entries()}
    for i, card in enumerate(cards):
        if card.name in mine:
            cards[i] = replace(card, entry=replace(card.entry, tags=mine[card.name][1].tags))
        elif card.name in computed and card.entry.provenance == computed[card.name].provenance:
            cards[i] = replace(card, entry=replace(card.entry, tags=computed[card.name].tags))
    taken = {card.name for card in cards}
    own = [(home, mine[name][1]) for name, (home, _) in sorted(mine.items()) if name not in taken]
    cards += [Card(entry, "yours", None, home / entry.file) for home, entry in own]
    taken |= set(mine)
    cards += [Card(entry, "shipped", None, entry.name) for entry in _shipped() if entry.name not in taken]
    return cards + [Card(entry, "computed", None, name) for name, entry in computed.items() if name not in taken]


@lru_cache(maxsize=1024)
def _loaded(source: str | Path, sha256: str) -> Swatch:
    """The swatch in a file, cached until the content of the file changes."""
    return load_swatch(source)


def matching(cards: Sequence[Card], text: str) -> list[Card]:
    """The cards that match every term of a search, such as "wood", "friction<0.3" or "loud stiffness>=500".

    See `hapscene.swatches.library.search`; place and phrases of a swatch are found like tags.

    Raises:
        SwatchError: a bound is malformed or names an unknown figure.
    """
    terms = re.sub(r"\s*([<>]=?)\s*", r"\1", text).split()
    if not terms:  # the phrases of all cards take longer: each swatch is loaded
        return list(cards)
    entries = [replace(card.entry, tags=(*card.entry.tags, card.place, *card.words)) for card in cards]
    found = {entry.name for entry in library.search(entries, terms)}  # the names of cards are unique
    return [card for card in cards if card.name in found]


@cache
def _shipped() -> tuple[LibraryEntry, ...]:
    """Entries of the shipped library, read once."""
    return tuple(library.shipped_entries())
