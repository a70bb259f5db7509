"""The swatch library panel of the tab Paint: search, play and select swatches."""

import asyncio
import base64
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from typing import Final

from hapscene.errors import SwatchError, no_such
from hapscene.paint.model.cards import Card, all_cards, matching, scene_cards
from hapscene.paint.web.context import ClientContext, Container, aria, card_html, escape_html, set_html
from hapscene.paint.web.view import rgb_bytes
from hapscene.surface.swatch import Swatch, touched_with
from hapscene.surface.swatch_summary import Phrase
from hapscene.swatches.picture import ball_png
from hapscene.swatches.sound import swatch_sound
from hapscene.view.palette import rgb

__all__ = ["SwatchPanel"]

CARD_MAX: Final = 60
"""Largest number of swatches shown at once [count]; the search finds the others."""

BALLS_AT_ONCE: Final = 9
"""Number of preview spheres that are rendered before the list is updated [count]: one screen."""

Key = tuple[str, str, int, str | None]
"""What a preview depends on; the last item is the colour."""

PLACES: Final = {"scene": "in the scene", "yours": "in your library", "shipped": "measured", "computed": "computed"}


class SwatchPanel:
    """Swatch library panel: a card for each swatch, and details of the selected one.

    The cards are custom HTML, whose buttons call `act` through swatch_library.js.
    """

    def __init__(self, context: ClientContext, container: Container) -> None:
        self._context = context
        self._cards: list[Card] = []
        self._shown_for: tuple[object, ...] = ()
        self._drawing: Future[None] | None = None
        self._shown_cards: Sequence[Card] = ()
        gui, callback = context.gui, context.callback
        with container, gui.add_folder("Swatches"):
            self._search = gui.add_text(
                "Search", "", hint="A name, a word, a source or a bound: rough, computed, friction<0.3"
            )
            self._search.on_update(callback(lambda target: self.show()))
            self._detail = gui.add_html("")
            self._list = gui.add_html("")
            self._rest = gui.add_html("")
        self.show(True)

    def close(self) -> None:
        """Stop rendering previews."""
        if self._drawing is not None:
            self._drawing.cancel()

    def show(self, reload: bool = False, swatches: Collection[int] = ()) -> None:
        """Update the panel.

        Args:
            reload: read the library again, because the list of swatches has changed.
            swatches: indices of swatches of the scene with changed parameters.
        """
        scene = self._context.session.scene
        if reload:
            self._cards = self._all()
        elif swatches:  # reading the library again would take long
            new: dict[int | None, Swatch] = {index: scene.swatches[index] for index in swatches}
            self._cards = [replace(c, source=new[c.index]) if c.index in new else c for c in self._cards]
        wanted = (self._context.tools.chosen, self._search.value)
        if not (reload or swatches) and wanted == self._shown_for:
            return
        self._shown_for = wanted
        found, problem = self._match()
        shown = found[:CARD_MAX]
        chosen = next((card for card in self._cards if card.name == self._context.tools.chosen), None)
        set_html(self._detail, self._detail_html(chosen) if chosen else "")
        self._show_cards(shown)
        left = len(found) - len(shown)
        more = f"… and {left} more. Use the search to find them." if left else ""
        text = problem or (more if found else "No swatch matches the search.")
        set_html(self._rest, card_html(escape_html(text), dim=True))

    def _all(self) -> list[Card]:
        """All cards; if the library is damaged, shows an error and returns the cards of the scene."""
        scene = self._context.session.scene
        try:
            return all_cards(scene)
        except SwatchError as error:
            self._context.say(str(error), "error")
            return scene_cards(scene)

    def _match(self) -> tuple[list[Card], str]:
        """The search result; for an invalid search, such as an incomplete bound, all cards and the error."""
        try:
            return matching(self._cards, str(self._search.value)), ""
        except SwatchError as error:
            return self._cards, str(error)

    # --- HTML ---

    def _show_cards(self, shown: Sequence[Card]) -> None:
        """Show the cards; previews that are not cached are rendered in a thread and shown later."""
        self._shown_cards, previews = shown, self._context.previews
        keys = [self._ball_key(card) for card in shown]
        missing = [(key, card) for key, card in zip(keys, shown, strict=True) if key not in previews]
        cards = "".join(self._card_html(card, previews.get(key, "")) for key, card in zip(keys, shown, strict=True))
        set_html(self._list, f'<ul class="hs-library" aria-label="Swatches">{cards}</ul>' if cards else "")
        if self._drawing is not None:
            self._drawing.cancel()
            self._drawing = None
        if missing:
            loop = self._context.server.get_event_loop()
            self._drawing = asyncio.run_coroutine_threadsafe(self._draw(missing, shown), loop)

    async def _draw(self, missing: Sequence[tuple[Key, Card]], shown: Sequence[Card]) -> None:
        await self._context.until_idle()
        for key, card in missing[:BALLS_AT_ONCE]:
            self._context.previews[key] = await asyncio.to_thread(_ball, card, key[-1])
        if shown is self._shown_cards:  # a cancellation may come too late to stop the previews of an earlier list
            self._drawing = None
            self._show_cards(shown)  # renders the next ones

    def _ball_key(self, card: Card) -> Key:
        """Cache key of a preview."""
        colours = self._context.view.colours
        colour = None if card.index is None else colours[card.index]
        return (card.name, card.entry.sha256, id(card.source) if card.index is not None else 0, colour)

    def _card_html(self, card: Card, ball: str) -> str:
        name, chosen = escape_html(card.name), card.name == self._context.tools.chosen
        feel = ", ".join((*card.entry.words, *card.entry.tags, PLACES[card.place]))
        picture = f'<img alt="" src="{ball}">' if ball else '<span class="ball"></span>'
        chip = "" if card.index is None else f'<i class="chip" style="background:{self._colour(card)}"></i> '
        picture += f"<span>{chip}{name}</span>"
        return (
            f'<li><button type="button" class="hs-pick" data-library="use" data-name="{name}" '
            f'aria-pressed="{aria(chosen)}" title="Paint with {name}: {escape_html(feel)}">{picture}</button>'
            f'<button type="button" class="hs-play" data-library="play" data-name="{name}" aria-label="Play {name}" '
            f'title="Play {name}">▶</button></li>'
        )

    def _detail_html(self, card: Card) -> str:
        """HTML of the description of the selected swatch."""
        try:
            lines = [f"{escape_html(p.word)} {_figure_html(p)}" for p in card.phrases]
        except SwatchError as error:
            lines = [escape_html(str(error))]
        name, tags = escape_html(card.name), "".join(f" · {escape_html(tag)}" for tag in card.entry.tags)
        where = escape_html(" · ".join(filter(None, (PLACES[card.place], touched_with(card.entry))))) + tags
        return (
            f'<div class="hs-swatch chosen"><div><b>{name}</b> <span class="dim">{where} · '
            f"selected</span><br>{'<br>'.join(lines)}</div></div>"
        )

    def _colour(self, card: Card) -> str:
        """Colour of a card for CSS; for a swatch of the scene, the colour in the view."""
        return f"rgb{rgb_bytes(card.albedo_rgb)}" if card.index is None else self._context.view.colours[card.index]

    def colour_of(self, name: str) -> str:
        """Colour of a swatch for CSS; "" if there is no swatch of that name."""
        return next((self._colour(card) for card in self._cards if card.name == name), "")

    def _card(self, name: object) -> Card:
        found = next((card for card in self._cards if card.name == name), None)
        if found is None:
            raise SwatchError(no_such("swatch", str(name), (card.name for card in self._cards)))
        return found

    # --- actions ---

    async def act(self, message: Mapping[str, object]) -> None:
        """Handle a message of a button of the panel.

        Raises:
            SwatchError: there is no such swatch.
        """
        what = message.get("act")
        if what == "use":
            self._use(self._card(message.get("name")))
        elif what == "play":
            await self._play(self._card(message.get("name")))

    def _use(self, card: Card) -> None:
        tools = self._context.tools
        tools.choose_swatch(card.name, card.source)  # added to the scene by the first stroke, as part of its step
        if tools.name not in ("brush", "fill", "sphere"):
            tools.choose_tool("brush")

    async def _play(self, card: Card) -> None:
        """Play the sound of a tap and a stroke in the browser."""
        sound = await asyncio.to_thread(swatch_sound, card.swatch)
        self._context.socket.sound(sound.a_m_s2, sound.rate_Hz, sound.start, sound.gain, self._context.client.client_id)
        silent = f"{card.name} makes no sound: it has neither a texture nor taps."
        self._context.say(f"{card.name}: {sound.levels}" if sound.a_m_s2.any() else silent)


def _figure_html(phrase: Phrase) -> str:
    """HTML of the figure of a phrase, with line breaks only between numbers; "" if the word is sufficient."""
    if not phrase.figure:
        return ""
    figure = escape_html(phrase.figure).replace(" ", "&nbsp;").replace(",&nbsp;", ", ")
    return f"<span class='dim'>{figure}</span>"


def _ball(card: Card, colour: str | None) -> str:
    """Data URL of the preview of a swatch; "" if it cannot be loaded."""
    try:
        own = None if colour is None else tuple(rgb(colour).tolist())
        return f"data:image/png;base64,{base64.b64encode(ball_png(card.swatch, own)).decode('ascii')}"
    except SwatchError:
        return ""
