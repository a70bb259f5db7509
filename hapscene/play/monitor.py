"""Terminal of `hapscene play`: force and contact, limits and their causes, timing statistics; key presses."""

import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final

import numpy as np

from hapscene.errors import HandleError
from hapscene.flags import Flag
from hapscene.loop import Servo, TimingStatistics
from hapscene.loop.timing import BIN_NS, BINS_PER_OCTAVE

__all__ = ["FLAG_TEXTS", "Monitor", "deadline_misses", "pressed_keys"]

FLAG_TEXTS: Final = {
    Flag.TOOL_NOT_FINITE: "device position is not a finite number",
    Flag.UNSETTLED: "proxy did not settle",
    Flag.EFFECT_MUTED: "effect muted: its output was not a finite number",
    Flag.FORCE_LIMITED: "force limited to the device's maximum",
    Flag.SLEW_LIMITED: "force slew rate limited to the device's maximum",
    Flag.ACCELERATION_LIMITED: "acceleration limited to the handle's maximum",
    Flag.ENERGY_DAMPED: "passivity controller active: a wall was damped",
    Flag.CROWDED: "too many bodies near the tool: some are ignored",
    Flag.POSE_REFUSED: "invalid pose of a body ignored",
    Flag.OUT_OF_WORKSPACE: "no force: tool outside the workspace of the device",
    Flag.TOO_FAST: "no force: tool speed above the limit",
    Flag.FORCE_NOT_FINITE: "no force: force is not a finite number",
    Flag.PEAK_LIMITED: "force limited to the peak force",
    Flag.HEAT_LIMITED: "force reduced: motors are warm",
    Flag.STEP_LIMITED: "change of the sent force limited",
    Flag.RAMPED: "force ramp",
    Flag.APPLICATION_SILENT: "no force: application does not respond",
    Flag.DEVICE_NOT_READY: "no force: device not ready",
    Flag.STALLED: "loop was stalled: force ramps up again",
    Flag.PROXY_RESET: "new shape enclosed the tool: proxy set on the nearest surface",
    Flag.BODY_REMOVED: "touched body removed: its force fades out",
    Flag.TOOL_FAR: "device position far from all bodies: check its unit, and --at",
}
"""Description of each flag for the user."""


class Monitor:
    """Summarises the state of a servo in a few lines."""

    def __init__(self, servo: Servo) -> None:
        self._servo = servo
        self._since = max(servo.state().tick + 1, 0)
        self._at_s = time.monotonic()
        self._mute = ""  # why a hardware handle stopped
        self._first_late = servo.timing()

    def lines(self) -> list[str]:
        """Lines on the time since the last call.

        Raises:
            HapsceneError: the process of the servo has ended, or its device is disconnected.
        """
        servo = self._servo
        log, now_s = servo.read(self._since), time.monotonic()
        rate_Hz = len(log.rows) / max(now_s - self._at_s, 1e-9)
        self._since, self._at_s = log.first + len(log.rows), now_s
        state = servo.state()
        most_N = np.linalg.norm(log.rows["f_W_N"], axis=1).max(initial=0.0)
        force = f"{np.linalg.norm(state.f_W_N):5.2f} N" + (f", max {most_N:.2f} N" if len(log.rows) else "")
        where = f"touching {servo.body_names[state.body]}" if state.touching else "no contact"
        lines = [f"{rate_Hz:5.0f} ticks/s   {force}   {where}"]
        flags = int(np.bitwise_or.reduce(log.rows["flags"])) if len(log.rows) else 0
        lines += [text for flag, text in FLAG_TEXTS.items() if flags & flag]
        return lines + [problem for problem in (servo.notice, self._handle_problem()) if problem]

    def summary(self) -> list[str]:
        """Lines on the whole session.

        Raises:
            HapsceneError: see `lines`.
        """
        late = self._servo.timing().since(self._first_late)
        count = int(late.delay.sum())
        return [
            f"{count:,} ticks, {late.missed} missed",
            f"deadline misses (latency above one period): {deadline_misses(late, self._servo.tick_s)}",
            f"latency: median {late.delay_us():.3g} µs, p99 {late.delay_us(0.99):.3g} µs, "
            f"max {late.delay_us(1.0):.3g} µs",
        ]

    def _handle_problem(self) -> str:
        if not self._mute:
            try:
                self._servo.handle_report()
            except HandleError as error:
                self._mute = f"handle stopped: {error}"
        return self._mute


def deadline_misses(late: TimingStatistics, span_s: float) -> int:
    """Number of ticks with a latency above a limit, to the 9 % resolution of the histogram."""
    first = math.ceil(BINS_PER_OCTAVE * math.log2(span_s * 1e9 / BIN_NS)) + 1
    return int(late.delay[first:].sum()) + late.missed


@contextmanager
def pressed_keys() -> Iterator[Callable[[], str]]:
    """A function that returns the keys pressed since its last call; "" if standard input is not a terminal."""
    try:
        import select
        import termios
        import tty

        fd = sys.stdin.fileno()
        before = termios.tcgetattr(fd)
        if os.tcgetpgrp(fd) != os.getpgrp():  # a background process that sets the terminal is stopped
            raise OSError
    except (ImportError, OSError, ValueError, termios.error):
        yield lambda: ""
        return

    def keys() -> str:
        pressed = b""
        with suppress(OSError):  # the terminal is gone
            while select.select([fd], [], [], 0.0)[0] and (read := os.read(fd, 64)):
                pressed += read
        return pressed.decode("ascii", "ignore")

    tty.setcbreak(fd)
    try:
        yield keys
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)
