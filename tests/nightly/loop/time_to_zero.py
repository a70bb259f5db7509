"""How long after a fault a device holds force: `hapscene play` drives an emulated device, whose own clock decides.

The device holds its last command. It is pressed against a wall, then a process or the device fails. Run:
python -m tests.nightly.loop.time_to_zero [BUSY [REPEATS [DEVICE …]]], with BUSY processes that load the processor; it
prints a table.
"""

import contextlib
import ctypes
import json
import math
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
import trimesh
from scipy.optimize import brentq

import hapscene
from hapscene.bridge.packets import FRAME, HELLO, STATE, WELCOME, Packet, pack, pack_json, unpack
from hapscene.handle.force_source import SimulatedSource
from hapscene.handle.plant import Plant
from hapscene.loop.timing import PRIORITY
from hapscene_plugins.devices import falcon_kinematics, woodenhaptics
from hapscene_plugins.devices.haply2diy_board import HARDWARE, MIDDLE_M
from hapscene_plugins.devices.haply2diy_kinematics import forward
from tests.handle.serial_board import BLOCK_S, COLUMNS, Peer, serve
from tests.nightly.plugins.devices.conftest import EMULATORS, Emulated
from tests.nightly.plugins.devices.emulators.emulator import prompt_clock
from tests.nightly.plugins.devices.vendor_desk import Desk, emulator
from tests.simulated_port import simulated_port, simulator_parser
from tests.until import until

CLEAR_M, PRESSED_M = -0.005, 0.005
"""Places of the tool before it presses and while it presses, along the axis, from the wall's front [m]."""

RAMP_S: Final = 2.5
"""Time in which the force can rise after the start [s]."""


def arm_angle_deg(y_m: float) -> float:
    """The 2DIY's first arm's angle [°] at which the tool is at (0, y): the second arm mirrors it."""

    def off_m(angle: float) -> float:
        p = forward((math.radians(angle), math.radians(180.0 - angle)), HARDWARE["v3"].base_m)
        assert p is not None
        return MIDDLE_M - p[1] - y_m

    return float(brentq(off_m, 95.0, 165.0))


def falcon_count(y_m: float) -> float:
    """The count of all three encoders of a Falcon at which the grip is at (0, y, 0)."""

    def off_m(count: float) -> float:
        angle = count * falcon_kinematics.COUNT_RAD + falcon_kinematics.ZERO_RAD
        p = falcon_kinematics.forward((angle, angle, angle), (0.0, 0.0, falcon_kinematics.MIDDLE_M))
        assert p is not None
        return falcon_kinematics.MIDDLE_M - p[2] - y_m

    return float(brentq(off_m, -800.0, 800.0))


def environment_with(more: dict[str, str]) -> dict[str, str]:
    """The environment of a process, with more variables; the paths of both are searched."""
    path = os.pathsep.join(filter(None, (more.get("PYTHONPATH"), os.environ.get("PYTHONPATH"))))
    return os.environ | more | {"PYTHONPATH": path}


class Board:
    """An emulated device in a separate process, moved along one axis.

    Attributes:
        options: options with which the driver finds it.
        faults: what to set in the emulator for each fault.
        whole: what to set in it for a device without fault.
        axis, front_m, held: axis of the movement, place of the wall along it, and the command that counts as pressed.
    """

    axis, front_m, held = 0, 0.0, 0.3
    faults: ClassVar[dict[str, dict[str, Any]]]
    whole: ClassVar[dict[str, Any]]

    def __init__(self, driver: str, folder: Path) -> None:
        self.environment = {"HAPSCENE_USB": str(folder / driver), "PYTHONPATH": str(EMULATORS)}
        self.emulated = Emulated(driver, folder)
        self.emulated.set(ready=1)
        self.options = "backend=usb_wire"
        self._log, self._part, self._rows = self.emulated.log.open(), "", []

    def fault(self, name: str) -> None:
        self.emulated.set(**self.faults[name])

    def mend(self) -> None:
        """End a fault."""
        self.emulated.set(**self.whole)

    def rows(self) -> list[list[float]]:
        """Time [ns] and components of all commands."""
        *lines, self._part = (self._part + self._log.read()).split("\n")  # the last line may be incomplete
        for line in lines:
            numbers = [float(part) for part in line.split()]
            if numbers[1] != -1:
                self._rows.append(numbers[:4])
        return self._rows

    def end(self) -> None:
        self._log.close()
        self.emulated.end()


