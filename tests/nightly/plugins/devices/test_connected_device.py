"""Tests the driver contract on a connected device: `pytest tests/nightly/plugins/devices/test_connected_device.py
--device NAME`.

Without `--device`, the simulated device is tested. The force is at most 0.5 N. The result is written to
`device-report.json`, to be filed with an issue (docs/how-to/set-up-a-device.md).
"""

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from hapscene.compiled.native import INTERPRETED
from hapscene.device.check import check_driver
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.play.first_run import FORCE_N, try_device


@pytest.fixture(scope="module")
def choice(request: pytest.FixtureRequest) -> DeviceChoice:
    options = dict(text.split("=", 1) for text in request.config.getoption("--device-option"))
    return DeviceChoice(request.config.getoption("--device") or "simulated", options)


def test_it_keeps_the_driver_contract(choice: DeviceChoice) -> None:
    lines: list[str] = []
    assert check_driver(DRIVERS.load(choice.name), choice.options, lines.append), "".join(lines)


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
    assert any("ok: commanded 0.3 N" in line for line in lines), "".join(lines)
    assert not any("far from all bodies" in line for line in lines), "".join(lines)
