"""A real handle on a serial port: docs/handle-protocol.md. It is a probe that also takes force.

Force goes out in lines of samples, never more than `BUFFER` ahead of what the handle says that it has played: that is
all the clock there is, so a busy computer costs no samples until that buffer is empty.
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
"""The line that empties the handle's buffer and sets force and count to 0."""

BUFFER: Final = 1024
"""Samples of force that a handle can hold [count]: 2 kB of a microcontroller, 0.2 s at 5 kHz."""

LINE_COUNT: Final = 32
"""Most samples of force in a line [count]: 200 bytes."""

SILENCE_S: Final = 3.0
"""How long a handle may say nothing [s]: boards that restart when the port is opened take up to 2 s."""

MISSING_MAX: Final = 0.01
"""Largest share of samples that may be lost on the way [1]; they are put on straight lines."""

_NAMES: Final = ("force", "acceleration", "played")

STATE: Final = "state"
"""The column that a handle has which plays live."""


class Wire(Protocol):
    """What a handle hangs on: drained as `DrainedPort` says, and written to."""

    def next(self) -> tuple[bytes, float] | str | None:
        """What came, and when; None where nothing did for a while; a text, why, when it is gone."""

    def write(self, data: bytes) -> None:
        """Send that.

        Raises:
            HandleError: it is not taken.
        """

    def close(self) -> None:
        """Let go of it."""


class SerialWire(Port):
    """A serial port, written to as well."""

    def write(self, data: bytes) -> None:
        try:
            self._serial.write_timeout = SILENCE_S
            self._serial.write(data)
        except OSError as error:  # pyserial's exceptions are OSErrors
            raise HandleError(f"the handle takes nothing: {' '.join(str(error).split())}") from None


class Board:
    """A handle's microcontroller, on whatever wire."""

    def __init__(self, name: str, wire: Wire, clock: Clock = CLOCK) -> None:
        """Waits for the handle to announce itself.

        Raises:
            HandleError: silence, or something else than a handle.
        """
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
        """Samples a second, as the handle announced."""
        assert self._decoder.header is not None
        return self._decoder.header.rate_Hz

    def close(self) -> None:
        """Has the handle put out no more force, and closes the port."""
        with closing(self._wire), suppress(HandleError):  # it is gone: a handle whose buffer is empty puts out none
            self._wire.write(sealed(START))

    def _await(self, done: Callable[[], bool], trouble: str) -> None:
        """Takes in what comes until `done`."""
        deadline_s = self._clock.now_s() + SILENCE_S
        while not done():
            piece = self._wire.next()
            if isinstance(piece, str):
                raise HandleError(f"{self.name}: the handle went away: {piece}")
            if piece is not None:
                with refusing(HandleError, self.name):
                    self._pieces += self._decoder.feed(*piece)
            if self._clock.now_s() > deadline_s and not done():
                raise HandleError(
                    f"{self.name}: {trouble} for {SILENCE_S:g} s; check the cable, --baud and docs/handle-protocol.md"
                )

    def _last_played(self) -> int | None:
        """How many samples the handle had played, modulo `WRAP`, at the last sample that came."""
        return int(self._pieces[-1].counts[-1, self.columns["played"][0]]) % WRAP if self._pieces else None


class SerialSource(Board):
    """A handle on a serial port, as a `Source`."""

    def __init__(self, name: str, baud: int = BAUD, say: Callable[[float], None] = lambda share: None) -> None:
        """Opens the port and waits for the handle to announce itself; `say` is told the share that was played [1].

        Raises:
            HandleError: no such port, silence, or something else than a handle.
        """
        self._say = say
        with refusing(HandleError):
            wire = SerialWire(name, baud)
        super().__init__(name, wire)

    def play(self, force_N: Array) -> tuple[Array, Array]:
        """Play force (n,) [N]; gives what was put out, and the acceleration [m/s²], (m,) each, m ≥ n.

        Raises:
            HandleError: the handle went away or fell silent, or more than `MISSING_MAX` of the samples were lost.
        """
        scale = self.columns["force"][1]
        counts = np.rint(np.asarray(force_N, dtype=np.float64) / scale).astype(np.int64)
        self._wire.write(sealed(START))
        self._pieces.clear()
        self._await(lambda: self._last_played() == 0, "it does not begin anew when told to")
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
            step = self._taken(played % WRAP, sent == len(counts))
            played = played + step if step else len(counts)  # the last lines of force were lost
            self._say(min(1.0, played / len(counts)))
        return self._gathered()

    def _taken(self, before: int, all_sent: bool) -> int:
        """Waits until the handle has played more than `before`; gives how much more.

        0 where it was sent all there is, and took none of it for longer than its buffer can last.
        """
        came = self._decoder.count.received

        def done() -> bool:
            idle = all_sent and self._decoder.count.received - came > BUFFER
            return self._last_played() != before or idle

        self._await(done, "it plays nothing")
        return ((self._last_played() or 0) - before) % WRAP

    def _gathered(self) -> tuple[Array, Array]:
        """Force and acceleration since the start, lost samples on straight lines."""
        first = self._pieces[0].first
        length = self._decoder.position - first
        at = np.concatenate([run.first - first + np.arange(len(run.counts)) for run in self._pieces])
        counts = np.concatenate([run.counts for run in self._pieces])
        lost = 1.0 - len(at) / length
        if lost > MISSING_MAX:
            raise HandleError(
                f"{self.name}: {100 * lost:.1f} % of the samples were lost on the way, at most {100 * MISSING_MAX:g} % "
                "may be: a faster port or a lower rate is needed"
            )
        columns = (self.columns[name] for name in ("force", "acceleration"))
        force, acceleration = (np.interp(np.arange(length), at, counts[:, i] * scale) for i, scale in columns)
        return force, acceleration


def _columns(port: str, announced: tuple[Column, ...]) -> dict[str, tuple[int, float]]:
    """Index and scale to SI of each column that a handle must have."""
    found: dict[str, tuple[int, float]] = {}
    for index, column in enumerate(announced):
        if column.name in (*_NAMES, STATE):
            units = UNITS.get(column.name, {"1": 1.0})
            if column.unit not in units:
                raise HandleError(f"{port}: no unit {column.unit!r} of {column.name}; there are: {', '.join(units)}")
            found[column.name] = (index, column.scale * units[column.unit])
    missing = [name for name in _NAMES if name not in found]
    if missing:
        raise HandleError(
            f"{port}: what is there announces no column {missing[0]!r}; a handle has force, acceleration and played "
            "(docs/handle-protocol.md)"
        )
    return found
