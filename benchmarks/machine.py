"""The machine that figures are from: what it can do, not whose it is."""

import datetime
import os
import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import hapscene

from .sheet import Sheet

PACKAGES = ("numba", "llvmlite", "numpy", "embreex", "trimesh")


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
