"""The microcontroller of a handle (docs/reference/handle-protocol.md): a sweep for identification, and live play.

Force is sent in lines of samples ahead of those that the board reports as played; the board is the only clock. In a
sweep that is as much as its buffer holds, so a busy computer loses no samples until the buffer is empty. In live play
it is `ahead_s`, which is therefore both the latency and the longest pause of a busy computer; the board stops the force
by itself after `watchdog_s` without a valid line.
"""

import threading
from collections.abc import Callable
from contextlib import closing, suppress
from typing import Final, Protocol

import numpy as np

from hapscene.errors import HandleError
from hapscene.handle.handle_output import FEEDBACK_DELAY_MAX, Feed
from hapscene.handle.plant import Array
from hapscene.io.files import refusing
from hapscene.io.probe_port import BAUD, Port
from hapscene.io.probe_protocol import UNITS, WRAP, Column, Decoder, Run, sample_line, sealed
from hapscene.wall_clock import CLOCK, Clock

__all__ = [
    "BUFFER",
    "EMPTY",
    "LIMITED",
    "LINE_COUNT",
    "LIVE",
    "RUN",
    "RUN_MAX",
    "START",
    "STATE",
    "WATCHDOG_EXPIRED",
    "WATCHDOG_MS",
    "Board",
    "LiveBoard",
    "SerialSource",
    "SerialWire",
    "Wire",
    "live_start",
]

START: Final = b"#hapscene-handle 1 start"
"""Line that clears the buffer of the handle and sets force and count to 0."""

BUFFER: Final = 1024
"""Samples of force in the buffer of a handle [count]: 2 kB of a microcontroller, 0.2 s at 5 kHz."""

LINE_COUNT: Final = 32
"""Most samples of force in a line [count], 200 bytes."""

SILENCE_S: Final = 3.0
"""Longest time without data before an error [s]. Boards that restart when the port is opened need up to 2 s."""

MISSING_MAX: Final = 0.01
"""Largest share of lost samples [1]. They are interpolated linearly."""

_NAMES: Final = ("force", "acceleration", "played")

STATE: Final = "state"
"""Additional column of a handle that plays live."""


class Wire(Protocol):
    """The connection to a handle: read through `next`, as `DrainedPort`, and written to."""

    def next(self) -> tuple[bytes, float] | str | None:
        """Received bytes and their time; None if nothing arrived for a while; a reason (str) after a disconnection."""

    def write(self, data: bytes) -> None:
        """Send bytes. Raises HandleError: the handle does not accept them."""

    def close(self) -> None:
        """Release the connection."""


class SerialWire(Port):
    """A serial port that can be written to."""

    def write(self, data: bytes) -> None:
        try:
            self._serial.write_timeout = SILENCE_S
            self._serial.write(data)
        except OSError as error:  # exceptions of pyserial are OSErrors
            raise HandleError(f"the handle does not accept data: {' '.join(str(error).split())}") from None


class Board:
    """The microcontroller of a handle, on any connection."""

    def __init__(self, name: str, wire: Wire, clock: Clock = CLOCK) -> None:
        """Start the handle and wait for its header. Raises HandleError: no answer, or the device is not a handle."""
        self.name, self._wire, self._clock = name, wire, clock
        self._decoder = Decoder()
        self._pieces: list[Run] = []
        try:
            self._wire.write(sealed(START))
            self._await(lambda: self._decoder.header is not None, "no line `#hapscene-probe 1 …`")
            assert self._decoder.header is not None
            self.columns = _columns(name, self._decoder.header.columns)
        except BaseException:
            self._wire.close()
            raise

    @property
    def rate_Hz(self) -> float:
        """Sample rate that the handle announced [Hz]."""
        assert self._decoder.header is not None
        return self._decoder.header.rate_Hz

    def close(self) -> None:
        """Stop the force of the handle, and close the connection."""
        with closing(self._wire), suppress(HandleError):  # a disconnected handle stops when its buffer is empty
            self._wire.write(sealed(START))

    def _await(self, done: Callable[[], bool], missing: str) -> None:
        """Receive data until `done`. `missing` describes the awaited event for the error."""
        deadline_s = self._clock.now_s() + SILENCE_S
        while not done():
            piece = self._wire.next()
            if isinstance(piece, str):
                raise HandleError(f"{self.name}: the handle was disconnected: {piece}")
            if piece is not None:
                with refusing(HandleError, self.name):
                    self._pieces += self._decoder.feed(*piece)
            if self._clock.now_s() > deadline_s and not done():
                raise HandleError(
                    f"{self.name}: {missing} for {SILENCE_S:g} s; check the cable, --baud and "
                    "docs/reference/handle-protocol.md"
                )

    def _last_played(self) -> int | None:
        """Number of samples that the handle had played at the last received sample, modulo `WRAP`."""
        return int(self._pieces[-1].counts[-1, self.columns["played"][0]]) % WRAP if self._pieces else None


