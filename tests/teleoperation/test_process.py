"""Two real processes on this machine, over UDP, with loss and reordering."""

import json
import signal
import subprocess
import sys
import time

import pytest

from hapscene.errors import HapsceneError
from hapscene.teleoperation.coupling import Coupling
from hapscene.teleoperation.link import Impairment
from hapscene.teleoperation.process import run_follower

LINE = "Impairment(delay_s=0.02, jitter_s=0.003, loss=0.1, reorder=0.1)"

FOLLOWER = f"""
import json
from hapscene.teleoperation.process import Coupling, Impairment, run_follower
print(json.dumps(run_follower(("127.0.0.1", 0), "127.0.0.1", "wood", Coupling(), {LINE})))
"""

LEADER = f"""
import json, sys
from hapscene.teleoperation.process import Coupling, Impairment, run_leader
address = ("127.0.0.1", int(sys.argv[1]))
print(json.dumps(run_leader(address, "medium", "inverse", Coupling(), {LINE}, duration_s=60.0)))
"""


def start(code: str, *words: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", code, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT to another process")
def test_two_processes_stay_passive_over_a_bad_line_and_end_at_ctrl_c() -> None:
    follower = start(FOLLOWER)
    leader = None
    try:
        assert follower.stdout is not None
        ready = follower.stdout.readline()
        assert ready.startswith("a follower listens at 127.0.0.1:"), follower.stderr and follower.stderr.read()
        leader = start(LEADER, ready.rsplit(":", 1)[1].strip())
        assert leader.stdout is not None
        leader.stdout.readline()
        time.sleep(1.5)
        leader.send_signal(signal.SIGINT)
        told = [process.communicate(timeout=30) for process in (leader, follower)]
    finally:
        for process in (leader, follower):
            if process is not None and process.poll() is None:
                process.kill()
    assert leader.returncode == follower.returncode == 0, told
    led, followed = (json.loads(out.splitlines()[-1]) for out, _ in told)
    assert led["ended"] == "it was stopped" and followed["ended"] == "the peer has ended"
    for went in (led, followed):
        assert went["heard"]["let in"] > 100 and went["lost_by_impairment"] > 10
        assert went["heard"]["overtaken"] > 10
        assert went["heard"]["malformed"] == went["heard"]["foreign"] == 0
        assert went["force_in_silence_N"] == 0.0
    assert led["work_of_motors_mJ"] + followed["work_of_motors_mJ"] < 2.0


def test_an_address_of_another_machine_cannot_be_listened_at() -> None:
    with pytest.raises(HapsceneError, match=r"192\.0\.2\.1:1: cannot be listened at"):
        run_follower(("192.0.2.1", 1), "127.0.0.1", "wood", Coupling(), Impairment())
