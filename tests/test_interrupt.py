"""Handlers of the signals that end a process, called directly; `tests/nightly/test_interrupt.py` sends signals."""

import signal
from types import SimpleNamespace
from typing import Any

import pytest

from hapscene import interrupt
from hapscene.interrupt import ENDS, interrupt_noted, interrupted_by_ends, reraise_swallowed_interrupt

KINDS = (signal.SIGINT, *ENDS)


def handle(kind: int) -> None:
    handler: Any = signal.getsignal(kind)
    handler(kind, None)


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


def test_the_importer_and_a_cleanup_are_not_interrupted() -> None:
    frames: Any = [SimpleNamespace(f_code=SimpleNamespace(co_filename=name)) for name in (interrupt.IMPORTER, "a.py")]
    assert [interrupt._is_safe(frame) for frame in (*frames, None)] == [False, True, True]
    assert not interrupt._is_propagating()
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt:
        try:
            raise OSError
        except OSError:
            assert interrupt._is_propagating()


def test_an_error_without_an_interrupt_is_raised() -> None:
    with pytest.raises(ZeroDivisionError), reraise_swallowed_interrupt():
        raise ZeroDivisionError
