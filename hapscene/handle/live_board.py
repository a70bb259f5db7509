"""A microcontroller handle that plays live: version 2 of docs/reference/handle-protocol.md. The board is the clock.

Force is sent in lines of samples, `ahead_s` ahead of those that the board reports as played. `ahead_s` is therefore
both the latency and the longest pause of a busy computer. The board stops the force by itself after `watchdog_s`
without a valid line.
"""

import threading
from typing import Final

import numpy as np

from hapscene.errors import HandleError
from hapscene.handle.handle_output import FEEDBACK_DELAY_MAX, Feed
from hapscene.handle.serial_handle import BUFFER, LINE_COUNT, STATE, Board, Wire
from hapscene.io.files import refusing
from hapscene.io.wire.protocol import WRAP, Run, sample_line, sealed
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["EMPTY", "LIMITED", "LIVE", "RUN", "RUN_MAX", "WATCHDOG_EXPIRED", "WATCHDOG_MS", "LiveBoard", "live_start"]

LIVE, EMPTY, WATCHDOG_EXPIRED, LIMITED = 1, 2, 4, 8
"""Bits of the column `state`: playing live; buffer empty; watchdog expired, no force until the next start; force
reduced by the board's own limits."""

RUN: Final = 16
"""Factor of the run number in the column `state`."""

RUN_MAX: Final = 255
"""Largest run number."""

WATCHDOG_MS: Final = (5, 1000)
"""Shortest and longest watchdog time of a board [ms]."""

GONE_S: Final = 0.5
"""Longest time without data from a board that plays [s]."""

AGAIN_S: Final = 0.1
"""Time without live data after which the start line is repeated [s]."""

ON_THE_WAY_S: Final = 0.02
"""Longest transmission time of samples to the board and back, in addition to the board's buffer [s]."""


def live_start(watchdog_s: float, run: int) -> bytes:
    """The line that starts live playing. The board's data then carry the run number."""
    return b"#hapscene-handle 2 start watchdog=%d run=%d" % (round(1e3 * watchdog_s), run)


