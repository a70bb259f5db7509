"""Readers in a separate process: results, failures, limits."""

import ctypes
import os
import re
import signal
import sys
import tempfile
import time
from pathlib import Path
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
    elif how == "abort":
        os.write(2, b"terminate called after throwing an instance of 'std::bad_alloc'\n")
        os.abort()
    elif how == "busy":  # as on a machine whose processors are shared with many other processes
        time.sleep(1.0)
        return {}
    elif how == "fill":
        return {"much": np.ones(100_000_000)}
    elif how == "flood":
        return {"much": np.ones(1_000_000)}
    elif how == "refuse":
        raise FormatError("line 3 is no good")
    elif how == "objects":
        return {"much": np.array([{}])}
    elif how == "leave":
        os._exit(0)
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


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("crash", "SIGSEGV.*about to crash"),
        ("refuse", r"^line 3 is no good$"),
        ("flood", ""),
        ("objects", ""),
        ("leave", ""),
        ("divide", "ZeroDivisionError"),
        ("abort", "190 MiB"),
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
