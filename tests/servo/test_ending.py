"""However the servo, its application or both end: no process stays, no memory, and nobody waits."""

import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import pytest
import trimesh

from hapscene.device.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.servo import Servo

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="neither these signals nor named memory there")

MASS = PointMass(0.045, 0.1, 0.26, 5.5e-5)

APPLICATION = """
import sys, time
sys.path.insert(0, {folder!r})
from test_ending import MASS, make_scene
from hapscene.servo import Servo
if __name__ == "__main__":
    with Servo(make_scene(), MASS) as servo:
        print(servo._channel.memory.name, flush=True)
        time.sleep(600.0)
"""


class Deadly:
    """Ends the process that takes it out of its box."""

    def __reduce__(self) -> tuple[object, ...]:
        return os._exit, (3,)


def make_scene() -> Scene:
    """A cube."""
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.02, 0.02, 0.02)), "m"), name="cube")
    return scene


def test_once_it_runs_its_memory_has_no_name_that_could_stay() -> None:
    with Servo(make_scene(), MASS) as servo:
        name = servo._channel.memory.name
        with pytest.raises(FileNotFoundError):
            SharedMemory(name)
        servo.start((0.0, 0.0, 0.05))
        end_s = time.monotonic() + 20.0
        while servo.state().tick < 10:
            assert time.monotonic() < end_s
            time.sleep(0.01)


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="no folder to see the memory in")
@pytest.mark.parametrize("all_of_them", [False, True])
def test_a_killed_application_leaves_nothing_and_says_nothing(tmp_path: Path, all_of_them: bool) -> None:
    script = tmp_path / "application.py"
    script.write_text(APPLICATION.format(folder=str(Path(__file__).parent)))
    application = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert application.stdout is not None
    name = application.stdout.readline().strip()
    if all_of_them:  # the resource tracker as well
        os.killpg(application.pid, signal.SIGKILL)
    else:
        application.kill()
    assert application.communicate(timeout=60.0) == ("", "")  # the pipes end with the last process that has them
    assert not Path("/dev/shm", name).exists()


def test_a_process_that_dies_of_what_it_is_sent_is_not_waited_for() -> None:
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
    assert said == ["the servo's process has ended (exit code 3); start a new one"]


def test_a_start_can_be_cancelled() -> None:
    servo = Servo(make_scene(), MASS)
    name = servo._channel.memory.name
    servo.cancel()
    with pytest.raises(HapsceneError, match="cancelled"):
        servo.__enter__()
    with pytest.raises(FileNotFoundError):
        SharedMemory(name)


def test_a_start_under_way_can_be_cancelled() -> None:
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
