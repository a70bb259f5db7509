"""The command `hapscene`, and `python -m hapscene`: Ctrl-C ends it in one line from the first moment on."""

import os
import sys
from _signal import SIG_IGN, SIGINT, signal  # type: ignore[import-not-found]  # signal itself takes longer than all before it


def run() -> None:
    """A command as a process, which ends with its exit code. Once it is done, Ctrl-C changes nothing any more."""
    signal(SIGINT, _end)
    from hapscene.cli import main

    code = main()
    signal(SIGINT, SIG_IGN)  # Python resets other handlers when it ends, and Ctrl-C would then kill it
    sys.exit(code)


def _end(kind: int, frame: object) -> None:
    os.write(2, b"hapscene: interrupted; nothing was written\n")
    os._exit(128 + kind)


if __name__ == "__main__":
    run()
