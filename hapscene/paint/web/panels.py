"""The panel of the page: tools and shelf in the tab Paint, hand and numbers in Feel, Compare, File. The page lays them
out, and is alone in knowing them."""

import asyncio
import inspect
import math
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from hapscene.errors import SaveConflict, SceneError, SwatchError, no_such
from hapscene.paint.document import Recovery
from hapscene.paint.history import face_count_text
from hapscene.paint.parameter import Parameter
from hapscene.paint.shelf import Card, Phrase, Sound, concatenated, matching, scene_cards, shelf, swatch_sound
from hapscene.paint.web.hand_config import COMPENSATOR_HINTS, GRIP_NAMES, HAND_DEVICES
from hapscene.paint.web.page_context import PageContext, bounded, card_html, escape_html, rgb_bytes, set_html
from hapscene.paint.web.tools import FILLS, RADIUS_SHARE
from hapscene.scene.scene_file import SUFFIX
from hapscene.surface.swatch import Swatch

# --- the tab Paint ---

TOOL_HINTS: Final = {
    "brush": "Hold Shift and drag: paints the chosen swatch.",
    "fill": "Hold Shift and click: fills from there; or choose a part.",
    "box": "Hold Shift and drag from corner to corner: what is inside is painted.",
    "sphere": "Hold Shift and drag from the middle outward: what is inside is painted.",
    "eraser": "Hold Shift and drag: brings back what the body was made of.",
    "pick": "Hold Shift and click: takes the swatch that is painted there.",
    "touch": "Hold Shift and drag: a hand strokes the surface.",
}
"""What each tool does."""

FORCE_N: Final = (0.1, 3.0)
"""Least and most force of the hand [N]: a light touch, and what the weakest device shipped can push back with."""

ALL: Final = "all of it"


class ToolPanel:
    """Sliders and choices of the tools; those of the tool in hand are seen.

    Args:
        context: the page.
    """

    def __init__(self, context: PageContext) -> None:
        self._context = context
        gui, tools = context.server.gui, context.tools
        low, high = (2e3 * share * context.view.diagonal_m for share in (RADIUS_SHARE[0], RADIUS_SHARE[2]))
        step = 10.0 ** math.floor(math.log10(low))
        with gui.add_folder("Tool"):
            self._hint = gui.add_html("")
            self._size = gui.add_slider(
                "Size [mm]",
                min=_round_up(low, step),
                max=_round_up(high, step),
                step=step,
                initial_value=_round_up(2e3 * tools.radius_m, step),
                hint="Diameter of brush, eraser, and of a sphere that is clicked; keys [ and ]",
            )
            self._fill = gui.add_dropdown("Fill", FILLS, initial_value=tools.fill, hint="What a click fills")
            self._angle = gui.add_slider(
                "Angle [°]",
                min=0,
                max=180,
                step=1,
                initial_value=round(math.degrees(tools.angle_rad)),
                hint="A facet goes on over edges that bend by at most this",
            )
            self._margin = gui.add_slider(
                "Depth [mm]",
                min=step,
                max=_round_up(high, step),
                step=step,
                initial_value=_round_up(1e3 * tools.margin_m, step),
                hint="How far the box reaches beyond the two places that span it",
            )
            self._groups = {f"{b.name}: {name}": (b.name, name) for b, name in _groups(context)}
            self._group = gui.add_dropdown("Part", tuple(self._groups), hint="A material, object or group of the file")
            self._group_button = gui.add_button("Fill this part", hint="Paints the part with the chosen swatch")
            self._force = gui.add_slider(
                "Force [N]",
                min=FORCE_N[0],
                max=FORCE_N[1],
                step=0.1,
                initial_value=tools.force_N,
                hint="With which the hand presses on the surface; what it holds is chosen in the tab Feel",
            )
        self._listen()
        self.show()

    def show(self) -> None:
        """See the settings of the tool in hand, and their values as they are."""
        tools = self._context.tools
        name, fill = tools.name, tools.fill
        set_html(self._hint, card_html(TOOL_HINTS[name], dim=True))
        self._size.visible = name in ("brush", "eraser", "sphere")
        self._fill.visible = self._group.visible = self._group_button.visible = name == "fill"
        self._angle.visible = name == "fill" and fill == "facet"
        self._margin.visible = name == "box"
        self._force.visible = name == "touch"
        if abs(self._size.value - 2e3 * tools.radius_m) > self._size.step / 2:
            self._size.value = 2e3 * tools.radius_m

    def _listen(self) -> None:
        callback, tools = self._context.callback, self._context.tools

        def angle(target: Any) -> None:
            tools.angle_rad = math.radians(bounded(target.value, 0.0, 180.0, math.degrees(tools.angle_rad)))

        def margin(target: Any) -> None:
            tools.margin_m = 1e-3 * bounded(target.value, target.min, target.max, 1e3 * tools.margin_m)

        def fill(target: Any) -> None:
            tools.fill = target.value if target.value in FILLS else tools.fill

        def force(target: Any) -> None:
            tools.force_N = bounded(target.value, *FORCE_N, tools.force_N)

        self._size.on_update(callback(lambda t: tools.resize(5e-4 * bounded(t.value, 0.0, 1e6, 2e3 * tools.radius_m))))
        self._angle.on_update(callback(angle))
        self._margin.on_update(callback(margin))
        self._fill.on_update(callback(fill))
        self._force.on_update(callback(force))
        self._group_button.on_click(callback(self._fill_group))

    def _fill_group(self, target: Any) -> None:
        if self._group.value not in self._groups:
            raise SceneError("no such part")
        body, name = self._groups[self._group.value]
        context = self._context
        session, swatch = context.session, context.tools.ensure_swatch()
        count = session.fill_body(body, swatch) if name == ALL else session.fill_group(body, name, swatch)
        context.socket.say(f"{face_count_text(count)} painted." if count else "It is painted so already.")


