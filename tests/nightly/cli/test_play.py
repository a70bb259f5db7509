"""`hapscene play` as a process."""

import subprocess
import sys
from pathlib import Path

import pytest

from hapscene.compiled.native import INTERPRETED

ROOT = Path(__file__).resolve().parents[3]


DEMO = str(ROOT / "assets" / "demo.scene.json")


compiled = pytest.mark.skipif(INTERPRETED, reason="an interpreted tick takes longer than a period")


@compiled
def test_ctrl_c_ends_it_with_the_summary() -> None:
    command = [sys.executable, "-m", "hapscene", "play", DEMO, "--device", "omni"]
    playing = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    for line in playing.stdout:  # type: ignore[union-attr]
        if "ticks/s" in line:
            break
    playing.send_signal(2)
    out, errors = playing.communicate(timeout=120.0)
    assert playing.returncode == 0 and "deadline misses" in out and errors == ""
