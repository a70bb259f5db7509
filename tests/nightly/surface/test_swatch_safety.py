"""Opening any swatch file, however large or malicious, stays within the stated memory."""

import subprocess
import sys
from pathlib import Path

import pytest

from hapscene.io.files import CONTAINER_MAX, VALUE_MAX
from hapscene.surface.swatch_file import BYTES_MAX

OPENING_BYTES = 400e6
"""The stated limit of memory for opening any file [bytes]; see `swatch_file.BYTES_MAX`."""

HEAD = '{"format": "hapscene swatch", "version": 1, "name": "x", '

BULKY = {
    # one sign beyond the Basic Multilingual Plane makes Python take four bytes for each of the text's
    "strings": HEAD + '"provenance": ["😀",' + ",".join(['"ab"'] * (VALUE_MAX - 100)) + "]",
    "floats": HEAD + '"albedo_rgb": ["😀",' + ",".join(["1e1"] * (VALUE_MAX - 100)) + "]",
    "keys": HEAD + '"effects": {"a":{"😀":1,' + ",".join(f'"k{i}":1.5' for i in range(49_000)) + "}}",
    "lists": HEAD + '"texture": ["😀",' + ",".join(["[1.5]"] * (CONTAINER_MAX - 100)) + "]",
    "text": HEAD + '"provenance": "😀' + "a" * (BYTES_MAX - 200) + '"',
    "brackets": "[" * (BYTES_MAX - 1),
}

MEASURE = """
import resource, sys
from hapscene.errors import SwatchError
from hapscene.swatches.library import load_swatch
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    load_swatch(sys.argv[1])
except SwatchError:
    pass
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(peak * (1 if sys.platform == "darwin" else 1024))
"""


def opening_bytes(path: Path) -> float:
    """Memory that a process needs more, at its peak, for opening a file."""
    pytest.importorskip("resource", reason="memory is measured on Unix only")
    done = subprocess.run([sys.executable, "-c", MEASURE, str(path)], capture_output=True, text=True, check=True)
    return float(done.stdout)


@pytest.mark.parametrize("case", BULKY)
def test_a_bulky_file_stays_within_the_stated_memory(tmp_path: Path, case: str) -> None:
    path = tmp_path / "x.swatch"
    text = BULKY[case]
    path.write_text(text + " " * (BYTES_MAX - len(text.encode()) - 1) + "}", encoding="utf-8")
    assert path.stat().st_size == BYTES_MAX
    assert opening_bytes(path) < OPENING_BYTES
