"""Monitor of the simulated hand: shows the touch in the view and the status line, and streams it to plots and sound."""

import asyncio
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.errors import HapsceneError
from hapscene.loop import ServoState
from hapscene.paint.web.context import PageContext

__all__ = ["Monitor"]

MONITOR_S: Final = 0.015
"""Period of the stream [s]. With 35 ms in the browser, the latency of sound is about 60 ms."""

STATUS_S: Final = 0.2
"""Period of the status line [s]: faster changes could not be read."""


class Monitor:
    """Reads the state of the hand and shows it.

    Args:
        context: the page.
        on_status: called when the status may have changed.

    Attributes:
        status: status line.
    """

    def __init__(self, context: PageContext, on_status: Callable[[], None]) -> None:
        self._context = context
        self._on_status = on_status
        self._next_status_s = 0.0
        self._shown = False
        self.status = ""

    async def run(self) -> None:
        """Show and stream the touch until cancelled."""
        while True:
            await asyncio.sleep(MONITOR_S)
            self.update(time.monotonic())

    def update(self, now_s: float) -> None:
        """Show and stream the touch since the last call."""
        touch, view, socket = self._context.touch, self._context.view, self._context.socket
        try:
            samples = touch.read(now_s)
        except HapsceneError as error:
            socket.say(str(error), "error")
            return
        state = None if samples is None or samples[0].tick < 0 else samples[0]
        if samples is not None and state is not None:
            if len(samples[1]):
                socket.trace(samples[1], samples[2], TICK_S)
            view.show_touch(state.p_WT_m, state.p_WP_m, state.f_W_N)
        elif self._shown:
            view.show_touch(None)
        self._shown = state is not None
        if now_s >= self._next_status_s:
            self._next_status_s = now_s + STATUS_S
            self.status = self._status_of(state)
            self._on_status()

    def _status_of(self, state: ServoState | None) -> str:
        swatches, touch = self._context.session.scene.swatches, self._context.touch
        if touch.status == "starting":
            return f"Starting the simulated hand: {touch.stage} … You can paint meanwhile."
        if touch.status != "ready":
            return touch.problem or "The simulated hand is off."
        if state is None:
            return "Ready to touch: select Touch and drag on the surface."
        if not state.touching or not 0 <= state.swatch < len(swatches):
            return f"No contact · {touch.config}"
        force_N = float(np.linalg.norm(state.f_W_N))
        name = swatches[state.swatch].name
        return f"{name}: {force_N:.2f} N · {1e3 * state.depth_m:.2f} mm deep · {1e3 * state.slip_m_s:.0f} mm/s"
