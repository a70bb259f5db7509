"""Emulated devices: each in a separate process, which logs the forces that it receives with its clock; a sound card."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

EMULATORS = Path(__file__).parent / "emulators"


class Emulated:
    """A running emulator. `place` is its address: a path, the name of a port, or a network address."""

    def __init__(self, name: str, folder: Path) -> None:
        self.log = folder / f"{name}.log"
        self.place = str(folder / name)
        command = [sys.executable, str(EMULATORS / f"{name}.py"), str(self.log), self.place]
        # the emulator imports emulator.py from its folder
        beside = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, env=beside, **pipes)
        said = self.process.stdout.readline().strip()  # type: ignore[union-attr]
        assert said, f"the emulator {name} does not start"
        self.place = self.place if said == "up" else said

    def set(self, **orders: float) -> None:
        """Set parameters of the emulator, such as faults to inject."""
        for name, value in orders.items():
            self.process.stdin.write(f"{name} {float(value)}\n")  # type: ignore[union-attr]
            self.process.stdin.flush()  # type: ignore[union-attr]
            said = self.process.stdout.readline()  # type: ignore[union-attr]
            assert said == "done\n" or name == "gone"  # a disconnected emulator may exit without an answer

    def rows(self) -> list[list[float]]:
        """Return the received forces: time [ns] and components."""
        return [[float(part) for part in line.split()] for line in self.log.read_text().splitlines()]

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()  # type: ignore[union-attr]
        self.process.stdout.close()  # type: ignore[union-attr]


@pytest.fixture
def emulate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Emulated]]:
    """Return a function that starts an emulator by name and makes it the USB bus."""
    running: list[Emulated] = []

    def start(name: str) -> Emulated:
        emulated = Emulated(name, tmp_path)
        running.append(emulated)
        monkeypatch.syspath_prepend(EMULATORS)
        monkeypatch.setenv("PYTHONPATH", str(EMULATORS), prepend=":")
        monkeypatch.setenv("HAPSCENE_USB", emulated.place)
        return emulated

    yield start
    for emulated in running:
        emulated.end()


# Simulated sound card: a null sink of PulseAudio, and a recording of what is played.


RATE_HZ = 48_000

NEEDED = {"pulseaudio": "pulseaudio", "parec": "pulseaudio-utils", "pactl": "pulseaudio-utils"}

ALSA = 'pcm.dualsense { type pulse device dualsense hint { show on description "DualSense" } }\n'

MAP = "front-left,front-right,rear-left,rear-right"
"""Channels of the sink, as in the USB descriptor of a DualSense."""


def missing() -> str:
    """Return the missing packages, for the reason of a skip; empty if all are installed."""
    packages = sorted({package for command, package in NEEDED.items() if shutil.which(command) is None})
    try:
        import sounddevice  # noqa: F401
    except ImportError:
        packages.append("sounddevice (Python)")
    except OSError:
        packages.append("libportaudio2")
    if not any(Path("/usr/lib").glob("*/alsa-lib/libasound_module_pcm_pulse.so")):
        packages.append("libasound2-plugins")
    return ", ".join(packages)


class NullSink:
    """Null sink with four channels, listed as a DualSense."""

    def __init__(self, folder: Path) -> None:
        runtime = folder / "run"
        runtime.mkdir(mode=0o700)
        (folder / ".asoundrc").write_text(ALSA)
        self.env = {
            **os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(runtime), "PULSE_RUNTIME_PATH": str(runtime),
            "PULSE_SERVER": f"unix:{runtime}/native",
        }  # fmt: skip
        sink = f"module-null-sink sink_name=dualsense channels=4 channel_map={MAP} rate=48000 format=s16le"
        words = ["pulseaudio", "-n", "--daemonize=no", "--use-pid-file=no", "--exit-idle-time=-1", "--log-level=0"]
        loads = [f"--load=module-native-protocol-unix socket={runtime}/native auth-anonymous=1", f"--load={sink}"]
        self._daemon = subprocess.Popen([*words, *loads], env=self.env, stderr=subprocess.DEVNULL)
        self._wait(lambda: "dualsense" in self._listed(), "the sink")

    def _listed(self) -> str:
        return subprocess.run(["pactl", "list", "short", "sinks"], env=self.env, capture_output=True, text=True).stdout

    @staticmethod
    def _wait(done: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + 20.0
        while not done():
            assert time.monotonic() < deadline_s, f"{what} did not appear within 20 s"
            time.sleep(0.05)

    @contextmanager
    def recording(self, file: Path) -> Iterator[None]:
        """Record what is played in this context to a file, (n, 4) int16."""
        words = ["parec", "--device=dualsense.monitor", "--format=s16le", f"--rate={RATE_HZ}", "--channels=4", "--raw"]
        words += [f"--channel-map={MAP}", "--latency-msec=20"]
        with file.open("wb") as out, subprocess.Popen(words, env=self.env, stdout=out) as recorder:
            try:
                self._wait(lambda: file.stat().st_size > 0, "the monitor's first sample")  # 1 to 2 s
                yield
            finally:
                recorder.send_signal(signal.SIGTERM)

    def python(self, code: str, *words: str, timeout_s: float = 120.0) -> str:
        """Run Python code with this sound card; return its standard output."""
        done = subprocess.run(
            [sys.executable, "-c", code, *words], env=self.env, capture_output=True, text=True, timeout=timeout_s
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def close(self) -> None:
        self._daemon.terminate()
        self._daemon.wait(120.0)

    @staticmethod
    def recorded(file: Path) -> np.ndarray:
        """Return the recording (n, 4) [1 = full scale], which PortAudio rounds to 16 bits."""
        whole = np.fromfile(file, np.int16)
        return whole[: len(whole) // 4 * 4].reshape(-1, 4) / 32767.0


@pytest.fixture(scope="session")
def sink(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NullSink]:
    lacking = missing()
    if lacking:
        pytest.skip(f"not installed: {lacking} (.ci/system-packages, extra `audio`)")
    sink = NullSink(tmp_path_factory.mktemp("sink"))
    yield sink
    sink.close()
