"""Other people's native code, in a process of its own: whatever it does there is one readable error here.

A reader of damaged files that is not memory-safe may crash, run away or fill the memory. `confined` runs a function of
this package in a new process under limits, and takes nothing from it but arrays, which are never unpickled.

STEP (Open CASCADE, which crashes on one damaged file in five), MATLAB files (SciPy, which crashes on a wrong tag) and
models of MuJoCo (which crashes on a number too large) are read there. In our own process stay, bounded before they
begin: zlib and Python's zipfile, what they unpack counted first; libxml2 for the Penn toolkit's files, its tags counted
first, without entities or network; Pillow for the textures of glTF and OBJ, whose pictures it holds to a size of its
own, and of which an error costs the colours alone; NumPy for the numbers of STL, PLY, OFF, glTF and recordings.
"""

import contextlib
import ctypes
import importlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import FormatError, printable

__all__ = ["confined", "import_path"]

Reader = Callable[..., Mapping[str, NDArray[Any]]]
"""What can be run: takes the open file (binary, seekable) and texts or numbers; gives arrays by name, none of objects.
What it refuses it raises as `FormatError`, whose text arrives here as it is."""

TIME_MAX_S: Final = 120.0
"""Longest time that a file may take [s]; a STEP file of 8,000 faces takes two."""

CLOCK_RATIO: Final = 4.0
"""How much longer it may take by the clock than by the processor [1]: others work on this machine too."""

SAID_MAX_B: Final = 16_384
"""How much of what the native code prints is kept [bytes]."""

_PR_SET_PDEATHSIG: Final = 1
_SIGXCPU: Final = 24


def import_path() -> dict[str, str]:
    """Environment of a Python process that is started with -P: it imports what this one does.

    With -P a file of the working folder, which may be a stranger's, is not taken for a module.
    """
    places = [str(Path(__file__).parents[2]), *(place for place in sys.path if place)]
    return {"PYTHONPATH": os.pathsep.join(places)}


class Answer(NamedTuple):
    """What a confined reader gave: arrays by name, and what the native code printed meanwhile."""

    arrays: Mapping[str, NDArray[Any]]
    said: str


def confined(
    reader: Reader,
    file: BinaryIO,
    *arguments: str | float | bool | None,
    by: str,
    memory_B: int,
    output_B: int,
    time_s: float = TIME_MAX_S,
    imports: Sequence[str] = (),
) -> Answer:
    """Run a reader in a process of its own, and give what it found.

    Args:
        reader: a function at the top of a module; the module is imported anew in the process.
        file: the open file, a real one (with a descriptor), at its start.
        arguments: what else it takes.
        by: whose code it is, for messages: "SciPy's reader of MATLAB files".
        memory_B: most memory that it may take, beside what importing it takes [bytes]; held on Linux only.
        output_B: most that it may give [bytes].
        time_s: most of the processor's time that it may take, counted on Linux only; by the clock `CLOCK_RATIO` times
            as much [s].
        imports: modules that it imports itself, whose memory is not counted either.

    Raises:
        FormatError: what the reader refuses; or it crashed, took too long or too much, and then what it printed last.
    """
    name = f"{reader.__module__}:{reader.__qualname__}"
    order = json.dumps([name, arguments, memory_B, math.ceil(time_s), list(imports)])
    alone = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    # Arrow's own allocator takes 128 MB at once, and with what is left nothing may be read
    environment = os.environ | import_path() | alone | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "hapscene.io.confined", order],
        stdin=file,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
        bufsize=0,
    )
    assert process.stdout is not None and process.stderr is not None
    start_s, most_s = time.monotonic(), CLOCK_RATIO * time_s
    watch = threading.Timer(most_s, process.kill)
    said = _Tail(process.stderr)
    try:
        watch.start()
        refused, arrays = _answer(process.stdout, output_B)
        code = process.wait()
    finally:
        watch.cancel()
        process.kill()
        process.wait()
        said.end()
        process.stdout.close()
        process.stderr.close()
    text = said.text()
    if refused is not None:
        raise FormatError(refused)
    if code == -_SIGXCPU or (code != 0 and time.monotonic() - start_s >= most_s):
        raise FormatError(f"{by} had not read it after {time_s:.3g} s, and was ended")
    if code != 0 or arrays is None:
        last = f"; it said: {text.splitlines()[-1][:200]}" if text else ""
        raise FormatError(f"{by} failed on it ({_ending(code)}): the file is damaged{last}")
    return Answer(arrays, text)


