"""The shelf of the tab Paint: swatches as small balls, found, sorted, heard, compared, chosen, kept and brought in."""

import asyncio
import base64
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any, Final

from hapscene.errors import HapsceneError, SwatchError, no_such
from hapscene.paint.shelf import (
    SORTS,
    Card,
    Phrase,
    Sound,
    concatenated,
    matching,
    ordered,
    scene_cards,
    shelf,
    swatch_sound,
)
from hapscene.paint.swatch_import import RECORDINGS, Unsaid, import_files
from hapscene.paint.swatch_picture import ball_png
from hapscene.paint.web.page_context import PageContext, aria, card_html, escape_html, set_html
from hapscene.paint.web.scene_view import rgb_bytes
from hapscene.scene.uv_paint import read_picture
from hapscene.surface import library
from hapscene.surface.look import Look, picture_png
from hapscene.surface.swatch import touched_with
from hapscene.surface.swatch_file import SUFFIX
from hapscene.view.palette import rgb as _rgb

CARD_MAX: Final = 60
"""Most swatches that are shown at once [count]: some screens full; the search finds the others."""

BALLS_AT_ONCE: Final = 9
"""How many balls are drawn before they are shown [count]: a screen of them."""

RECENT_MAX: Final = 100
"""How many swatches are known as used lately [count]."""

IMPORTED: Final = (SUFFIX, ".xml", *RECORDINGS)
"""Suffixes of what can be dropped on the page to be a swatch."""

LOOK: Final = ".look"
"""What the page adds to the name of a picture that shall be the chosen swatch's look."""

DELETE: Final = "Delete"
SURELY: Final = "Delete for good: no undo, and scenes saved with it lack it"

NONE: Final = "…"
"""What is chosen to compare before the shelf is known."""

PLACES: Final = {"scene": "in the scene", "yours": "in your library", "shipped": "measured", "computed": "computed"}

ALL: Final = "all"


