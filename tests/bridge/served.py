"""`hapscene serve` as a process."""

import subprocess
import sys
from pathlib import Path

import trimesh


class Served:
    """`hapscene serve` of a cube of 50 mm, and the ports it listens at."""

    def __init__(self, folder: Path, *more: str) -> None:
        trimesh.creation.box((0.05, 0.05, 0.05)).export(folder / "crate.stl")
        words = ["-m", "hapscene", "serve", "crate.stl", "--unit", "m", "--swatch", "wood", "--udp", "0", *more]
        self.process = subprocess.Popen(
            [sys.executable, *words], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        assert self.process.stdout is not None
        while "udp" not in (line := self.process.stdout.readline()):
            assert line, "it ended"
        self.port = int(line.split(":")[1].split()[0])
        self.ws = self.process.stdout.readline().strip() if "--ws" in more else ""

    def end(self) -> str:
        self.process.terminate()
        return self.process.communicate(timeout=120.0)[0]
