"""The numbers of the swatch that is painted with, as sliders: what they change is felt and heard at once."""

import math
from functools import partial
from typing import Any

from hapscene.errors import SwatchError
from hapscene.paint.parameter import Parameter
from hapscene.paint.parts import Parts, bounded, safe

STEP_COUNT = 200
"""About how many steps a slider has [count]: finer than what is felt apart, 2 % of stiffness at its middle."""


class NumberPanel:
    """Sliders of the chosen swatch; made anew when another is chosen.

    Args:
        parts: the page.
        container: the tab they are in.
    """

    def __init__(self, parts: Parts, container: Any) -> None:
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
        if index is None:  # its adding was undone: painting with it adds it again
            self._clear()
            return
        found = [p for p in parts.session.parameters(index) if p.applies]
        swatch = parts.session.scene.swatches[index]
        shape = (index, swatch.name, parts.session.device, *((p.name, p.minimum, p.maximum) for p in found))
        if shape != self._shown:
            self._make(found, swatch.name)
            self._shown = shape
        told = (
            f"as it is painted with; every change is felt and heard at once. Limits are those of the "
            f"{safe(parts.session.device)}."
            if found
            else "is what every face has until it is painted, and stays as it is. A copy of it can be tuned."
        )
        notes = "".join(f"<br>⚠ {safe(p.note)}" for p in found if p.note)
        content = f'<div class="hs-card"><b>{safe(swatch.name)}</b> {told}{notes}</div>'
        if self._head.content != content:
            self._head.content = content
        for p in found:
            slider = self._sliders[p.name]
            if abs(slider.value - p.value) > 1e-9 * max(1.0, abs(p.value)):
                slider.value = p.value

    def _make(self, found: list[Parameter], name: str) -> None:
        gui, on = self._parts.server.gui, self._parts.on
        self._clear()
        with self._container:
            self._folder = gui.add_folder(f"Numbers of {name}")
        with self._folder:
            for p in found:
                step = _step(p.maximum - p.minimum)
                unit = "" if p.unit in ("1", "") else f" [{p.unit}]"
                slider = gui.add_slider(
                    _capital(p.label) + unit,
                    min=p.minimum,
                    max=max(math.floor(p.maximum / step + 1e-9) * step, p.value),
                    step=step,
                    initial_value=p.value,
                    hint=f"{_capital(p.meaning)}; {p.reset:.4g} to begin with",
                )
                slider.on_update(on(partial(self._tune, p)))
                self._sliders[p.name] = slider
            self._name = gui.add_text("New name", f"{name} 2" if name.startswith("my ") else f"my {name}")
            if not found:  # plain
                gui.add_button("Copy", hint="A new swatch to tune and to paint with").on_click(on(self._copy))
                return
            gui.add_button("Reset", hint="Back to the numbers that the swatch came with").on_click(on(self._reset))
            gui.add_button("Save as new swatch", hint="Into your library: on the shelf from now on").on_click(
                on(self._save)
            )

    def _clear(self) -> None:
        if self._folder is not None:
            self._folder.remove()
        self._folder, self._sliders, self._shown = None, {}, ()
        self._head.content = ""

    def _tune(self, p: Parameter, target: Any) -> None:
        value = bounded(target.value, p.minimum, p.maximum, p.value)
        self._parts.session.tune(self._parts.tools.ink(), **{p.name: value})

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


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
