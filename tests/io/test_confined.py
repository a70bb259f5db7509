"""Readers in a separate process: results, failures, limits."""

import ctypes
import io
import os
import re
import signal
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np
import pytest

import hapscene
from hapscene.errors import FormatError
from hapscene.io.confined import confined, import_path


def give(file: BinaryIO, scale: float) -> dict[str, Any]:
    """A reader that succeeds."""
    os.write(1, b"native words\n")
    return {"numbers": scale * np.frombuffer(file.read(), np.uint8), "none": np.zeros((0, 3)), "word": np.array("mm")}


def misbehave(file: BinaryIO, how: str) -> dict[str, Any]:
    if how == "crash":
        os.write(2, b"about to crash\n")
        ctypes.string_at(0)
    elif how == "loop":
        while True:
            pass
    elif how == "sleep":
        signal.pause()
    elif how == "colour":
        os.write(2, b"\x1b[32;1mred\x1b[0m \7\n")
        os._exit(1)
    elif how == "busy":  # as on a machine whose processors are shared with many other processes
        time.sleep(1.0)
        return {}
    elif how == "fill":
        return {"much": np.ones(100_000_000)}
    elif how == "refuse":
        raise FormatError("line 3 is no good")
    raise ZeroDivisionError


def _run(reader: Any, *arguments: Any, **limits: Any) -> Any:
    limits = {"by": "the test's reader", "memory_B": 200_000_000, "output_B": 1_000_000} | limits
    with tempfile.TemporaryFile() as file:
        file.write(b"\1\2\3")
        file.seek(0)
        return confined(reader, file, *arguments, **limits)


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make this file importable in the process."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    for reader in (give, misbehave):
        monkeypatch.setattr(reader, "__module__", Path(__file__).stem)


def test_import_path() -> None:
    places = [Path(place) for place in import_path()["PYTHONPATH"].split(os.pathsep)]
    package = Path(hapscene.__file__).resolve().parent
    assert places[0] == package.parent and package not in places


def test_arrays_and_output() -> None:
    answer = _run(give, 0.5)
    assert answer.arrays["numbers"].tolist() == [0.5, 1.0, 1.5]
    assert answer.arrays["none"].shape == (0, 3)
    assert answer.arrays["word"] == "mm"
    assert answer.output == "native words"


HEAD = b'{"refused": null, "arrays": [["a", "<f8", [2]]]}\n'


@pytest.mark.parametrize(
    ("code", "output", "answer", "words"),
    [
        (0, b"", HEAD + bytes(16), None),
        (0, b"bad_alloc", HEAD + bytes(16), None),
        (0, b"", HEAD + bytes(15), r"failed on it \(exit code 0\): the file is damaged$"),
        (0, b"", HEAD.replace(b"null", b'"line 3"') + bytes(16), "^line 3$"),
        (0, b"", HEAD.replace(b"[2]", b"[3]"), "exceeds the limit"),
        (0, b"", HEAD.replace(b"<f8", b"|O") + bytes(16), "exceeds the limit"),
        (0, b"", b"", "exit code 0"),
        (3, b"one\n\x1b[31mtwo\x1b[0m\n", HEAD + bytes(16), r"exit code 3\).*its last output: two$"),
        (-11, b"", b"", "SIGSEGV"),
        (-250, b"", b"", "signal 250"),
        (-24, b"", b"", "processor time"),
        (1, b"std::bad_alloc", b"", "more than 3 MiB"),
    ],
)
def test_each_end_of_the_process_has_its_error(
    code: int, output: bytes, answer: bytes, words: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    did: list[str] = []
    process = SimpleNamespace(stdout=io.BytesIO(answer), stderr=io.BytesIO(output))
    process.kill, process.wait = lambda: did.append("kill"), lambda: did.append("wait") or code
    monkeypatch.setattr("hapscene.io.confined._start", lambda order, file: process)
    if words is None:
        found = _run(give, memory_B=3 << 20, output_B=16)
        assert found.arrays["a"].tolist() == [0.0, 0.0] and found.output == output.decode()
    else:
        with pytest.raises(FormatError, match=words):
            _run(give, memory_B=3 << 20, output_B=16)
    assert did[-2:] == ["kill", "wait"] and process.stdout.closed and process.stderr.closed


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("crash", "SIGSEGV.*about to crash"),
        ("refuse", r"^line 3 is no good$"),
        ("divide", "ZeroDivisionError"),
        pytest.param("fill", "190 MiB", marks=pytest.mark.skipif(sys.platform != "linux", reason="Linux")),
    ],
)
def test_failures_raise_format_error(how: str, reason: str) -> None:
    with pytest.raises(FormatError) as caught:
        _run(misbehave, how)
    assert re.search(reason, str(caught.value))


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="processor time is limited on Linux only")
def test_processor_time_is_limited() -> None:
    with pytest.raises(FormatError, match="processor"):
        _run(misbehave, "loop", time_s=0.5)


@pytest.mark.nightly
def test_waiting_takes_no_processor_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _run(misbehave, "busy", time_s=0.5).arrays == {}
    monkeypatch.setattr("hapscene.io.confined.CLOCK_RATIO", 2.0)
    with pytest.raises(FormatError, match="clock"):
        _run(misbehave, "sleep", time_s=0.5)


def test_output_is_escaped() -> None:
    assert _run(give, 1.0).output == "native words"
    with pytest.raises(FormatError, match=r"red \\x07$"):
        _run(misbehave, "colour")
