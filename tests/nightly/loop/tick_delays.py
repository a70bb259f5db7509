"""Delays of a driver's ticks against those of an empty loop, in turn by blocks of one second, within one process.

Two loops that run at once share processors in ways that differ from run to run. Taken in turn, over many blocks, both
meet the same load. Threads have no real-time priority and are not pinned; the emulated device has real-time priority
if it is permitted, as a real device needs no processor. Run:
python -m tests.nightly.loop.tick_delays [BUSY [BLOCKS [DEVICE …]]], with BUSY processes that load the processors.
"""

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.device import DeviceChoice
from hapscene.loop import servo_process
from hapscene.loop.shared_memory import open_channel
from hapscene.loop.timing import TimingStatistics, request_realtime_priority
from tests.nightly.loop import empty_loop
from tests.nightly.loop.time_to_zero import DEVICES, busy_processes, wall_scene

BLOCK_S: Final = 1.0

WARM_S: Final = 0.1
"""Time after the start of a block that is not counted [s]."""


def blocks_of(driver: str, folder: Path, count: int) -> tuple[list[TimingStatistics], list[TimingStatistics]]:
    """Timing statistics of the driver and of the empty loop, for each block."""
    device = DEVICES[driver](driver, folder)
    os.environ.update(device.environment)
    sys.path[:0] = [path for path in device.environment.get("PYTHONPATH", "").split(os.pathsep) if path]
    options = dict(option.split("=") for option in device.options.split(","))
    made = {"scene": wall_scene(device), "devices": [DeviceChoice(driver, options)], "force_N": None, "tick_s": 1e-3}
    opened: list[Any] = []
    device.move(device.front_m - 0.005)
    twins = servo_process.open_twins(made, opened)
    channel = open_channel(1000, twins[0].renderer.block, bodies=1)
    row = channel.channel[0]
    try:
        handler = servo_process.OrderHandler(made["scene"], twins, channel)
        ours, theirs = [], []

        def timing() -> TimingStatistics:
            return TimingStatistics(row.late.copy(), row.busy.copy(), int(row.missed))

        handler.start([(0.0, 0.0, 0.0)], np.zeros(3))
        for _ in range(count):
            handler.resume()
            ours.append(_block(timing))
            handler.pause()
            empty = empty_loop.EmptyLoop()
            theirs.append(_block(empty.timing))
            empty.stop()
        assert not channel.fault[0], bytes(channel.fault)
        handler.end()
    finally:
        for connection in opened:
            connection.close()
        device.end()
        channel.memory.unlink()  # its views keep it open until this process ends
    return ours, theirs


def _block(timing: Any) -> TimingStatistics:
    time.sleep(WARM_S)
    before = timing()
    time.sleep(BLOCK_S)
    statistics: TimingStatistics = timing().since(before)
    return statistics


def pooled(blocks: list[TimingStatistics]) -> TimingStatistics:
    """The statistics of all blocks together."""
    return TimingStatistics(
        sum(block.delay for block in blocks), sum(block.busy for block in blocks), sum(block.missed for block in blocks)
    )


def ratios(ours: list[TimingStatistics], theirs: list[TimingStatistics], share: float) -> tuple[float, float, float]:
    """Ratio of the pooled delays at a share of the ticks, and its 5th and 95th percentile over resampled blocks."""
    random, drawn = np.random.default_rng(0), []
    for _ in range(500):
        at = random.integers(len(ours), size=len(ours))
        drawn.append(pooled([ours[k] for k in at]).delay_us(share) / pooled([theirs[k] for k in at]).delay_us(share))
    low, high = np.percentile(drawn, [5, 95])
    return pooled(ours).delay_us(share) / pooled(theirs).delay_us(share), float(low), float(high)


def without_priority() -> None:
    """Let the loops of this process run with normal priority."""
    prompt = lambda *priority: request_realtime_priority(0)  # noqa: E731
    servo_process.request_realtime_priority = empty_loop.request_realtime_priority = prompt


def main(busy: str = "2", blocks: str = "60", *drivers: str) -> None:
    """Print the ratios."""
    without_priority()
    with busy_processes(int(busy)):
        for driver in drivers or ("haply2diy", "inverse3", "falcon", "woodenhaptics"):
            with tempfile.TemporaryDirectory() as folder:
                ours, theirs = blocks_of(driver, Path(folder), int(blocks))
            line = [f"{driver:15}"]
            for share in (0.5, 0.9, 0.99, 0.999):
                late = [pooled(each).delay_us(share) for each in (ours, theirs)]
                ratio, low, high = ratios(ours, theirs, share)
                line.append(f"p{100 * share:g} {late[0]:.0f}/{late[1]:.0f} µs = {ratio:.2f} ({low:.2f} to {high:.2f})")
            print("; ".join(line), flush=True)
    print(f"load {os.getloadavg()[0]:.1f}, {busy} busy processes")


if __name__ == "__main__":
    main(*sys.argv[1:])