def _groups(context: PageContext) -> list[tuple[Any, str]]:
    """Every body, whole, and its parts where it has several."""
    found = []
    for body in context.session.scene.bodies:
        found.append((body, ALL))
        groups = context.session.groups(body.name)
        if len(groups) > 1:
            found += [(body, name) for name, _ in groups]
    return found


def _round_up(value: float, step: float) -> float:
    return round(math.ceil(value / step - 1e-9) * step, 9)


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
        context: the page.
        container: the tab of the shelf.
        compare: the tab of the comparison.
    """

    def __init__(self, context: PageContext, container: Any, compare: Any) -> None:
        self._context = context
        self._cards: list[Card] = []
        self._shown_for: tuple[Any, ...] = ()
        self._found: tuple[str, ...] | None = None
        self._rows: list[tuple[Any, Any]] = []
        gui, callback = context.server.gui, context.callback
        with container, gui.add_folder("Swatches"):
            self._search = gui.add_text("Search", "", hint="A name, a word or a bound: rough, soft, friction<0.3")
            self._search.on_update(callback(lambda target: self.show()))
            self._list = gui.add_folder(None)
            self._rest = gui.add_html("")
        with compare:
            self._pair = [gui.add_dropdown(label, (NONE,)) for label in ("Swatch A", "Swatch B")]
            self._play = gui.add_button_group("Hear", ("▶ A", "▶ B", "▶ A, then B"))
            self._table = gui.add_html("")
        for dropdown in self._pair:
            dropdown.on_update(callback(lambda target: self._compare()))
        self._play.on_click(callback(self._play_chosen))
        self.show(True)

    def show(self, others: bool = False, swatches: Collection[int] = ()) -> None:
        """Have the cards as the swatches are: `others` than before, or some of the scene's with new numbers."""
        scene = self._context.session.scene
        if others:
            self._cards = self._all()
            self._offer_pair()
        elif swatches:  # what the library knows of them is the same: that takes long to tell
            new: dict[int | None, Any] = {index: scene.swatches[index] for index in swatches}
            self._cards = [replace(c, source=new[c.index]) if c.index in new else c for c in self._cards]
        wanted = (self._context.tools.chosen, self._search.value)
        if not (others or swatches) and wanted == self._shown_for:
            return
        self._shown_for = wanted
        self._compare()
        found, problem = self._match()
        names = tuple(card.name for card in found[:CARD_MAX])
        if names != self._found:
            self._lay_out(found[:CARD_MAX])
            self._found = names
        left = len(found) - len(names)
        more = f"… and {left} more: search for a name or a word." if left else ""
        told = problem or (more if found else "None is like that. Search for less, or for another word.")
        set_html(self._rest, card_html(escape_html(told), dim=True))
        for card, (told, _) in zip(found[:CARD_MAX], self._rows, strict=True):
            set_html(told, self._card_html(card))

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

    def _lay_out(self, cards: list[Card]) -> None:
        gui, callback = self._context.server.gui, self._context.callback
        for told, buttons in self._rows:
            told.remove()
            buttons.remove()
        self._rows = []
        with self._list:
            for card in cards:
                told = gui.add_html(self._card_html(card))
                buttons = gui.add_button_group("", (USE, PLAY, COMPARE))
                buttons.on_click(callback(partial(self._press, card.name)))
                self._rows.append((told, buttons))

    def _card_html(self, card: Card) -> str:
        chosen = " chosen" if card.name == self._context.tools.chosen else ""
        try:
            said = [f"{escape_html(p.word)} {_figure_html(p)}" for p in card.phrases]
        except SwatchError as error:
            said = [escape_html(str(error))]
        where = PLACES[card.place] + (" · <b>painting with it</b>" if chosen else "")
        return (
            f'<div class="hs-swatch{chosen}"><span class="chip" style="background:{self._colour(card)}"></span>'
            f"<div><b>{escape_html(card.name)}</b> <span class='dim'>{where}</span><br>{'<br>'.join(said)}</div></div>"
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

    async def _press(self, name: str, target: Any) -> None:
        card, what = self._card(name), target.value
        if what == USE:
            tools = self._context.tools
            tools.choose_swatch(card.name, card.source)
            tools.ensure_swatch()
            if tools.name not in ("brush", "fill", "box", "sphere"):
                tools.choose_tool("brush")
        elif what == PLAY:
            await self._play_cards(card)
        elif what == COMPARE:
            self._pair[0].value, self._pair[1].value = self._pair[1].value, card.name
            self._compare()
            self._context.socket.say(f"{self._pair[0].value} beside {card.name}: see the tab Compare.")

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


# --- the tab Feel ---


class HandPanel:
    """Choices of device, grip and handle.

    Args:
        context: the page.
        container: the tab they are in.
    """

    def __init__(self, context: PageContext, container: Any) -> None:
        self._context = context
        gui, callback, config = context.server.gui, context.callback, context.touch.config
        with container, gui.add_folder("Hand"):
            device = gui.add_dropdown(
                "Device",
                tuple(HAND_DEVICES),
                initial_value=config.device,
                hint="What the hand holds; its limits apply. omni is the whole arm, with its friction, bending and "
                "motors; the others are a mass with friction that reaches everywhere",
            )
            grip = gui.add_dropdown("Grip", GRIP_NAMES, initial_value=config.grip, hint="How firmly the hand holds it")
            handle = gui.add_dropdown(
                "Handle",
                tuple(COMPENSATOR_HINTS),
                initial_value=config.compensator,
                hint="What drives the voice coil in the handle, which makes textures and taps; or no handle at all",
            )
            self._heard = gui.add_html("")
        context.session.tuning.choose_device(config.limits)
        device.on_update(callback(partial(self._choose, "device")))
        grip.on_update(callback(self._choose_grip))
        handle.on_update(callback(partial(self._choose, "compensator")))
        self._show_heard()

    def _show_heard(self) -> None:
        hint = COMPENSATOR_HINTS[self._context.touch.config.compensator]
        self._heard.content = card_html(f"Heard and plotted: {escape_html(hint)}.")

    def _choose_grip(self, target: Any) -> None:
        touch = self._context.touch
        touch.config = replace(touch.config, grip=target.value)

    async def _choose(self, what: str, target: Any) -> None:
        """Hold something else: the hand starts anew, the painting stays."""
        session, touch = self._context.session, self._context.touch
        touch.config = replace(touch.config, **{what: target.value})
        session.tuning.choose_device(touch.config.limits)
        self._show_heard()
        self._context.refresh()  # the limits are others at once
        if touch.status != "closed":
            await touch.open(session.painting.snapshot(), session.tuning.tick_s)


STEP_COUNT: Final = 200
"""About how many steps a slider has [count]: finer than what is felt apart, 2 % of stiffness at its middle."""

FIGURES: Final = 4
"""How many figures of a number a field has room for [count]."""

NAME_MAX: Final = 24
"""Longest name over the sliders [characters]: a longer one would run out of the panel."""


class NumberPanel:
    """Sliders of the chosen swatch; made anew when another is chosen.

    Args:
        context: the page.
        container: the tab they are in.
    """

    def __init__(self, context: PageContext, container: Any) -> None:
        self._context = context
        self._container = container
        self._shown: tuple[Any, ...] = ()
        self._sliders: dict[str, Any] = {}
        with container:
            self._head = context.server.gui.add_html("")
            self._folder: Any = None
        self.show()

    def show(self) -> None:
        """Have the sliders as the swatch is."""
        context = self._context
        index = context.tools.swatch
        if index is None:  # not painted with yet, or that was undone
            chosen = escape_html(context.tools.chosen)
            self._clear(f"<b>{chosen}</b> has its numbers here as soon as it is painted with.")
            return
        found = [p for p in context.session.tuning.parameters(index) if p.applies]
        swatch = context.session.scene.swatches[index]
        shape = (index, swatch.name, context.session.device, *((p.name, p.minimum, p.maximum) for p in found))
        if shape != self._shown:
            self._make(found, swatch)
            self._shown = shape
        told = (
            f"as it is painted with; every change is felt and heard at once. Limits are those of the "
            f"{escape_html(context.session.device)}."
            if found
            else "is what every face has until it is painted, and stays as it is. A copy of it can be tuned."
        )
        notes = "".join(f"<br>⚠ {escape_html(p.note)}" for p in found if p.note)
        set_html(self._head, card_html(f"<b>{escape_html(swatch.name)}</b> {told}{notes}"))
        for p in found:
            slider = self._sliders[p.name]
            if slider.value != _rounded(p.value):
                slider.value = _rounded(p.value)
        if found and tuple(self._colour.value) != rgb_bytes(swatch.albedo_rgb):
            self._colour.value = rgb_bytes(swatch.albedo_rgb)

    def _make(self, found: list[Parameter], swatch: Swatch) -> None:
        gui, callback, name = self._context.server.gui, self._context.callback, swatch.name
        self._clear()
        with self._container:
            self._folder = gui.add_folder(f"Numbers of {_short(name)}")
        with self._folder:
            for p in found:
                step = _step(p.maximum - p.minimum)
                unit = "" if p.unit in ("1", "") else f" [{p.unit}]"
                slider = gui.add_slider(
                    _capital(p.label) + unit,
                    min=min(p.minimum, _rounded(p.value)),
                    max=max(math.floor(p.maximum / step + 1e-9) * step, _rounded(p.value)),
                    step=step,
                    initial_value=_rounded(p.value),
                    hint=f"{_capital(p.meaning)}; {p.reset:.4g} to begin with",
                )
                slider.precision = FIGURES  # of the field: else it rounds to the step what is typed
                slider.on_update(callback(partial(self._tune, p)))
                self._sliders[p.name] = slider
            if found:
                self._colour = gui.add_rgb("Colour", rgb_bytes(swatch.albedo_rgb), hint="As it is shown, and exported")
                self._colour.on_update(callback(self._recolour))
            self._name = gui.add_text("New name", f"{name} 2" if name.startswith("my ") else f"my {name}")
            for label, hint, act in BUTTONS[: None if found else 1]:  # plain can only be copied
                gui.add_button(label, hint=hint).on_click(callback(partial(act, self)))

    def _clear(self, text: str = "") -> None:
        if self._folder is not None:
            self._folder.remove()
        self._folder, self._sliders, self._shown = None, {}, ()
        set_html(self._head, card_html(text))

    def _tune(self, p: Parameter, target: Any) -> None:
        value = bounded(target.value, p.minimum, p.maximum, p.value)
        self._context.session.tune(self._context.tools.ensure_swatch(), **{p.name: value})

    def _recolour(self, target: Any) -> None:
        red, green, blue = target.value
        self._context.session.recolour(self._context.tools.ensure_swatch(), (red / 255, green / 255, blue / 255))

    def _reset(self, target: Any) -> None:
        if not self._context.session.tuning.reset(self._context.tools.ensure_swatch()):
            self._context.socket.say("These are the numbers that it came with.")

    def _copy(self, target: Any) -> None:
        session, name = self._context.session, self._new_name()
        index = session.tuning.copy_swatch(self._context.tools.ensure_swatch(), name)
        self._context.tools.choose_swatch(name, session.scene.swatches[index])

    def _new_name(self) -> str:
        name = str(self._name.value).strip()
        if not name:
            raise SwatchError("give the new swatch a name")
        return name

    def _save(self, target: Any) -> None:
        name = self._new_name()
        index = self._context.tools.ensure_swatch()
        file = self._context.session.tuning.save_swatch_as(index, name)
        self._context.tools.choose_swatch(name, self._context.session.scene.swatches[index])
        self._context.socket.say(f"{name!r} is in your library: {file}")


def _step(span: float) -> float:
    """A round step for a slider."""
    if span <= 0.0:
        return 1e-3
    rough = span / STEP_COUNT
    power = 10.0 ** math.floor(math.log10(rough))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * 0.999))


