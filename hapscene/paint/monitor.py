"""The live monitor: what the hand feels, shown on the scene, told in a line, and sent to be plotted and heard."""

import asyncio
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from hapscene.errors import HapsceneError
from hapscene.paint.parts import Parts
from hapscene.servo import State

MONITOR_S: Final = 0.015
"""How often what was felt is sent [s]; with the browser's own 35 ms ahead it is heard about 60 ms after it was felt."""

WORD_S: Final = 0.2
"""How often the line under the picture changes [s]: any faster cannot be read."""


class Monitor:
    """Reads the hand and shows it.

    Args:
        parts: the page.
        told: called whenever there may be another word.

    Attributes:
        word: what is felt, in a line.
    """

    def __init__(self, parts: Parts, told: Callable[[], None]) -> None:
        self._parts = parts
        self._told = told
        self.word = ""

    async def watch(self) -> None:
        """Show and send what the hand feels, for as long as it is let."""
        touch, view, live = self._parts.touch, self._parts.view, self._parts.live
        next_word_s = 0.0
        shown = False
        while True:
            await asyncio.sleep(MONITOR_S)
            now_s = time.monotonic()
            try:
                read = touch.read(now_s)
            except HapsceneError as error:
                live.say(str(error), "error")
                continue
            if read is not None and read[0].tick >= 0:
                state, force_N, a_m_s2 = read
                if len(force_N):
                    live.trace(force_N, a_m_s2, touch.tick_s)
                view.show_touch(state.p_WT_m, state.p_WP_m, state.f_W_N)
                shown = True
            elif shown:
                view.show_touch(None)
                shown = False
            if now_s >= next_word_s:
                next_word_s = now_s + WORD_S
                self.word = self._word_of(None if read is None else read[0])
                self._told()

    def _word_of(self, state: State | None) -> str:
        session, touch = self._parts.session, self._parts.touch
        if touch.status == "starting":
            return "The hand gets ready …"
        if touch.status != "ready":
            return "There is no hand to touch with."
        if state is None or state.tick < 0:
            return "The hand is ready: press 7, hold Shift and drag on the surface."
        if not state.touching or not 0 <= state.swatch < len(session.scene.swatches):
            return f"In the air · {touch.hold}"
        force_N = float(np.linalg.norm(state.f_W_N))
        name = session.scene.swatches[state.swatch].name
        return f"{name}: {force_N:.2f} N · {1e3 * state.depth_m:.2f} mm deep · {1e3 * state.slip_m_s:.0f} mm/s"
