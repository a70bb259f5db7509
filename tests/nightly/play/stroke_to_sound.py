"""Time from a press on the page of `hapscene play` to its sound, on a sound card without hardware.

Chromium has no window, and the sound goes to a null sink of PulseAudio, which is recorded. The time runs from the
browser's time of the pointer event to the first sample of the tap in the recording. Run:
python -m tests.nightly.play.stroke_to_sound [COUNT]; it prints the figures.
"""

import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from playwright.sync_api import Page, sync_playwright

from hapscene.loop import Servo
from hapscene.play.page_server import PageServer
from tests.nightly.play.test_page_browser import is_ready, make_scene, pixel
from tests.nightly.plugins.devices.conftest import MAP, RATE_HZ, NullSink, missing
from tests.until import until

LOUD: Final = 3e-3
"""Level above which the tap has begun, relative to full scale [1]: ten times the quantum of the silent sink."""


class Monitor:
    """Notes when loud samples of the null sink were played. A sample is as old as those that were read after it."""

    def __init__(self, sink: NullSink) -> None:
        words = ["parec", "--device=dualsense.monitor", "--format=s16le", f"--rate={RATE_HZ}", "--channels=4", "--raw"]
        words += [f"--channel-map={MAP}", "--latency-msec=4"]
        self._recorder = subprocess.Popen(words, env=sink.env, stdout=subprocess.PIPE)
        self.loud_s: list[float] = []
        self.chunks: list[int] = []
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        assert self._recorder.stdout is not None
        rest = b""
        while data := os.read(self._recorder.stdout.fileno(), 1 << 16):
            now_s, data = time.time(), rest + data
            frames = np.frombuffer(data[: len(data) // 8 * 8], np.int16).reshape(-1, 4)
            rest = data[frames.nbytes :]
            self.chunks.append(len(frames))
            loud = np.flatnonzero(np.abs(frames).max(axis=1) > LOUD * 32767)
            self.loud_s += (now_s - (len(frames) - loud) / RATE_HZ).tolist()

    def first_after_s(self, at_s: float) -> float:
        """Time of the first loud sample after a time; NaN without one."""
        return next((loud_s for loud_s in self.loud_s if loud_s > at_s), np.nan)

    def close(self) -> None:
        self._recorder.terminate()
        self._thread.join()
        self._recorder.wait()


def press(tab: Page, servo: Servo, monitor: Monitor, x_m: float) -> float:
    """Press once; the time to the sound [ms]."""
    tab.mouse.move(*pixel(tab, x_m, 0.03))
    tab.wait_for_timeout(500)  # silence
    tab.mouse.down()
    until(lambda: servo.state().touching)
    tab.wait_for_timeout(500)
    pressed_s = 1e-3 * float(tab.evaluate("window.pressedAt"))
    tab.mouse.up()
    return 1e3 * (monitor.first_after_s(pressed_s) - pressed_s)


def measure(count: int, folder: Path) -> dict[str, Any]:
    """Press `count` times; times to the sound, latency that the output reports, and time of the recorder's chunks."""
    sink = NullSink(folder)
    cache = {"XDG_CACHE_HOME": str(Path.home() / ".cache")}  # of compiled code, since the sink has its own home
    os.environ.update(sink.env | cache)
    scene = make_scene()
    try:
        with (
            PageServer(scene, tools=1) as page,
            Servo(scene, page.devices, handle="audio") as servo,
            sync_playwright() as playwright,
        ):
            servo.start([(0.0, 0.0, 0.0)])
            page.attach(servo)
            servo.turn_handle(1.0)
            monitor = Monitor(sink)
            browser = playwright.chromium.launch(executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"))
            tab = browser.new_page(viewport={"width": 1000, "height": 640})
            tab.goto(page.url)
            until(lambda: is_ready(tab))
            note = "window.pressedAt = performance.timeOrigin + e.timeStamp"
            tab.evaluate(f"pad.addEventListener('pointerdown', (e) => {{ {note}; }}, true)")
            times_ms = [press(tab, servo, monitor, 0.05 + 1e-3 * (k % 20)) for k in range(count)]
            report = servo.handle_report()
            browser.close()
            monitor.close()
    finally:
        sink.close()
    chunk_ms = 1e3 * float(np.median(monitor.chunks)) / RATE_HZ
    return {"times_ms": times_ms, "buffer_ms": 1e3 * report["latency_s"], "chunk_ms": chunk_ms, "report": report}


def main(count: str = "20") -> None:
    """Print the figures."""
    if lacking := missing():
        raise SystemExit(f"not installed: {lacking}")
    with tempfile.TemporaryDirectory() as folder:
        found = measure(int(count), Path(folder))
    times_ms = np.array(found["times_ms"])
    print(np.round(times_ms, 1).tolist())
    print(
        f"press to sound: median {np.nanmedian(times_ms):.0f} ms, p90 {np.nanpercentile(times_ms, 90):.0f} ms, "
        f"{np.isnan(times_ms).sum()} without a sound; of it the buffer of the sound card, as it reports it: "
        f"{found['buffer_ms']:.0f} ms; recorder: chunks of {found['chunk_ms']:.0f} ms; load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
