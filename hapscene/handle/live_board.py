"""A handle of one's own that plays live: docs/handle-protocol.md, version 2. The board's clock is the clock.

Force goes out in lines of samples, `ahead_s` ahead of what the board says that it has played: that is the latency, and
how long a busy computer may say nothing. The board itself puts out none once it has heard nothing valid for
`watchdog_s`.
"""

import threading
from typing import Final

import numpy as np

from hapscene.errors import HandleError
from hapscene.handle.handle_output import HEARD_MAX, Feed
from hapscene.handle.serial_handle import BUFFER, LINE_COUNT, STATE, Board, Wire
from hapscene.io.files import refusing
from hapscene.io.wire.protocol import WRAP, Run, sample_line, sealed
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["EMPTY", "LIMITED", "LIVE", "RUN", "RUN_MAX", "TRIPPED", "WATCHDOG_MS", "LiveBoard", "live_start"]

LIVE, EMPTY, TRIPPED, LIMITED = 1, 2, 4, 8
"""Bits of the column `state`: started to play live; the buffer is empty; the watchdog has tripped, and no force is put
out until the next start; the force is not what it was sent, but what the board's own limits allow."""

RUN: Final = 16
"""What the column `state` counts the number of the run in: above those bits."""

RUN_MAX: Final = 255
"""Largest number of a run."""

WATCHDOG_MS: Final = (5, 1000)
"""Shortest and longest time that a board may be told to wait [ms]."""

GONE_S: Final = 0.5
"""How long a board that plays may say nothing [s]."""

AGAIN_S: Final = 0.1
"""After what time it is told again to start, where it does not, or no more [s]."""

ON_THE_WAY_S: Final = 0.02
"""How long samples may be on their way to the board and back, beside what the board has in hand [s]."""


def live_start(watchdog_s: float, run: int) -> bytes:
    """The line that begins to play live; what the board says from then on bears the number of the run."""
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
        """Waits for the board to announce itself.

        Args:
            name: of it, for messages.
            wire: what it hangs on; closed where this raises.
            limit_N: largest force that it is sent.
            ahead_s: how much force it has in hand.
            watchdog_s: after how long without a word it shall put out none.
            highpass_Hz: what is lower is left out.
            lag_s: how much of the channel is kept in hand beside that.
            clock: measures how long the board says nothing.

        Raises:
            HandleError: silence, no handle, or one that only plays sweeps; options that cannot be.
        """
        with refusing(HandleError, name):
            low, high = WATCHDOG_MS
            if not low <= 1e3 * watchdog_s <= high or not 0.0 < limit_N < 1e3:
                wire.close()
                raise HandleError(f"option watchdog_s is {1e-3 * low:g} to {1e-3 * high:g} s, limit_N above 0")
        super().__init__(name, wire, clock)
        self._watchdog_s, self._number = watchdog_s, 0
        self.ceiling, self.highpass_Hz, self.lag_s = limit_N, highpass_Hz, lag_s
        self.fault = ""
        self.counts = {"underruns": 0, "watchdog": 0, "restarts": 0, "lost": 0, "board_limited": 0}
        self._ahead = min(max(round(ahead_s * self.rate_Hz), 2 * LINE_COUNT), BUFFER - LINE_COUNT)
        self.reads_back = self._ahead + ON_THE_WAY_S * self.rate_Hz < HEARD_MAX
        self._latency_s = self._ahead / self.rate_Hz
        self._live = self._empty = self._closed = False
        self._sent = self._played = 0  # since it was told to start
        self._pulled = 0  # of the feed, ever
        self._told_s = 0.0  # when it was told to start, or said something since
        self._feed: Feed | None = None
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        if STATE not in self.columns:
            self.close()
            raise HandleError(
                f"{name}: plays no live force, only the sweep of `hapscene device identify`: its firmware announces no "
                "column 'state' (docs/handle-protocol.md, version 2)"
            )

    @property
    def latency_s(self) -> float:
        """Force that the board has in hand, on average [s]."""
        return self._latency_s

    def start(self, feed: Feed) -> None:
        self._feed, now_s = feed, self._clock.now_s()
        with refusing(HandleError, self.name):
            while isinstance(piece := self._wire.next(), tuple):
                self._decoder.feed(*piece)  # what came while nobody listened would hold up the first answer
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
        """Have it start anew, from silence."""
        self._live = self._empty = False
        self._sent = self._played = 0
        self._told_s = self._clock.now_s()
        self._number = self._number % RUN_MAX + 1
        self._wire.write(sealed(live_start(self._watchdog_s, self._number)))

    def _run(self) -> None:
        """The thread: hears what was played, and sends as much more."""
        heard_s = self._clock.now_s()
        try:
            while not self._closing.is_set():
                piece = self._wire.next()
                if isinstance(piece, str):
                    raise HandleError(f"{self.name}: the handle went away: {piece}")
                now_s = self._clock.now_s()
                if piece is not None:
                    with refusing(HandleError, self.name):
                        for run in self._decoder.feed(*piece):
                            heard_s = now_s
                            self._hear(run)
                    self.counts["lost"] = self._decoder.count.dropped
                if now_s - heard_s > GONE_S:
                    raise HandleError(f"{self.name}: the handle says nothing for {GONE_S:g} s; check the cable")
                if now_s - self._told_s > AGAIN_S:
                    self.counts["restarts"] += self._live
                    self._begin()
                elif self._live:
                    self._send()
        except HandleError as error:
            self.fault = str(error)

    def _hear(self, run: Run) -> None:
        """Takes in samples that came back."""
        columns = self.columns
        rows = run.counts[run.counts[:, columns[STATE][0]] // RUN == self._number]  # others are of before it was told
        if not len(rows):
            return
        self._told_s = self._clock.now_s()
        states, played = (rows[:, columns[name][0]] for name in (STATE, "played"))
        assert self._feed is not None
        if not self._live:
            self._live = True
            self._feed.fade_in()
        self.counts["board_limited"] += int(np.count_nonzero(states & LIMITED))
        steps = (played - self._played) % WRAP
        step = int(steps[-1])
        tripped = bool((states & TRIPPED).any())
        if tripped or step > self._sent - self._played:
            self.counts["watchdog" if tripped else "restarts"] += 1
            self._begin()
            return
        force, acceleration = (rows[:, columns[name][0]] * columns[name][1] for name in ("force", "acceleration"))
        force[(states & EMPTY) > 0] = np.nan
        self._feed.hear(self._pulled - self._sent + self._played + steps - 1, force, acceleration)
        self._played += step
        empty = bool(((states & EMPTY) * played).any())  # not before the first
        if empty and not self._empty:
            self.counts["underruns"] += 1
            if self._played == self._sent:  # else more is on its way, and would be cut
                self._feed.fade_in()
        self._empty = empty

    def _send(self) -> None:
        """As much force as the board may have in hand."""
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
