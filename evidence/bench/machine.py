"""Properties of the machine that figures are measured on, without its name."""

import datetime
import os
import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Final

import hapscene

from .sheet import Sheet

PACKAGES: Final = ("numba", "llvmlite", "numpy", "embreex", "trimesh")


def describe_machine(sheet: Sheet) -> None:
    """Add processor, cores, system, versions and date to a sheet."""
    sheet.add("machine", "processor", _processor())
    sheet.add("machine", "cores", float(os.cpu_count() or 1))
    sheet.add("machine", "system", f"{platform.system()} {platform.release()} {platform.machine()}")
    sheet.add("machine", "Python", platform.python_version())
    for package in PACKAGES:
        sheet.add("machine", package, version(package))
    sheet.add("machine", "hapscene", hapscene.__version__)
    sheet.add("machine", "date", datetime.datetime.now(datetime.UTC).date().isoformat())


def machine_words(sheet: Sheet) -> list[str]:
    """Return the properties that `describe_machine` added, each with its name."""
    noted = [figure for figure in sheet if figure.case == "machine"]
    return [f"{f.name} {f.value:g}" if isinstance(f.value, float) else f"{f.name} {f.value}" for f in noted]


def _processor() -> str:
    """Return model and clock of the processor, as far as the system reports them."""
    if sys.platform.startswith("linux"):
        info: dict[str, str] = {}
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            info.setdefault(name.strip(), value.strip())
        clock = f", {float(info['cpu MHz']) / 1e3:.1f} GHz" if "cpu MHz" in info else ""
        if "model name" in info:
            return f"{info['model name']}{_family(info)}{clock}"
    if sys.platform == "darwin":
        command = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    return platform.processor() or platform.machine()


def _family(info: dict[str, str]) -> str:
    """Return family and model number, which distinguish processors that a virtual machine gives the same name."""
    if "model" not in info:
        return ""
    return f" (family {info.get('cpu family', '?')}, model {info['model']})"
