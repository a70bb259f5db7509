"""What `hapscene play` shows of a servo: how well it keeps time, what is felt, what is limited and why."""

import math
import time
from typing import Any, Final

import numpy as np

from hapscene.errors import HandleError
from hapscene.flags import Flag
from hapscene.loop import Servo, TimingStatistics
from hapscene.loop.empty_loop import EmptyLoop
from hapscene.loop.timing import BIN_NS, BINS_PER_OCTAVE

__all__ = ["WHY", "Monitor", "later_than"]

WHY: Final = {
    Flag.TOOL_NOT_FINITE: "the device gave no number for its position",
    Flag.UNSETTLED: "the proxy did not settle",
    Flag.EFFECT_MUTED: "an effect gave no number, and is mute",
    Flag.FORCE_LIMITED: "force at the device's limit",
    Flag.SLEW_LIMITED: "force changes as fast as the device may",
    Flag.ACCELERATION_LIMITED: "acceleration at the handle's limit",
    Flag.ENERGY_DAMPED: "a wall was damped, so as not to buzz",
    Flag.CROWDED: "more bodies here than a tick asks",
    Flag.POSE_REFUSED: "a body was given an invalid pose",
    Flag.OUT_OF_WORKSPACE: "no force: the tool is out of the device's workspace",
    Flag.TOO_FAST: "no force: the tool moved faster than a hand",
    Flag.FORCE_NOT_FINITE: "no force: it was no number",
    Flag.PEAK_LIMITED: "force at the most that the device is ever sent",
    Flag.HEAT_LIMITED: "the motors are warm: less force until they have cooled",
    Flag.STEP_LIMITED: "force sent changes as fast as the device may",
    Flag.RAMPED: "force rises or falls",
    Flag.APPLICATION_SILENT: "no force: the application stood still",
    Flag.DEVICE_NOT_READY: "no force: the device is not ready",
    Flag.STALLED: "the loop stood still: the force begins anew",
}
"""What each flag says to who holds the device."""

BARS: Final = " ▁▂▃▄▅▆▇█"

EDGES_US: Final = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, math.inf)
"""Upper edges of the histogram that is shown [µs]."""


class Monitor:
    """Looks at a servo now and then, and tells in a few lines what has happened since."""

    def __init__(self, servo: Servo) -> None:
        self._servo = servo
        self._empty = EmptyLoop(servo.tick_s)
        self._since = max(servo.state().tick + 1, 0)
        self._at_s = time.monotonic()
        self._late, self._idle = servo.timing(), self._empty.timing()
        self._mute = ""  # why a real handle plays no more
        self._worst = (0, -1, 0)  # longest tick [ns], its number, of it finding the contact [ns]
        self.first_late, self.first_idle, self.first_tick = self._late, self._idle, self._since

    def close(self) -> None:
        """Look no more."""
        self._empty.stop()

    def lines(self) -> list[str]:
        """What has happened since the last look.

        Raises:
            HapsceneError: the servo's process has ended, or its device is gone.
        """
        servo = self._servo
        log, now_s = servo.read(self._since), time.monotonic()
        late, idle = servo.timing(), self._empty.timing()
        rate_Hz = len(log.rows) / max(now_s - self._at_s, 1e-9)
        self._since, self._at_s = log.first + len(log.rows), now_s
        self._note_worst(log)
        state, device = servo.state(), servo.device_state()
        most_N = np.linalg.norm(log.rows["f_W_N"], axis=1).max(initial=0.0)
        force = f"{np.linalg.norm(state.f_W_N):5.2f} N" + (f", most {most_N:.2f} N" if len(log.rows) else "")
        where = f"touching {servo.body_names[state.body]}" if state.touching else "in the air"
        told = [
            f"{rate_Hz:5.0f} ticks/s   {force}   {where}" + _warmth(device) + _buttons(device),
            f"late     {_bars(late.since(self._late))}  {_percentiles(late.since(self._late))}",
            f"empty    {_bars(idle.since(self._idle))}  {_percentiles(idle.since(self._idle))}",
            self._told_worst(),
        ]
        self._late, self._idle = late, idle
        flags = int(np.bitwise_or.reduce(log.rows["flags"])) if len(log.rows) else 0
        told += [why for flag, why in WHY.items() if flags & flag]
        return told + [trouble for trouble in (servo.notice, self._handle_trouble()) if trouble]

    def summary(self) -> list[str]:
        """What happened since the beginning.

        Raises:
            HapsceneError: as `lines`.
        """
        late = self._servo.timing().since(self.first_late)
        idle = self._empty.timing().since(self.first_idle)
        count = int(late.delay.sum())
        return [
            f"{count:,} ticks, {late.missed} missed",
            f"later than a period: {later_than(late, self._servo.tick_s)}; an empty loop beside it: "
            f"{later_than(idle, self._servo.tick_s)}",
            f"late by {_percentiles(late)}; the empty loop by {_percentiles(idle)}",
            self._told_worst(),
        ]

    def _handle_trouble(self) -> str:
        if not self._mute:
            try:
                self._servo.handle_report()
            except HandleError as error:
                self._mute = f"nothing is heard: {error}"
        return self._mute

    def _note_worst(self, log: Any) -> None:
        if len(log.rows):
            at = int(np.argmax(log.rows.tick_ns))
            row = log.rows[at]
            self._worst = max(self._worst, (int(row.tick_ns), log.first + at, int(row.contact_ns)))

    def _told_worst(self) -> str:
        tick_ns, number, contact_ns = self._worst
        if number < 0:
            return "worst tick: none yet"
        cause = "finding the contact" if contact_ns > tick_ns / 2 else "effects, or another program"
        return f"worst tick {number:,}: {tick_ns / 1e3:.1f} µs, {contact_ns / 1e3:.1f} of them contact: {cause}"


def later_than(late: TimingStatistics, span_s: float) -> int:
    """How many ticks began later than that, to the 9 % of a bin."""
    first = math.ceil(BINS_PER_OCTAVE * math.log2(span_s * 1e9 / BIN_NS)) + 1
    return int(late.delay[first:].sum()) + late.missed


def _bars(late: TimingStatistics) -> str:
    """A histogram in eight signs, of counts on a logarithmic scale."""
    upper_us = BIN_NS * 2.0 ** (np.arange(len(late.delay)) / BINS_PER_OCTAVE) / 1e3
    edges = np.searchsorted(upper_us, EDGES_US)
    counts = np.diff(np.concatenate([[0], np.cumsum(late.delay)])[[0, *np.minimum(edges + 1, len(late.delay))]])
    top = max(math.log1p(max(counts.max(), 1)), 1.0)
    return "".join(BARS[math.ceil(math.log1p(count) / top * (len(BARS) - 1))] for count in np.maximum(counts, 0))


def _percentiles(late: TimingStatistics) -> str:
    return f"{late.delay_us():.3g} µs, p99 {late.delay_us(0.99):.3g}, most {late.delay_us(1.0):.3g}"


def _warmth(device: Any) -> str:
    return f"   motors at {100 * float(device.heat):.0f} %" if device.heat >= 0.0 else ""


def _buttons(device: Any) -> str:
    pressed = [str(k + 1) for k in range(16) if int(device.buttons) >> k & 1]
    return f"   button {', '.join(pressed)}" if pressed else ""
