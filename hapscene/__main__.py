"""Entry point of the command `hapscene` and of `python -m hapscene`; handles Ctrl-C from the start."""

import os
import sys
from _signal import SIG_IGN, SIGINT, signal  # type: ignore[import-not-found]  # the module signal is slow to import


def run() -> None:
    """Run the command line and exit with its exit code. Ctrl-C has no effect after the command is done."""
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
