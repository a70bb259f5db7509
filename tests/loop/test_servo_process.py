"""The servo in a real process: its start, an error there, and its end."""

import os
import signal

import numpy as np
import pytest

from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.loop import Servo
from tests.loop.test_servo import ASKED, MASS, make_scene
from tests.until import until


@pytest.mark.skipif(not hasattr(os, "waitid"), reason="needs waitid")
def test_killed_process_rejects_calls_and_keeps_its_ticks() -> None:
    with Servo(make_scene(), MASS) as servo:
        servo.start((0.0, 0.0, 0.01))
        until(lambda: servo.state().tick >= 50)
        os.kill(servo._process.pid, signal.SIGKILL)
        os.waitid(os.P_PID, servo._process.pid, os.WEXITED | os.WNOWAIT)  # its end is now visible
        for asked in ASKED.values():
            with pytest.raises(HapsceneError, match="exit code -9"):
                asked(servo)
        assert "ended" in repr(servo)
        log = servo.session_log()
        assert log.first == 0 and log.rows.shape[1] > 50 and np.ptp(log.rows["p_WT_m"][0, :, 2]) < 1e-6
    for asked in ASKED.values():
        with pytest.raises(HapsceneError, match="closed"):
            asked(servo)
    with pytest.raises(HapsceneError, match="closed"):
        servo.session_log()
    with pytest.raises(HapsceneError, match="entered"):
        servo.__enter__()


def test_error_of_the_process_is_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    far = np.eye(4)
    far[0, 3] = 5.0
    with pytest.raises(HapsceneError, match="reach"), Servo(make_scene(), Omni(), X_WD=far):
        pass
    assert "Traceback" not in capfd.readouterr().err
