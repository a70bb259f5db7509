"""Key presses in the terminal during `hapscene play`."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

__all__ = ["pressed_keys"]


@contextmanager
def pressed_keys() -> Iterator[Callable[[], str]]:
    """A function that returns the keys pressed since its last call; "" if standard input is not a terminal."""
    try:
        import select
        import termios
        import tty

        fd = sys.stdin.fileno()
        before = termios.tcgetattr(fd)
        if os.tcgetpgrp(fd) != os.getpgrp():  # a background process that sets the terminal is stopped
            raise OSError
    except (ImportError, OSError, ValueError, termios.error):
        yield lambda: ""
        return

    def keys() -> str:
        pressed = b""
        with suppress(OSError):  # the terminal is gone
            while select.select([fd], [], [], 0.0)[0] and (read := os.read(fd, 64)):
                pressed += read
        return pressed.decode("ascii", "ignore")

    tty.setcbreak(fd)
    try:
        yield keys
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)
