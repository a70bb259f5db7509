"""A screen where there is none, for tests and docs/make_pictures.py alone to open windows on: Xvfb (package xvfb)."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def virtual_screen(width: int, height: int) -> Iterator[str]:
    """The name of a display of an Xvfb of its own, with a number that was free; "" where it does not start.

    Args:
        width, height: of the screen [pixels].

    Raises:
        FileNotFoundError: Xvfb is not installed.
    """
    read, write = os.pipe()
    # without -noreset it starts anew, deaf for a moment, whenever a screenshot was its only client
    size = ("-screen", "0", f"{width}x{height}x24")
    command = ["Xvfb", "-displayfd", str(write), *size, "-nolisten", "tcp", "-noreset"]
    with subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL) as server:
        os.close(write)
        with os.fdopen(read) as pipe:
            number = pipe.readline().strip()
        try:
            yield number and f":{number}"
        finally:
            server.terminate()
