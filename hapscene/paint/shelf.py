"""The shelf: every swatch to paint with, those of the scene first, then the user's library, then the shipped ones."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, Literal

from hapscene.errors import SwatchError
from hapscene.paint.word import Phrase, phrases
from hapscene.scene.scene import Scene
from hapscene.surface.library import Entry, entry_of, library_folder, own_entries, shipped_entries
from hapscene.surface.library_search import search
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import load_swatch

Place = Literal["scene", "yours", "shipped"]

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
    """

    entry: Entry
    place: Place
    index: int | None
    source: Swatch | str | Path

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
        return self.source if isinstance(self.source, Swatch) else load_swatch(self.source)

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
    taken = {card.name for card in cards}
    home = library_folder()
    own = [entry for entry in own_entries() if entry.name not in taken]
    cards += [Card(entry, "yours", None, home / entry.file) for entry in own]
    cards += [Card(entry, "shipped", None, entry.name) for entry in _shipped() if entry.name not in taken]
    return cards


def matching(cards: Iterable[Card], text: str) -> list[Card]:
    """The cards that meet all words and bounds of a search: "wood", "grippy", "friction<0.3", "loud stiffness>=500".

    Raises:
        SwatchError: a malformed bound, or one on an unknown figure.
    """
    every = list(cards)
    text = re.sub(r"\s*([<>]=?)\s*", r"\1", text)
    words = [term for term in text.split() if not set(term) & set("<>")]
    bounds = [term for term in text.split() if set(term) & set("<>")]
    held = {id(entry) for entry in search([card.entry for card in every], bounds)}
    return [card for card in every if id(card.entry) in held and all(_has(card, w.casefold()) for w in words)]


def _has(card: Card, word: str) -> bool:
    """Whether a word is in the name, begins one of what it feels like, or is one of where it comes from."""
    try:
        said = [phrase.word for phrase in card.phrases]
    except SwatchError:
        said = card.entry.words
    if word in card.name.casefold() or any(token.startswith(word) for token in _tokens(*said)):
        return True
    return word in _tokens(card.entry.provenance, card.entry.licence)


def _tokens(*texts: str) -> list[str]:
    return re.findall(r"\w+", " ".join(texts).casefold())


_known: list[Entry] = []


def _shipped() -> list[Entry]:
    """The shipped ones, read once: they do not change."""
    if not _known:
        _known.extend(shipped_entries())
    return _known