class SerialSource(Board):
    """A handle on a serial port, as a `ForceSource`."""

    def __init__(self, name: str, baud: int = BAUD) -> None:
        """Open the port and wait for the handle's header.

        Raises:
            HandleError: no such port, no answer, or the device is not a handle.
        """
        with refusing(HandleError):
            wire = SerialWire(name, baud)
        super().__init__(name, wire)

    def play(self, force_N: Array) -> tuple[Array, Array]:
        """Play a force (n,) [N]. Returns the force that was put out and the acceleration [m/s²], (m,) each, m ≥ n.

        Raises:
            HandleError: the handle was disconnected or stopped answering, or lost more than `MISSING_MAX` samples.
        """
        scale = self.columns["force"][1]
        counts = np.rint(np.asarray(force_N, dtype=np.float64) / scale).astype(np.int64)
        self._wire.write(sealed(START))
        self._pieces.clear()
        self._await(lambda: self._last_played() == 0, "no restart after the start line")
        del self._pieces[:-1]
        sent = played = 0
        while played < len(counts):
            end = min(len(counts), played + BUFFER - LINE_COUNT)
            if sent < end:
                self._wire.write(_force_lines(sent, counts[sent:end].tolist()))
                sent = end
            step = self._wait_for_progress(played % WRAP, sent == len(counts))
            played = played + step if step else len(counts)  # the last lines of force were lost
        return self._collect_samples()

    def _wait_for_progress(self, before: int, all_sent: bool) -> int:
        """Wait until the handle has played more than `before` samples. Returns how many more.

        Returns 0 if all samples were sent and none was played for longer than the buffer lasts.
        """
        came = self._decoder.count.received

        def done() -> bool:
            idle = all_sent and self._decoder.count.received - came > BUFFER
            return self._last_played() != before or idle

        self._await(done, "no sample played")
        return ((self._last_played() or 0) - before) % WRAP

    def _collect_samples(self) -> tuple[Array, Array]:
        """Force and acceleration since the start, with lost samples interpolated."""
        first = self._pieces[0].first
        length = self._decoder.position - first
        at = np.concatenate([run.first - first + np.arange(len(run.counts)) for run in self._pieces])
        counts = np.concatenate([run.counts for run in self._pieces])
        lost = 1.0 - len(at) / length
        if lost > MISSING_MAX:
            raise HandleError(
                f"{self.name}: {100 * lost:.1f} % of the samples were lost, more than {100 * MISSING_MAX:g} %: "
                "use a faster port or a lower sample rate"
            )
        columns = (self.columns[name] for name in ("force", "acceleration"))
        force, acceleration = (np.interp(np.arange(length), at, counts[:, i] * scale) for i, scale in columns)
        return force, acceleration


def _force_lines(first: int, counts: list[int]) -> bytes:
    """Lines of force samples, of which the first has the number `first`."""
    return b"".join(sample_line(first + i, counts[i : i + LINE_COUNT]) for i in range(0, len(counts), LINE_COUNT))


def _columns(port: str, announced: tuple[Column, ...]) -> dict[str, tuple[int, float]]:
    """Index and scale to SI units of each column that a handle must have."""
    found: dict[str, tuple[int, float]] = {}
    for index, column in enumerate(announced):
        if column.name in (*_NAMES, STATE):
            units = UNITS.get(column.name, {"1": 1.0})
            if column.unit not in units:
                raise HandleError(
                    f"{port}: unknown unit {column.unit!r} of column {column.name!r}; there are: {', '.join(units)}"
                )
            found[column.name] = (index, column.scale * units[column.unit])
    missing = [name for name in _NAMES if name not in found]
    if missing:
        raise HandleError(
            f"{port}: the device announces no column {missing[0]!r}; a handle has force, acceleration and played "
            "(docs/reference/handle-protocol.md)"
        )
    return found


# Live play: version 2 of the protocol.


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
        self._live = self._empty = self._closed = self._halted = False
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
        room = room if room >= LINE_COUNT // 2 else 0  # none: only to see whether the force must end
        samples = np.zeros(room)
        assert self._feed is not None
        halted, self._halted = self._halted, self._feed.pull(samples) is True
        self._pulled += room
        if self._halted and not halted:
            self._begin()  # the board discards what it has not played yet
        elif room:
            counts = np.rint(np.clip(samples, -self.ceiling, self.ceiling) / self.columns["force"][1])
            self._wire.write(_force_lines(self._sent, counts.astype(int).tolist()))
            self._sent += room