class Haply2diy(Board):
    axis, front_m, held = 1, -0.035, 0.05
    faults: ClassVar = {
        "no answers": {"silent": 1},
        "truncated answers": {"fault": 1},
        "NaN": {"fault": 2},
        "random bytes": {"mangled": 2},
        "position jumps": {"fault": 3},
    }
    whole: ClassVar = {"fault": 0, "silent": 0, "mangled": 0}

    def __init__(self, driver: str, folder: Path) -> None:
        super().__init__(driver, folder)
        self.options = f"port={self.emulated.place},homed=yes"

    def move(self, y_m: float) -> None:
        first = arm_angle_deg(y_m)
        self.emulated.set(first=first, second=180.0 - first)


class Falcon(Board):
    axis, held = 1, 100.0
    faults: ClassVar = {"no answers": {"silent": 1}, "random bytes": {"mangled": 2}}

    def move(self, y_m: float) -> None:
        count = falcon_count(y_m)
        self.emulated.set(count0=count, count1=count, count2=count)


class WoodenHaptics(Board):
    held = 100.0
    faults: ClassVar = {"no answers": {"silent": 1}, "random bytes": {"mangled": 2}}

    def __init__(self, driver: str, folder: Path) -> None:
        super().__init__(driver, folder)
        self.options += ",homed=yes"
        self.emulated.set(b=-1318, c=3464)  # the tool is in the middle of the workspace

    def move(self, x_m: float) -> None:
        angle = math.asin(x_m / woodenhaptics.MIDDLE_M[0])
        self.emulated.set(a=-angle / (2.0 * math.pi) * woodenhaptics.COUNTS / woodenhaptics.GEAR[0])


class Inverse3(Board):
    faults: ClassVar = {"no answers": {"silent": 1}, "NaN": {"x": math.nan}, "random bytes": {"mangled": 2}}

    def __init__(self, driver: str, folder: Path) -> None:
        super().__init__(driver, folder)
        self.options = f"uri={self.emulated.place}"

    def move(self, x_m: float) -> None:
        self.emulated.set(x=x_m + 0.05)


class Library(Board):
    """A vendor's library in the process of the servo, with a desk that outlives it."""

    def __init__(self, driver: str, folder: Path) -> None:
        self._rows, self._count = [], 0
        self.name, self._place = {"openhaptics": ("hd", "position"), "forcedimension": ("dhd", "position")}[driver]
        self.desk = Desk(folder / "desk")
        self.environment = {"HAPSCENE_EMULATED_DESK": str(self.desk.path)}
        self.options = f"library={emulator(self.name)}"
        status = np.zeros(16, np.int64)
        status[:2] = 1
        desk = {"transform": np.eye(4).ravel(), "workspace": (-80, -60, -35, 80, 60, 35), "most_force": 3.4}
        self.desk.set(name=b"NULL", calibration=0x5000, style=4 if self.name == "hd" else 1, status=status, **desk)

    def move(self, x_m: float) -> None:
        self.desk.set(position=(1e3 * x_m, 0.0, 0.0) if self.name == "hd" else (0.0, x_m, 0.0))

    def fault(self, name: str) -> None:
        self.desk.set(**self.faults[name])

    def mend(self) -> None:
        self.desk.set(**self.whole)

    def rows(self) -> list[list[float]]:
        if self.name == "dhd" and self.desk.count:  # the device's own watchdog
            os.environ.update(self.environment)
            ctypes.CDLL(emulator("dhd")).watch()
        new = self.desk.rows(self._count)
        self._count += len(new)
        self._rows += np.column_stack([1e9 * new["t_s"], np.nan_to_num(new["force"])]).tolist()
        return self._rows

    def end(self) -> None:
        pass


class OpenHaptics(Library):
    faults: ClassVar = {
        "no answers": {"begin_error": 0x302},
        "NaN": {"position": (math.nan,) * 3},
        "the library's thread hangs": {"stuck": 1},
    }
    whole: ClassVar = {"begin_error": 0, "position": (0.0,) * 3}


class ForceDimension(Library):
    faults: ClassVar = {
        "no answers": {"refuse": b"dhdGetPosition", "refuse_code": 2},
        "NaN": {"position": (math.nan,) * 3},
    }


