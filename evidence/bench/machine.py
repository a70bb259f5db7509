"""The machine that figures are from: what it can do, not whose it is."""

import ctypes
import datetime
import gc
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Final

import hapscene
from hapscene.errors import HapsceneError

from .sheet import Sheet

PACKAGES: Final = ("numba", "llvmlite", "numpy", "embreex", "trimesh")


def describe_machine(sheet: Sheet) -> None:
    """Note processor, cores, system, versions and date."""
    sheet.add("machine", "processor", _processor())
    sheet.add("machine", "cores", float(os.cpu_count() or 1))
    sheet.add("machine", "system", f"{platform.system()} {platform.release()} {platform.machine()}")
    sheet.add("machine", "Python", platform.python_version())
    for package in PACKAGES:
        sheet.add("machine", package, version(package))
    sheet.add("machine", "hapscene", hapscene.__version__)
    sheet.add("machine", "date", datetime.datetime.now(datetime.UTC).date().isoformat())


def machine_words(sheet: Sheet) -> list[str]:
    """What `describe_machine` noted, each with its name."""
    noted = [figure for figure in sheet if figure.case == "machine"]
    return [f"{f.name} {f.value:g}" if isinstance(f.value, float) else f"{f.name} {f.value}" for f in noted]


def run_python(arguments: list[str], otherwise: str, **environment: str) -> str:
    """What a fresh Python prints that is given code and its arguments.

    Raises:
        HapsceneError: with the words `otherwise` and its last line, where it fails.
    """
    command = [sys.executable, "-c", *arguments]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise HapsceneError(f"{otherwise}: {done.stderr.strip().splitlines()[-1]}")
    return done.stdout


def held_MB(build: Callable[[], object]) -> float:
    """How much more memory this process has while what is built is held [MB]; NaN where the system does not tell."""
    before_B = _resident_B()
    held = build()
    grown_B = _resident_B() - before_B
    del held
    return max(grown_B, 0.0) / 1e6


def _resident_B() -> float:
    """Memory of this process, what was freed given back first."""
    if not sys.platform.startswith("linux"):
        return float("nan")
    gc.collect()
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)  # of glibc
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return float(pages * os.sysconf("SC_PAGE_SIZE"))


def _processor() -> str:
    """Its model and clock, as far as the system tells."""
    if sys.platform.startswith("linux"):
        told: dict[str, str] = {}
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            told.setdefault(name.strip(), value.strip())
        clock = f", {float(told['cpu MHz']) / 1e3:.1f} GHz" if "cpu MHz" in told else ""
        if "model name" in told:
            return f"{told['model name']}{_family(told)}{clock}"
    if sys.platform == "darwin":
        command = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    return platform.processor() or platform.machine()


def _family(told: dict[str, str]) -> str:
    """Family and model number, which tell processors apart that a virtual machine gives one name."""
    if "model" not in told:
        return ""
    return f" (family {told.get('cpu family', '?')}, model {told['model']})"
