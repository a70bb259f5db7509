"""The handle that is played as sound: on a null sink, and on simulated cards."""

import time
from pathlib import Path
from typing import Any

import numpy as np

RATE_HZ = 48_000


RECORDING = """
import sys, numpy as np
from hapscene.handle.live_process import open_output
from hapscene.handle.live_process import play_recording
samples = np.load(sys.argv[1])
output = open_output("audio", {"gain": 0.02, "highpass_Hz": 0, "buffer_s": sys.argv[2], "block": 480})
stream = play_recording(samples, 10_000.0, output)
print(output.name, output._columns, stream.counts)
"""


LIVE = """
import runpy, sys
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


SERVO = """
import os, sys, threading, time, numpy as np
from contextlib import closing
from hapscene.loop.shared_memory import open_channel
from hapscene.handle.live_process import LiveHandle

def tick(channel, over):
    began, done = time.monotonic(), 0
    while not over.is_set():
        for done in range(done + 1, int(1e3 * (time.monotonic() - began)) + 1):
            at = np.arange(10 * done - 10, 10 * done) / 1e4
            channel.a_m_s2[0, (done - 1) % 8000] = 25.0 * np.sin(2 * np.pi * 250.0 * at)
            channel.channel[0].done = done
        time.sleep(1e-3)

if __name__ == "__main__":
    channel, over = open_channel(8000, 10), threading.Event()
    thread = threading.Thread(target=tick, args=(channel, over))
    thread.start()
    where = {"length": 8000, "block": 10, "name": channel.memory.name}
    with closing(LiveHandle(where, 1e4, 0, os.getpid(), "audio", {"gain": 0.02, "buffer_s": sys.argv[1]})) as handle:
        time.sleep(1.9)
        report = handle.update_report()
        over.set()  # ticks stop
        thread.join()
        time.sleep(0.2)
    channel.close(unlink=True)
    print(round(1e3 * report["latency_s"], 1), int(report["gaps"] + report["skips"] + report["underruns"]))
"""


def test_dualsense_plays_a_recording_on_channels_3_and_4_to_16_bits(sink: Any, tmp_path: Path) -> None:
    t_s = np.arange(10_000) / 1e4
    np.save(tmp_path / "chirp.npy", 25.0 * np.sin(2.0 * np.pi * (20.0 + 245.0 * t_s) * t_s))
    wanted_s = np.arange(1200, 47_000) / RATE_HZ
    wanted = 0.5 * np.sin(2.0 * np.pi * (20.0 + 245.0 * wanted_s) * wanted_s)
    error = np.inf
    for buffer_s in ("0.1", "0.2"):  # a busy computer may leave a gap without an underrun flag
        with sink.recording(tmp_path / "played"):
            output = sink.python(RECORDING, str(tmp_path / "chirp.npy"), buffer_s)
            time.sleep(0.3)
        played = sink.recorded(tmp_path / "played")
        assert output.startswith("dualsense [2, 3]")
        assert not played[:, :2].any()
        np.testing.assert_array_equal(played[:, 2], played[:, 3])
        at = int(np.argmax(np.correlate(played[:, 2], wanted[20_000:24_000], "valid"))) - 20_000
        assert (
            not played[: at - 1500, 2].any() and not played[at + 49_000 :, 2].any()
        )  # silence, faded, before and after
        error = min(error, np.abs(played[at : at + len(wanted), 2] - wanted).max())
        if error < 1.8e-5:
            break
    assert error < 1.8e-5  # half a step of 16 bits, 1.53e-5, and what the resampler is off by


def test_servo_output_has_no_clicks_and_ends_in_silence(sink: Any, tmp_path: Path) -> None:
    (tmp_path / "servo.py").write_text(SERVO)
    for buffer_s in ("0.05", "0.1", "0.2"):  # a busy computer
        with sink.recording(tmp_path / "played"):
            latency_ms, wrong = sink.python(LIVE, str(tmp_path / "servo.py"), buffer_s).split()
            time.sleep(0.2)
        played = sink.recorded(tmp_path / "played")
        loud = np.flatnonzero(np.abs(played[:, 2]) > 1e-3)
        if wrong == "0" and np.abs(np.diff(played[:, 2])).max() < 0.025:
            break
    assert wrong == "0" and 0.0 < float(latency_ms) - 1e3 * float(buffer_s) < 60.0
    assert not played[:, :2].any() and not played[-2000:].any()
    assert np.abs(np.diff(played[:, 2])).max() < 0.025
    part = played[loud[-1] - 52_800 : loud[-1] - 4_800, 2] * np.blackman(48_000)
    spectrum = np.abs(np.fft.rfft(part))
    assert spectrum.argmax() == 250 and spectrum[260:].max() < 1e-3 * spectrum.max()
