"""The processes of a servo: how they are started, asked and ended; by mocks of processes and pipes."""

import signal
from itertools import chain, repeat
from multiprocessing.shared_memory import SharedMemory
from types import SimpleNamespace
from typing import Any
from unittest.mock import ANY, MagicMock, call

import numpy as np
import pytest

from hapscene.device.driver_registry import DeviceChoice
from hapscene.errors import HapsceneError
from hapscene.handle import live_process
from hapscene.loop import servo_connection
from hapscene.loop.servo_connection import ANSWER_S, BUILD_S, REPORT_S, START_S, ServoConnection
from hapscene.loop.servo_process import run
from hapscene.loop.shared_memory import write_text
from hapscene.loop.watchdog import watch

if not hasattr(signal, "pthread_sigmask"):
    pytest.skip("no signals of a terminal on this system", allow_module_level=True)

SIGNALS = {getattr(signal, name) for name in ("SIGINT", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGTTIN", "SIGTTOU")}
CHOICES = [DeviceChoice("pen")]


def application(patch: pytest.MonkeyPatch, *answers: Any, force: bool) -> tuple[ServoConnection, Any]:
    """A servo of a force device and a handle, or of neither, and its system. A process ends when it is joined."""
    system = MagicMock()
    system.Pipe.side_effect = [(system.wire, system.far), (system.life, system.dying), (system.watch, system.there)]
    system.Process.side_effect = [system.servo, system.watchdog]
    system.wire.recv.side_effect = [(None, "bodies"), (None, {"seed": 3}), *answers]
    system.servo.pid, system.servo.exitcode, system.Heartbeat.return_value.asked = 5, 3, np.zeros(1, np.int64)
    for process in (system.servo, system.watchdog):

        def end(*span_s: float, alive: Any = process.is_alive) -> None:
            alive.return_value = False

        def start() -> None:
            assert signal.pthread_sigmask(signal.SIG_BLOCK, []) >= SIGNALS

        process.start.side_effect, process.join.side_effect, process.kill.side_effect = start, end, end
    patch.setattr(servo_connection, "DRIVERS", SimpleNamespace(load=lambda name: SimpleNamespace(force=force)))
    patch.setattr(servo_connection, "multiprocessing", SimpleNamespace(get_context=lambda kind: system))
    patch.setattr(servo_connection, "ForkingPickler", SimpleNamespace(dumps=lambda message: message))
    patch.setattr(servo_connection, "Heartbeat", system.Heartbeat)
    patch.setattr(live_process, "LiveHandle", system.LiveHandle)
    more: dict[str, Any] = {"a_rate_Hz": 4e3, "patience_s": 9.0, "progress": system.say, "shape": (5, 4, 3, 2)}
    return ServoConnection({"made": 1}, CHOICES, DeviceChoice("coil") if force else None, "coil.toml", **more), system


def acts(system: Any) -> list[Any]:
    """What was done since the last call."""
    done = [act for act in system.mock_calls if not act[0].endswith(("is_alive", "__bool__"))]
    system.reset_mock()
    return done


def test_a_force_device_has_a_watchdog_and_all_processes_end(monkeypatch: pytest.MonkeyPatch) -> None:
    servo, system = application(monkeypatch, (None, 7), ("no such swatch", None), force=True)
    system.wire.poll.side_effect = chain((True, True, False), repeat(True))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with servo:
        name, shape = servo._channel.memory.name, {"length": 5, "block": 4, "bodies": 3, "tools": 2}
        assert servo.alive and signal.pthread_sigmask(signal.SIG_BLOCK, []) == before
        with pytest.raises(FileNotFoundError):
            SharedMemory(name)  # only the processes have it
        watched = (system.life, system.there, name, (5, 4, 3, 2), 5, CHOICES)
        assert acts(system) == [
            *(call.Pipe(), call.Pipe(duplex=False)),
            call.Process(target=run, args=(system.far, system.dying, name, 5), name=ANY, daemon=True),
            *(call.servo.start(), call.far.close(), call.dying.close(), call.Pipe(duplex=False)),
            call.Process(target=watch, args=watched, name=ANY, daemon=True),
            *(call.watchdog.start(), call.there.close(), call.watch.poll(START_S), call.watch.recv()),
            *(call.life.close(), call.wire.send_bytes({"made": 1}), call.say("a new process … ")),
            *(call.wire.poll(REPORT_S), call.wire.poll(START_S), call.wire.recv(), call.say("bodies … ")),
            *(call.wire.poll(REPORT_S), call.say("5 s … "), call.wire.poll(REPORT_S)),
            *(call.wire.poll(START_S - REPORT_S), call.wire.recv(), call.Heartbeat(ANY, 9.0)),
            call.LiveHandle(shape | {"name": name}, 4e3, 0, 5, "coil", {}, handle="coil.toml"),
        ]
        assert servo._renderer_arguments == {"seed": 3}
        assert servo._order("deform", 2) == 7 and servo._asked.tolist() == [3]
        with pytest.raises(HapsceneError, match="no such swatch"):
            servo._order("tune")
        assert acts(system) == [
            *(call.wire.send_bytes(("deform", (2,))), call.wire.poll(BUILD_S), call.wire.recv()),
            *(call.wire.send_bytes(("tune", ())), call.wire.poll(ANSWER_S), call.wire.recv()),
        ]
        system.watchdog.join.side_effect = None  # it hangs
    assert acts(system) == [
        *(call.wire.send(("stop", ())), call.servo.join(ANSWER_S), call.wire.close(), call.LiveHandle().close()),
        *(call.watchdog.join(ANSWER_S), call.watchdog.kill(), call.Heartbeat().stop()),
    ]
    servo.close()  # again
    with pytest.raises(RuntimeError):
        servo._lane.submit(print)
    assert not servo.alive and not acts(system)


def test_a_process_that_does_not_end_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    servo, system = application(monkeypatch, force=False)
    with servo:
        assert call.life.close() not in acts(system)
        system.servo.join.side_effect = None
    assert acts(system) == [
        *(call.wire.send(("stop", ())), call.servo.join(ANSWER_S), call.servo.kill(), call.servo.join()),
        *(call.wire.close(), call.Heartbeat().stop()),
    ]


@pytest.mark.parametrize(
    ("answer", "code", "force"), [(None, 3, False), (EOFError, 3, True), (EOFError, -9, False), (OSError, -9, True)]
)
def test_an_order_without_an_answer(answer: Any, code: int, force: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    servo, system = application(monkeypatch, answer, force=force)
    with servo:
        system.servo.exitcode, system.wire.poll.return_value = code, answer is not None
        with pytest.raises(HapsceneError) as error:
            servo._order("pause")
        killed = call.servo.kill() in acts(system)
        assert killed == (answer is None) == (f"exit code {code}" not in str(error.value))
        assert ("watchdog" in str(error.value)) == (code == -9 and force) and not servo.alive
        with pytest.raises(HapsceneError, match=f"exit code {code}"):
            servo._order("pause")


def test_the_fault_before_the_end_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    servo, system = application(monkeypatch, force=True)
    with servo:
        write_text(servo._channel.fault, "the cable is out")
        for alive in (True, False):
            system.servo.exitcode, system.servo.is_alive.return_value = -9, alive
            with pytest.raises(HapsceneError, match="the cable is out"):
                servo._order("pause")


@pytest.mark.parametrize("silent", [True, False])
def test_no_device_is_driven_without_a_watchdog(silent: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    servo, system = application(monkeypatch, force=True)
    system.watch.poll.return_value, system.watch.recv.side_effect = not silent, EOFError
    with pytest.raises(HapsceneError, match="watchdog"):
        servo.__enter__()
    done = acts(system)
    assert call.servo.kill() in done and call.wire.send(("stop", ())) not in done and not servo.alive


def test_a_start_can_be_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    servo, system = application(monkeypatch, force=False)
    servo.cancel()
    with pytest.raises(HapsceneError, match="cancelled"):
        servo.__enter__()
    assert acts(system)[3:] == [call.servo.start(), *(call.servo.kill(), call.servo.join(), call.wire.close())]
    servo.cancel()
    assert acts(system) == [call.servo.kill()]
    with pytest.raises(HapsceneError, match="once"):
        servo.__enter__()


def test_a_servo_that_starts_rejects_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    servo, system = application(monkeypatch, force=False)
    system.Pipe.side_effect = lambda: servo._channel  # as another thread does
    with pytest.raises(HapsceneError, match="context"):
        servo.__enter__()
