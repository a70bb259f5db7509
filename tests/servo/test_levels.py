"""A servo whose time is taken away feels its scene coarser, without a jump, and finer again when it has time."""

import os
import signal
import time

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.fidelity.fidelity import BodyFidelity, Fidelity, Level, SwatchFidelity
from hapscene.fidelity.level_step import HANDOVER_N
from hapscene.flags import Flag
from hapscene.play.monitor import Monitor, later_than
from hapscene.scene.mesh import Mesh
from hapscene.servo import Servo
from tests.until import until

from .test_servo import MASS

MESHES = [
    Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=n, radius=0.05), "m")
    for n in (6, 4, 3)  # 82,000 faces, 5,000, 1,300
]
FIDELITY = Fidelity(
    tuple(
        Level({"ball": BodyFidelity(mesh)}, {"wood": SwatchFidelity(order=order)})
        for mesh, order in zip(MESHES, (None, 20, 8), strict=True)
    )
)


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs signals that stop a process")
def test_it_steps_down_while_its_time_is_taken_away_and_up_again_when_it_has_it():
    """Its process is stopped for 4 of each 8 ms; what a hand feels that rests on the scene is there all the time."""
    scene = hapscene.Scene()
    scene.add(MESHES[0], name="ball", swatch="wood")
    with Servo(scene, MASS, fidelity=FIDELITY, budget_us=900.0, ring_s=90.0) as servo:
        servo.start((0.0, 0.0, 0.0502))
        servo.aim((0.0, 0.0, 0.048), "medium")
        until(lambda: servo.state().touching and servo.state().tick > 500)
        monitor = Monitor(servo)
        begun, pid = servo.state().tick, servo._process.pid
        end_s = time.monotonic() + 120.0
        while servo.state().level < 2 and time.monotonic() < end_s:
            os.kill(pid, signal.SIGSTOP)
            time.sleep(0.004)
            os.kill(pid, signal.SIGCONT)
            time.sleep(0.004)
        state, calm = servo.state(), servo.lateness()
        assert state.level == 2 and state.level_count == 3 and state.flags & Flag.COARSER and state.touching
        assert "coarser: level 3 of 3" in monitor.lines()
        monitor.close()
        until(lambda: servo.state().tick > begun + 3000)
        deadline_s = time.monotonic() + 120.0
        while servo.state().level > 0 and time.monotonic() < deadline_s:
            time.sleep(0.05)
        ended, since = servo.state(), servo.lateness().since(calm)
        log = servo.read(begun)
        with pytest.raises(hapscene.errors.HapsceneError, match="no copy of what the tick remembered"):
            servo.flight().replay()
    rows = log.rows
    level = (rows["flags"] & Flag.COARSER) != 0
    stepped = np.flatnonzero(np.diff(level)) + 1
    if len(stepped) == 0:
        pytest.skip("this machine takes so much time away by itself that it has been coarser all along")
    change = np.linalg.norm(np.diff(rows["f_W_N"], axis=0), axis=1)
    assert change.max() <= HANDOVER_N + 0.02  # and what the hand itself moves in a tick
    assert change[stepped - 1].max() < 1e-9
    assert rows["touching"].all() and np.linalg.norm(rows["f_W_N"], axis=1).min() > 0.1
    if ended.level > 0 and later_than(since, 1e-3) > 0:
        pytest.skip("this machine lets no 2 s pass without a late tick, so nothing steps up")
    assert ended.level == 0 and not ended.flags & Flag.COARSER and since.up >= 2