class _Tail:
    """Reads what the process says, in a thread, so that it never waits for us; keeps the end of it."""

    def __init__(self, pipe: Any) -> None:
        self._kept = b""
        self._pipe = pipe
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while part := self._pipe.read(SAID_MAX_B):
            self._kept = (self._kept + part)[-SAID_MAX_B:]

    def end(self) -> None:
        self._thread.join()

    def text(self) -> str:
        plain = re.sub(rb"\x1b\[[0-9;]*m", b"", self._kept)  # colours, which it takes us for a terminal to show
        return printable(plain.decode("utf-8", errors="replace").strip(), lines=True)


def _answer(pipe: Any, most_B: int) -> tuple[str | None, dict[str, NDArray[Any]] | None]:
    """What was refused, or the arrays; neither where the process ended before it had answered.

    Raises:
        FormatError: it gives more than it may.
    """
    try:
        head = json.loads(pipe.readline(1 << 20))
        arrays: dict[str, NDArray[Any]] = {}
        for name, dtype, shape in head["arrays"]:
            array = np.dtype(dtype)
            size_B = array.itemsize * math.prod(shape)
            most_B -= size_B
            if most_B < 0 or array.hasobject:
                raise FormatError("it holds more than is read of such a file")
            arrays[name] = np.empty(shape, array)
            _fill(arrays[name].reshape(-1).view(np.uint8).data, pipe)
        return head["refused"], arrays
    except (EOFError, ValueError, KeyError, TypeError):
        return None, None


def _fill(place: memoryview, pipe: Any) -> None:
    """Read as much as fits into the place.

    Raises:
        EOFError: there is less.
    """
    while place:
        count = pipe.readinto(place)
        if not count:
            raise EOFError
        place = place[count:]


def _ending(code: int) -> str:
    try:
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"
    except ValueError:
        return f"signal {-code}"


# In the process.


def _main(order: str) -> None:
    name, arguments, memory_B, time_s, imports = json.loads(order)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever waits for us hears it, and ends us
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what native code prints is no answer
    module, _, function = name.partition(":")
    reader: Reader = getattr(importlib.import_module(module), function)
    for other in imports:
        importlib.import_module(other)
    _limit(memory_B, time_s)
    refused: str | None = None
    arrays: Mapping[str, NDArray[Any]] = {}
    try:
        with open(0, "rb", closefd=False) as file:
            arrays = reader(file, *arguments)
    except FormatError as error:
        refused = str(error)
    except MemoryError:
        refused = f"to read it takes more than {memory_B >> 20} MiB of memory: the file is damaged, or too large"
    whole = {key: np.ascontiguousarray(array) for key, array in arrays.items()}
    head = [[key, array.dtype.str, array.shape] for key, array in whole.items()]
    answers.write(json.dumps({"refused": refused, "arrays": head}).encode() + b"\n")
    for array in whole.values():
        answers.write(array.reshape(-1).view(np.uint8).data)
    answers.flush()
    sys.stdout.flush()
    os._exit(0)  # what native code has left behind is not put in order


def _limit(memory_B: int, time_s: int) -> None:
    """Bound this process's memory and time, and end it with the one that waits for it; where the system can."""
    if sys.platform == "linux":
        import resource

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most_B = pages * resource.getpagesize() + memory_B
        limits = (
            (resource.RLIMIT_AS, most_B),
            (resource.RLIMIT_CPU, time_s + math.ceil(time.process_time())),
            (resource.RLIMIT_CORE, 0),
        )
        for what, most in limits:
            with contextlib.suppress(ValueError, OSError):  # less is allowed already
                # the second limit kills, as others do; the first, a second earlier, says why
                resource.setrlimit(what, (most, most + (what == resource.RLIMIT_CPU)))


if __name__ == "__main__":
    _main(sys.argv[1])
