"""The numbers of the chosen swatch in the tab Feel."""

import math
from functools import partial
from typing import Any, Final

from hapscene.errors import SwatchError
from hapscene.paint.composing import numbered
from hapscene.paint.parameter import Parameter
from hapscene.paint.web.page_context import PageContext, bounded, card_html, escape_html, set_html
from hapscene.paint.web.scene_view import rgb_bytes
from hapscene.surface.swatch import Swatch

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
            taken = [known.name for known in self._context.session.scene.swatches]
            own = name if name.startswith("my ") else f"my {name}"
            self._name = gui.add_text("New name", numbered(own, taken))
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
    ("Save as new", "Into your library under the new name, which it has from now on", NumberPanel._save),
    ("Reset", "Back to what the swatch came with", NumberPanel._reset),
)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
