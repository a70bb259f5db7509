"""Ctrl-C as a wish to end, for work that has something to put in order first."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """While it is open, the first Ctrl-C (or SIGTERM) is only noted; a second one raises KeyboardInterrupt.

    Gives the function that says whether it was noted. To be opened in the main thread.
    """
    noted = threading.Event()
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.getsignal(kind) for kind in kinds}

    def note(kind: int, frame: object) -> None:
        noted.set()
        for each in kinds:
            signal.signal(each, signal.default_int_handler)

    for kind in kinds:
        signal.signal(kind, note)
    try:
        yield noted.is_set
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler or signal.SIG_DFL)
