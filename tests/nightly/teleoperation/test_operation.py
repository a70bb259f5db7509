"""Teleoperation in closed loop: interpreted and compiled results agree."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hapscene.device.sim.point import PointMass
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.teleoperation.operation import Impairment, Operation
from hapscene.teleoperation.plate import plate


def run_briefly() -> list[float]:
    """Eight ticks with contact, waves, a link with loss, and the handle."""
    device, line = PointMass(0.05, 0.1, 0.1, 55e-6), Impairment(0.001, 0.001, 0.1)
    operation = Operation(plate("wood"), (0.0, 0.0, 1e-6), line=line, device=device)
    operated = operation.run(ReferenceTrajectory.hold((0.0, 0.0, -0.05), 8))
    sums = operated.a_handle_m_s2.sum(), operated.a_tip_m_s2.sum()
    return [*operated.leader_W_m[-1].tolist(), *operated.f_leader_W_N[-1].tolist(), *map(float, sums)]


def test_interpreted_and_compiled_agree() -> None:
    code = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
    code += "from test_operation import run_briefly; print(*run_briefly())"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    compiled = run_briefly()
    assert [float(word) for word in done.stdout.split()] == pytest.approx(compiled, rel=1e-9, abs=1e-15)
    assert compiled[5] != 0.0 and compiled[-1] != 0.0
