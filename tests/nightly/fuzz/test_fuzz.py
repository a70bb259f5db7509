"""Fuzzing: each of thousands of damaged files is read or refused in one line; no reader crashes, hangs or loses data.

The nightly tests have a short run. A long one, with another seed:

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


def look(worker: Worker, name: str, count: int, folder: Path) -> None:
    found = [(finding, keep(finding, folder)) for finding in campaign(worker, name, SEED, count)]
    assert not found, "\n".join(f"{finding}; the file: {file}" for finding, file in found)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Where what is found is kept."""
    return Path(os.environ.get("HAPSCENE_FUZZ_OUT", tmp_path))


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_broken_is_read_or_refused(worker: Worker, name: str, out: Path) -> None:
    look(worker, name, FORMATS[name].quick, out)


@pytest.mark.soak
@pytest.mark.parametrize("name", FORMATS)
def test_what_is_broken_is_read_or_refused_at_length(worker: Worker, name: str, out: Path) -> None:
    look(worker, name, FORMATS[name].soak, out)


def test_no_format_of_a_mesh_or_a_recording_is_forgotten() -> None:
    here = {Path(next(iter(good(name)))).suffix for name in FORMATS}
    assert {f".{suffix}" for suffix in mesh_file.FORMATS} - {".stp"} <= here  # another spelling of .step
    assert set(SUFFIXES) - {".txt"} <= here  # read as .csv is
