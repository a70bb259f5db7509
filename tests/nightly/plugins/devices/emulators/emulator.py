"""What all emulators share: orders on stdin, and a log of the forces that they receive, on their own clock."""

import argparse
import os
import random
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path


def prompt_clock() -> None:
    """Request real-time priority for this thread and those it starts, above that of the watchdog, and quick changes
    between them: the clock of an emulated device is to be right on a busy machine."""
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(3))
    sys.setswitchinterval(1e-4)


class Emulator:
    """Orders are lines `name number`, and set an attribute; the end of stdin ends the process."""

    def __init__(self) -> None:
        prompt_clock()
        parser = argparse.ArgumentParser()
        parser.add_argument("log")
        parser.add_argument("place", nargs="?")
        self.arguments = parser.parse_args()
        self._log = Path(self.arguments.log).open("a", buffering=1)  # noqa: SIM115
        self.ready = 0.0  # calibrated, homed
        self.gone = 0.0  # torn out
        self.silent = 0.0  # answers nothing
        self.mangled = 0.0  # which share of what is sent comes out wrong
        self.random = random.Random(7)
        self.obeyed = threading.Event()  # never: what is gone waits for its end

    def obey(self, say: str = "up") -> None:
        """From now on; `say` tells the test where it listens."""
        print(say, flush=True)
        threading.Thread(target=self._obey, daemon=True).start()

    def _obey(self) -> None:
        for line in sys.stdin:
            name, value = line.split()
            setattr(self, name, float(value))
            print("done", flush=True)
        os._exit(0)

    def log(self, *values: float) -> None:
        """A row: what was commanded, now."""
        self._log.write(" ".join(map(repr, (time.monotonic_ns(), *values))) + "\n")

    def mangle(self, data: bytes) -> bytes:
        """A share of it with bits turned, bytes lost, doubled or made up; in the end anything. 2: random bytes."""
        if self.mangled == 2.0:
            return self.random.randbytes(len(data))
        if self.random.random() >= self.mangled:
            return data
        wrong, at = bytearray(data), self.random.randrange(len(data))
        match self.random.randrange(5):
            case 0:
                wrong[at] ^= 1 << self.random.randrange(8)
            case 1:
                del wrong[at:]
            case 2:
                wrong[at:at] = self.random.randbytes(self.random.randrange(1, 40))
            case 3:
                wrong = bytearray(self.random.randbytes(len(wrong)))
            case 4:
                wrong += wrong[at:]
        return bytes(wrong)
