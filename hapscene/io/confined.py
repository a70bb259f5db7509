"""Execution of unsafe file readers in a separate process with limits on memory and time.

A native reader may crash, hang or exhaust the memory on a damaged file. `confined` runs a function of this package in a
new process and receives only arrays from it, which are never unpickled.

Readers that run there: STEP (Open CASCADE, which crashes on one of five damaged files), MATLAB (SciPy, which crashes on
a wrong tag), MuJoCo models (which crash on numbers that are too large). Readers that run in the main process with prior
checks: zlib and zipfile (unpacked size), libxml2 for files of the Penn toolkit (number of tags; no entities, no
network), Pillow for textures (its own limit on pixels), NumPy for STL, PLY, OFF, glTF and recordings.
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
from typing import IO, Any, BinaryIO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import FormatError, printable

__all__ = ["confined", "import_path"]

Reader = Callable[..., Mapping[str, NDArray[np.generic]]]
"""A reader: takes the open file (binary, seekable) and further arguments, returns arrays without object types by name.
It raises `FormatError` for invalid files; the message is passed on."""

TIME_MAX_S: Final = 120.0
"""Maximum processor time to read a file [s]. A STEP file with 8,000 faces takes 2 s."""

CLOCK_RATIO: Final = 20.0
"""Ratio of the limits on wall-clock time and processor time [1]. The processor time decides, so that a valid file is
read on a busy machine too; the clock ends readers that wait forever."""

_OUT_OF_MEMORY: Final = re.compile(r"bad_alloc|MemoryError|[Oo]ut of memory|Cannot allocate memory")
"""What native code prints if an allocation fails."""

SAID_MAX_B: Final = 16_384
"""Maximum length of the stored output of the reader [bytes]."""

_PR_SET_PDEATHSIG: Final = 1
_SIGXCPU: Final = 24


def import_path() -> dict[str, str]:
    """Return the environment of a Python process that is started with -P, such that it has the same import path.

    With -P, Python does not import from the working folder, which may contain untrusted files.
    """
    places = [str(Path(__file__).parents[2]), *(place for place in sys.path if place)]
    return {"PYTHONPATH": os.pathsep.join(places)}


class Answer(NamedTuple):
    """Result of a reader: arrays by name, and what the native code printed."""

    arrays: Mapping[str, NDArray[np.generic]]
    output: str


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
    """Run a reader in a separate process and return its result.

    Args:
        reader: a function at the top level of a module, which is imported in the process.
        file: the open file, with a descriptor, at its start.
        arguments: further arguments of the reader.
        by: name of the native code for messages, such as "SciPy's reader of MATLAB files".
        memory_B: maximum memory in addition to that of imports [bytes]; Linux only.
        output_B: maximum size of the arrays [bytes].
        time_s: maximum processor time, Linux only; the wall-clock limit is `CLOCK_RATIO` times as long [s].
        imports: modules that are imported before memory is limited.

    Raises:
        FormatError: the reader rejected the file, crashed, or exceeded a limit.
    """
    name = f"{reader.__module__}:{reader.__qualname__}"
    process = _start(json.dumps([name, arguments, memory_B, math.ceil(time_s), list(imports)]), file)
    assert process.stdout is not None and process.stderr is not None
    start_s, most_s = time.monotonic(), CLOCK_RATIO * time_s
    watch = threading.Timer(most_s, process.kill)
    tail = _Tail(process.stderr)
    try:
        watch.start()
        refused, arrays = _answer(process.stdout, output_B)
        code = process.wait()
    finally:
        watch.cancel()
        process.kill()
        process.wait()
        tail.end()
        process.stdout.close()
        process.stderr.close()
    text = tail.text()
    if refused is not None:
        raise FormatError(refused)
    if code == -_SIGXCPU:
        raise FormatError(f"{by} used more than {time_s:.3g} s of processor time, the limit for this file")
    if code != 0 and time.monotonic() - start_s >= most_s:
        raise FormatError(f"{by} did not finish within {most_s:.3g} s on the clock, the limit for this file")
    if code != 0 and _OUT_OF_MEMORY.search(text):
        raise FormatError(_memory_exceeded(by, memory_B))
    if code != 0 or arrays is None:
        last = f"; its last output: {text.splitlines()[-1][:200]}" if text else ""
        raise FormatError(f"{by} failed on it ({_ending(code)}): the file is damaged{last}")
    return Answer(arrays, text)


def _start(order: str, file: BinaryIO) -> subprocess.Popen[bytes]:
    """Start the process that reads the file."""
    alone = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    # Arrow's default allocator reserves 128 MB at once, which would exceed the limit
    environment = os.environ | import_path() | alone | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "hapscene.io.confined", order],
        stdin=file,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
        bufsize=0,
    )


class _Tail:
    """Reads the output of the process in a thread, so that the process never blocks, and keeps its end."""

    def __init__(self, pipe: IO[bytes]) -> None:
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
        plain = re.sub(rb"\x1b\[[0-9;]*m", b"", self._kept)  # without colour codes
        return printable(plain.decode("utf-8", errors="replace").strip(), lines=True)


def _answer(pipe: IO[bytes], most_B: int) -> tuple[str | None, dict[str, NDArray[np.generic]] | None]:
    """Return the reader's error message or the arrays; neither if the process ended early.

    Raises:
        FormatError: the arrays exceed the limit.
    """
    try:
        head = json.loads(pipe.readline(1 << 20))
        arrays: dict[str, NDArray[np.generic]] = {}
        for name, dtype, shape in head["arrays"]:
            array = np.dtype(dtype)
            size_B = array.itemsize * math.prod(shape)
            most_B -= size_B
            if most_B < 0 or array.hasobject:
                raise FormatError("its content exceeds the limit for this kind of file")
            arrays[name] = np.empty(shape, array)
            _fill(arrays[name].reshape(-1).view(np.uint8).data, pipe)
        return head["refused"], arrays
    except (EOFError, ValueError, KeyError, TypeError):
        return None, None


def _fill(place: memoryview, pipe: Any) -> None:
    """Fill a buffer from a pipe.

    Raises:
        EOFError: the pipe ended early.
    """
    while place:
        count = pipe.readinto(place)
        if not count:
            raise EOFError
        place = place[count:]


def _memory_exceeded(what: str, memory_B: int) -> str:
    return f"{what} needs more than {memory_B >> 20} MiB of memory, the limit for this file: it is damaged or too large"


def _ending(code: int) -> str:
    try:
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"
    except ValueError:
        return f"signal {-code}"


# Code that runs in the separate process.


def _main(order: str) -> None:
    name, arguments, memory_B, time_s, imports = json.loads(order)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles it and ends this process
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # separates the output of native code from the answer
    module, _, function = name.partition(":")
    reader: Reader = getattr(importlib.import_module(module), function)
    for other in imports:
        importlib.import_module(other)
    _limit(memory_B, time_s)
    refused: str | None = None
    arrays: Mapping[str, NDArray[np.generic]] = {}
    try:
        with open(0, "rb", closefd=False) as file:
            arrays = reader(file, *arguments)
    except FormatError as error:
        refused = str(error)
    except MemoryError:
        refused = _memory_exceeded("reading it", memory_B)
    whole = {key: np.ascontiguousarray(array) for key, array in arrays.items()}
    head = [[key, array.dtype.str, array.shape] for key, array in whole.items()]
    answers.write(json.dumps({"refused": refused, "arrays": head}).encode() + b"\n")
    for array in whole.values():
        answers.write(array.reshape(-1).view(np.uint8).data)
    answers.flush()
    sys.stdout.flush()
    os._exit(0)  # skip the cleanup of native code, which may crash


def _limit(memory_B: int, time_s: int) -> None:
    """Limit memory and time of this process, and end it along with its parent; Linux only."""
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
            with contextlib.suppress(ValueError, OSError):  # a lower limit is already set
                # the soft limit sends SIGXCPU, which identifies the reason; the hard limit kills a second later
                resource.setrlimit(what, (most, most + (what == resource.RLIMIT_CPU)))


if __name__ == "__main__":
    _main(sys.argv[1])
