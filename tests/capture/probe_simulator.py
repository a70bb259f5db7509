"""A simulated probe: `python -m tests.capture.probe_simulator` speaks the probe protocol on a pseudo-terminal.

It prints the name of the port. A hand strokes back and forth; its force and speed set the level of a surface with two
resonances.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import Final

import numpy as np

from hapscene.io.probe_protocol import Column, Header, sample_line
from hapscene.wall_clock import CLOCK, Clock
from tests.header_line import header_line
from tests.simulated_port import simulated_port, simulator_parser

COLUMNS: Final = (
    Column("acceleration", "m/s2", 1e-3),
    Column("force", "N", 1e-3),
    Column("tangential_force", "N", 1e-3),
    Column("speed", "m/s", 1e-4),
)
FRICTION: Final = 0.4
LEVEL: Final = 10.0
"""Acceleration at 1 N and 1 m/s, root mean square [m/s²]."""

BLOCK_S: Final = 0.01
"""Time between two writes [s]."""

LATE_S: Final = 2e-3
"""Interval at which the simulator tries to write again [s]."""

HELD_S: Final = 0.6
"""How late a reader may be before what was sent is lost [s]: as Linux holds it for a serial port of 921,600 baud. For a
pseudo-terminal it holds a tenth of a second, too little where reader or simulator wait for a busy core."""


def strokes(rate_Hz: float, seed: int = 0) -> Iterator[np.ndarray]:
    """Blocks of `BLOCK_S` of counts (k, 4) for `COLUMNS`, without end."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    poles = [np.exp((2j * np.pi * f - 160.0) / rate_Hz) for f in (180.0, 420.0)]
    a = np.poly([*poles, *np.conj(poles)]).real
    energy = np.sum(lfilter([1.0], a, np.eye(1, round(rate_Hz))[0]) ** 2)
    state = np.zeros(4)
    count = max(1, round(BLOCK_S * rate_Hz))
    scales = np.array([column.scale for column in COLUMNS])
    n = np.arange(count)
    while True:
        t_s = n / rate_Hz
        force = 1.2 + 0.6 * np.sin(2 * np.pi * 0.31 * t_s)
        speed = 0.12 * np.sin(2 * np.pi * 0.7 * t_s)
        excitation = LEVEL / np.sqrt(energy) * np.abs(speed) * force * rng.standard_normal(count)
        acceleration, state = lfilter([1.0], a, excitation, zi=state)
        table = np.stack([acceleration, force, FRICTION * force * np.sign(speed), np.abs(speed)], axis=1)
        yield np.rint(table / scales).astype(np.int64)
        n = n + count


def lines(rate_Hz: float, seed: int = 0, drop: float = 0.0) -> Iterator[bytes]:
    """What the probe prints in each `BLOCK_S`, the header once a second; lines are left out with probability `drop`."""
    rng = np.random.default_rng([seed, 1])
    header = header_line(Header(rate_Hz, COLUMNS))
    number = 0
    for turn, counts in enumerate(strokes(rate_Hz, seed)):
        kept = rng.random(len(counts)) >= drop
        rows = [sample_line(number + i, row) for i, row in enumerate(counts.tolist()) if kept[i]]
        yield (header if turn % round(1.0 / BLOCK_S) == 0 else b"") + b"".join(rows)
        number += len(counts)


def main(arguments: list[str] | None = None, clock: Clock = CLOCK) -> int:
    """Run the simulator until its time is over or Ctrl-C."""
    parser = simulator_parser("tests.capture.probe_simulator", __doc__, 3200.0)
    parser.add_argument("--drop", type=float, default=0.0, metavar="P", help="probability that a line is lost")
    options = parser.parse_args(arguments)
    import scipy.signal  # noqa: F401  # slow import, before the port is announced

    wire = simulated_port(parser)
    start_s = taken_s = clock.now_s()
    with suppress(KeyboardInterrupt):
        for turn, text in enumerate(lines(options.rate, options.seed, options.drop)):
            if turn * BLOCK_S >= options.seconds:
                break
            clock.sleep_s(max(0.0, start_s + turn * BLOCK_S - clock.now_s()))
            while text:
                try:
                    text, taken_s = text[os.write(wire, text) :], clock.now_s()
                except BlockingIOError:
                    if clock.now_s() - taken_s > HELD_S:  # without a reader, samples are lost as on a serial line
                        break
                    clock.sleep_s(LATE_S)
    return 0


if __name__ == "__main__":
    sys.exit(main())
