"""What the hand of the tab Feel holds: device, grip and handle; and presets of hand and brush."""

import math
from dataclasses import replace
from functools import partial
from typing import Any, Final

from hapscene.paint.preset import PresetError, load_presets, save_preset
from hapscene.paint.session import FILLS
from hapscene.paint.web.hand_config import COMPENSATOR_HINTS, GRIP_NAMES, HAND_DEVICES
from hapscene.paint.web.page_context import PageContext, bounded, card_html, escape_html
from hapscene.paint.web.tool_panel import FORCE_N

NO_PRESET: Final = "none"

BRUSH: Final = {
    **{"radius_m": 10.0, "margin_m": 10.0, "angle_rad": math.pi, "force_N": FORCE_N[1], "fill": 0.0},
    **{"softness": 1.0, "opacity": 1.0, "through": 1.0},
}
"""What of the tools a preset keeps, and the most of it."""


def _names() -> list[str]:
    try:
        return sorted(load_presets())
    except PresetError:  # said when one is saved
        return []


class HandPanel:
    """Choices of device, grip and handle, and of presets.

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
        self._choices = {"device": device, "grip": grip, "compensator": handle}
        context.session.tuning.choose_device(config.limits)
        device.on_update(callback(partial(self._choose, "device")))
        grip.on_update(callback(self._choose_grip))
        handle.on_update(callback(partial(self._choose, "compensator")))
        with container, gui.add_folder("Presets", expand_by_default=False):
            self._presets = gui.add_dropdown("Preset", (NO_PRESET, *_names()), hint="Hand and brush as they were saved")
            self._name = gui.add_text("Name", "", hint="To save hand and brush under as they are now")
            save = gui.add_button("Save preset", hint="In your own folder, for all scenes")
            delete = gui.add_button("Delete preset", hint="The one that is chosen")
        self._presets.on_update(callback(self._take))
        save.on_click(callback(self._save))
        delete.on_click(callback(self._delete))
        self._show_heard()

    # --- presets ---

    def _save(self, target: Any) -> None:
        context, name = self._context, str(self._name.value).strip()
        if name == NO_PRESET:
            raise PresetError(f"{NO_PRESET!r} stands for no preset: give another name")
        kept = {key: getattr(context.touch.config, key) for key in self._choices}
        save_preset(name, kept | {key: getattr(context.tools, key) for key in BRUSH if hasattr(context.tools, key)})
        self.show_presets(name)
        context.socket.say(f"Preset {name!r} saved.")

    def _delete(self, target: Any) -> None:
        name = str(self._presets.value)
        if name == NO_PRESET:
            raise PresetError("choose the preset to delete first")
        save_preset(name, None)
        self.show_presets(NO_PRESET)
        self._context.socket.say(f"Preset {name!r} deleted.")

    def show_presets(self, name: str) -> None:
        """Offer those that there are, with one chosen."""
        self._presets.options = (NO_PRESET, *_names())
        self._presets.value = name

    async def _take(self, target: Any) -> None:
        """Have hand and brush as in a preset: of it what is known, and within bounds."""
        preset, tools = load_presets().get(str(target.value), {}), self._context.tools
        for key, bounds in BRUSH.items():
            value = preset.get(key)
            if key == "radius_m" and value is not None:
                tools.resize(bounded(value, 0.0, bounds, tools.radius_m))
            elif key == "fill" and value in FILLS:
                tools.fill = value
            elif hasattr(tools, key) and isinstance(value, int | float):
                before = getattr(tools, key)
                setattr(tools, key, value if isinstance(before, bool) else bounded(value, 0.0, bounds, before))
        for key, choice in self._choices.items():
            if preset.get(key) in choice.options and choice.value != preset[key]:
                choice.value = preset[key]
                if key == "grip":
                    self._choose_grip(choice)
                else:
                    await self._choose(key, choice)

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
