"""What the hand holds, in the panel: device, grip, and what drives the handle."""

from dataclasses import replace
from functools import partial
from typing import Any

from hapscene.paint.hold import COMPENSATORS_TOLD, GRIP_NAMES, HELD_DEVICES
from hapscene.paint.parts import Parts, safe


class HandPanel:
    """Choices of device, grip and handle.

    Args:
        parts: the page.
        container: the tab they are in.
    """

    def __init__(self, parts: Parts, container: Any) -> None:
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
        self._told.content = f'<div class="hs-card">Heard and plotted: {safe(COMPENSATORS_TOLD[compensator])}.</div>'

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
