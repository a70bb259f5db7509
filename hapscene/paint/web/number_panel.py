"""The numbers of the swatch that is painted with, as sliders: what they change is felt and heard at once."""

import math
from functools import partial
from typing import Any, Final

from hapscene.errors import SwatchError
from hapscene.paint.parameter import Parameter
from hapscene.paint.web.page_context import PageContext, bounded, bytes_of, escape_html, set_html
from hapscene.surface.swatch import Swatch

STEP_COUNT = 200
"""About how many steps a slider has [count]: finer than what is felt apart, 2 % of stiffness at its middle."""

FIGURES: Final = 4
"""How many figures of a number a field has room for [count]."""

NAME_MAX: Final = 24
"""Longest name over the sliders [characters]: a longer one would run out of the panel."""


class NumberPanel:
    """Sliders of the chosen swatch; made anew when another is chosen.

    Args:
        parts: the page.
        container: the tab they are in.
    """

    def __init__(self, parts: PageContext, container: Any) -> None:
        self._parts = parts
        self._container = container
        self._shown: tuple[Any, ...] = ()
        self._sliders: dict[str, Any] = {}
        with container:
            self._head = parts.server.gui.add_html("")
            self._folder: Any = None
        self.show()

    def show(self) -> None:
        """Have the sliders as the swatch is."""
        parts = self._parts
        index = parts.tools.swatch
        if index is None:  # not painted with yet, or that was undone
            self._clear(f"<b>{escape_html(parts.tools.chosen)}</b> has its numbers here as soon as it is painted with.")
            return
        found = [p for p in parts.session.parameters(index) if p.applies]
        swatch = parts.session.scene.swatches[index]
        shape = (index, swatch.name, parts.session.device, *((p.name, p.minimum, p.maximum) for p in found))
        if shape != self._shown:
            self._make(found, swatch)
            self._shown = shape
        told = (
            f"as it is painted with; every change is felt and heard at once. Limits are those of the "
            f"{escape_html(parts.session.device)}."
            if found
            else "is what every face has until it is painted, and stays as it is. A copy of it can be tuned."
        )
        notes = "".join(f"<br>⚠ {escape_html(p.note)}" for p in found if p.note)
        set_html(self._head, f'<div class="hs-card"><b>{escape_html(swatch.name)}</b> {told}{notes}</div>')
        for p in found:
            slider = self._sliders[p.name]
            if slider.value != _told(p.value):
                slider.value = _told(p.value)
        if found and tuple(self._colour.value) != rgb_of(swatch):
            self._colour.value = rgb_of(swatch)

    def _make(self, found: list[Parameter], swatch: Swatch) -> None:
        gui, on, name = self._parts.server.gui, self._parts.on, swatch.name
        self._clear()
        with self._container:
            self._folder = gui.add_folder(f"Numbers of {_short(name)}")
        with self._folder:
            for p in found:
                step = _step(p.maximum - p.minimum)
                unit = "" if p.unit in ("1", "") else f" [{p.unit}]"
                slider = gui.add_slider(
                    _capital(p.label) + unit,
                    min=min(p.minimum, _told(p.value)),
                    max=max(math.floor(p.maximum / step + 1e-9) * step, _told(p.value)),
                    step=step,
                    initial_value=_told(p.value),
                    hint=f"{_capital(p.meaning)}; {p.reset:.4g} to begin with",
                )
                slider.precision = FIGURES  # of the field: else it rounds to the step what is typed
                slider.on_update(on(partial(self._tune, p)))
                self._sliders[p.name] = slider
            if found:
                self._colour = gui.add_rgb("Colour", rgb_of(swatch), hint="As it is shown, and exported")
                self._colour.on_update(on(self._recolour))
            self._name = gui.add_text("New name", f"{name} 2" if name.startswith("my ") else f"my {name}")
            for label, hint, act in BUTTONS[: None if found else 1]:  # plain can only be copied
                gui.add_button(label, hint=hint).on_click(on(partial(act, self)))

    def _clear(self, told: str = "") -> None:
        if self._folder is not None:
            self._folder.remove()
        self._folder, self._sliders, self._shown = None, {}, ()
        set_html(self._head, told and f'<div class="hs-card">{told}</div>')

    def _tune(self, p: Parameter, target: Any) -> None:
        value = bounded(target.value, p.minimum, p.maximum, p.value)
        self._parts.session.tune(self._parts.tools.ink(), **{p.name: value})

    def _recolour(self, target: Any) -> None:
        red, green, blue = target.value
        self._parts.session.recolour(self._parts.tools.ink(), (red / 255, green / 255, blue / 255))

    def _reset(self, target: Any) -> None:
        if not self._parts.session.reset(self._parts.tools.ink()):
            self._parts.live.say("These are the numbers that it came with.")

    def _copy(self, target: Any) -> None:
        session, name = self._parts.session, self._new_name()
        index = session.copy_swatch(self._parts.tools.ink(), name)
        self._parts.tools.take(name, session.scene.swatches[index])

    def _new_name(self) -> str:
        name = str(self._name.value).strip()
        if not name:
            raise SwatchError("give the new swatch a name")
        return name

    def _save(self, target: Any) -> None:
        name = self._new_name()
        index = self._parts.tools.ink()
        file = self._parts.session.save_swatch_as(index, name)
        self._parts.tools.take(name, self._parts.session.scene.swatches[index])
        self._parts.live.say(f"{name!r} is in your library: {file}")


def _step(span: float) -> float:
    """A round step for a slider."""
    if span <= 0.0:
        return 1e-3
    rough = span / STEP_COUNT
    power = 10.0 ** math.floor(math.log10(rough))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * 0.999))


def _told(value: float) -> float:
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


def rgb_of(swatch: Swatch) -> tuple[int, int, int]:
    """Its colour, 0 to 255 each."""
    return bytes_of(swatch.albedo_rgb)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
