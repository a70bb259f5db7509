"""Ten minutes on a desk: ticks beside a viewer that draws and Python that never rests, and an empty loop beside them."""

import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import hapscene
from hapscene.play.monitor import later_than
from hapscene.servo import Servo
from hapscene.servo.empty_loop import EmptyLoop
from hapscene.view.picture import write_picture

MINUTES = float(os.environ.get("SOAK_MINUTES", "10"))
DEMO = Path(__file__).resolve().parents[2] / "assets" / "demo.scene.json"


def memory_kB(pid: int) -> int:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1])


@pytest.mark.soak
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="memory is looked up in /proc")
@pytest.mark.parametrize("device", ["omni", "simulated"])
def test_ticks_are_as_late_as_those_of_an_empty_loop(device: str, tmp_path: Path) -> None:
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
            before, memories, end_s, k = (servo.lateness(), empty.lateness()), [], time.monotonic() + 60.0 * MINUTES, 0
            while time.monotonic() < end_s:
                time.sleep(0.02)
                k += 1
                if device == "omni":
                    servo.aim((0.02 * np.sin(0.02 * k), 0.01 * np.cos(0.013 * k), 0.0), "medium")
                servo.state()
                if k % 500 == 0:
                    memories.append(memory_kB(servo._process.pid))
            ours, theirs = servo.lateness().since(before[0]), empty.lateness().since(before[1])
        finally:
            over.set()
            for thread in threads:
                thread.join()
            empty.stop()
    counts = [later_than(late, 1e-3) for late in (ours, theirs)]
    late = [(round(ours.late_us(share), 1), round(theirs.late_us(share), 1)) for share in (0.5, 0.99, 0.999, 0.9999)]
    print(f"\n{device}: {int(ours.late.sum()):,} ticks, {counts[0]} later than a period, of the empty loop {counts[1]}")
    print(f"late by, and the empty loop [µs]: {late}; missed {ours.missed}, {theirs.missed}")
    print(
        f"busy: median {ours.busy_us():.1f} µs, p99 {ours.busy_us(0.99):.1f}; memory {memories[0]} to {memories[-1]} kB"
    )
    assert counts[0] <= 1.2 * counts[1] + 10
    assert memories[-1] < 1.02 * memories[len(memories) // 4]
