"""The end of a servo or its application, by any cause, leaves no process and no memory, and blocks nothing."""

import os
import pickle
import random
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import pytest
import trimesh

from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.loop import Servo
from hapscene.loop.shared_memory import Channel, open_channel
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from tests.until import until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="neither these signals nor named memory there")

MASS = PointMass(0.045, 0.1, 0.26, 5.5e-5)

APPLICATION = """
import sys, time
sys.path.insert(0, {folder!r})
from tests.nightly.loop.test_ending import MASS, make_scene
from hapscene.loop import Servo
if __name__ == "__main__":
    with Servo(make_scene(), MASS) as servo:
        print(servo._channel.memory.name, flush=True)
        time.sleep(600.0)
"""


class Deadly:
    """Ends the process that unpickles it."""

    def __reduce__(self) -> tuple[object, ...]:
        return os._exit, (3,)


def make_scene() -> Scene:
    """A cube."""
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.02, 0.02, 0.02)), "m"), name="cube")
    return scene


def begin(folder: Path, text: str) -> subprocess.Popen[str]:
    """Start a program in a separate process group."""
    script = folder / "application.py"
    script.write_text(text.format(folder=str(Path(__file__).parents[3])))
    return subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.fixture
def blocks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the shared blocks that were created."""
    names = []

    def noted(length: int, block: int, **counts: int) -> Channel:
        channel = open_channel(length, block, **counts)
        names.append(channel.memory.name)
        return channel

    monkeypatch.setattr("hapscene.loop.servo_connection.open_channel", noted)
    return names


def assert_gone(blocks: list[str]) -> None:
    (name,) = blocks
    with pytest.raises(FileNotFoundError):
        SharedMemory(name)


def test_memory_of_a_running_servo_has_no_name() -> None:
    with Servo(make_scene(), MASS) as servo:
        name = servo._channel.memory.name
        with pytest.raises(FileNotFoundError):
            SharedMemory(name)
        servo.start((0.0, 0.0, 0.05))
        until(lambda: servo.state().tick >= 10)


def test_process_that_dies_at_the_start() -> None:
    servo = Servo(make_scene(), MASS, first=Deadly(), padding=bytes(10_000_000))
    said: list[str] = []

    def enter() -> None:
        try:
            servo.__enter__()
        except HapsceneError as error:
            said.append(str(error))

    thread = threading.Thread(target=enter, daemon=True)
    thread.start()
    thread.join(120.0)
    assert len(said) == 1 and "exit code 3" in said[0]


def test_argument_that_cannot_be_pickled(blocks: list[str]) -> None:
    with pytest.raises((AttributeError, TypeError, pickle.PicklingError)), Servo(make_scene(), lambda: None):
        pass
    assert_gone(blocks)


def test_servo_not_entered_uses_no_resources(blocks: list[str]) -> None:
    threads = threading.active_count()
    servo = Servo(make_scene(), MASS)
    assert "not started" in repr(servo)
    servo.close()
    assert not blocks and threading.active_count() <= threads and "closed" in repr(servo)


def test_application_without_close_ends(tmp_path: Path) -> None:
    text = APPLICATION.replace("    with Servo(make_scene(), MASS) as servo:", "    servo = Servo(make_scene(), MASS)")
    text = text.replace("        time.sleep(600.0)", "").replace("        print(", "    servo.__enter__()\n    print(")
    application = begin(tmp_path, text)
    out, errors = application.communicate(timeout=120.0)
    assert (application.returncode, errors) == (0, "")
    assert not Path("/dev/shm", out.strip()).exists()


def test_start_in_progress_can_be_cancelled() -> None:
    servo = Servo(make_scene(), MASS)

    def cancel() -> None:
        while servo._process is None:
            time.sleep(0.001)
        servo.cancel()

    thread = threading.Thread(target=cancel)
    thread.start()
    with pytest.raises(HapsceneError, match=r"cancelled|has ended"):
        servo.__enter__()
    thread.join()
    assert not servo.alive


# Missing shared memory.


ENTER = """
import sys
sys.path.insert(0, {folder!r})
from tests.nightly.loop.test_ending import MASS, make_scene
from hapscene.errors import HapsceneError
from hapscene.loop import Servo
if __name__ == "__main__":
    try:
        with Servo(make_scene(), MASS) as servo:
            servo.start((0.0, 0.0, 0.05))
            servo.read(), servo.pause()
            print("it runs")
    except HapsceneError as error:
        print(error)
"""


def enter_with(mount: str, folder: Path) -> str:
    """Return the output of a servo that is entered with another folder mounted over that of shared memory."""
    enter = shutil.which("unshare")
    command = f"mount -t tmpfs {mount} && exec {shlex.quote(sys.executable)} {folder / 'application.py'}"
    tried = [enter or "unshare", "-m", "sh", "-c", f"mount -t tmpfs {mount}"]
    if sys.platform != "linux" or enter is None or subprocess.run(tried, capture_output=True).returncode:
        pytest.skip("needs Linux and the permission to mount a folder (root)")
    (folder / "application.py").write_text(ENTER.format(folder=str(Path(__file__).parents[3])))
    done = subprocess.run([enter, "-m", "sh", "-c", command], capture_output=True, text=True, timeout=120.0)
    assert (done.returncode, done.stderr) == (0, "")  # no SIGBUS, and no output of the resource tracker
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("mount", "says"),
    [
        ("-o size=1m tmpfs /dev/shm", "/dev/shm has 1,048,576 bytes"),
        ("-o ro tmpfs /dev/shm", "mount -t tmpfs tmpfs /dev/shm"),
        ("-o size=7900k tmpfs /dev/shm", "it runs"),
    ],
    ids=["small", "read-only", "just enough"],
)
def test_missing_shared_memory_is_reported(mount: str, says: str, tmp_path: Path) -> None:
    assert says in enter_with(mount, tmp_path)


# Kills at random times.


USED = """
import os, sys
from multiprocessing import shared_memory
sys.path.insert(0, {folder!r})
from tests.nightly.loop.test_ending import MASS, make_scene
from hapscene.loop import Servo
if __name__ == "__main__":
    shared_memory._make_filename = lambda: f"/of-{{os.getpid()}}"
    servo = Servo(make_scene(), MASS)
    print("made", flush=True)
    with servo:
        print(servo._process.pid, flush=True)
        servo.start((0.0, 0.0, 0.05))
        while True:
            servo.aim((0.0, 0.0, 0.009)), servo.state(), servo.read()
            if servo.state().tick % 50 == 0:
                servo.repaint(make_scene())
"""


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="no folder to see the memory in")
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(2, 20))])
def test_kill_at_any_time_leaves_nothing(seed: int, tmp_path: Path) -> None:
    chance, running = random.Random(seed), seed % 3 > 0
    application = begin(tmp_path, USED)
    assert application.stdout is not None
    said = [application.stdout.readline() for _ in range(1 + running)]
    time.sleep(chance.uniform(0.0, 0.3))  # any time after that
    of_servo = seed % 3 == 1
    os.kill(int(said[1]) if of_servo else application.pid, signal.SIGKILL)
    errors = application.communicate(timeout=120.0)[1]  # its pipes close with the last process that holds them
    if of_servo:
        assert "HapsceneError" in errors and "exit code -9" in errors
    elif running:  # before it runs, the resource tracker of Python reports what it cleaned up
        assert errors == ""
    until(lambda: not alive(application.pid))
    assert not Path("/dev/shm", f"of-{application.pid}").exists()


def alive(group: int) -> bool:
    """Return whether a process of the group exists."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
