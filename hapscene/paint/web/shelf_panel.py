"""The shelf of swatches, and the comparison of two, in the panel."""

import asyncio
from collections.abc import Collection
from dataclasses import replace
from functools import partial
from typing import Any, Final

from hapscene.errors import SwatchError, no_such
from hapscene.paint.shelf import Card, Phrase, Sound, joined, matching, scene_cards, shelf, stroked
from hapscene.paint.web.page_context import PageContext, css, escape_html, set_html

CARD_MAX: Final = 8
"""Most swatches that are shown at once [count]: what a screen holds; the search finds the others."""

USE: Final = "Paint with it"
PLAY: Final = "▶ Play"
COMPARE: Final = "Compare"

NONE: Final = "…"
"""What is chosen to compare before the shelf is known."""

PLACES: Final = {"scene": "in the scene", "yours": "in your library", "shipped": "shipped"}


class ShelfPanel:
    """Cards of swatches: their colour, name, words and numbers; to paint with, to hear, to compare.

    Args:
        parts: the page.
        container: the tab of the shelf.
        compare: the tab of the comparison.
    """

    def __init__(self, parts: PageContext, container: Any, compare: Any) -> None:
        self._parts = parts
        self._cards: list[Card] = []
        self._looked_for: tuple[Any, ...] = ()
        self._found: tuple[str, ...] | None = None
        self._rows: list[tuple[Any, Any]] = []
        gui, on = parts.server.gui, parts.on
        with container, gui.add_folder("Swatches"):
            self._search = gui.add_text("Search", "", hint="A name, a word or a bound: rough, soft, friction<0.3")
            self._search.on_update(on(lambda target: self.show()))
            self._list = gui.add_folder(None)
            self._rest = gui.add_html("")
        with compare:
            self._pair = [gui.add_dropdown(label, (NONE,)) for label in ("Swatch A", "Swatch B")]
            self._play = gui.add_button_group("Hear", ("▶ A", "▶ B", "▶ A, then B"))
            self._table = gui.add_html("")
        for dropdown in self._pair:
            dropdown.on_update(on(lambda target: self._compare()))
        self._play.on_click(on(self._play_pair))
        self.show(True)

    def show(self, others: bool = False, swatches: Collection[int] = ()) -> None:
        """Have the cards as the swatches are: `others` than before, or some of the scene's with new numbers."""
        scene = self._parts.session.scene
        if others:
            self._cards = self._all()
            self._offer_pair()
        elif swatches:  # what the library knows of them is the same: that takes long to tell
            new: dict[int | None, Any] = {index: scene.swatches[index] for index in swatches}
            self._cards = [replace(c, source=new[c.index]) if c.index in new else c for c in self._cards]
        looked_for = (self._parts.tools.chosen, self._search.value)
        if not (others or swatches) and looked_for == self._looked_for:
            return
        self._looked_for = looked_for
        self._compare()
        found, problem = self._match()
        names = tuple(card.name for card in found[:CARD_MAX])
        if names != self._found:
            self._lay_out(found[:CARD_MAX])
            self._found = names
        left = len(found) - len(names)
        told = problem or (_rest(left, len(found)) if left or not found else "")
        set_html(self._rest, told and f'<div class="hs-card dim">{escape_html(told)}</div>')
        for card, (told, _) in zip(found[:CARD_MAX], self._rows, strict=True):
            set_html(told, self._tell(card))

    def _all(self) -> list[Card]:
        """All cards; without the library's, where that is damaged, which the user is told."""
        scene = self._parts.session.scene
        try:
            return shelf(scene)
        except SwatchError as error:
            self._parts.live.say(str(error), "error")
            return scene_cards(scene)

    def _match(self) -> tuple[list[Card], str]:
        """What the search finds, or all and why it finds nothing: a bound may be half typed."""
        try:
            return matching(self._cards, str(self._search.value)), ""
        except SwatchError as error:
            return self._cards, str(error)

    def _lay_out(self, cards: list[Card]) -> None:
        gui, on = self._parts.server.gui, self._parts.on
        for told, buttons in self._rows:
            told.remove()
            buttons.remove()
        self._rows = []
        with self._list:
            for card in cards:
                told = gui.add_html(self._tell(card))
                buttons = gui.add_button_group("", (USE, PLAY, COMPARE))
                buttons.on_click(on(partial(self._do, card.name)))
                self._rows.append((told, buttons))

    def _tell(self, card: Card) -> str:
        chosen = " chosen" if card.name == self._parts.tools.chosen else ""
        try:
            said = [f"{escape_html(p.word)} {_dim(p)}" for p in card.phrases]
        except SwatchError as error:
            said = [escape_html(str(error))]
        where = PLACES[card.place] + (" · <b>painting with it</b>" if chosen else "")
        return (
            f'<div class="hs-swatch{chosen}"><span class="chip" style="background:{self._colour(card)}"></span>'
            f"<div><b>{escape_html(card.name)}</b> <span class='dim'>{where}</span><br>{'<br>'.join(said)}</div></div>"
        )

    def _colour(self, card: Card) -> str:
        """As on the scene, where it is in it."""
        return css(card.albedo_rgb) if card.index is None else self._parts.view.colours[card.index]

    def colour_of(self, name: str) -> str:
        """The colour of a swatch, for CSS; "" where there is none of that name."""
        return next((self._colour(card) for card in self._cards if card.name == name), "")

    def _card(self, name: Any) -> Card:
        for card in self._cards:
            if card.name == name:
                return card
        raise SwatchError(no_such("swatch", str(name), (card.name for card in self._cards)))

    async def _do(self, name: str, target: Any) -> None:
        card, what = self._card(name), target.value
        if what == USE:
            tools = self._parts.tools
            tools.take(card.name, card.source)
            tools.ink()
            if tools.name not in ("brush", "fill", "box", "sphere"):
                tools.choose("brush")
        elif what == PLAY:
            await self._hear(card)
        elif what == COMPARE:
            self._pair[0].value, self._pair[1].value = self._pair[1].value, card.name
            self._compare()
            self._parts.live.say(f"{self._pair[0].value} beside {card.name}: see the tab Compare.")

    # --- two beside each other ---

    def _offer_pair(self) -> None:
        names = tuple(card.name for card in self._cards)
        for dropdown, first in zip(self._pair, (1, 2), strict=True):
            known = dropdown.value
            if tuple(dropdown.options) != names:
                dropdown.options = names
                dropdown.value = known if known in names else names[min(first, len(names) - 1)]

    def _compare(self) -> None:
        try:
            a, b = (self._card(dropdown.value) for dropdown in self._pair)
            rows = [
                f"<tr><th>{escape_html(p.quality)}</th><td>{escape_html(p.word)}<br>{_dim(p)}</td>"
                f"<td>{escape_html(q.word)}<br>{_dim(q)}</td></tr>"
                for p, q in zip(a.phrases, b.phrases, strict=True)
            ]
        except SwatchError as error:
            set_html(self._table, f'<div class="hs-card">{escape_html(str(error))}</div>')
            return
        heads = "".join(
            f'<th><span class="chip" style="background:{self._colour(card)}"></span> {escape_html(card.name)}</th>'
            for card in (a, b)
        )
        set_html(self._table, f'<table class="hs-table"><tr><th></th>{heads}</tr>{"".join(rows)}</table>')

    async def _play_pair(self, target: Any) -> None:
        a, b = (self._card(dropdown.value) for dropdown in self._pair)
        await self._hear(*{"▶ A": (a,), "▶ B": (b,)}.get(str(target.value), (a, b)))

    async def _hear(self, *cards: Card) -> None:
        """Have swatches tapped and stroked in the browser, one after the other."""

        def made() -> Sound:
            return joined([stroked(card.swatch) for card in cards])

        sound = await asyncio.get_running_loop().run_in_executor(None, made)
        self._parts.live.sound(sound.a_m_s2, sound.rate_Hz)
        if not sound.a_m_s2.any():
            self._parts.live.say(f"{cards[0].name} is silent: it has neither texture nor taps.")


def _dim(phrase: Phrase) -> str:
    """The figure of a phrase, a line broken only between two of its numbers; nothing where the word says it all."""
    if phrase.figure in ("none", "no texture"):
        return ""
    kept = escape_html(phrase.figure).replace(" ", "&nbsp;").replace(",&nbsp;", ", ")
    return f"<span class='dim'>{kept}</span>"


def _rest(left: int, found: int) -> str:
    if not found:
        return "None is like that. Search for less, or for another word."
    return f"… and {left} more: search for a name or a word."
