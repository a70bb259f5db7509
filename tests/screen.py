"""Virtual X display (Xvfb, package xvfb) for tests and docs/make_pictures.py."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def virtual_screen(width: int, height: int) -> Iterator[str]:
    """Start Xvfb on a free display number; yield the name of the display, or "" if Xvfb does not start.

    Args:
        width, height: size of the screen [pixels].

    Raises:
        FileNotFoundError: Xvfb is not installed.
    """
    read, write = os.pipe()
    # without -noreset, Xvfb restarts and refuses connections for a moment when its last client disconnects
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
