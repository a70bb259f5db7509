"""Emulated devices: each a process of its own, which logs the force that it is told on its own clock."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

EMULATORS = Path(__file__).parent / "emulators"


class Emulated:
    """An emulator that runs. `place` is where it listens: a path, a port's name, an address."""

    def __init__(self, name: str, folder: Path) -> None:
        self.log = folder / f"{name}.log"
        self.place = str(folder / name)
        command = [sys.executable, str(EMULATORS / f"{name}.py"), str(self.log), self.place]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        said = self.process.stdout.readline().strip()  # type: ignore[union-attr]
        assert said, f"the emulator {name} does not start"
        self.place = self.place if said == "up" else said

    def tell(self, **orders: float) -> None:
        for name, value in orders.items():
            self.process.stdin.write(f"{name} {float(value)}\n")  # type: ignore[union-attr]
            self.process.stdin.flush()  # type: ignore[union-attr]
            assert self.process.stdout.readline() == "done\n"  # type: ignore[union-attr]

    def rows(self) -> list[list[float]]:
        """What it was told: ns, and numbers."""
        return [[float(part) for part in line.split()] for line in self.log.read_text().splitlines()]

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()  # type: ignore[union-attr]
        self.process.stdout.close()  # type: ignore[union-attr]


@pytest.fixture
def emulate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Emulated]]:
    """Starts the emulator of a name; the USB bus is its bus from then on."""
    running: list[Emulated] = []

    def start(name: str) -> Emulated:
        emulated = Emulated(name, tmp_path)
        running.append(emulated)
        monkeypatch.syspath_prepend(EMULATORS)
        monkeypatch.setenv("PYTHONPATH", str(EMULATORS), prepend=":")
        monkeypatch.setenv("HAPSCENE_USB", emulated.place)
        return emulated

    yield start
    for emulated in running:
        emulated.end()
