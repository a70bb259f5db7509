"""Handlers of the signals that end a process; `tests/nightly/test_interrupt.py` sends signals to processes."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hapscene import interrupt
from hapscene.cli import main
from hapscene.interrupt import AGAIN_S, ENDS, interrupt_noted, interrupted_by_ends, reraise_swallowed_interrupt

pytestmark = [
    pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="Windows has no timers"),
    pytest.mark.timeout(60, method="thread"),  # the other method is a timer too
]

KINDS = (signal.SIGINT, *ENDS)
IMPORTER, OTHER = (
    SimpleNamespace(f_code=SimpleNamespace(co_filename=name)) for name in (interrupt.IMPORTER, "a.py")
)  # frames


def handle(kind: int) -> None:
    handler: Any = signal.getsignal(kind)
    handler(kind, None)


@pytest.fixture(autouse=True)
def alarms(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Timers that were set; none of them ends."""
    alarms: list[Any] = []
    before = signal.signal(signal.SIGALRM, signal.SIG_DFL)
    monkeypatch.setattr(signal, "setitimer", lambda *given: alarms.append(given[1:]))
    yield alarms
    signal.signal(signal.SIGALRM, before)


def test_the_first_signal_interrupts_and_further_ends_have_no_effect() -> None:
    before = [signal.getsignal(kind) for kind in KINDS]
    for kind in KINDS:
        with interrupted_by_ends():
            for sent in (kind, signal.SIGINT):
                with pytest.raises(KeyboardInterrupt) as caught:
                    handle(sent)
                assert caught.value.args == (sent,)
                for end in ENDS:
                    handle(end)
        assert [signal.getsignal(kind) for kind in KINDS] == before


def test_the_first_signal_is_noted() -> None:
    acts: list[bool] = []
    for kind in KINDS:
        with interrupt_noted(lambda: acts.append(True)) as noted:
            assert not noted()
            handle(kind)
            assert noted() and signal.getsignal(signal.SIGINT) == signal.default_int_handler
    assert len(acts) == len(KINDS)


def test_an_error_without_an_interrupt_is_raised() -> None:
    with pytest.raises(ZeroDivisionError), reraise_swallowed_interrupt():
        raise ZeroDivisionError


def test_a_swallowed_interrupt_is_raised_again_until_it_is_cleared(alarms: list[Any]) -> None:
    with interrupted_by_ends():
        handler: Any = signal.getsignal(signal.SIGINT)
        handler(signal.SIGINT, IMPORTER)
        assert alarms == [(AGAIN_S, AGAIN_S)]
        again: Any = signal.getsignal(signal.SIGALRM)
        again(signal.SIGALRM, IMPORTER)
        with pytest.raises(KeyboardInterrupt) as caught:
            again(signal.SIGALRM, OTHER)
        assert caught.value.args == (signal.SIGINT,)
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt:
            again(signal.SIGALRM, OTHER)
            try:
                raise OSError
            except OSError:
                again(signal.SIGALRM, OTHER)  # it is propagating
        with pytest.raises(KeyboardInterrupt):
            handler(signal.SIGINT, IMPORTER)  # the user insists
        with pytest.raises(KeyboardInterrupt), reraise_swallowed_interrupt():
            raise ZeroDivisionError
        assert alarms[1:] == [(0.0,)] and signal.getsignal(signal.SIGALRM) == signal.SIG_DFL
        handler(signal.SIGINT, IMPORTER)
    assert alarms[2:] == [(AGAIN_S, AGAIN_S), (0.0,)] and signal.getsignal(signal.SIGALRM) == signal.SIG_DFL


def test_a_closed_terminal_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    acts: list[Any] = []
    monkeypatch.setattr(interrupt, "_TERMINALS", (1, 2))
    monkeypatch.setattr(os, "isatty", lambda number: number == 1)
    monkeypatch.setattr(os, "open", lambda path, mode: acts.append((path, mode)) or 9)
    monkeypatch.setattr(os, "dup2", lambda *numbers: acts.append(numbers))
    monkeypatch.setattr(os, "close", acts.append)
    with interrupt_noted(), pytest.raises(KeyboardInterrupt):
        handle(signal.SIGINT)
        with interrupted_by_ends():
            handle(signal.SIGINT)
    assert acts == [(os.devnull, os.O_WRONLY), (9, 2), 9] * 2


def test_the_command_handles_ctrl_c_from_its_start_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    from hapscene import __main__ as entry

    acts: list[Any] = []
    monkeypatch.setattr(entry, "signal", lambda kind, handler: acts.append(handler))
    monkeypatch.setattr("hapscene.cli.main", lambda: acts.append("main") or 7)
    with pytest.raises(SystemExit) as end:
        entry.run()
    assert acts == [entry._end, "main", signal.SIG_IGN] and end.value.code == 7
    monkeypatch.setattr(os, "write", lambda number, text: acts.append(number))
    monkeypatch.setattr(os, "_exit", acts.append)
    entry._end(signal.SIGINT, None)
    assert acts[3:] == [2, 130]


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has none")
def test_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with interrupted_by_ends(), interrupt_noted() as noted:
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN and not noted()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_interrupted_command_reports_it_and_exits_with_the_signal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def end(*arguments: object, **more: object) -> None:
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr("hapscene.scene.mesh_file.load_mesh", end)
    (tmp_path / "any.glb").touch()
    assert main(["check", str(tmp_path / "any.glb")]) == 128 + signal.SIGTERM
    assert capsys.readouterr().err == "hapscene: interrupted; nothing was written\n"
