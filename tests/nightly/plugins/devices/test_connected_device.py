"""Tests the driver contract on a connected device: `pytest tests/nightly/plugins/devices/test_connected_device.py
--device NAME`.

Without `--device`, the simulated device is tested. The force is at most 0.5 N. The result is written to
`device-report.json`, to be filed with an issue (docs/how-to/set-up-a-device.md).
"""

import json
import platform
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.compiled.native import INTERPRETED
from hapscene.device.driver import DEVICE_STATE
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.play.first_run import FORCE_N, try_device


@pytest.fixture(scope="module")
def choice(request: pytest.FixtureRequest) -> DeviceChoice:
    options = dict(text.split("=", 1) for text in request.config.getoption("--device-option"))
    return DeviceChoice(request.config.getoption("--device") or "simulated", options)


def test_device_is_opened_read_and_closed(choice: DeviceChoice) -> None:
    with choice.open() as device:
        assert device.state.dtype == DEVICE_STATE
        end_s = time.monotonic() + 60.0
        while device.state.ready[0] == 0 and time.monotonic() < end_s:
            device.read()
            device.write()
        assert device.state.ready[0] == 1, device.reason(int(device.state.trouble[0]))
        count = int(device.state.count[0])
        for _ in range(200):
            device.read()
            device.write()
            R = device.state.R_DT[0]
            assert np.isfinite(device.state.p_DT_m).all() and pytest.approx(np.eye(3), abs=1e-3) == R @ R.T
        assert device.state.count[0] > count
    device.close()  # twice does no harm


def test_options_that_it_does_not_have_are_refused(choice: DeviceChoice) -> None:
    with pytest.raises(Exception, match="no option 'colour'"):
        DeviceChoice(choice.name, {**choice.options, "colour": "red"}).open()


@pytest.mark.skipif(INTERPRETED, reason="an interpreted tick takes longer than a period")
def test_first_run_passes(choice: DeviceChoice, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    lines: list[str] = []
    code = try_device(choice.name, choice.options, lines.append, wait=False)
    asked = request.config.getoption("--device") is not None
    report: dict[str, Any] = {
        "device": choice.name,
        "options": choice.options,
        "hapscene": version("hapscene"),
        "system": platform.platform(),
        "python": platform.python_version(),
        "most_N": FORCE_N,
        "assumptions": DRIVERS.load(choice.name).assumptions,
        "output": [line.strip() for line in lines],
        "good": code == 0,
    }
    place = (Path.cwd() if asked else tmp_path) / "device-report.json"
    place.write_text(json.dumps(report, indent=2, ensure_ascii=False), encoding="utf-8")
    if asked:  # another program that came between is not a test's fault
        assert code == 0, "".join(lines)
    assert any("N sent, downwards" in line and "good" in line for line in lines), "".join(lines)