class ShelfPanel:
    """Cards of swatches: a ball that looks like each; and of the chosen one its words, numbers and what can be done.

    The cards are HTML of our own, whose buttons speak to `act` (shelf.js).

    Args:
        context: the page.
        container: the tab of the shelf.
        compare: the tab of the comparison.
    """

    def __init__(self, context: PageContext, container: Any, compare: Any) -> None:
        self._context = context
        self._cards: list[Card] = []
        self._shown_for: tuple[Any, ...] = ()
        self._balls: dict[tuple[Any, ...], str] = {}
        self._drawing: Future[None] | None = None
        self._making: set[asyncio.Task[Any]] = set()
        self._recent: list[str] = []
        self._said: dict[str, str] = {}  # of the last recording: the next is most likely of the same kind
        self._where, self._sort = ALL, SORTS[0]
        gui, callback = context.server.gui, context.callback
        with container, gui.add_folder("Swatches"):
            self._search = gui.add_text("Search", "", hint="A name, a word or a bound: rough, soft, friction<0.3")
            self._search.on_update(callback(lambda target: self.show()))
            self._bar = gui.add_html("")
            self._progress = gui.add_html("")
            self._detail = gui.add_html("")
            self._list = gui.add_html("")
            self._rest = gui.add_html("")
        with compare:
            self._pair = [gui.add_dropdown(label, (NONE,)) for label in ("Swatch A", "Swatch B")]
            self._play = gui.add_button_group("Hear", ("▶ A", "▶ B", "▶ A, then B"))
            self._table = gui.add_html("")
        for dropdown in self._pair:
            dropdown.on_update(callback(lambda target: self._compare()))
        self._play.on_click(callback(self._play_chosen))
        self.show(True)

    def close(self) -> None:
        """Draw no more, and end what swatches are being made of."""
        if self._drawing is not None:
            self._drawing.cancel()
        for task in list(self._making):
            self._context.server.get_event_loop().call_soon_threadsafe(task.cancel)

    def show(self, others: bool = False, swatches: Collection[int] = ()) -> None:
        """Have the cards as the swatches are: `others` than before, or some of the scene's with new numbers."""
        scene = self._context.session.scene
        if others:
            self._cards = self._all()
            self._offer_pair()
        elif swatches:  # what the library knows of them is the same: that takes long to tell
            new: dict[int | None, Any] = {index: scene.swatches[index] for index in swatches}
            self._cards = [replace(c, source=new[c.index]) if c.index in new else c for c in self._cards]
        wanted = (self._context.tools.chosen, self._search.value, self._where, self._sort)
        if not (others or swatches) and wanted == self._shown_for:
            return
        self._shown_for = wanted
        self._compare()
        found, problem = self._match()
        if self._where not in {ALL, *map(_place, self._cards)}:
            self._where = ALL
        if self._where != ALL:
            found = [card for card in found if _place(card) == self._where]
        shown = ordered(found, self._sort, self._recent)[:CARD_MAX]
        set_html(self._bar, self._bar_html())
        chosen = next((card for card in self._cards if card.name == self._context.tools.chosen), None)
        set_html(self._detail, self._detail_html(chosen) if chosen else "")
        self._show_cards(shown)
        left = len(found) - len(shown)
        more = f"… and {left} more: search for a name or a word." if left else ""
        told = problem or (more if found else "None is like that. Search for less, or for another word.")
        set_html(self._rest, card_html(escape_html(told), dim=True))

    def _all(self) -> list[Card]:
        """All cards; without the library's, where that is damaged, which the user is told."""
        scene = self._context.session.scene
        try:
            return shelf(scene)
        except SwatchError as error:
            self._context.socket.say(str(error), "error")
            return scene_cards(scene)

    def _match(self) -> tuple[list[Card], str]:
        """What the search finds, or all and why it finds nothing: a bound may be half typed."""
        try:
            return matching(self._cards, str(self._search.value)), ""
        except SwatchError as error:
            return self._cards, str(error)

    # --- how it looks ---

    def _show_cards(self, shown: Sequence[Card]) -> None:
        """Show balls that are drawn already at once, the others as soon as they are, drawn beside."""
        keys = [self._ball_key(card) for card in shown]
        missing = [(key, card) for key, card in zip(keys, shown, strict=True) if key not in self._balls]
        cards = "".join(self._card_html(card, self._balls.get(key, "")) for key, card in zip(keys, shown, strict=True))
        set_html(self._list, f'<ul class="hs-shelf" aria-label="Swatches">{cards}</ul>' if cards else "")
        if self._drawing is not None:
            self._drawing.cancel()
            self._drawing = None
        if missing:
            loop = self._context.server.get_event_loop()
            self._drawing = asyncio.run_coroutine_threadsafe(self._draw(missing, shown), loop)

    async def _draw(self, missing: Sequence[tuple[tuple[Any, ...], Card]], shown: Sequence[Card]) -> None:
        for key, card in missing[:BALLS_AT_ONCE]:
            self._balls[key] = await asyncio.to_thread(_ball, card, key[-1])
        self._drawing = None
        self._show_cards(shown)  # and the next

    def _ball_key(self, card: Card) -> tuple[Any, ...]:
        """What a ball depends on; last of it its colour."""
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
            f'<li><button type="button" class="hs-pick" data-shelf="use" data-name="{name}" '
            f'aria-pressed="{aria(chosen)}" title="Paint with {name}: {escape_html(feel)}">{picture}</button>'
            f'<button type="button" class="hs-hear" data-shelf="play" data-name="{name}" aria-label="Play {name}" '
            f'title="Play {name}">▶</button></li>'
        )

    def _bar_html(self) -> str:
        """What is shown, how it is sorted, and the button to bring files in."""
        places = dict.fromkeys([ALL, *(_place(card) for card in self._cards)])
        return (
            f'<div class="hs-shelf-bar"><label>Show {_select("where", places, self._where, "All, or some")}</label>'
            f"<label>Sort {_select('sort', SORTS, self._sort, 'In which order')}</label>"
            f'<button type="button" data-upload="{",".join(IMPORTED)}" title="Bring in swatches, recordings to fit, or '
            f'models of the Penn toolkit; or drop them on the page">Import…</button></div>'
        )

    def _detail_html(self, card: Card) -> str:
        """The swatch that is painted with: its words and numbers, and what can be done with it."""
        try:
            said = [f"{escape_html(p.word)} {_figure_html(p)}" for p in card.phrases]
        except SwatchError as error:
            said = [escape_html(str(error))]
        name, tags = escape_html(card.name), "".join(f" · {escape_html(tag)}" for tag in card.entry.tags)
        acts = [
            ("play", "▶ Play", "Hear it tapped and stroked"),
            ("compare", "Compare", "See and hear it beside another"),
            *([("edit", "Edit…", "Name, tags and folder in your library; or delete it")] if card.own else []),
        ]
        buttons = "".join(
            f'<button type="button" data-shelf="{act}" data-name="{name}" aria-label="{word.strip("▶ ")} {name}" '
            f'title="{tip}">{word}</button>'
            for act, word, tip in acts
        )
        buttons += (
            f'<button type="button" data-upload="image/*" data-as="{LOOK}" title="A picture that {name} looks like, '
            f'{1e3 * Look.size_m:g} mm wide; or drop one here">Picture…</button>'
        )
        where = escape_html(" · ".join(filter(None, (_place(card), touched_with(card.entry))))) + tags
        return (
            f'<div class="hs-swatch chosen" data-as="{LOOK}"><div><b>{name}</b> <span class="dim">{where} · '
            f"painting with it</span><br>{'<br>'.join(said)}</div><div class='hs-acts'>{buttons}</div></div>"
        )

    def _colour(self, card: Card) -> str:
        """As on the scene, where it is in it."""
        return f"rgb{rgb_bytes(card.albedo_rgb)}" if card.index is None else self._context.view.colours[card.index]

    def colour_of(self, name: str) -> str:
        """The colour of a swatch, for CSS; "" where there is none of that name."""
        return next((self._colour(card) for card in self._cards if card.name == name), "")

    def _card(self, name: Any) -> Card:
        found = next((card for card in self._cards if card.name == name), None)
        if found is None:
            raise SwatchError(no_such("swatch", str(name), (card.name for card in self._cards)))
        return found

    # --- what is done ---

    async def act(self, message: Mapping[str, Any]) -> None:
        """Do what the shelf's own HTML was pressed for: a message of the page.

        Raises:
            SwatchError: there is no such swatch.
        """
        what, value = message.get("act"), message.get("value")
        if what == "where":
            self._where = str(value)
        elif what == "sort" and value in SORTS:
            self._sort = str(value)
        elif what == "use":
            self._use(self._card(message.get("name")))
        elif what == "play":
            await self._play_cards(self._card(message.get("name")))
        elif what == "compare":
            self._compare_with(self._card(message.get("name")))
        elif what == "edit":
            self._edit(self._card(message.get("name")))

    def _use(self, card: Card) -> None:
        tools = self._context.tools
        self._recent = [card.name, *(name for name in self._recent if name != card.name)][:RECENT_MAX]
        tools.choose_swatch(card.name, card.source)
        tools.ensure_swatch()
        if tools.name not in ("brush", "fill", "box", "sphere"):
            tools.choose_tool("brush")

    def _edit(self, card: Card) -> None:
        """Ask for another name, tags or folder of a swatch of the user's library; or to delete it."""
        if card.own is None:
            raise SwatchError(f"{card.name!r} is not in your library: save it as new first (tab Feel)")
        gui, callback = self._context.server.gui, self._context.callback
        modal = self._context.open_dialog(f"{card.name} in your library")

        def save(target: Any) -> None:
            new = str(name.value).strip()
            tagged = str(tags.value).split(",")
            library.edit(card.name, new_name=new, tags=tagged, inside=str(folder.value).strip())
            self._let_go(card, new)
            self._context.close_dialog(modal)

        def delete(target: Any) -> None:
            if target.label == DELETE:
                target.label = SURELY
                return
            library.remove(card.name)
            self._let_go(card, card.name)
            self._context.socket.say(f"{card.name!r} is no longer in your library.")
            self._context.close_dialog(modal)

        with modal:
            name = gui.add_text("Name", card.name)
            tags = gui.add_text(
                "Tags", ", ".join(card.entry.tags), hint="Words to find it by, with commas between them"
            )
            folder = gui.add_text("Folder", card.folder, hint="A folder of your library, as metals; none for its top")
            gui.add_button("Save").on_click(callback(save))
            gui.add_button(DELETE, color="red").on_click(callback(delete))
            gui.add_button("Cancel", color="gray").on_click(callback(lambda target: self._context.close_dialog(modal)))

    def _let_go(self, card: Card, name: str) -> None:
        """A file of the library has moved, or is gone: the scene keeps what it has of it as its own."""
        self._context.session.tuning.let_go_of(card.name)
        if self._context.tools.chosen == card.name and card.index is None:
            self._cards = self._all()
            there = next((c for c in self._cards if c.name == name), self._cards[-1])
            self._context.tools.choose_swatch(there.name, there.source)
        self.show(True)

    # --- what is brought in ---

    async def take(self, files: Sequence[Path]) -> None:
        """Make swatches of files, in the user's library; ask where a recording does not say what it holds."""
        recordings = [file for file in files if file.suffix.lower() in RECORDINGS]
        task = asyncio.current_task()
        assert task is not None  # it is called in the event loop
        self._making.add(task)
        try:
            await self._bring([file for file in files if file not in recordings], {})
            for file in recordings:
                await self._bring([file], {})
        finally:
            self._making.discard(task)

    async def _bring(self, files: Sequence[Path], said: Mapping[str, str]) -> None:
        if not files:
            return
        socket, names = self._context.socket, ", ".join(file.name for file in files[:3])
        progress = asyncio.ensure_future(self._show_progress(names))
        try:
            made = await import_files(files, **said)
        except Unsaid as unsaid:
            progress.cancel()
            answer = await self._ask_of(files[0], unsaid, {**self._said, **said})
            if answer is not None:
                await self._bring(files, answer)
            return
        except (HapsceneError, OSError) as error:
            socket.say(str(error), "error")
            return
        finally:
            progress.cancel()
            set_html(self._progress, "")
        self._said = {key: value for key, value in said.items() if key != "name"}
        self._search.value, self._where = "", ALL
        self.show(True)
        self._use(self._card(made[0]))
        what = repr(made[0]) if len(made) == 1 else f"{len(made)} swatches, {made[0]!r} the first,"
        socket.say(f"In your library: {what} from {names}.")
        self._context.refresh()

    async def _show_progress(self, names: str) -> None:
        """Tell for how long it has been worked on, until it is cancelled."""
        for seconds in count():
            told = f"Making a swatch of {escape_html(names)} … {seconds} s"
            set_html(self._progress, f'<div class="hs-card" role="status">{told}</div>')
            await asyncio.sleep(1.0)

    async def _ask_of(self, file: Path, unsaid: Unsaid, said: Mapping[str, str]) -> dict[str, str] | None:
        """Ask what a recording does not say; None where nobody will."""
        gui, callback = self._context.server.gui, self._context.callback
        answer: asyncio.Future[dict[str, str] | None] = asyncio.get_running_loop().create_future()
        modal = self._context.open_dialog(f"What does {file.name} hold?")

        def reply(value: dict[str, str] | None) -> None:
            if not answer.done():
                answer.set_result(value)
            self._context.close_dialog(modal)

        with modal:
            gui.add_html(card_html(escape_html(f"{unsaid}.")))
            fields = {
                "name": gui.add_text("Name", said.get("name", file.stem)),
                "rate": gui.add_text(
                    "Rate [Hz]", said.get("rate", ""), hint="Samples a second, where the file has not"
                ),
                "columns": gui.add_text(
                    "Columns", said.get("columns", unsaid.guess), hint="As acceleration=accel,speed=v"
                ),
                "units": gui.add_text("Units", said.get("units", "acceleration=m/s2,speed=mm/s,force=N")),
            }
            told = lambda target: reply({key: str(field.value).strip() for key, field in fields.items()})  # noqa: E731
            gui.add_button("Fit").on_click(callback(told))
            gui.add_button("Cancel", color="gray").on_click(callback(lambda target: reply(None)))
        while not answer.done() and not modal.closed:  # a question may be closed by a key
            await asyncio.wait([answer], timeout=1.0)
        return answer.result() if answer.done() else None

    async def take_picture(self, files: Sequence[Path]) -> None:
        """Have the chosen swatch look as a picture.

        Raises:
            HapsceneError: it is none, or the swatch is plain.
        """
        file = files[0].rename(files[0].with_suffix(""))
        made = await asyncio.get_running_loop().run_in_executor(None, lambda: picture_png(read_picture(file)))
        tools = self._context.tools
        self._context.session.tuning.set_picture(tools.ensure_swatch(), made)
        self._context.socket.say(f"{tools.chosen} looks like {file.name} now.")
        self._context.refresh()

    # --- two beside each other ---

    def _compare_with(self, card: Card) -> None:
        """Compare this very swatch, as A: with what is painted with, else what was before, or compared with last."""
        known = [c.name for c in self._cards]
        last = (self._pair[1].value, self._pair[0].value)
        others = (self._context.tools.chosen, *self._recent, *last, *known, card.name)
        other = next(name for name in others if name in known and (name != card.name or len(known) == 1))
        self._pair[0].value, self._pair[1].value = card.name, other
        self._compare()

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
                f"<tr><th>{escape_html(p.quality)}</th><td>{escape_html(p.word)}<br>{_figure_html(p)}</td>"
                f"<td>{escape_html(q.word)}<br>{_figure_html(q)}</td></tr>"
                for p, q in zip(a.phrases, b.phrases, strict=True)
            ]
        except SwatchError as error:
            set_html(self._table, card_html(escape_html(str(error))))
            return
        heads = "".join(
            f'<th><span class="chip" style="background:{self._colour(card)}"></span> {escape_html(card.name)}</th>'
            for card in (a, b)
        )
        set_html(self._table, f'<table class="hs-table"><tr><th></th>{heads}</tr>{"".join(rows)}</table>')

    async def _play_chosen(self, target: Any) -> None:
        a, b = (self._card(dropdown.value) for dropdown in self._pair)
        await self._play_cards(*{"▶ A": (a,), "▶ B": (b,)}.get(str(target.value), (a, b)))

    async def _play_cards(self, *cards: Card) -> None:
        """Have swatches tapped and stroked in the browser, one after the other."""

        def made() -> Sound:
            return concatenated([swatch_sound(card.swatch) for card in cards])

        sound = await asyncio.get_running_loop().run_in_executor(None, made)
        self._context.socket.sound(sound.a_m_s2, sound.rate_Hz)
        if not sound.a_m_s2.any():
            self._context.socket.say(f"{cards[0].name} is silent: it has neither texture nor taps.")


def _figure_html(phrase: Phrase) -> str:
    """The figure of a phrase, a line broken only between two of its numbers; nothing where the word says it all."""
    if phrase.figure in ("none", "no texture"):
        return ""
    kept = escape_html(phrase.figure).replace(" ", "&nbsp;").replace(",&nbsp;", ", ")
    return f"<span class='dim'>{kept}</span>"


def _place(card: Card) -> str:
    """Where a swatch is, in words: its folder of the user's library besides."""
    return f"your library: {card.folder}" if card.place == "yours" and card.folder else PLACES[card.place]


def _ball(card: Card, colour: str | None) -> str:
    """A picture of a swatch as an address; empty where it cannot be loaded."""
    try:
        rgb = None if colour is None else tuple(_rgb(colour).tolist())
        return f"data:image/png;base64,{base64.b64encode(ball_png(card.swatch, rgb)).decode('ascii')}"
    except SwatchError:
        return ""


def _select(act: str, options: Collection[str], chosen: str, tip: str) -> str:
    items = "".join(f"<option{' selected' * (o == chosen)}>{escape_html(o)}</option>" for o in options)
    return f'<select data-shelf="{act}" title="{tip}">{items}</select>'