class Network:
    """A device on another computer: sends its position at 500 Hz, and stops its force 15 ms after the last answer."""

    axis, front_m, held = 0, 0.0, 0.3
    faults: ClassVar = {"no answers": {"silent": True}, "NaN": {"x_m": math.nan}}
    environment: ClassVar[dict[str, str]] = {}

    def __init__(self, driver: str, folder: Path) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.options, self.x_m, self.silent, self._over, self._rows = f"port={port}", 0.0, False, False, []
        self._thread = threading.Thread(target=self._run, args=(port,), daemon=True)
        self._thread.start()

    def _run(self, port: int) -> None:
        link, key, number = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), 0, 0
        link.connect(("127.0.0.1", port))
        link.settimeout(0.002)
        prompt_clock()
        while not self._over:
            number += 1
            frame = struct.pack("<BBHI3d", 1, 0, 0, 0, self.x_m, 0.0, 0.0)
            hello = pack_json({"version": 1, "nonce": 1, "up": "z", "handed": "right", "metres": 1.0})
            kind, payload = (FRAME, frame) if key else (HELLO, hello)
            with contextlib.suppress(OSError):
                if not self.silent:
                    link.send(pack(Packet(kind, key, number, payload)))
                data = link.recv(65_536)
                while select.select([link], [], [], 0.0)[0]:
                    data = link.recv(65_536)  # the newest answer
                answer = unpack(data)
                key = answer.key if answer.kind == WELCOME else key
                if answer.kind == STATE:
                    self._rows.append([time.monotonic_ns(), *struct.unpack_from("<Qd3d3d3d3d", answer.payload)[11:]])
            time.sleep(0.002)
            if self._rows and time.monotonic_ns() - self._rows[-1][0] > 15_000_000:
                self._rows.append([time.monotonic_ns(), 0.0, 0.0, 0.0])

    def move(self, x_m: float) -> None:
        self.x_m = x_m

    def fault(self, name: str) -> None:
        for attribute, value in self.faults[name].items():
            setattr(self, attribute, value)

    def rows(self) -> list[list[float]]:
        return self._rows.copy()

    def end(self) -> None:
        self._over = True
        self._thread.join()


class Handle(Board):
    """A handle's board. A recorded stroke over a texture drives it; it stops 20 ms after the last data."""

    held, device, swatch = 0.02, "replay", "wood"
    faults: ClassVar = {}

    def __init__(self, driver: str, folder: Path) -> None:
        self.emulated = Emulated.__new__(Emulated)
        command = [sys.executable, "-m", "tests.nightly.loop.time_to_zero", driver, str(folder / "log")]
        self.environment = {"HAPSCENE_USB": str(folder / "board"), "PYTHONPATH": str(EMULATORS)}
        self.emulated.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment_with(self.environment)
        )
        said = self.emulated.process.stdout.readline().strip()  # type: ignore[union-attr]
        self._log, self._part, self._rows = (folder / "log").open(), "", []
        t_s = np.arange(0.0, 0.6, 0.001)
        path = np.column_stack([t_s, np.minimum(0.1 * t_s - 0.005, 0.002), 0.1 * t_s - 0.03, np.zeros_like(t_s)])
        np.savetxt(folder / "stroke.csv", path, delimiter=",", header="t,x,y,z", comments="")
        self.options = f"file={folder / 'stroke.csv'},again=yes,origin=world"
        option = "backend=usb_wire" if driver == "usb" else f"port={said}"
        self.words = ["--handle", driver, "--handle-option", option]

    def move(self, x_m: float) -> None:
        pass


def noting_peer(log: str) -> Peer:
    """The microcontroller of a `Handle`: logs the force of each sample that it plays."""
    peer, file = Peer(SimulatedSource(Plant(), 5000.0)), open(log, "w", buffering=1)  # noqa: PTH123, SIM115
    peer.give(1)
    take_next = peer._next

    def note() -> tuple[int, int, int]:
        force, played, state = take_next()
        file.write(f"{time.monotonic_ns()} {force * COLUMNS[0].scale}\n")
        return force, played, state

    peer._next = note  # type: ignore[method-assign]
    prompt_clock()
    return peer


def serial_board(log: str) -> None:
    """The board of a handle on a serial port."""
    peer = noting_peer(log)
    serve(peer, simulated_port(simulator_parser("tests.nightly.loop.time_to_zero", __doc__, 5000.0)), lambda: False)


