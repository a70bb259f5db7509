"""What the system grants is told, and to the asking thread alone."""

import ctypes
import os
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from hapscene.native import INTERPRETED
from hapscene.servo import prompt
from hapscene.servo.prompt import SLACK_NS, be_prompt

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux is asked")

PR_GET_TIMERSLACK = 30


def slack_ns() -> int:
    return int(ctypes.CDLL(None).prctl(PR_GET_TIMERSLACK))


def test_what_is_told_is_so_for_the_thread_that_asked() -> None:
    before = os.sched_getscheduler(0), slack_ns()

    def ask() -> tuple[bool, int]:
        return be_prompt(), os.sched_getscheduler(0)

    with ThreadPoolExecutor(1) as lane:
        granted, policy = lane.submit(ask).result()
    assert granted == (policy == os.SCHED_FIFO)
    assert (os.sched_getscheduler(0), slack_ns()) == before


def test_without_the_right_it_waits_among_the_others_but_is_woken_promptly(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with ThreadPoolExecutor(1) as lane:
        assert lane.submit(lambda: (be_prompt(), slack_ns())).result() == (False, SLACK_NS)


@pytest.mark.skipif(INTERPRETED, reason="is the case anyway")
def test_interpreted_ticks_never_go_before_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prompt, "INTERPRETED", True)
    with ThreadPoolExecutor(1) as lane:
        granted, policy = lane.submit(lambda: (be_prompt(), os.sched_getscheduler(0))).result()
    assert not granted and policy == os.sched_getscheduler(0)