def _rounded(value: float) -> float:
    """What a field shows of a number; the swatch keeps it all."""
    return float(f"{value:.{FIGURES}g}")


def _short(name: str) -> str:
    """A name that a folder's head has room for."""
    return name if len(name) <= NAME_MAX else name[: NAME_MAX - 1] + "…"


BUTTONS: Final = (
    ("Copy", "A second swatch, to tune and to paint with; what is painted stays as it is", NumberPanel._copy),
    ("Save as new swatch", "Into your library under the new name, which it has from now on", NumberPanel._save),
    ("Reset", "Back to what the swatch came with", NumberPanel._reset),
)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


# --- the tab File ---

KEYS: Final = (
    ("1 … 7", "brush, fill, box, sphere, eraser, pick, touch"),
    ("Shift + drag", "use the tool (L: the other way round)"),
    ("[  ]", "smaller, larger brush"),
    ("Ctrl Z, Ctrl Y", "undo, redo"),
    ("Ctrl S", "save"),
    ("Enter, Esc", "a typed number counts, or not"),
    ("drag, wheel", "turn the view, zoom"),
    ("right drag", "move the view"),
    ("W A S D Q E", "walk through the scene"),
    ("H", "show the hint"),
)

AUTOSAVED: Final = "A copy is kept beside the file every second, and offered after a crash."


