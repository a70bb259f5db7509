"""An emulated handle: `python -m tests.handle.serial_board` speaks the protocol on a pseudo-terminal.

It prints the port's name; `hapscene device identify --port NAME` in another terminal then identifies it. Each time that
a sweep begins, the simulated hand holds it otherwise.
"""

import os
import re
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from hapscene.handle.board import (
    BUFFER,
    EMPTY,
    LIMITED,
    LINE_COUNT,
    LIVE,
    RUN,
    RUN_MAX,
    START,
    STATE,
    WATCHDOG_EXPIRED,
    WATCHDOG_MS,
)
from hapscene.handle.force_source import SimulatedSource, simulated_grips
from hapscene.handle.plant import Plant
from hapscene.io.probe_protocol import LINE_MAX, WRAP, Column, Header, checksum, sample_line
from tests.header_line import header_line
from tests.simulated_port import simulated_port, simulator_parser

COLUMNS: Final = (Column("force", "N", 1e-4), Column("acceleration", "m/s2", 1e-3), Column("played", "1", 1.0))

BLOCK_S: Final = 0.002
"""Time between two writes [s]."""

CAUGHT_UP_S: Final = 0.1
"""How much time is made up for at once [s]: a board's clock does not wait; more would not fit onto the wire."""

STATE_COLUMN: Final = Column(STATE, "1", 1.0)

_FORCE_LINE: Final = re.compile(rb"(0|[1-9][0-9]{0,4})((?:,(?:0|-?[1-9][0-9]{0,6})){1,%d})" % LINE_COUNT)
_LIVE_START: Final = re.compile(rb"#hapscene-handle 2 start watchdog=([1-9][0-9]{0,3}) run=([1-9][0-9]{0,2})")