class UsbBoard:
    """The board of a handle on USB. It plays by its own clock, also if no process reads it."""

    ids, kind, ends = (0x16C0, 0x05DC), 2, (0x81, 0x02)
    gone = silent = 0.0

    def __init__(self, log: str) -> None:
        self._peer, self._lock, self._out = noting_peer(log), threading.Lock(), b""

    def obey(self) -> None:
        print("up", flush=True)
        threading.Thread(target=self._play, daemon=True).start()

    def _play(self) -> None:
        rate_Hz = self._peer.source.rate_Hz
        given = int(rate_Hz * time.monotonic())
        while True:
            time.sleep(BLOCK_S)
            now = int(rate_Hz * time.monotonic())
            with self._lock:
                self._out = (self._out + self._peer.give(now - given))[-4096:]
            given = now

    def control(self, request: int, value: int) -> None:
        pass

    def write(self, endpoint: int, data: bytes) -> None:
        with self._lock:
            self._peer.take(data)

    def read(self, endpoint: int, wait_s: float) -> bytes | None:
        end_s = time.monotonic() + wait_s
        while not self._out and time.monotonic() < end_s:
            time.sleep(5e-4)
        with self._lock:
            data, self._out = self._out[:1024], self._out[1024:]
        return data or None


def usb_board(log: str) -> None:
    """The board of a handle on USB."""
    from tests.nightly.plugins.devices.emulators.usb_wire import serve as serve_usb

    serve_usb(UsbBoard(log), os.environ["HAPSCENE_USB"])


DEVICES: Final[dict[str, Any]] = {
    "haply2diy": Haply2diy,
    "falcon": Falcon,
    "woodenhaptics": WoodenHaptics,
    "inverse3": Inverse3,
    "openhaptics": OpenHaptics,
    "forcedimension": ForceDimension,
    "network": Network,
    "serial": Handle,
    "usb": Handle,
}
"""Emulated devices by driver."""


def wall_scene(device: Any) -> hapscene.Scene:
    """A wall in front of a device."""
    wall = trimesh.creation.box((0.1, 0.1, 0.1))
    wall.apply_translation((device.front_m + 0.05) * np.eye(3)[device.axis])
    scene = hapscene.Scene()
    scene.add(wall, name="wall", unit="m", swatch=getattr(device, "swatch", None))
    return scene


def press(device: Any) -> None:
    """Move a device against the wall within 0.4 s."""
    for x_m in np.linspace(CLEAR_M, PRESSED_M, 40):
        device.move(device.front_m + x_m)
        time.sleep(0.01)


def is_pressed(device: Any) -> bool:
    """Whether a device exerts a force."""
    return max((abs(part) for row in device.rows()[-50:] for part in row[1:]), default=0.0) > float(device.held)


def time_to_zero_ms(device: Any, since_ns: int) -> float:
    """Time from a moment to the first command of zero that no other follows within 0.4 s [ms]; infinite: none yet."""
    rows, end_ns = [row for row in device.rows()[-100_000:] if row[0] > since_ns], since_ns + 400_000_000
    held = [row[0] for row in rows if any(row[1:]) and row[0] < end_ns]
    zeros = [row[0] for row in rows if not any(row[1:]) and row[0] > max(held, default=since_ns)]
    return float((zeros[0] - since_ns) * 1e-6) if zeros else math.inf


