"""All swatches to paint with: those of the scene, of the user's library, and the shipped ones."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Final, Literal

from hapscene.errors import SwatchError
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch, touched_with
from hapscene.swatches import library
from hapscene.swatches.library import LibraryEntry, entry_of, load_swatch
from hapscene.swatches.words import Phrase, phrases

__all__ = ["SORTS", "Card", "all_cards", "matching", "ordered", "scene_cards"]

Place = Literal["scene", "yours", "shipped", "computed"]

SORTS: Final = ("place", "name", "roughness", "loudness")
"""What cards are sorted by: place is as `all_cards` gives them; roughness and loudness (of taps) from the least."""

GREY: Final = (0.7, 0.7, 0.7)
"""Colour of a swatch that cannot be loaded."""


@dataclass(frozen=True, eq=False)
class Card:
    """A swatch to paint with.

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


def all_cards(scene: Scene) -> list[Card]:
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


def ordered(cards: Iterable[Card], by: str) -> list[Card]:
    """Cards sorted by one of `SORTS`."""
    if by == "place":
        return list(cards)
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
