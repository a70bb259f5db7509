"""Time of tick and `step` of this checkout against another one: both run alternately, and pairs are compared."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from hapscene.errors import HapsceneError
from hapscene.scene.ply import save_mesh

from .case import slide_path, sphere

__all__ = ["compare_checkouts", "lines"]

ROOT: Final = Path(__file__).resolve().parents[2]
WORKER: Final = Path(__file__).with_name("against_worker.py")

PACKAGES: Final = {
    "hapscene": "hapscene",
    "hapscene_plugins": "plugins",
    "hapscene_assets": "assets",
    "hapscene_swatches": "swatches",
}
"""Folder in a checkout by import name."""

FIGURES: Final = {"tick": "tick", "step": "`step` from Python"}

SUBDIVISIONS, TICKS, PASSES = 6, 3000, 8
"""Subdivisions of the sphere, ticks of the path, runs of each process [count]."""

SLOWER: Final = 1.03
"""Ratio of times above which this checkout counts as slower [1]."""


class Compared(NamedTuple):
    """A time of both checkouts: medians [µs], and the ratio in each round."""

    name: str
    ours_us: float
    theirs_us: float
    ratios: list[float]

    @property
    def ratio(self) -> float:
        """Median over the rounds of this checkout's time over the other's."""
        return float(np.median(self.ratios))


def compare_checkouts(other: Path, rounds: int, say: Callable[[str], None]) -> list[Compared]:
    """Time both checkouts: in each round two new processes run the same path alternately.

    Raises:
        HapsceneError: `other` is not a checkout of hapscene, or a process fails.
    """
    if not all((other / folder).is_dir() for folder in PACKAGES.values()):
        raise HapsceneError(f"{other}: not a checkout of hapscene; expected the folders {', '.join(PACKAGES.values())}")
    times: list[list[dict[str, float]]] = []  # per round: this checkout, the other one
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        save_mesh(sphere(SUBDIVISIONS), work / "sphere.ply")
        np.save(work / "path.npy", slide_path(TICKS))
        for number in range(rounds):
            say(f"round {number + 1} of {rounds}")
            with ExitStack() as stack:
                this, that = (stack.enter_context(_worker(at, work)) for at in (ROOT, other.resolve()))
                runs = [(_run(this), _run(that)) for _ in range(PASSES)]
            times.append([{key: min(run[i][key] for run in runs) for key in FIGURES} for i in range(2)])
    return [
        Compared(
            name,
            float(np.median([ours[key] for ours, _ in times])),
            float(np.median([theirs[key] for _, theirs in times])),
            [ours[key] / theirs[key] for ours, theirs in times],
        )
        for key, name in FIGURES.items()
    ]


def lines(found: list[Compared]) -> list[str]:
    """Return the lines that are printed for a comparison."""
    printed = [f"{'':20} this [µs]  other [µs]  this over other, median (minimum–maximum of the rounds)"]
    for one in found:
        verdict = f"slower by more than {100 * (SLOWER - 1):.0f} %" if one.ratio > SLOWER else "not slower"
        spread = f"({min(one.ratios):.3f}–{max(one.ratios):.3f})"
        printed.append(f"{one.name:20} {one.ours_us:9.3f}  {one.theirs_us:10.3f}  {one.ratio:.3f} {spread}: {verdict}")
    return printed


@contextmanager
def _worker(checkout: Path, work: Path) -> Iterator["subprocess.Popen[str]"]:
    """Start a process that imports hapscene from a checkout and runs the path on request."""
    links = work / checkout.as_posix().strip("/").replace("/", "-")
    links.mkdir(exist_ok=True)
    for name, folder in PACKAGES.items():
        if not (links / name).exists():
            (links / name).symlink_to(checkout / folder, target_is_directory=True)
    command = [sys.executable, str(WORKER), str(work / "sphere.ply"), str(work / "path.npy")]
    environment = os.environ | {"PYTHONPATH": str(links), "PYTHONSAFEPATH": "1"}
    with subprocess.Popen(
        command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            _run(process)  # compiles, or loads compiled code
            yield process
        finally:
            process.kill()


def _run(process: "subprocess.Popen[str]") -> dict[str, float]:
    """Run the path once; return the times [µs]."""
    assert process.stdin is not None and process.stdout is not None
    try:
        process.stdin.write("run\n")
        process.stdin.flush()
        answer = process.stdout.readline()
    except OSError:
        answer = ""
    if not answer:
        raise HapsceneError("a timed process ended early: its error is printed above")
    found: dict[str, float] = json.loads(answer)
    return found
