"""The tab Paint above the swatches: the tool and its settings."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from hapscene.errors import SceneError
from hapscene.paint.model.history import face_count_text
from hapscene.paint.model.session import FILLS
from hapscene.paint.model.strokes import Symmetry
from hapscene.paint.web.context import PageContext, bounded, card_html, set_html
from hapscene.paint.web.tools import RADIUS_SHARE, REGIONS, STROKES

__all__ = ["ToolPanel"]

TOOL_HINTS: Final = {
    "brush": "Hold Shift and drag: paints the chosen swatch.",
    "fill": "Hold Shift and click: fills from there; or choose a part.",
    "box": "Hold Shift and drag from corner to corner: what is inside is painted.",
    "sphere": "Hold Shift and drag from the middle outward: what is inside is painted.",
    "eraser": "Hold Shift and drag: brings back what the body was made of.",
    "pick": "Hold Shift and click: takes the swatch that is painted there.",
    "lasso": "Hold Shift and draw around what is seen: all inside is painted.",
    "polygon": "Hold Shift and click the corners; Enter, or a click on the first, paints what is seen inside.",
    "touch": "Hold Shift and drag: a hand strokes the surface.",
}
"""What each tool does."""

FORCE_N: Final = (0.1, 3.0)
"""Least and most force of the hand [N]: a light touch, and what the weakest device shipped can push back with."""

MIRRORS: Final = ("no", "x", "y", "z", "x y", "x z", "y z", "x y z")

ALL: Final = "all of it"

BORDER: Final = ("Grow", "Shrink")


class ToolPanel:
    """Sliders and choices of the tools; those of the current tool are visible.

    Args:
        context: the page.
    """

    def __init__(self, context: PageContext) -> None:
        self._context = context
        gui, tools = context.server.gui, context.tools
        self._groups = self._grouped()
        self._sliders: list[tuple[Any, str, float]] = []  # handle, attribute of the tools, factor to what is shown
        low, high, step = self._sizes()
        with gui.add_folder("Tool"):
            self._hint = gui.add_html("")
            told = "Diameter of brush, eraser, and of a sphere that is clicked; keys [ and ]"
            self._size = self._slider("Size [mm]", (low, high, step), "radius_m", 2e3, told)
            self._fill = gui.add_dropdown("Fill", FILLS, initial_value=tools.fill, hint="What a click fills")
            told = "A facet goes on over edges that bend by at most this"
            self._angle = self._slider("Angle [°]", (0, 180, 1), "angle_rad", 180 / math.pi, told)
            told = "How far the box reaches beyond the two places that span it"
            self._margin = self._slider("Depth [mm]", (step, high, step), "margin_m", 1e3, told)
            self._group = gui.add_dropdown("Part", tuple(self._groups), hint="A material, object or group of the file")
            self._group_button = gui.add_button("Fill this part", hint="Paints the part with the chosen swatch")
            told = "How far the chosen swatch grows or shrinks, along all of its border"
            self._by = gui.add_slider("Border [mm]", step, high, step, _round_up(1e3 * tools.margin_m, step), hint=told)
            self._border = gui.add_button_group("Swatch", BORDER, hint="On all bodies that are seen and not locked")
            told = "How far in from the edge of the brush its swatch fades into what is there"
            self._softness = self._slider("Softness [%]", (0, 100, 5), "softness", 100, told)
            told = "How much of the swatch is put over what is there: two swatches are felt at once, by weight"
            self._opacity = self._slider("Opacity [%]", (5, 100, 5), "opacity", 100, told)
            told = "With which the hand presses on the surface; what it holds is chosen in the tab Feel"
            self._force = self._slider("Force [N]", (*FORCE_N, 0.1), "force_N", 1, told)
            self._more = gui.add_folder("More", expand_by_default=False)
            with self._more:
                told = "Paints the same on the other side of planes through the body's middle"
                self._mirrors = gui.add_dropdown("Mirror", MIRRORS, hint=told)
                self._turns = gui.add_slider("Around", 1, 24, 1, 1, hint="How often it is painted around the axis")
                self._axis = gui.add_dropdown("Axis", tuple("xyz"), initial_value="z", hint="Through the body's middle")
                told = "Shows what is unpainted as the file colours it; else all in the colours of swatches"
                has = context.view.has_file_colours
                self._colours = gui.add_checkbox("File's colours", True, visible=has, hint=told)
                told = "Paints also what is not seen: backs, and what something else hides"
                self._through = gui.add_checkbox("Paint through", tools.through, hint=told)
        self._listen()
        self.show()

    def _slider(self, label: str, span: tuple[float, float, float], attribute: str, factor: float, hint: str) -> Any:
        """A slider of a number of the tools, shown times a factor, from and to and in steps of `span`."""
        low, high, step = span
        value = min(max(_round_up(factor * getattr(self._context.tools, attribute), step), low), high)
        made = self._context.server.gui.add_slider(label, low, high, step, value, hint=hint)
        self._sliders.append((made, attribute, factor))
        return made

    def show_bodies(self) -> None:
        """Update the parts and the ranges of sizes: there are other bodies."""
        self._groups = self._grouped()
        self._group.options = tuple(self._groups)
        low, high, _ = self._sizes()
        for slider in (self._size, self._margin, self._by):
            slider.value, slider.max = min(slider.value, high), high
        self._size.min = min(low, self._size.min)
        self._context.tools.resize(self._context.tools.radius_m)

    def _sizes(self) -> tuple[float, float, float]:
        """Smallest and largest diameter of the brush, and their step [mm], in proportion to the scene."""
        low, high = (2e3 * share * self._context.view.diagonal_m for share in (RADIUS_SHARE[0], RADIUS_SHARE[2]))
        step = 10.0 ** math.floor(math.log10(low))
        return _round_up(low, step), _round_up(high, step), step

    def _grouped(self) -> dict[str, tuple[str, str]]:
        """Body and group by label: every body, whole, and its parts where it has several."""
        session, found = self._context.session, {}
        for body in session.scene.bodies:
            groups = [name for name, _ in session.groups(body.name)]
            for name in (ALL, *groups) if len(groups) > 1 else (ALL,):
                found[f"{body.name}: {name}"] = body.name, name
        return found

    def show(self) -> None:
        """Show the settings of the current tool, and their values."""
        tools = self._context.tools
        name, fill = tools.name, tools.fill
        set_html(self._hint, card_html(TOOL_HINTS[name], dim=True))
        self._size.visible = name in ("brush", "eraser", "sphere")
        for control in (self._fill, self._group, self._group_button, self._by, self._border):
            control.visible = name == "fill"
        self._angle.visible = name == "fill" and fill == "facet"
        self._margin.visible = name == "box"
        painting = name in (*STROKES, *REGIONS, "polygon")
        self._softness.visible = name in STROKES
        for control in (self._opacity, self._mirrors, self._turns, self._through):
            control.visible = painting
        self._more.visible = painting or self._colours.visible
        self._axis.visible = painting and tools.symmetry.turns > 1
        self._force.visible = name == "touch"
        for slider, attribute, factor in self._sliders:
            shown = min(max(factor * getattr(tools, attribute), slider.min), slider.max)
            if abs(slider.value - shown) > slider.step / 2:
                slider.value = shown
        for choice, now in ((self._fill, fill), (self._through, tools.through)):
            if choice.value != now:
                choice.value = now

    def _listen(self) -> None:
        callback, tools = self._context.callback, self._context.tools

        def fill(target: Any) -> None:
            tools.fill = target.value if target.value in FILLS else tools.fill

        def through(target: Any) -> None:
            tools.through = bool(target.value)

        def symmetry(target: Any) -> None:
            mirrors = "" if self._mirrors.value == MIRRORS[0] else str(self._mirrors.value).replace(" ", "")
            tools.symmetry = Symmetry(mirrors, int(self._turns.value), str(self._axis.value))

        for slider, attribute, factor in self._sliders:
            slider.on_update(callback(partial(self._take_number, attribute, factor)))
        for control in (self._mirrors, self._turns, self._axis):
            control.on_update(callback(symmetry))
        self._colours.on_update(callback(lambda target: self._context.view.show_file_colours(bool(target.value))))
        self._through.on_update(callback(through))
        self._fill.on_update(callback(fill))
        self._group_button.on_click(callback(self._fill_group))
        self._border.on_click(callback(self._grow))

    def _take_number(self, attribute: str, factor: float, slider: Any) -> None:
        tools = self._context.tools
        value = bounded(slider.value, slider.min, slider.max, factor * getattr(tools, attribute)) / factor
        take: Callable[[float], None] = tools.resize if attribute == "radius_m" else partial(setattr, tools, attribute)
        take(value)

    def _fill_group(self, target: Any) -> None:
        if self._group.value not in self._groups:
            raise SceneError("no such part")
        body, name = self._groups[self._group.value]
        session, swatch = self._context.session, self._context.tools.ensure_swatch()
        count = session.fill_body(body, swatch) if name == ALL else session.fill_group(body, name, swatch)
        self._context.socket.say(f"{face_count_text(count)} painted." if count else "It is painted so already.")

    def _grow(self, target: Any) -> None:
        tools, session = self._context.tools, self._context.session
        by_m = 1e-3 * bounded(self._by.value, 0.0, 1e6, 1.0)
        count = 0 if tools.swatch is None else session.grow(tools.swatch, by_m if target.value == BORDER[0] else -by_m)
        none = f"Nothing is painted with {tools.chosen} that could: it is nowhere, everywhere, hidden or locked."
        self._context.socket.say(f"{face_count_text(count)} painted." if count else none)


def _round_up(value: float, step: float) -> float:
    return round(math.ceil(value / step - 1e-9) * step, 9)
