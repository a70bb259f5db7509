"""`hapscene lab teleoperate`, as typed."""

import json
import signal
import subprocess
import sys

import pytest

from hapscene.interrupt import ENDS


@pytest.mark.skipif(sys.platform == "win32", reason="no process can send these signals there")
@pytest.mark.parametrize("kind", [signal.SIGINT, *ENDS])
def test_a_follower_that_is_ended_says_how_it_went(kind: signal.Signals) -> None:
    command = [sys.executable, "-m", "hapscene", "lab", "teleoperate", "follower", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "a follower listens at 127.0.0.1:" in process.stdout.readline()
        process.send_signal(kind)
        told, complained = process.communicate(timeout=120.0)
    assert process.returncode == 0 and complained == "" and json.loads(told)["ended"] == "it was stopped"
