"""Emulated vendors' libraries, compiled from C, and the desk they stand on: a file that outlives their process."""

import shutil
import subprocess
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest

HERE = Path(__file__).parent / "emulators"
ROW = [("t_s", "f8"), ("force", "f8", (3,)), ("spent_s", "f8"), ("ready", "i8"), ("bad", "i8"), ("device", "i8")]
COUNTS = ("buttons", "calibration", "style", "count", "started", "disabled", "watchdog")
FAULTS = ("begin_error", "end_error", "saturated", "off", "stuck", "refuse_code")
DESK = np.dtype(
    [
        *[
            ("position", "f8", (3,)),
            ("velocity", "f8", (3,)),
            ("gripper", "f8"),
            ("transform", "f8", (16,)),
            ("warmth", "f8"),
            ("most_force", "f8"),
        ],
        *[("workspace", "f8", (6,)), ("at_s", "f8"), *[(name, "i8") for name in COUNTS], ("status", "i8", (16,))],
        *[(name, "i8") for name in FAULTS],
        *[("refuse", "S32"), ("name", "S32"), ("second", "S32"), ("tried", "S256"), ("rows", ROW, (1 << 17,))],
    ]
)
"""As in emulators/desk.h."""


@cache
def emulator(name: str) -> str:
    """Path of the library that emulators/NAME.c makes."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler (gcc, cc) that makes the emulated library")
    path = Path(mkdtemp()) / f"lib{name}.so"
    command = [compiler, "-shared", "-fPIC", "-O2", "-o", str(path), str(HERE / f"{name}.c"), "-lpthread", "-lm"]
    subprocess.run(command, check=True)
    return str(path)


class Desk:
    """Faults to switch (`desk.set(begin_error=0x302)`), and what was commanded."""

    def __init__(self, path: Path) -> None:
        with path.open("wb") as file:
            file.truncate(DESK.itemsize)
        self.path = path
        self._map = np.memmap(path, DESK, "r+", shape=(1,))

    def __getattr__(self, name: str) -> Any:
        return self._map[0][name]

    def set(self, **values: Any) -> None:
        for name, value in values.items():
            self._map[name][0] = value

    def rows(self, since: int = 0) -> np.ndarray:
        """Forces commanded from number `since` on, with the times of the emulator's clock; the ring keeps the last."""
        rows, count = self._map["rows"][0], int(self.count)
        return np.array(rows[np.arange(max(since, count - len(rows)), count) % len(rows)])


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    made = Desk(tmp_path / "desk")
    monkeypatch.setenv("HAPSCENE_EMULATED_DESK", str(made.path))
    return made
