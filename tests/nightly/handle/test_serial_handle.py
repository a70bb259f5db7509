"""A handle over a pseudo-terminal: a simulated one at the wire, and wires and handles that go wrong."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")


def test_the_simulator_is_identified_as_typed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], end_in_time: Callable[["subprocess.Popen[str]"], None]
) -> None:
    """Two processes: the simulated handle at its port, and the command."""
    from hapscene.cli import main
    from hapscene.handle.handle_file import load_handle

    command = [sys.executable, "-m", "tests.handle.serial_board", "--rate", "2000", "--seconds", "60", "--hurry"]
    with subprocess.Popen([*command, "--grips", "2"], stdout=subprocess.PIPE, text=True) as simulator:
        end_in_time(simulator)
        assert simulator.stdout is not None
        name = simulator.stdout.readline().strip()
        try:
            words = ["device", "identify", "--port", name, "--grips", "2", "--high", "400", "--seconds", "2.5"]
            assert main([*words, "-o", str(tmp_path / "a.handle")]) == 0
        finally:
            simulator.terminate()
    found = load_handle(tmp_path / "a.handle")
    assert found.plant.m_h_kg == pytest.approx(0.12, rel=0.02) and found.plant.k_s_N_m == pytest.approx(250.0, rel=0.1)
    assert found.grips[1].k_u_N_m > 5.0 * found.grips[0].k_u_N_m
    output = capfd.readouterr().out
    assert "grip light: hold the handle in this grip" in output and "mass of the handle" in output
