"""What the nightly tests share."""

import subprocess
import threading
from collections.abc import Callable, Iterator

import pytest


@pytest.fixture
def end_in_time() -> Iterator[Callable[["subprocess.Popen[str]"], None]]:
    """Kills the processes that it is given after three minutes, so that no test waits for their output for ever."""
    watchdogs = []

    def watch(process: "subprocess.Popen[str]") -> None:
        watchdogs.append(threading.Timer(180.0, process.kill))
        watchdogs[-1].start()

    yield watch
    for watchdog in watchdogs:
        watchdog.cancel()
