"""A real handle on a serial port, for identification (docs/reference/handle-protocol.md).

Force is sent in lines of samples, at most `BUFFER` ahead of those that the handle reports as played. The handle is the
only clock: a busy computer loses no samples until the buffer of the handle is empty.
"""

from collections.abc import Callable
from contextlib import closing, suppress
from typing import Final, Protocol

import numpy as np

from hapscene.errors import HandleError
from hapscene.handle.plant import Array
from hapscene.io.files import refusing
from hapscene.io.wire.port import BAUD, Port
from hapscene.io.wire.protocol import WRAP, Column, Decoder, Run, sample_line, sealed
from hapscene.io.wire.unit import UNITS
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["BUFFER", "LINE_COUNT", "START", "STATE", "Board", "SerialSource", "SerialWire", "Wire"]

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
"""Additional column of a handle that plays live (`live_board`)."""


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

    def __init__(self, name: str, baud: int = BAUD, say: Callable[[float], None] = lambda share: None) -> None:
        """Open the port and wait for the handle's header. `say` receives the share that was played, 0 … 1.

        Raises:
            HandleError: no such port, no answer, or the device is not a handle.
        """
        self._say = say
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
            lines = []
            while sent < min(len(counts), played + BUFFER - LINE_COUNT):
                chunk = counts[sent : sent + LINE_COUNT]
                lines.append(sample_line(sent, chunk.tolist()))
                sent += len(chunk)
            if lines:
                self._wire.write(b"".join(lines))
            step = self._wait_for_progress(played % WRAP, sent == len(counts))
            played = played + step if step else len(counts)  # the last lines of force were lost
            self._say(min(1.0, played / len(counts)))
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
