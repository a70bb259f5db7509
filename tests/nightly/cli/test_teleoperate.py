"""`hapscene lab teleoperate`"""

import json
import signal
import subprocess
import sys

import pytest

from hapscene.interrupt import ENDS


@pytest.mark.skipif(sys.platform == "win32", reason="no process can send these signals there")
@pytest.mark.parametrize("kind", [signal.SIGINT, *ENDS])
def test_a_follower_prints_a_summary_when_it_is_ended(kind: signal.Signals) -> None:
    command = [sys.executable, "-m", "hapscene", "lab", "teleoperate", "follower", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert "follower listening at 127.0.0.1:" in process.stdout.readline()
        process.send_signal(kind)
        output, errors = process.communicate(timeout=120.0)
    assert process.returncode == 0 and errors == "" and json.loads(output)["ended"] == "stopped"
