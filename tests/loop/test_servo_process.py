"""The servo in a real process: its start, an error there, and its end."""

import os
import signal
import warnings
import weakref
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

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


class Twin:
    """Can be referred to weakly."""

    renderer = SimpleNamespace(block=4)


@pytest.fixture
def acts(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the process does, in order; without devices, loop and memory. Looks at the wire find nothing, then the end
    of the watchdog, then an order."""
    acts: list[Any] = []

    def note(*words: Any, result: Any = None) -> Callable[..., Any]:
        return lambda *given, **more: (acts.append((*words, *given, *more.values())), result)[1]

    device = SimpleNamespace(close=note("close device"), state=None)
    views = weakref.WeakSet[Any]()  # twins, which hold views of the memory
    memory = SimpleNamespace(close=lambda unlink: acts.append(("close memory", unlink, len(views))))
    names = ("end", "check_devices", "write_faults", "write_log")
    handler = SimpleNamespace(made={"seed": 3}, connections=[device], **{name: note(name) for name in names})
    handler.answer = lambda order, arguments: (None, (order, *arguments))
    found = iter((slice(0), slice(1, 2)))

    def open_twins(made: dict[str, Any], opened: list[Any]) -> list[Any]:
        opened.append(device)
        acts.append(made.pop("settings"))
        if isinstance(acts[-1], Exception):
            raise acts[-1]
        twins = [Twin()]
        views.update(twins)
        return twins

    def look(ends: list[Any], span_s: float) -> list[Any]:
        acts.append((len(ends), span_s))
        return ends[next(found, slice(1))]

    monkeypatch.setattr(servo_process, "ready_among", look)
    monkeypatch.setattr(servo_process, "open_twins", open_twins)
    monkeypatch.setattr(servo_process, "open_channel", note("memory", result=memory))
    monkeypatch.setattr(servo_process, "settings_of", lambda renderers, settings: (len(renderers), settings))
    monkeypatch.setattr(servo_process, "OrderHandler", lambda scene, *given: (acts.append(given[2:]), handler)[1])
    monkeypatch.setattr(signal, "signal", note())
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    return acts


def run_with(acts: list[Any], *orders: Any, settings: Any = "strong", deaf: bool = False) -> None:
    """Run the process with these orders; a type of error is raised instead."""
    bodies = [SimpleNamespace(mesh=SimpleNamespace(faces=[0] * 12))] * 2
    made = {"scene": SimpleNamespace(bodies=bodies), "bodies": 9, "log_folder": "logs", "settings": settings}
    waiting = iter([made, *orders])

    def recv() -> Any:
        order = next(waiting)
        if isinstance(order, type):
            raise order
        return order

    def send(message: Any) -> None:
        error, result = message
        acts.append(("stage", "24" in result) if isinstance(result, str) else (error, result))

    def live(message: object) -> None:
        acts.append("closed")
        if deaf:
            raise BrokenPipeError

    wire: Any = SimpleNamespace(recv=recv, send=send)
    servo_process.run(wire, SimpleNamespace(send=live), "name", 100)  # type: ignore[arg-type]


BEGUN = [
    *((signal.SIGTERM, servo_process._end), ("stage", True), "strong", ("memory", 100, 4, "name", 9, 1)),
    *(("stage", False), ("logs", (1, None)), (None, {"seed": 3})),
]
ENDED = [("end",), ("close device",), "closed"]
LOOKS = [(2, 0.1), ("check_devices", True), (2, 0.1), ("check_devices", False), (1, 0.1)]


def test_the_process_answers_orders_and_then_closes_all(acts: list[Any]) -> None:
    run_with(acts, ("tune", ("wood", 1)), ("stop", ()))
    assert acts == [
        *(*BEGUN, *LOOKS, (None, ("tune", "wood", 1)), (1, 0.1), *ENDED),
        *(("write_faults",), ("close memory", False, 0)),
    ]


@pytest.mark.parametrize("error", [EOFError, OSError, KeyboardInterrupt])
def test_the_end_of_the_application_is_logged(acts: list[Any], error: type) -> None:
    """An interrupted process may still write a force: it does not say that its devices are closed."""
    run_with(acts, error, deaf=True)
    ended = ENDED[: 2 if error is KeyboardInterrupt else 3]
    logged = ("write_log", "the application has ended")
    assert acts == [*BEGUN, *LOOKS, *ended, ("write_faults",), logged, ("close memory", False, 0)]


def test_a_start_that_fails_is_answered(acts: list[Any]) -> None:
    run_with(acts, settings=HapsceneError("too far"))
    assert acts[-3:] == [("too far", None), ("close device",), "closed"]
    with pytest.raises(ZeroDivisionError):
        run_with(acts, settings=ZeroDivisionError())
    assert "ZeroDivisionError" in acts[-3][0] and acts[-2:] == [("close device",), "closed"]


def test_a_second_sigterm_has_no_effect(acts: list[Any]) -> None:
    with pytest.raises(KeyboardInterrupt):
        servo_process._end(signal.SIGTERM, None)
    assert acts == [(signal.SIGTERM, signal.SIG_IGN)]
