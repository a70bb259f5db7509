"""The first run with a device, on a virtual servo."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.cli.play import middle_of_top
from hapscene.device.model import DEVICES
from hapscene.device.sim.hand import grip_named
from hapscene.errors import DeviceError
from hapscene.flags import Flag
from hapscene.play import first_run
from hapscene.scene.scene import Scene
from tests.virtual_clock import VirtualClock
from tests.virtual_servo import VirtualServo


@pytest.mark.parametrize("push_s", [first_run.PUSH_S, 0.0])
def test_each_check_of_a_simulated_device(push_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    servos: list[VirtualServo] = []

    def open_servo(*arguments: Any, **made: Any) -> VirtualServo:
        servos.append(VirtualServo(*arguments, **made))
        return servos[0]

    time = SimpleNamespace(
        sleep=lambda span_s: servos[0].advance(round(1e3 * span_s)), monotonic=lambda: servos[0].clock.now_s()
    )
    monkeypatch.setattr(first_run, "Servo", open_servo)
    monkeypatch.setattr(first_run, "time", time)
    monkeypatch.setattr(first_run, "PUSH_S", push_s)
    said: list[str] = []
    code = first_run.try_device("simulated", {"model": "phantom-1.0"}, said.append, wait=False)
    passes = push_s > 0.0
    assert code == (0 if passes else 1)
    assert [line.strip() for line in said if line.startswith(("  ok: ", "  FAILED: "))] == [
        "ok: 1000 positions per second",
        "ok: moved 0 mm along x, 0 mm along y, 0 mm along z",
        "ok: largest step 0.00 mm per tick",
        "ok: commanded 0.3 N, sent 0.29 N downwards" if passes else "FAILED: commanded 0.3 N, sent 0.00 N downwards",
        "ok: no force while paused",
    ]
    sank_mm = float(next(line for line in said if "moved down" in line).split()[-2])
    point, k_N_m = DEVICES["phantom-1.0"].point, grip_named("light").k_N_m
    assert point is not None  # friction stops it beside the point where the hand carries the push
    assert not passes or sank_mm == pytest.approx(1e3 * first_run.PUSH_N / k_N_m, abs=1e3 * point.c_N / k_N_m)


def test_a_device_is_calibrated_or_refused_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, said = VirtualClock(), list[str]()
    time = SimpleNamespace(sleep=clock.sleep_s, monotonic=clock.now_s)
    monkeypatch.setattr(first_run, "time", time)
    state = SimpleNamespace(ready=0, trouble=1)

    def home() -> None:
        state.trouble, servo.notice = 0, "homing"

    servo: Any = SimpleNamespace(device_state=lambda: state, home=home, notice="")
    driver: Any = SimpleNamespace(home="press the button", needs="an air supply")
    start_s = clock.now_s()
    with pytest.raises(DeviceError, match=r"60 s: homing.*an air supply"):
        first_run._await_ready(servo, driver, said.append, said.append)
    assert said == ["Calibration: press the button.", "homing\n"]
    assert first_run.READY_S < clock.now_s() - start_s < first_run.READY_S + 0.2
    state.ready = 1
    first_run._await_ready(servo, driver, said.append, said.append)
    assert said[2:] == ["ready\n"]


@pytest.mark.parametrize("simulated", [True, False])
@pytest.mark.parametrize(("count", "missed", "step_mm"), [(800, 11, 0.5), (400, 10, 3.0), (800, 0, 0.0)])
def test_the_moves_of_a_device_are_measured(
    count: int, missed: int, step_mm: float, simulated: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It moves along y, there and back, in the last of 1000 ticks."""
    clock, counts, said = VirtualClock(), iter((100, 100 + count)), list[str]()
    monkeypatch.setattr(first_run, "time", SimpleNamespace(sleep=clock.sleep_s, monotonic=clock.now_s))
    rows = np.zeros(1000, [("p_WT_m", float, 3), ("flags", int)])
    rows["p_WT_m"] += (1.0, 2.0, 3.0)
    rows["p_WT_m"][900:, 1] -= 1e-3 * step_mm * np.minimum(np.arange(100), np.arange(100)[::-1])
    rows["flags"][3] = Flag.HEAT_LIMITED
    servo: Any = SimpleNamespace(
        state=lambda: SimpleNamespace(tick=7),
        device_state=lambda: SimpleNamespace(count=next(counts)),
        read=lambda since: SimpleNamespace(rows=rows[: 1000 * (since == 7)]),
        timing=lambda: SimpleNamespace(since=lambda late: SimpleNamespace(missed=missed)),
        tick_s=1e-3,
    )
    driver: Any = SimpleNamespace(simulated=simulated, speed_m_s=2.0)
    checks = first_run._look_at_moves(servo, driver, said.append)
    assert [good for _, good in checks] == [count > 400, simulated or step_mm > 0.0, step_mm < 2.0, False]
    words = [
        f"{count / 4:.0f} ",
        f"0 mm along x, {49 * step_mm:.0f} mm along y, 0 mm",
        f"step {step_mm:.2f} mm",
        "warm",
    ]
    assert all(word in text for word, (text, _) in zip(words, checks, strict=True))
    assert [f"{missed} of 1000" in line for line in said] == [True] * (missed > 10)


def test_flags_of_a_ramp_and_of_a_busy_computer_are_no_problem() -> None:
    flags = np.array([Flag.RAMPED | Flag.STALLED, Flag.HEAT_LIMITED, Flag.APPLICATION_SILENT])
    assert first_run._problems(flags) == [("force reduced: motors are warm", False)]


def test_a_device_is_placed_at_the_middle_of_the_top() -> None:
    import trimesh

    scene, pose = Scene(), np.eye(4)
    pose[:3, 3] = (0.5, 0.2, 0.0)
    scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), unit="m")
    scene.add(trimesh.creation.box((0.2, 0.2, 0.4)), unit="m", pose=pose)
    assert middle_of_top(scene) == pytest.approx((0.25, 0.1, 0.2))
