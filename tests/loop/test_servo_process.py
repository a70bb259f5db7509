"""The servo in a real process: its start, an error there, and its end."""

import os
import signal
import warnings
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any
from unittest.mock import ANY, MagicMock, call

import numpy as np
import pytest

from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.loop import Servo, servo_process
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


# The main function of the process, without devices, loop and memory.


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    """Notes all. The wire is looked at: nothing, then the watchdog ends, then there are orders."""
    system, scene = MagicMock(), SimpleNamespace(bodies=[SimpleNamespace(mesh=SimpleNamespace(faces=[0] * 12))] * 2)
    names = ("ready_among", "open_twins", "open_channel", "settings_of", "OrderHandler")
    for name in names:
        monkeypatch.setattr(servo_process, name, getattr(system, name))
    monkeypatch.setattr(signal, "signal", system.signal)
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    system.made = {"scene": scene, "bodies": 9, "log_folder": "logs", "settings": "strong"}
    system.ready_among.side_effect = [[], [system.life], [system.wire], [system.wire]]
    system.open_twins.side_effect = lambda made, opened: (opened.append(system.device), [system.twin])[1]
    system.twin.renderer.block, system.OrderHandler.return_value.made = 4, {"seed": 3}
    system.OrderHandler.return_value.connections = [system.device]
    return system


def run_with(system: MagicMock, *orders: Any) -> list[Any]:
    """Run the process with these orders; a type of error is raised instead. Return what it did."""
    system.wire.recv.side_effect = [system.made, *orders]
    servo_process.run(system.wire, system.life, "name", 100)
    (_, twins, *given), _ = system.OrderHandler.call_args
    assert twins == [] and given == [system.open_channel(), "logs", system.settings_of()]  # no views are left
    return [act for act in system.mock_calls if not act[0].endswith(("Handler", "_of", "recv", "__"))][:-1]


HANDLER = call.OrderHandler()


def test_the_process_answers_orders_and_then_closes_all(system: MagicMock) -> None:
    wire, life, made = system.wire, system.life, system.made
    assert run_with(system, ("tune", ("wood", 1)), ("stop", ())) == [
        *(call.signal(signal.SIGTERM, servo_process._end), call.wire.send((None, ANY))),
        *(call.open_twins(made, [system.device]), call.open_channel(100, 4, "name", bodies=9, tools=1)),
        *(call.wire.send((None, ANY)), call.wire.send((None, {"seed": 3}))),
        *(call.ready_among([wire, life], 0.1), HANDLER.check_devices(True)),
        *(call.ready_among([wire, life], 0.1), HANDLER.check_devices(False), call.ready_among([wire], 0.1)),
        *(HANDLER.answer("tune", ("wood", 1)), call.wire.send(ANY), call.ready_among([wire], 0.1)),
        *(HANDLER.end(), call.device.close(), call.life.send(None), HANDLER.write_faults()),
        call.open_channel().close(unlink=False),
    ]
    assert "24" in wire.send.call_args_list[0][0][0][1] and made == {"scene": made["scene"], "settings": "strong"}


@pytest.mark.parametrize("error", [EOFError, OSError, KeyboardInterrupt])
def test_the_end_of_the_application_is_logged(system: MagicMock, error: type) -> None:
    """An interrupted process may still write a force: it does not say that its devices are closed."""
    system.life.send.side_effect = BrokenPipeError
    done = run_with(system, error)
    assert done[done.index(HANDLER.end()) :] == [
        *(HANDLER.end(), call.device.close(), *([] if error is KeyboardInterrupt else [call.life.send(None)])),
        *(HANDLER.write_faults(), HANDLER.write_log("the application has ended")),
        call.open_channel().close(unlink=False),
    ]


@pytest.mark.parametrize("error", [HapsceneError, ZeroDivisionError])
def test_a_start_that_fails_is_answered(system: MagicMock, error: type[Exception]) -> None:
    system.settings_of.side_effect = error("too far")
    system.wire.recv.side_effect = [system.made]
    with pytest.raises(ZeroDivisionError) if error is ZeroDivisionError else nullcontext():
        servo_process.run(system.wire, system.life, "name", 100)
    ((answer, none),) = system.wire.send.call_args[0]
    assert none is None and ("Traceback" in answer) == (answer != "too far") == (error is ZeroDivisionError)
    assert system.mock_calls[-3:] == [
        call.device.close(),
        call.life.send(None),
        call.open_channel().close(unlink=False),
    ]


def test_a_second_sigterm_has_no_effect(system: MagicMock) -> None:
    with pytest.raises(KeyboardInterrupt):
        servo_process._end(signal.SIGTERM, None)
    assert system.mock_calls == [call.signal(signal.SIGTERM, signal.SIG_IGN)]
