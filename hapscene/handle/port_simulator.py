"""A handle without hardware: `python -m hapscene.handle.port_simulator` speaks the protocol on a pseudo-terminal.

It prints the port's name; `hapscene handle identify --port NAME` in another terminal then identifies it. Each time that
a sweep begins, the simulated hand holds it otherwise.
"""

import os
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from hapscene.handle.force_source import SimulatedSource, simulated_grips
from hapscene.handle.plant import Plant
from hapscene.handle.serial_handle import BUFFER, START
from hapscene.wire.port import simulated_port, simulator_parser
from hapscene.wire.protocol import WRAP, Column, Header, checksum, header_line, sample_line

COLUMNS: Final = (Column("force", "N", 1e-4), Column("acceleration", "m/s2", 1e-3), Column("played", "1", 1.0))

BLOCK_S: Final = 0.01
"""Time between two writes [s]."""


class Peer:
    """What a handle's microcontroller does: takes lines of force in, gives lines of samples out."""

    def __init__(self, source: SimulatedSource, grip_count: int = 5, seed: int = 0) -> None:
        self.source = source
        self.queue: deque[int] = deque()
        self._grips = simulated_grips(grip_count, seed)
        self._rest = b""
        self._expected = self._played = self._number = self._grip = 0
        self._announce = True

    def take(self, data: bytes) -> None:
        """Takes in what the host sent."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            body, _, crc = line.rpartition(b"*")
            if crc != b"%04X" % checksum(body):
                continue
            if body == START:
                self._begin()
                continue
            number, *counts = (int(part) for part in body.split(b","))
            lost = (number - self._expected) % WRAP
            self.queue.extend([0] * lost if lost <= BUFFER else [])
            self.queue.extend(counts)
            self._expected = (number + len(counts)) % WRAP

    def _begin(self) -> None:
        if self._played:  # a new sweep: another grip
            self._grip = (self._grip + 1) % len(self._grips)
        _, k_u, b_u = self._grips[self._grip]
        self.source.plant = replace(self.source.plant, k_u_N_m=k_u, b_u_Ns_m=b_u)
        self.queue.clear()
        self._expected = self._played = 0
        self._announce = True

    def give(self, count: int) -> bytes:
        """The lines of the next `count` samples; without force in the buffer it puts out none."""
        assert len(self.queue) <= BUFFER, "the host sent more than the buffer holds"
        force = [self.queue.popleft() if self.queue else None for _ in range(count)]
        acceleration, _ = self.source.advance(np.array([value or 0 for value in force]) * COLUMNS[0].scale)
        announce, self._announce = self._announce or self._number % 1000 < count, False
        lines = [header_line(Header(self.source.rate_Hz, COLUMNS))] if announce else []
        for value, reading in zip(force, np.rint(acceleration / COLUMNS[1].scale).astype(int).tolist(), strict=True):
            self._played = (self._played + (value is not None)) % WRAP
            lines.append(sample_line(self._number, (value or 0, reading, self._played)))
            self._number += 1
        return b"".join(lines)


def serve(peer: Peer, wire: int, over: Callable[[], bool], hurried: bool = False) -> None:
    """Plays the handle at the end `wire` of a pseudo-terminal until it is over.

    Args:
        peer: the handle.
        wire: file descriptor, not blocking.
        over: asked about 100 times a second.
        hurried: as fast as force comes in, not at the rate, and waiting for a reader that is slow.
    """
    count = max(1, round(BLOCK_S * peer.source.rate_Hz))
    due_s = time.monotonic()
    while not over():
        try:
            peer.take(os.read(wire, 1 << 16))
        except BlockingIOError:
            pass
        except OSError:
            return  # the other end was closed for good
        if not (hurried and peer.queue):
            due_s = max(due_s + BLOCK_S, time.monotonic() - BLOCK_S)  # what was missed is not made up for
            time.sleep(max(0.0, due_s - time.monotonic()))
        _write(wire, peer.give(len(peer.queue) if hurried and peer.queue else count), over, 30.0 if hurried else 0.2)


def _write(wire: int, data: bytes, over: Callable[[], bool], patience_s: float) -> None:
    """Writes all of it; what nobody reads in that time is lost, as on a wire."""
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
    parser = simulator_parser("hapscene.handle.port_simulator", __doc__, 5000.0)
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