class FilePanel:
    """The tab of the file.

    Args:
        context: the page.
        container: the tab.
        path: where the scene is saved to, unless told otherwise.
    """

    def __init__(self, context: PageContext, container: Any, path: Path) -> None:
        self._context = context
        self._path = path
        self._look_chosen = False
        self._tuned: tuple[object, str] = None, ""
        gui, callback = context.server.gui, context.callback
        with container:
            self._file = gui.add_text("Scene file", str(path), hint=f"Ends in {SUFFIX}")
            gui.add_button("Save", hint="Ctrl S").on_click(callback(lambda target: self.save()))
            self._status = gui.add_html("")
            self._exports = _exports()
            if self._exports:
                with gui.add_folder("Export"):
                    self._format = gui.add_dropdown("Format", tuple(self._exports))
                    self._losses = gui.add_html("")
                    self._target = gui.add_text("File", "")
                    gui.add_button("Export").on_click(callback(self._export))
                    self._format.on_update(callback(lambda target: self._show_format()))
                    self._show_format()
            with gui.add_folder("Looks"):
                self._dark = gui.add_checkbox("Dark", False)
                self._dark.on_update(callback(lambda target: self._choose_look()))
            rows = "".join(f"<tr><td><kbd>{escape_html(k)}</kbd></td><td>{escape_html(v)}</td></tr>" for k, v in KEYS)
            with gui.add_folder("Keys"):
                gui.add_html(f'<table class="hs-table">{rows}</table>')
        self._apply_theme()

    def prefer_look(self, dark: bool) -> None:
        """Light or dark as the first who comes has it, until it is chosen."""
        if not self._look_chosen:
            self._look_chosen, self._dark.value = True, dark
            self._apply_theme()

    def _choose_look(self) -> None:
        self._look_chosen = True
        self._apply_theme()

    def _apply_theme(self) -> None:
        """Light or dark, as chosen."""
        self._context.server.gui.configure_theme(
            dark_mode=bool(self._dark.value), show_share_button=False, show_logo=False, control_width="medium"
        )

    def show(self) -> None:
        """Tell whether everything is saved, and what is safe anyway."""
        document = self._context.session.document
        text = "● Not saved yet. " if document.dirty else "✓ Everything is saved. "
        if document.changed:
            text += escape_html(document.problem or (AUTOSAVED if document.autosave else "No copy of it is kept."))
        elif tuned := self._tuned_words():
            text += f"<br>{escape_html(tuned)}"
        set_html(self._status, card_html(text))

    def _tuned_words(self) -> str:
        """What the fidelity file beside the scene saves; looked at anew when one of the two is another."""
        from hapscene.fidelity.fidelity_file import fidelity_beside, saving_words

        session = self._context.session
        if session.path is None:
            return ""
        beside = fidelity_beside(session.path)
        stamps = [(file, file.stat().st_mtime_ns if file.is_file() else 0) for file in (session.path, beside)]
        if stamps != self._tuned[0]:
            self._tuned = stamps, saving_words(beside, session.scene)
        return self._tuned[1]

    async def save(self) -> None:
        """Save to the file that is named; ask first if that is not the one that was loaded."""
        session, path = self._context.session, Path(str(self._file.value).strip())
        await self._write(lambda force: f"Saved: {session.save(path, force)}")

    async def _export(self, target: Any) -> None:
        from hapscene.exchange import export_scene

        if self._format.value not in self._exports:
            raise SceneError("no such format")
        name, file = self._format.value, Path(str(self._target.value).strip())
        session = self._context.session

        def write(force: bool) -> str:
            made = export_scene(session.painting.snapshot(), file, name, replace=force)
            return "Exported: " + ", ".join(str(path) for path in made)

        await self._write(write)

    async def _write(self, write: Callable[[bool], str], force: bool = False) -> None:
        """Do what `write` does, and tell what it says; ask first, then with force, where that loses somebody's file."""
        try:
            said = await asyncio.get_running_loop().run_in_executor(None, write, force)
        except SaveConflict as conflict:
            self._ask(
                "Save over it?",
                f"{conflict}.",
                ("Do not save; I will give another name", None, lambda: None),
                ("Save over it", "red", lambda: self._write(write, True)),
            )
            return
        self._context.socket.say(said)
        self._show_path()

    def offer_recovery(self) -> None:
        """Ask what becomes of what painters that were killed left, one after the other."""
        document = self._context.session.document
        recovery = document.recovery()
        if recovery is None:
            return

        def then_next(act: Callable[[Recovery], object]) -> Callable[[], None]:
            def done() -> None:
                act(recovery)
                self.offer_recovery()

            return done

        when = time.strftime("%Y-%m-%d %H:%M", time.localtime(recovery.saved_s))
        name = recovery.path.name.removesuffix(SUFFIX)
        self._ask(
            "Recover your work?",
            f"A session of {name} ended without saving. Its work up to {when} is still there.",
            ("Recover it", None, then_next(document.recover)),
            ("Ask me the next time", "gray", lambda: None),
            ("Discard it", "red", then_next(document.discard_recovery)),
        )

    def _ask(self, title: str, question: str, *choices: tuple[str, str | None, Callable[[], Any]]) -> None:
        """Ask a question; each answer with its colour and what it does. It stands until one of them succeeded.

        Enter gives the first: one that loses nothing.
        """
        gui, callback = self._context.server.gui, self._context.callback
        modal = gui.add_modal(title)

        def answer(act: Callable[[], Any]) -> Callable[[Any], Any]:
            async def done(target: Any) -> None:
                result = act()
                if inspect.isawaitable(result):
                    await result
                if not modal.closed:
                    modal.close()

            return callback(done)

        with modal:
            gui.add_html(card_html(escape_html(question)))
            for label, colour, act in choices:
                gui.add_button(label, color=colour).on_click(answer(act))

    def _show_path(self) -> None:
        """Have the panel's title, and where to export to, as the scene file is called."""
        path = self._context.session.path
        if path is not None and path != self._path:
            self._path = path
            self._context.server.gui.set_panel_label(path.name)
            if self._exports:
                self._show_format()

    def _show_format(self) -> None:
        from hapscene.exchange import is_mesh_of

        export = self._exports.get(self._format.value)
        if export is None:
            return
        losses = ", ".join(export.loses) or "nothing"
        self._losses.content = card_html(f"{escape_html(export.summary)}.<br>Loses: {escape_html(losses)}.")
        stem, scene = self._path.name.removesuffix(SUFFIX), self._context.session.scene
        files = (self._path.with_name(f"{stem}{more}{export.suffix}") for more in ("", "_painted"))
        self._target.value = str(next((file for file in files if not is_mesh_of(scene, file)), ""))


def _exports() -> Mapping[str, Any]:
    """What can be exported to; nothing where the room of the formats is not there."""
    try:
        from hapscene.exchange import EXPORTS
    except ImportError:
        return {}
    return EXPORTS