class LiveBoard(Board):
    """A handle's microcontroller that plays live, as a `HandleOutput`."""

    takes_force = True
    gain = 1.0

    def __init__(
        self,
        name: str,
        wire: Wire,
        limit_N: float,
        ahead_s: float,
        watchdog_s: float,
        highpass_Hz: float,
        lag_s: float,
        clock: Clock = CLOCK,
    ) -> None:
        """Wait for the header of the board. The numbers are the options of the drivers `serial` and `usb`, which
        explain them.

        Raises:
            HandleError: no answer, not a handle, a handle that only plays sweeps, or an option out of range. `wire`
                is closed.
        """
        with refusing(HandleError, name):
            low, high = WATCHDOG_MS
            if not low <= 1e3 * watchdog_s <= high:
                wire.close()
                raise HandleError(f"option watchdog_s={watchdog_s:g}: expected {1e-3 * low:g} to {1e-3 * high:g} s")
            if not 0.0 < limit_N < 1e3:
                wire.close()
                raise HandleError(f"option limit_N={limit_N:g}: expected above 0 N and below 1000 N")
        super().__init__(name, wire, clock)
        self._watchdog_s, self._number = watchdog_s, 0
        self.ceiling, self.highpass_Hz, self.lag_s = limit_N, highpass_Hz, lag_s
        self.fault = ""
        self.counts = {"underruns": 0, "watchdog": 0, "restarts": 0, "lost": 0, "board_limited": 0}
        self._ahead = min(max(round(ahead_s * self.rate_Hz), 2 * LINE_COUNT), BUFFER - LINE_COUNT)
        self.reads_back = self._ahead + ON_THE_WAY_S * self.rate_Hz < FEEDBACK_DELAY_MAX
        self._latency_s = self._ahead / self.rate_Hz
        self._live = self._empty = self._closed = False
        self._sent = self._played = 0  # samples since the start line
        self._pulled = 0  # samples pulled from the feed so far
        self._answered_s = 0.0  # time of the start line, or of the last data of its run
        self._feed: Feed | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        if STATE not in self.columns:
            self.close()
            raise HandleError(
                f"{name}: cannot play live, only the sweep of `hapscene device identify`: the firmware announces no "
                "column 'state'; update it (docs/reference/handle-protocol.md, version 2)"
            )

    @property
    def latency_s(self) -> float:
        """Average amount of force in the board's buffer [s]."""
        return self._latency_s

    def start(self, feed: Feed) -> None:
        self._feed, now_s = feed, self._clock.now_s()
        with refusing(HandleError, self.name):
            while isinstance(piece := self._wire.next(), tuple):
                self._decoder.feed(*piece)  # discard old data, which would delay the first answer
                if piece[1] >= now_s:
                    break
        self._begin()
        self._thread = threading.Thread(target=self._run, name="hapscene handle", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if not self._closed:
            self._closed = True
            super().close()

    def _begin(self) -> None:
        """Send a start line: the board restarts from silence."""
        self._live = self._empty = False
        self._sent = self._played = 0
        self._answered_s = self._clock.now_s()
        self._number = self._number % RUN_MAX + 1
        self._wire.write(sealed(live_start(self._watchdog_s, self._number)))

    def _run(self) -> None:
        """Main function of the thread: for each report of played samples, send the same number of new samples."""
        received_s = self._clock.now_s()
        try:
            while not self._closing.is_set():
                piece = self._wire.next()
                if isinstance(piece, str):
                    raise HandleError(f"{self.name}: the handle was disconnected: {piece}")
                now_s = self._clock.now_s()
                if piece is not None:
                    with refusing(HandleError, self.name):
                        for run in self._decoder.feed(*piece):
                            received_s = now_s
                            self._receive(run)
                    self.counts["lost"] = self._decoder.count.dropped
                if now_s - received_s > GONE_S:
                    raise HandleError(f"{self.name}: no data from the handle for {GONE_S:g} s; check the cable")
                if now_s - self._answered_s > AGAIN_S:
                    self.counts["restarts"] += self._live
                    self._begin()
                elif self._live:
                    self._send()
        except HandleError as error:
            self.fault = str(error)

    def _receive(self, run: Run) -> None:
        """Process samples from the board."""
        columns = self.columns
        rows = run.counts[run.counts[:, columns[STATE][0]] // RUN == self._number]  # others are of an earlier run
        if not len(rows):
            return
        self._answered_s = self._clock.now_s()
        states, played = (rows[:, columns[name][0]] for name in (STATE, "played"))
        assert self._feed is not None
        if not self._live:
            self._live = True
            self._feed.fade_in()
        self.counts["board_limited"] += int(np.count_nonzero(states & LIMITED))
        steps = (played - self._played) % WRAP
        step = int(steps[-1])
        expired = bool((states & WATCHDOG_EXPIRED).any())
        if expired or step > self._sent - self._played:
            self.counts["watchdog" if expired else "restarts"] += 1
            self._begin()
            return
        force, acceleration = (rows[:, columns[name][0]] * columns[name][1] for name in ("force", "acceleration"))
        force[(states & EMPTY) > 0] = np.nan
        self._feed.receive_feedback(self._pulled - self._sent + self._played + steps - 1, force, acceleration)
        self._played += step
        empty = bool(((states & EMPTY) * played).any())  # the buffer is also empty before the first sample
        if empty and not self._empty:
            self.counts["underruns"] += 1
            if self._played == self._sent:  # otherwise samples are on their way, and a fade would cut them
                self._feed.fade_in()
        self._empty = empty

    def _send(self) -> None:
        """Fill the board's buffer up to `ahead_s`."""
        self._latency_s += 0.02 * ((self._sent - self._played) / self.rate_Hz - self._latency_s)
        room = self._played + self._ahead - self._sent
        if room < LINE_COUNT // 2:
            return
        samples = np.zeros(room)
        assert self._feed is not None
        self._feed.pull(samples)
        self._pulled += room
        whole = np.rint(np.clip(samples, -self.ceiling, self.ceiling) / self.columns["force"][1]).astype(int).tolist()
        starts = range(0, room, LINE_COUNT)
        self._wire.write(b"".join(sample_line(self._sent + i, whole[i : i + LINE_COUNT]) for i in starts))
        self._sent += room
