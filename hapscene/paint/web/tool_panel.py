"""The tab Paint above its shelf: the tool, and its settings."""

import math
from functools import partial
from typing import Any, Final

from hapscene.errors import SceneError
from hapscene.paint.history import face_count_text
from hapscene.paint.session import FILLS
from hapscene.paint.symmetry import Symmetry
from hapscene.paint.web.page_context import PageContext, bounded, card_html, set_html
from hapscene.paint.web.tools import RADIUS_SHARE, REGIONS, STROKES

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
    """Sliders and choices of the tools; those of the tool in hand are seen.

    Args:
        context: the page.
    """

    def __init__(self, context: PageContext) -> None:
        self._context = context
        gui, tools = context.server.gui, context.tools
        low, high, step = self._sizes()
        self._groups = self._grouped()

        def slider(label: str, low: float, high: float, step: float, value: float, hint: str) -> Any:
            return gui.add_slider(label, min=low, max=high, step=step, initial_value=value, hint=hint)

        def size(label: str, low: float, value_m: float, hint: str) -> Any:
            return slider(f"{label} [mm]", low, high, step, _round_up(1e3 * value_m, step), hint)

        def percent(label: str, low: int, value: int, hint: str) -> Any:
            return slider(f"{label} [%]", low, 100, 5, value, hint)

        with gui.add_folder("Tool"):
            self._hint = gui.add_html("")
            told = "Diameter of brush, eraser, and of a sphere that is clicked; keys [ and ]"
            self._size = size("Size", low, 2 * tools.radius_m, told)
            self._fill = gui.add_dropdown("Fill", FILLS, initial_value=tools.fill, hint="What a click fills")
            angle = round(math.degrees(tools.angle_rad))
            self._angle = slider("Angle [°]", 0, 180, 1, angle, "A facet goes on over edges that bend by at most this")
            told = "How far the box reaches beyond the two places that span it"
            self._margin = size("Depth", step, tools.margin_m, told)
            self._group = gui.add_dropdown("Part", tuple(self._groups), hint="A material, object or group of the file")
            self._group_button = gui.add_button("Fill this part", hint="Paints the part with the chosen swatch")
            told = "How far the chosen swatch grows or shrinks, along all of its border"
            self._by = size("Border", step, tools.margin_m, told)
            self._border = gui.add_button_group("Swatch", BORDER, hint="On all bodies that are seen and not locked")
            told = "How far in from the edge of the brush its swatch fades into what is there"
            self._softness = percent("Softness", 0, 0, told)
            told = "How much of the swatch is put over what is there: two swatches are felt at once, by weight"
            self._opacity = percent("Opacity", 5, 100, told)
            told = "With which the hand presses on the surface; what it holds is chosen in the tab Feel"
            self._force = slider("Force [N]", *FORCE_N, 0.1, tools.force_N, told)
            self._more = gui.add_folder("More", expand_by_default=False)
            with self._more:
                told = "Paints the same on the other side of planes through the body's middle"
                self._mirrors = gui.add_dropdown("Mirror", MIRRORS, hint=told)
                self._turns = slider("Around", 1, 24, 1, 1, "How often it is painted around the axis")
                self._axis = gui.add_dropdown("Axis", tuple("xyz"), initial_value="z", hint="Through the body's middle")
                told = "Shows what is unpainted as the file colours it; else all in the colours of swatches"
                has = context.view.has_file_colours
                self._colours = gui.add_checkbox("File's colours", True, visible=has, hint=told)
                told = "Paints also what is not seen: backs, and what something else hides"
                self._through = gui.add_checkbox("Paint through", tools.through, hint=told)
        self._listen()
        self.show()

    def show_bodies(self) -> None:
        """There are other bodies."""
        self._groups = self._grouped()
        self._group.options = tuple(self._groups)
        low, high, _ = self._sizes()
        for slider in (self._size, self._margin, self._by):
            slider.value, slider.max = min(slider.value, high), high
        self._size.min = min(low, self._size.min)
        self._context.tools.resize(self._context.tools.radius_m)

    def _sizes(self) -> tuple[float, float, float]:
        """Smallest and largest diameter of the brush, and their step [mm]: as the scene is large."""
        low, high = (2e3 * share * self._context.view.diagonal_m for share in (RADIUS_SHARE[0], RADIUS_SHARE[2]))
        step = 10.0 ** math.floor(math.log10(low))
        return _round_up(low, step), _round_up(high, step), step

    def _grouped(self) -> dict[str, tuple[str, str]]:
        return {f"{b.name}: {name}": (b.name, name) for b, name in _groups(self._context)}

    def show(self) -> None:
        """See the settings of the tool in hand, and their values as they are."""
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
        for slider, value in (
            (self._size, 2e3 * tools.radius_m),
            (self._angle, math.degrees(tools.angle_rad)),
            (self._margin, 1e3 * tools.margin_m),
            (self._softness, 100 * tools.softness),
            (self._opacity, 100 * tools.opacity),
            (self._force, tools.force_N),
        ):
            shown = min(max(value, slider.min), slider.max)
            if abs(slider.value - shown) > slider.step / 2:
                slider.value = shown
        for choice, now in ((self._fill, fill), (self._through, tools.through)):
            if choice.value != now:
                choice.value = now

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

        def through(target: Any) -> None:
            tools.through = bool(target.value)

        def symmetry(target: Any) -> None:
            mirrors = "" if self._mirrors.value == MIRRORS[0] else str(self._mirrors.value).replace(" ", "")
            tools.symmetry = Symmetry(mirrors, int(self._turns.value), str(self._axis.value))

        def percent(name: str, slider: Any) -> None:
            setattr(tools, name, bounded(slider.value, slider.min, slider.max, 100 * getattr(tools, name)) / 100)

        for control in (self._mirrors, self._turns, self._axis):
            control.on_update(callback(symmetry))
        self._softness.on_update(callback(partial(percent, "softness")))
        self._opacity.on_update(callback(partial(percent, "opacity")))
        self._colours.on_update(callback(lambda target: self._context.view.show_file_colours(bool(target.value))))
        self._through.on_update(callback(through))
        self._size.on_update(callback(lambda t: tools.resize(5e-4 * bounded(t.value, 0.0, 1e6, 2e3 * tools.radius_m))))
        self._angle.on_update(callback(angle))
        self._margin.on_update(callback(margin))
        self._fill.on_update(callback(fill))
        self._force.on_update(callback(force))
        self._group_button.on_click(callback(self._fill_group))
        self._border.on_click(callback(self._grow))

    def _fill_group(self, target: Any) -> None:
        if self._group.value not in self._groups:
            raise SceneError("no such part")
        body, name = self._groups[self._group.value]
        context = self._context
        session, swatch = context.session, context.tools.ensure_swatch()
        count = session.fill_body(body, swatch) if name == ALL else session.fill_group(body, name, swatch)
        context.socket.say(f"{face_count_text(count)} painted." if count else "It is painted so already.")

    def _grow(self, target: Any) -> None:
        tools, session = self._context.tools, self._context.session
        by_m = 1e-3 * bounded(self._by.value, 0.0, 1e6, 1.0)
        count = 0 if tools.swatch is None else session.grow(tools.swatch, by_m if target.value == BORDER[0] else -by_m)
        none = f"Nothing is painted with {tools.chosen} that could: it is nowhere, everywhere, hidden or locked."
        self._context.socket.say(f"{face_count_text(count)} painted." if count else none)


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
