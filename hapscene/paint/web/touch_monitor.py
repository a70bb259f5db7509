"""The live monitor: what the hand feels, shown on the scene, told in a line, and sent to be plotted and heard."""

import asyncio
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from hapscene.errors import HapsceneError
from hapscene.paint.web.page_context import PageContext
from hapscene.paint.web.stroke_recorder import StrokeRecorder
from hapscene.servo import ServoState

MONITOR_S: Final = 0.015
"""How often what was felt is sent [s]; with the browser's own 35 ms ahead it is heard about 60 ms after it was felt."""

STATUS_S: Final = 0.2
"""How often the line under the picture changes [s]: any faster cannot be read."""


class Monitor:
    """Reads the hand and shows it.

    Args:
        context: the page.
        on_status: called whenever there may be another status.

    Attributes:
        status: what is felt, in a line.
        recorder: what was felt, to be played again in the place of what is.
    """

    def __init__(self, context: PageContext, on_status: Callable[[], None]) -> None:
        self._context = context
        self._on_status = on_status
        self.status = ""
        self.recorder = StrokeRecorder()
        context.touch.on_felt = self.recorder.note

    async def watch(self) -> None:
        """Show and send what the hand feels, for as long as it is let."""
        touch, view, socket = self._context.touch, self._context.view, self._context.socket
        next_status_s = 0.0
        shown = False
        while True:
            await asyncio.sleep(MONITOR_S)
            now_s = time.monotonic()
            try:
                felt = touch.read(now_s)
            except HapsceneError as error:
                socket.say(str(error), "error")
                continue
            again = self.recorder.read(now_s)
            read = again or felt
            if read is not None and (again is not None or read[0].tick >= 0):
                state, force_N, a_m_s2 = read
                if len(force_N):
                    socket.trace(force_N, a_m_s2, self._context.session.tuning.tick_s)
                view.show_touch(state.p_WT_m, state.p_WP_m, state.f_W_N)
                shown = True
            elif shown:
                view.show_touch(None)
                shown = False
            if now_s >= next_status_s:
                next_status_s = now_s + STATUS_S
                self.status = self._status_of(None if felt is None else felt[0])
                self._on_status()

    def _status_of(self, state: ServoState | None) -> str:
        session, touch = self._context.session, self._context.touch
        if self.recorder.playing:
            return "Played again …"
        if touch.status == "starting":
            return "The hand gets ready …"
        if touch.status != "ready":
            return touch.problem or "There is no hand to touch with."
        if state is None or state.tick < 0:
            return "The hand is ready: press 7, hold Shift and drag on the surface."
        if not state.touching or not 0 <= state.swatch < len(session.scene.swatches):
            return f"In the air · {touch.config}"
        force_N = float(np.linalg.norm(state.f_W_N))
        name = session.scene.swatches[state.swatch].name
        return f"{name}: {force_N:.2f} N · {1e3 * state.depth_m:.2f} mm deep · {1e3 * state.slip_m_s:.0f} mm/s"