class Play:
    """`hapscene play` with an emulated device, pressed against a wall."""

    def __init__(self, driver: str, folder: Path) -> None:
        device = self.device = DEVICES[driver](driver, folder)
        wall_scene(device).save(folder / "wall.scene.json")
        device.move(device.front_m + CLEAR_M)
        words = ["play", str(folder / "wall.scene.json"), "--device", getattr(device, "device", driver)]
        words += ["--at", "0", "0", "0", "--option", device.options, "--log", str(folder / "logs")]
        words += getattr(device, "words", [])
        self.process = subprocess.Popen(
            [sys.executable, "-m", "hapscene", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env=environment_with(device.environment),
        )
        try:
            until(lambda: len(device.rows()) > 100)
            time.sleep(RAMP_S)
            press(device)
            until(lambda: is_pressed(device))
        except (AssertionError, IndexError):
            self.process.kill()
            device.end()
            raise AssertionError(f"the wall is not pressed: {self.process.communicate()[0]!r}") from None
        self.servo_pid, self.other_pid = self._children()[:2]

    def _children(self) -> list[int]:
        """The processes that multiprocessing started, the oldest first: the servo, its watchdog or its handle.

        The system may give a later process a lower number.
        """
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        started = [pid for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        stats = {pid: Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in started}
        return [int(pid) for pid in sorted(started, key=lambda pid: int(stats[pid][19]))]  # start time

    def end(self) -> None:
        for pid in (self.servo_pid, self.other_pid, self.process.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.communicate()
        self.device.end()


def killed(who: str, by: signal.Signals) -> Callable[[Play], None]:
    """A signal to one of the processes, or to the group."""

    def act(play: Play) -> None:
        if who == "group":
            os.killpg(play.process.pid, by)
        else:
            pids = {"application": play.process.pid, "servo": play.servo_pid, "watchdog": play.other_pid}
            os.kill(pids[who], by)

    return act


SIGNALS: Final = {
    "application: SIGKILL": killed("application", signal.SIGKILL),
    "application: SIGSTOP": killed("application", signal.SIGSTOP),
    "application: SIGINT": killed("application", signal.SIGINT),
    "application: SIGTERM": killed("application", signal.SIGTERM),
    "servo: SIGKILL": killed("servo", signal.SIGKILL),
    "servo: SIGSEGV": killed("servo", signal.SIGSEGV),
    "servo: SIGSTOP": killed("servo", signal.SIGSTOP),
    "servo: SIGTERM": killed("servo", signal.SIGTERM),
    "watchdog: SIGKILL": killed("watchdog", signal.SIGKILL),
    "process group: SIGKILL": killed("group", signal.SIGKILL),
}
"""What happens to processes, by name."""


def events_of(driver: str) -> list[str]:
    """What can happen to a device: signals, and its own faults."""
    signals = [name for name in SIGNALS if DEVICES[driver] is not Handle or "watchdog" not in name]  # it has none
    return [*signals, *(f"device: {fault}" for fault in DEVICES[driver].faults)]


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Processes that compute without end."""
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


SATURATE: Final = f"""
import os, sys, time
os.sched_setaffinity(0, [int(sys.argv[1])])
print(flush=True)
sys.stdin.readline()
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({PRIORITY}))
end_s = time.monotonic() + 0.9
while time.monotonic() < end_s:
    pass
"""
"""A thread with the real-time priority of a servo whose ticks take longer than a period, on one processor."""


@contextmanager
def saturated_processors(cores: Iterable[int] | None = None) -> Iterator[None]:
    """Real-time threads that take processors, by default all, for 0.9 s; the context has a higher priority."""
    words = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    taken = sorted(os.sched_getaffinity(0) if cores is None else cores)
    threads: list[Any] = [subprocess.Popen([sys.executable, "-c", SATURATE, str(core)], **words) for core in taken]
    for thread in threads:
        thread.stdout.readline()
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY + 2))
    try:
        for thread in threads:
            thread.stdin.write("\n")
            thread.stdin.flush()
        time.sleep(0.03)  # until they run
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        for thread in threads:
            thread.communicate()


def measure(driver: str, event: str, folder: Path, saturated: bool = False) -> float:
    """Time to zero force after an event [ms], on processors that real-time threads saturate or not."""
    play = Play(driver, folder)
    try:
        with saturated_processors() if saturated else nullcontext():
            return _time_after(play, event)
    finally:
        play.end()


def _time_after(play: Play, event: str) -> float:
    at_ns = time.monotonic_ns()
    SIGNALS[event](play) if event in SIGNALS else play.device.fault(event.removeprefix("device: "))
    time.sleep(0.6)
    return time_to_zero_ms(play.device, at_ns)


def main(busy: str = "0", repeats: str = "3", *drivers: str) -> None:
    """Print the table."""
    table: dict[str, list[float]] = {}
    with busy_processes(int(busy)):
        for driver in drivers or DEVICES:
            for event in events_of(driver):
                row = table.setdefault(f"{driver}; {event}", [])
                while len(row) < int(repeats):
                    with tempfile.TemporaryDirectory() as folder, contextlib.suppress(AssertionError):  # not pressed
                        row.append(round(measure(driver, event, Path(folder)), 1))
                print(f"{driver:15} {event:28} {row}", flush=True)
    print(json.dumps({"load": os.getloadavg()[0], "busy": busy, "ms": table}))


if __name__ == "__main__":
    boards: Final[dict[str, Any]] = {"serial": serial_board, "usb": usb_board}
    if sys.argv[1:2] and sys.argv[1] in boards:
        boards[sys.argv[1]](*sys.argv[2:])
    else:
        main(*sys.argv[1:])
