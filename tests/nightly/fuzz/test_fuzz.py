"""Fuzzing: readers load or refuse damaged files in one line, and never crash, hang or lose data without a warning.

The nightly tests have a short run. To run a long one with another seed:

    HAPSCENE_FUZZ_SEED=7 HAPSCENE_FUZZ_OUT=out/fuzz pytest -m soak tests/nightly/fuzz -k "npz or wav"
"""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapscene.capture.batch import SUFFIXES
from hapscene.scene import mesh_file
from tests.nightly.fuzz.harness import FORMATS, Worker, campaign, good, keep

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the worker's limits are Linux's")

SEED = os.environ.get("HAPSCENE_FUZZ_SEED", "0")


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with Worker() as made:
        yield made


def assert_no_findings(worker: Worker, name: str, count: int, folder: Path) -> None:
    found = [(finding, keep(finding, folder)) for finding in campaign(worker, name, SEED, count)]
    assert not found, "\n".join(f"{finding}; the file: {file}" for finding, file in found)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Folder for the files that were not handled correctly."""
    return Path(os.environ.get("HAPSCENE_FUZZ_OUT", tmp_path))


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_file_is_read_or_refused(worker: Worker, name: str, out: Path) -> None:
    assert_no_findings(worker, name, FORMATS[name].quick, out)


@pytest.mark.soak
@pytest.mark.parametrize("name", FORMATS)
def test_many_damaged_files_are_read_or_refused(worker: Worker, name: str, out: Path) -> None:
    assert_no_findings(worker, name, FORMATS[name].soak, out)


def test_all_mesh_and_recording_formats_are_fuzzed() -> None:
    here = {Path(next(iter(good(name)))).suffix for name in FORMATS}
    assert {f".{suffix}" for suffix in mesh_file.FORMATS} - {".stp"} <= here  # .stp is the same format as .step
    assert set(SUFFIXES) - {".txt"} <= here  # .txt is the same format as .csv
