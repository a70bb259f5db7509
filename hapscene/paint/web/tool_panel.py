"""The settings of the tools, in the panel."""

import math
from dataclasses import replace
from functools import partial
from typing import Any, Final

from hapscene.errors import SceneError
from hapscene.paint.history import faces_word
from hapscene.paint.web.hand_config import COMPENSATORS_TOLD, GRIP_NAMES, HELD_DEVICES
from hapscene.paint.web.page_context import PageContext, bounded, escape_html, set_html
from hapscene.paint.web.tools import FILLS, RADIUS_SHARE

FORCE_N = (0.1, 3.0)
"""Least and most force of the hand [N]: a light touch, and what the weakest device shipped can push back with."""

ALL = "all of it"

TOLD: Final = {
    "brush": "Hold Shift and drag: paints the chosen swatch.",
    "fill": "Hold Shift and click: fills from there; or choose a part.",
    "box": "Hold Shift and drag from corner to corner: what is inside is painted.",
    "sphere": "Hold Shift and drag from the middle outward: what is inside is painted.",
    "eraser": "Hold Shift and drag: brings back what the body was made of.",
    "pick": "Hold Shift and click: takes the swatch that is painted there.",
    "touch": "Hold Shift and drag: a hand strokes the surface.",
}
"""What each tool does."""


class ToolPanel:
    """Sliders and choices of the tools; those of the tool in hand are seen.

    Args:
        parts: the page.
    """

    def __init__(self, parts: PageContext) -> None:
        self._parts = parts
        gui, tools = parts.server.gui, parts.tools
        low, high = (2e3 * share * parts.view.diagonal_m for share in (RADIUS_SHARE[0], RADIUS_SHARE[2]))
        step = 10.0 ** math.floor(math.log10(low))
        with gui.add_folder("Tool"):
            self._told = gui.add_html("")
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
            self._grow = gui.add_slider(
                "Depth [mm]",
                min=step,
                max=_round_up(high, step),
                step=step,
                initial_value=_round_up(1e3 * tools.grow_m, step),
                hint="How far the box reaches beyond the two places that span it",
            )
            self._groups = {f"{b.name}: {name}": (b.name, name) for b, name in _groups(parts)}
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
        tools = self._parts.tools
        name, fill = tools.name, tools.fill
        set_html(self._told, f'<div class="hs-card dim">{TOLD[name]}</div>')
        self._size.visible = name in ("brush", "eraser", "sphere")
        self._fill.visible = self._group.visible = self._group_button.visible = name == "fill"
        self._angle.visible = name == "fill" and fill == "facet"
        self._grow.visible = name == "box"
        self._force.visible = name == "touch"
        if abs(self._size.value - 2e3 * tools.radius_m) > self._size.step / 2:
            self._size.value = 2e3 * tools.radius_m

    def _listen(self) -> None:
        on, tools = self._parts.on, self._parts.tools

        def angle(target: Any) -> None:
            tools.angle_rad = math.radians(bounded(target.value, 0.0, 180.0, math.degrees(tools.angle_rad)))

        def grow(target: Any) -> None:
            tools.grow_m = 1e-3 * bounded(target.value, target.min, target.max, 1e3 * tools.grow_m)

        def fill(target: Any) -> None:
            tools.fill = target.value if target.value in FILLS else tools.fill

        def force(target: Any) -> None:
            tools.force_N = bounded(target.value, *FORCE_N, tools.force_N)

        self._size.on_update(on(lambda t: tools.resize(5e-4 * bounded(t.value, 0.0, 1e6, 2e3 * tools.radius_m))))
        self._angle.on_update(on(angle))
        self._grow.on_update(on(grow))
        self._fill.on_update(on(fill))
        self._force.on_update(on(force))
        self._group_button.on_click(on(self._fill_group))

    def _fill_group(self, target: Any) -> None:
        if self._group.value not in self._groups:
            raise SceneError("no such part")
        body, name = self._groups[self._group.value]
        parts = self._parts
        if name == ALL:
            count = parts.session.fill_body(body, parts.tools.ink())
        else:
            count = parts.session.fill_group(body, name, parts.tools.ink())
        parts.live.say(f"{faces_word(count)} painted." if count else "It is painted so already.")


def _groups(parts: PageContext) -> list[tuple[Any, str]]:
    """Every body, whole, and its parts where it has several."""
    found = []
    for body in parts.session.scene.bodies:
        found.append((body, ALL))
        groups = parts.session.groups(body.name)
        if len(groups) > 1:
            found += [(body, name) for name, _ in groups]
    return found


def _round_up(value: float, step: float) -> float:
    return round(math.ceil(value / step - 1e-9) * step, 9)


# What the hand holds, in the panel: device, grip, and what drives the handle.


class HandPanel:
    """Choices of device, grip and handle.

    Args:
        parts: the page.
        container: the tab they are in.
    """

    def __init__(self, parts: PageContext, container: Any) -> None:
        self._parts = parts
        gui, on, hold = parts.server.gui, parts.on, parts.touch.hold
        with container, gui.add_folder("Hand"):
            device = gui.add_dropdown(
                "Device",
                tuple(HELD_DEVICES),
                initial_value=hold.device,
                hint="What the hand holds; its limits apply. omni is the whole arm, with its friction, bending and "
                "motors; the others are a mass with friction that reaches everywhere",
            )
            grip = gui.add_dropdown("Grip", GRIP_NAMES, initial_value=hold.grip, hint="How firmly the hand holds it")
            handle = gui.add_dropdown(
                "Handle",
                tuple(COMPENSATORS_TOLD),
                initial_value=hold.compensator,
                hint="What drives the voice coil in the handle, which makes textures and taps; or no handle at all",
            )
            self._told = gui.add_html("")
        parts.session.choose_device(hold.limits)
        device.on_update(on(partial(self._choose, "device")))
        grip.on_update(on(self._choose_grip))
        handle.on_update(on(partial(self._choose, "compensator")))
        self._tell()

    def _tell(self) -> None:
        compensator = self._parts.touch.hold.compensator
        self._told.content = (
            f'<div class="hs-card">Heard and plotted: {escape_html(COMPENSATORS_TOLD[compensator])}.</div>'
        )

    def _choose_grip(self, target: Any) -> None:
        touch = self._parts.touch
        touch.hold = replace(touch.hold, grip=target.value)

    async def _choose(self, what: str, target: Any) -> None:
        """Hold something else: the hand starts anew, the painting stays."""
        session, touch = self._parts.session, self._parts.touch
        touch.hold = replace(touch.hold, **{what: target.value})
        session.choose_device(touch.hold.limits)
        self._tell()
        self._parts.changed()  # the limits are others at once
        if touch.status != "closed":
            await touch.open(session.snapshot(), session.tick_s)
