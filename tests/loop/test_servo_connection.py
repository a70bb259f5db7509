"""The processes of a servo: how they are started, asked and ended; by processes and pipes that only note it."""

import signal
from multiprocessing.reduction import ForkingPickler
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.device.driver_registry import DeviceChoice
from hapscene.errors import HapsceneError
from hapscene.handle import live_process
from hapscene.loop import servo_connection
from hapscene.loop.servo_connection import ANSWER_S, BUILD_S, START_S, ServoConnection
from hapscene.loop.servo_process import run
from hapscene.loop.shared_memory import write_text
from hapscene.loop.watchdog import watch

if not hasattr(signal, "pthread_sigmask"):
    pytest.skip("signals of a terminal", allow_module_level=True)

SIGNALS = {getattr(signal, name) for name in ("SIGINT", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGTTIN", "SIGTTOU")}


class Noted:
    """Notes calls. A pipe receives `answers`: an error is raised, None does not arrive. A process ends when it is asked
    to, unless it is `stuck`."""

    pid, exitcode, stuck, runs = 5, 3, False, False

    def __init__(self, acts: list[Any], name: str, answers: Any = (), **fields: Any) -> None:
        self.acts, self.name, self.answers = acts, name, answers
        self.__dict__.update(fields)

    def __getattr__(self, method: str) -> Any:
        return lambda *given: self.acts.append((self.name, method, *given))

    def poll(self, span_s: float) -> bool:
        self.acts.append((self.name, "poll", span_s))
        return self.answers[0] is not None

    def recv(self) -> Any:
        if isinstance(answer := self.answers.pop(0), type):
            raise answer
        return answer

    def send_bytes(self, pickled: Any) -> None:
        self.acts.append((self.name, ForkingPickler.loads(pickled)))

    def start(self) -> None:
        self.acts.append((self.name, "start", signal.pthread_sigmask(signal.SIG_BLOCK, []) >= SIGNALS))
        self.runs = True

    def join(self, span_s: float | None = None) -> None:
        self.acts.append((self.name, "join", span_s))
        self.runs = self.runs and self.stuck

    def kill(self) -> None:
        self.acts.append((self.name, "kill"))
        self.runs = self.stuck = False

    def is_alive(self) -> bool:
        return self.runs


class Application:
    """A servo of a force device and a handle, or of neither."""

    def __init__(self, patch: pytest.MonkeyPatch, *, force: bool, ready: Any = "ready") -> None:
        self.acts: list[Any] = []
        self.processes: dict[Any, Noted] = {}
        self.answers: list[Any] = [(None, "bodies"), (None, {"seed": 3})]
        ends = iter((("wire", self.answers), ("life", ()), ("watch", [ready])))
        self.asked = np.zeros(1, np.int64)

        def pipe(duplex: bool = True) -> Any:
            name, answers = next(ends)
            assert duplex == (name == "wire")
            return Noted(self.acts, name, answers), Noted(self.acts, f"other {name}")

        def process(target: Any, args: Any, name: str, daemon: bool) -> Noted:
            self.acts.append((target, daemon, *(arg.name if isinstance(arg, Noted) else arg for arg in args)))
            self.processes[target] = Noted(self.acts, name.split()[-1])
            return self.processes[target]

        def play(*given: Any, **more: Any) -> Noted:
            self.acts.append(("play", *given, more))
            return Noted(self.acts, "handle")

        drivers, system = SimpleNamespace(force=force), SimpleNamespace(Pipe=pipe, Process=process)
        beat = Noted(self.acts, "heartbeat", asked=self.asked)
        patch.setattr(servo_connection, "DRIVERS", SimpleNamespace(load=lambda name: drivers))
        patch.setattr(servo_connection, "multiprocessing", SimpleNamespace(get_context=lambda kind: system))
        patch.setattr(servo_connection, "Heartbeat", lambda counter, patience_s: beat)
        patch.setattr(live_process, "LiveHandle", play)
        self.choices, handle = [DeviceChoice("pen")], DeviceChoice("coil", {"side": 1}) if force else None
        self.said = list[str]()
        more: dict[str, Any] = {"a_rate_Hz": 4e3, "patience_s": 9.0, "progress": self.said.append}
        self.servo = ServoConnection({"made": 1}, self.choices, handle, "coil.toml", shape=(5, 4, 3, 2), **more)


STARTED = [("wire", {"made": 1}), *[("wire", "poll", 5.0), ("wire", "poll", START_S)] * 2]
STOPPED = [("wire", "send", ("stop", ())), ("servo", "join", ANSWER_S), ("wire", "close")]


def test_a_force_device_has_a_watchdog_and_all_processes_end(monkeypatch: pytest.MonkeyPatch) -> None:
    app = Application(monkeypatch, force=True)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with app.servo as servo:
        name, numbers = servo._channel.memory.name, {"length": 5, "block": 4, "bodies": 3, "tools": 2}
        assert servo.alive and signal.pthread_sigmask(signal.SIG_BLOCK, []) == before
        assert app.acts == [
            *((run, True, "other wire", "other life", name, 5), ("servo", "start", True)),
            *(("other wire", "close"), ("other life", "close")),
            *((watch, True, "life", "other watch", name, (5, 4, 3, 2), 5, app.choices), ("watchdog", "start", True)),
            *(("other watch", "close"), ("watch", "poll", START_S), ("life", "close"), *STARTED),
            ("play", numbers | {"name": name}, 4e3, 0, 5, "coil", {"side": 1}, {"handle": "coil.toml"}),
        ]
        assert app.said == ["a new process … ", "bodies … "] and servo._renderer_arguments == {"seed": 3}
        del app.acts[:]
        app.answers += [(None, 7), ("no such swatch", None)]
        assert servo._order("deform", 2) == 7 and app.asked[0] == 3
        with pytest.raises(HapsceneError, match="no such swatch"):
            servo._order("tune")
        asked = [
            ("wire", ("deform", (2,))),
            ("wire", "poll", BUILD_S),
            ("wire", ("tune", ())),
            ("wire", "poll", ANSWER_S),
        ]
        assert app.acts == asked
        app.processes[watch].stuck = True
    ended = [("handle", "close"), ("watchdog", "join", ANSWER_S), ("watchdog", "kill"), ("heartbeat", "stop")]
    assert app.acts == [*asked, *STOPPED, *ended] and not servo.alive
    servo.close()  # again
    assert len(app.acts) == len([*asked, *STOPPED, *ended])


def test_a_process_that_does_not_end_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    app = Application(monkeypatch, force=False)
    with app.servo:
        assert ("life", "close") not in app.acts and ("other life", "close") in app.acts
        app.processes[run].stuck = True
        del app.acts[:]
    assert app.acts == [*STOPPED[:2], ("servo", "kill"), ("servo", "join", None), STOPPED[2], ("heartbeat", "stop")]


@pytest.mark.parametrize(("answer", "code"), [(None, 3), (EOFError, 3), (OSError, -9)])
def test_an_order_without_an_answer(answer: Any, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    app = Application(monkeypatch, force=code == -9)
    with app.servo as servo:
        app.processes[run].exitcode = code
        app.answers.append(answer)
        with pytest.raises(HapsceneError) as error:
            servo._order("pause")
        assert (("servo", "kill") in app.acts) == (answer is None) == (f"exit code {code}" not in str(error.value))
        assert ("watchdog" in str(error.value)) == (code == -9) and not servo.alive
        with pytest.raises(HapsceneError, match=f"exit code {code}"):
            servo._order("pause")


def test_the_fault_before_the_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    app = Application(monkeypatch, force=True)
    with app.servo as servo:
        write_text(servo._channel.fault, "the cable is out")
        for runs in (True, False):
            app.processes[run].exitcode, app.processes[run].runs = -9, runs
            with pytest.raises(HapsceneError, match="the cable is out"):
                servo._order("pause")


@pytest.mark.parametrize("ready", [None, EOFError])
def test_no_device_is_driven_without_a_watchdog(ready: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    app = Application(monkeypatch, force=True, ready=ready)
    with pytest.raises(HapsceneError, match="watchdog"):
        app.servo.__enter__()
    assert ("servo", "kill") in app.acts and ("wire", "send", ("stop", ())) not in app.acts and not app.servo.alive


def test_a_start_can_be_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    app = Application(monkeypatch, force=False)
    app.servo.cancel()
    with pytest.raises(HapsceneError, match="cancelled"):
        app.servo.__enter__()
    assert app.acts[1:3] == [("servo", "start", True), ("servo", "kill")]
    with pytest.raises(HapsceneError, match="once"):
        app.servo.__enter__()