class Peer:
    """What a handle's microcontroller does: takes lines of force in, gives lines of samples out."""

    def __init__(self, source: SimulatedSource, grip_count: int = 5, seed: int = 0) -> None:
        self.source = source
        self.queue: deque[int] = deque()
        self._grips = simulated_grips(grip_count, seed)
        self._rest = b""
        self._expected = self._played = self._number = self._grip = self._quiet = self._watchdog = self._run = 0
        self._expired = False
        self._announce = True
        self._hold()

    def _hold(self) -> None:
        _, k_u, b_u = self._grips[self._grip]
        self.source.plant = replace(self.source.plant, k_u_N_m=k_u, b_u_Ns_m=b_u)

    def take(self, data: bytes) -> None:
        """Takes in what the host sent."""
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[:LINE_MAX]  # a line of this length is invalid
        for line in lines:
            body, _, crc = line.rpartition(b"*")
            if crc != b"%04X" % checksum(body):
                continue
            if body == START:
                self._begin(0, 0)
            elif start := _LIVE_START.fullmatch(body):
                watchdog_ms, run = int(start[1]), int(start[2])
                if WATCHDOG_MS[0] <= watchdog_ms <= WATCHDOG_MS[1] and run <= RUN_MAX:
                    self._begin(int(watchdog_ms * self.source.rate_Hz) // 1000, run)
            elif force := _FORCE_LINE.fullmatch(body):
                self._fill(int(force[1]), [int(part) for part in force[2][1:].split(b",")])

    def _fill(self, number: int, counts: list[int]) -> None:
        """Force into the buffer; in live play only what is due next and has room."""
        lost = (number - self._expected) % WRAP
        if self._watchdog and (number >= WRAP or self._expired or len(self.queue) + lost + len(counts) > BUFFER):
            return
        self.queue.extend([0] * lost if lost <= BUFFER else [])
        self.queue.extend(counts)
        self._expected = (number + len(counts)) % WRAP
        self._quiet = 0

    def _begin(self, watchdog: int, run: int) -> None:
        """Start a run. `watchdog`: in samples; for a sweep, `watchdog` and the number of the run are 0."""
        if self._played:  # a new sweep: another grip
            self._grip = (self._grip + 1) % len(self._grips)
            self._hold()
        self.queue.clear()
        self._expected = self._played = self._quiet = 0
        self._watchdog, self._run, self._expired = watchdog, run, False
        self._announce = True

    def give(self, count: int) -> bytes:
        """The lines of the next `count` samples; without force in the buffer it puts out none."""
        assert len(self.queue) <= BUFFER, "the host sent more than the buffer holds"
        rows = [self._next() for _ in range(count)]
        acceleration, _ = self.source.advance(np.array([force for force, _, _ in rows]) * COLUMNS[0].scale)
        announce, self._announce = self._announce or self._number % 1000 < count, False
        lines = [header_line(Header(self.source.rate_Hz, (*COLUMNS, STATE_COLUMN)))] if announce else []
        readings = np.rint(acceleration / COLUMNS[1].scale).astype(int).tolist()
        for (force, played, state), reading in zip(rows, readings, strict=True):
            lines.append(sample_line(self._number, (force, reading, played, state)))
            self._number += 1
        return b"".join(lines)

    def _next(self) -> tuple[int, int, int]:
        """Force of the next sample, how many have been played, and the state."""
        if self._watchdog and self._quiet >= self._watchdog:
            self._expired = True
            self.queue.clear()
        self._quiet += 1
        empty = not self.queue
        asked = 0 if empty else self.queue.popleft()
        self._played = (self._played + (not empty)) % WRAP
        limit = round(self.source.plant.force_limit_N / COLUMNS[0].scale)
        force = min(max(asked, -limit), limit)
        bits = (
            (LIVE, bool(self._watchdog)),
            (EMPTY, empty),
            (WATCHDOG_EXPIRED, self._expired),
            (LIMITED, force != asked),
        )
        return force, self._played, RUN * self._run + sum(bit for bit, on in bits if on)


def serve(peer: Peer, wire: int, over: Callable[[], bool], hurried: bool = False) -> None:
    """Plays the handle at the end `wire` of a pseudo-terminal until it is over.

    Args:
        peer: the handle.
        wire: file descriptor, not blocking.
        over: asked some 100 times a second.
        hurried: as fast as force comes in, not at the rate, and waiting for a reader that is slow.
    """
    rate_Hz = peer.source.rate_Hz
    given, most = int(rate_Hz * time.monotonic()), int(CAUGHT_UP_S * rate_Hz)
    while not over():
        try:
            peer.take(os.read(wire, 1 << 16))
        except BlockingIOError:
            pass
        except OSError:
            return  # the other end was closed for good
        if hurried and peer.queue:
            count, given = len(peer.queue), int(rate_Hz * time.monotonic())
        else:
            time.sleep(BLOCK_S)
            now = int(rate_Hz * time.monotonic())
            count, given = min(now - given, most), now
        _write(wire, peer.give(count), over, 30.0 if hurried else 0.2)


def _write(wire: int, data: bytes, over: Callable[[], bool], patience_s: float) -> None:
    """Write all bytes; bytes that are not read in time are lost, as on a wire."""
    until_s = time.monotonic() + patience_s
    while data and time.monotonic() < until_s and not over():
        try:
            data = data[os.write(wire, data) :]
        except BlockingIOError:
            time.sleep(0.001)
        except OSError:
            return


def main(arguments: list[str] | None = None) -> int:
    """Run the simulator until its time is over or Ctrl-C."""
    parser = simulator_parser("tests.handle.serial_board", __doc__, 5000.0)
    parser.add_argument("--grips", type=int, default=5, metavar="N", help="how many ways to hold it (default 5)")
    parser.add_argument("--hurry", action="store_true", help="play as fast as force comes, not at the rate")
    options = parser.parse_args(arguments)
    peer = Peer(SimulatedSource(Plant(), options.rate, seed=options.seed), options.grips, options.seed)
    peer.give(1)  # compiled before anybody waits
    wire = simulated_port(parser)
    with suppress(KeyboardInterrupt):
        until_s = time.monotonic() + options.seconds
        serve(peer, wire, lambda: time.monotonic() >= until_s, options.hurry)
    return 0


if __name__ == "__main__":
    sys.exit(main())
