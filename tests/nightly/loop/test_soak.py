"""Soak tests: delays of ticks beside a viewer and a busy Python thread, compared with an empty loop; devices that fail
again and again."""

import importlib.util
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hapscene
from hapscene.device import DeviceChoice, choose
from hapscene.loop import Servo
from hapscene.play.monitor import deadline_misses
from hapscene.view.picture import write_picture
from tests.nightly.loop import time_to_zero
from tests.nightly.loop.empty_loop import EmptyLoop
from tests.until import until

MINUTES = float(os.environ.get("SOAK_MINUTES", "10"))
DEMO = Path(__file__).resolve().parents[3] / "assets" / "demo.scene.json"


def load_beside(name: str) -> Any:
    """Load a module of the driver tests."""
    place = Path(__file__).parents[1] / "plugins" / "devices" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, place)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def memory_kB(pid: int) -> int:
    """Return the private memory of a process, without shared memory [kB]."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("RssAnon")).split()[1])


@pytest.mark.soak
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="memory is looked up in /proc")
@pytest.mark.parametrize("device", ["omni", "simulated", "openhaptics"])
def test_delays_equal_those_of_an_empty_loop(device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, over, choice, desk = hapscene.load_scene(DEMO), threading.Event(), device, None
    if device == "openhaptics":
        vendor = load_beside("vendor_desk")
        desk = vendor.Desk(tmp_path / "desk")
        monkeypatch.setenv("HAPSCENE_EMULATED_DESK", str(desk.path))
        workspace = (-80, -60, -35, 80, 60, 35)
        desk.set(name=b"NULL", calibration=0x5000, style=4, transform=np.eye(4).ravel(), workspace=workspace)
        desk.set(most_force=3.4)
        choice = choose("openhaptics", library=vendor.emulator("hd"))

    def spin() -> None:
        while not over.is_set():
            sum(range(1000))

    def draw() -> None:
        while not over.is_set():
            write_picture(scene, None, tmp_path / "scene.png")

    with Servo(scene, choice, ring_s=60.0) as servo:
        servo.start((0.0, 0.0, 0.05) if desk is None else (0.0, 0.0, 0.012))
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
                elif desk is not None:  # a stroke over the plate; y points up in the frame of the device
                    place = np.eye(4)
                    place[3, :3] = 20.0 * np.sin(0.02 * k), -12.0, 10.0 * np.cos(0.013 * k)
                    desk.set(transform=place.ravel(), position=place[3, :3])
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
    if desk is not None:
        spent_us = 1e6 * desk.rows()["spent_s"][-60_000:]
        print("in the callback [µs], median and p99:", np.round(np.percentile(spent_us, [50, 99]), 1).tolist())
    assert more <= 1.2 * less + 10
    assert memories[-1] < 1.02 * memories[len(memories) // 4]


@pytest.mark.soak
@pytest.mark.skipif(
    not Path("/proc").is_dir() or not hasattr(os, "openpty"), reason="needs /proc and a pseudo-terminal"
)
@pytest.mark.parametrize("driver", ["haply2diy", "openhaptics"])
def test_force_ends_after_each_fault_and_returns(driver: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A device is pressed against a wall. It fails in all ways in turn, some shorter than the driver's patience."""
    device, random = time_to_zero.DEVICES[driver](driver, tmp_path), np.random.default_rng(20)
    for name, value in device.environment.items():
        monkeypatch.setenv(name, value)
    options = dict(option.split("=") for option in device.options.split(","))
    faults = [name for name in device.faults if "hangs" not in name]  # the watchdog ends the servo
    times_ms: dict[str, list[float]] = {name: [] for name in faults}
    memories, recovered, k, end_s = [], 0, 0, time.monotonic() + 60.0 * MINUTES

    def is_pressed() -> bool:
        nonlocal recovered
        if servo.mode == "error":  # the fault lasted too long, or the device is elsewhere after it
            servo.recover()
            servo.resume()
            recovered += 1
        return time_to_zero.is_pressed(device)

    try:
        device.move(device.front_m + time_to_zero.CLEAR_M)
        with Servo(time_to_zero.wall_scene(device), DeviceChoice(driver, options)) as servo:
            servo.start((0.0, 0.0, 0.0))
            while time.monotonic() < end_s:
                time_to_zero.press(device)
                until(is_pressed)
                name, at_ns = faults[k % len(faults)], time.monotonic_ns()
                device.fault(name)
                time.sleep(random.uniform(0.1, 1.0))
                times_ms[name].append(time_to_zero.time_to_zero_ms(device, at_ns))
                device.mend()
                for x_m in np.linspace(time_to_zero.PRESSED_M, time_to_zero.CLEAR_M, 40):
                    device.move(device.front_m + x_m)
                    time.sleep(0.01)
                memories.append(memory_kB(servo._process.pid))
                k += 1
    finally:
        device.end()
    print(f"\n{driver}: {k} faults, {recovered} reopened; memory {memories[0]} to {memories[-1]} kB")
    print("time to zero [ms], median and largest:", {n: (np.median(t), max(t)) for n, t in times_ms.items() if t})
    assert max(max(times) for times in times_ms.values() if times) < 30.0
    assert recovered > 0 and memories[-1] < 1.02 * memories[len(memories) // 4]
