"""Monitor of the simulated hand: shows the touch in the view and the status line, and streams it to plots and sound."""

import asyncio
import time
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import TICK_S
from hapscene.errors import HapsceneError
from hapscene.loop import ServoState
from hapscene.paint.web.context import PageContext
from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch
from hapscene.swatches.sound import FULL_SCALE_M_S2, swatch_sound

__all__ = ["Loudness", "Monitor"]

MONITOR_S: Final = 0.015
"""Period of the stream [s]. With messages in time, the browser buffers less than three periods."""

STATUS_S: Final = 0.2
"""Period of the status line [s]: faster changes could not be read."""

RISE_S: Final = 0.15
"""Time constant of a change of the gain [s]: a tap, of a few 10 ms, keeps about its true level."""

PEAK: Final = 0.9
"""Largest sample that is played, of the full scale [1]."""


class Loudness:
    """Gain with which the touch is played: strokes on all swatches are about equally loud, and no sample clips.

    The acceleration for devices and plots keeps its true level.

    Attributes:
        gain: present gain [1].
        rms_m_s2: true level of the last samples, root mean square [m/s²].
    """

    def __init__(self) -> None:
        self.gain, self.rms_m_s2 = 1.0, 0.0
        self._swatch: Swatch | None = None
        self._target = 1.0

    def take(self, a_m_s2: NDArray[np.float64], swatch: Swatch | None, duration_s: float) -> tuple[float, float]:
        """Return the gains of the first and last sample of an acceleration; `swatch` is None without contact."""
        if swatch is not self._swatch:
            self._swatch = swatch
            self._target = 1.0 if swatch is None else swatch_sound(swatch).loudness_gain
        peak = float(np.abs(a_m_s2).max(initial=0.0))
        most = PEAK * FULL_SCALE_M_S2 / max(peak, 1e-9)
        self.rms_m_s2 = float(np.sqrt(np.mean(np.square(a_m_s2)))) if a_m_s2.size else 0.0
        first = min(self.gain, most)
        step = (self._target / first) ** -np.expm1(-duration_s / RISE_S)
        self.gain = min(first * float(step), most)
        return first, self.gain

    def __str__(self) -> str:
        return f"{self.rms_m_s2:.2g} m/s² rms, played {round(20.0 * np.log10(self.gain)):+d} dB"


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
        self._loudness = Loudness()

    async def prepare(self) -> None:
        """Import the synthesis: the first sound of a swatch takes long, later ones 3 ms."""
        await asyncio.to_thread(lambda: swatch_sound(load_swatch("wood")).loudness_gain)

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
                swatches = self._context.session.scene.swatches
                touched = state.touching and 0 <= state.swatch < len(swatches)
                swatch = swatches[state.swatch] if touched else None
                gains = self._loudness.take(samples[2], swatch, len(samples[1]) * TICK_S)
                socket.trace(samples[1], samples[2], TICK_S, gains)
            view.show_touch(state)
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
        slip = f"{1e3 * state.slip_m_s:.0f} mm/s"
        return f"{name}: {force_N:.2f} N · {1e3 * state.depth_m:.2f} mm deep · {slip} · {self._loudness}"
