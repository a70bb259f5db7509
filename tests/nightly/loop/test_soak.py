"""Soak test: delays of ticks beside a viewer and a busy Python thread, compared with an empty loop."""

import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import hapscene
from hapscene.loop import Servo
from hapscene.loop.empty_loop import EmptyLoop
from hapscene.play.monitor import deadline_misses
from hapscene.view.picture import write_picture

MINUTES = float(os.environ.get("SOAK_MINUTES", "10"))
DEMO = Path(__file__).resolve().parents[3] / "assets" / "demo.scene.json"


def memory_kB(pid: int) -> int:
    """Return the private memory of a process, without shared memory [kB]."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("RssAnon")).split()[1])


@pytest.mark.soak
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="memory is looked up in /proc")
@pytest.mark.parametrize("device", ["omni", "simulated"])
def test_delays_equal_those_of_an_empty_loop(device: str, tmp_path: Path) -> None:
    scene, over = hapscene.load_scene(DEMO), threading.Event()

    def spin() -> None:
        while not over.is_set():
            sum(range(1000))

    def draw() -> None:
        while not over.is_set():
            write_picture(scene, None, tmp_path / "scene.png")

    with Servo(scene, device, ring_s=60.0) as servo:
        servo.start((0.0, 0.0, 0.05))
        empty = EmptyLoop()
        threads = [threading.Thread(target=work) for work in (spin, draw)]
        for thread in threads:
            thread.start()
        try:
            time.sleep(5.0)
            before, memories, end_s, k = (servo.timing(), empty.timing()), [], time.monotonic() + 60.0 * MINUTES, 0
            while time.monotonic() < end_s:
                time.sleep(0.02)
                k += 1
                if device == "omni":
                    servo.aim((0.02 * np.sin(0.02 * k), 0.01 * np.cos(0.013 * k), 0.0), "medium")
                servo.state()
                if k % 500 == 0:
                    memories.append(memory_kB(servo._process.pid))
            ours, theirs = servo.timing().since(before[0]), empty.timing().since(before[1])
        finally:
            over.set()
            for thread in threads:
                thread.join()
            empty.stop()
    more, less = (deadline_misses(late, 1e-3) for late in (ours, theirs))
    late = [(round(ours.delay_us(share), 1), round(theirs.delay_us(share), 1)) for share in (0.5, 0.99, 0.999, 0.9999)]
    print(f"\n{device}: {int(ours.delay.sum()):,} ticks, {more} later than a period, of the empty loop {less}")
    print(f"late by, and the empty loop [µs]: {late}; missed {ours.missed}, {theirs.missed}")
    print(
        f"busy: median {ours.busy_us():.1f} µs, p99 {ours.busy_us(0.99):.1f}; memory {memories[0]} to {memories[-1]} kB"
    )
    assert more <= 1.2 * less + 10
    assert memories[-1] < 1.02 * memories[len(memories) // 4]
