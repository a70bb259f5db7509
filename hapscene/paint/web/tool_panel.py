"""The upper part of the tab Paint: settings of the selected tool."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from hapscene.paint.model.session import FILLS
from hapscene.paint.web.context import ClientContext, Container, Control, bounded, card_html, set_html
from hapscene.paint.web.tools import RADIUS_SHARE, REGIONS, STROKES
from hapscene.view.feel_layer import SHOWS

__all__ = ["ToolPanel"]

TOOL_HINTS: Final = {
    "brush": "Drag to paint with the selected swatch.",
    "fill": "Click to fill a facet, a body or a material.",
    "sphere": "Drag outward from the centre to paint inside a sphere.",
    "eraser": "Drag to restore the default swatch.",
    "pick": "Click to select the swatch under the pointer.",
    "lasso": "Draw an outline to paint the visible surface inside it.",
    "touch": "Drag to stroke the surface with the simulated hand.",
}
"""Instructions for each tool; page.css puts before them what has to be held or turned on."""

FORCE_N: Final = (0.1, 3.0)
"""Range of the force of the hand [N]: from a light touch to the maximum of the weakest supported device."""


class ToolPanel:
    """Controls of the tools of a browser; those of the current tool are visible."""

    def __init__(self, context: ClientContext, container: Container) -> None:
        self._context = context
        gui, tools = context.gui, context.tools
        self._sliders: list[tuple[Any, str, float]] = []  # handle, attribute of the tools, factor to the shown value
        low, high, step = self._sizes()
        with container, gui.add_folder("Tool"):
            self._hint = gui.add_html("")
            hint = "Diameter of brush and eraser, and of a sphere that is clicked (keys [ and ])"
            self._size = self._slider("Size [mm]", (low, high, step), "radius_m", 2e3, hint)
            self._fill = gui.add_dropdown("Fill", FILLS, initial_value=tools.fill, hint="Area that a click fills")
            hint = "Largest angle between adjacent faces of a facet"
            self._angle = self._slider("Angle [°]", (0, 180, 1), "angle_rad", 180 / math.pi, hint)
            hint = "Width of the soft border inside the brush, relative to its radius"
            self._falloff = self._slider("Falloff [%]", (0, 100, 5), "falloff", 100, hint)
            hint = "Weight of the swatch over the present painting; blended swatches are rendered by weight"
            self._opacity = self._slider("Opacity [%]", (5, 100, 5), "opacity", 100, hint)
            hint = "Normal force of the simulated hand, whose device is set in the tab Haptics"
            self._force = self._slider("Force [N]", (*FORCE_N, 0.1), "force_N", 1, hint)
            hint = "Materials of the mesh files, paint, or paint over materials (key V)"
            self._layers = gui.add_dropdown("Show", SHOWS, initial_value=context.view.show, hint=hint)
        self._listen()
        self.show()

    def _slider(self, label: str, span: tuple[float, float, float], attribute: str, factor: float, hint: str) -> Any:
        """A slider for an attribute of the tools, shown multiplied by a factor; `span` is minimum, maximum, step."""
        low, high, step = span
        value = min(max(_round_up(factor * getattr(self._context.tools, attribute), step), low), high)
        made = self._context.gui.add_slider(label, low, high, step, value, hint=hint)
        self._sliders.append((made, attribute, factor))
        return made

    def _show_sizes(self) -> None:
        """Update the ranges of sizes after bodies have changed."""
        low, high, _ = self._sizes()
        self._size.value, self._size.max = min(self._size.value, high), high
        self._size.min = min(low, self._size.min)
        self._context.tools.resize(self._context.tools.radius_m)

    def _sizes(self) -> tuple[float, float, float]:
        """Smallest and largest diameter of the brush, and the step [mm], in proportion to the scene."""
        low, high = (2e3 * share * self._context.view.diagonal_m for share in (RADIUS_SHARE[0], RADIUS_SHARE[2]))
        step = 10.0 ** math.floor(math.log10(low))
        return _round_up(low, step), _round_up(high, step), step

    def show(self, bodies: bool = False) -> None:
        """Show the controls of the current tool and update their values, and the ranges after `bodies` have changed."""
        tools = self._context.tools
        if bodies:
            self._show_sizes()
        name, fill = tools.name, tools.fill
        set_html(self._hint, card_html(f'<span class="hs-hold"></span>{TOOL_HINTS[name]}', dim=True))
        self._size.visible = name in ("brush", "eraser", "sphere")
        self._fill.visible = name == "fill"
        self._angle.visible = name == "fill" and fill == "facet"
        self._falloff.visible = name in STROKES
        self._opacity.visible = name in (*STROKES, *REGIONS)
        self._layers.visible = self._context.view.has_look
        self._force.visible = name == "touch"
        for slider, attribute, factor in self._sliders:
            shown = min(max(factor * getattr(tools, attribute), slider.min), slider.max)
            if abs(slider.value - shown) > slider.step / 2:
                slider.value = shown
        for choice, now in ((self._fill, fill), (self._layers, self._context.view.show)):
            if choice.value != now:
                choice.value = now

    def _listen(self) -> None:
        callback, tools, view = self._context.callback, self._context.tools, self._context.view

        def choose_fill(target: Control) -> None:
            if target.value in FILLS:
                tools.fill = target.value

        def show_layers(target: Control) -> None:
            if target.value in SHOWS:
                view.show_layers(target.value)

        for slider, attribute, factor in self._sliders:
            slider.on_update(callback(partial(self._take_number, attribute, factor)))
        self._layers.on_update(callback(show_layers))
        self._fill.on_update(callback(choose_fill))

    def _take_number(self, attribute: str, factor: float, slider: Any) -> None:
        tools = self._context.tools
        value = bounded(slider.value, slider.min, slider.max, factor * getattr(tools, attribute)) / factor
        take: Callable[[float], None] = tools.resize if attribute == "radius_m" else partial(setattr, tools, attribute)
        take(value)


def _round_up(value: float, step: float) -> float:
    return round(math.ceil(value / step - 1e-9) * step, 9)
