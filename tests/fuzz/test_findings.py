"""What was once found: the smallest file of each, and the words that refuse it now."""

import io
import re
import struct
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from .harness import Worker, good

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the worker's limits are Linux's")

FOLDER = Path(__file__).with_name("findings")


def npy(header: str, data: bytes = b"") -> bytes:
    """An array's file with that header, right or wrong."""
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header.encode() + data


def archive(content: bytes, name: str = "acceleration.npy", method: int = zipfile.ZIP_STORED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as made:
        made.writestr(zipfile.ZipInfo(name), content, method)
    return out.getvalue()


def array() -> bytes:
    out = io.BytesIO()
    np.save(out, np.arange(20.0))
    return out.getvalue()


def spoilt(content: bytes, at: int, value: bytes) -> bytes:
    """Some bytes of it replaced; counted from the end where `at` is below 0."""
    at = at % len(content)
    return content[:at] + value + content[at + len(value) :]


def packed_wrongly(method: int) -> bytes:
    """An archive whose member's own content is damaged."""
    return spoilt(archive(array(), method=method), 30 + len("acceleration.npy") + 12, b"\xff\0\xff\0\xff")


def declared(flags: int, method: int) -> bytes:
    """An archive whose member says that it has those flags and that method, at both places."""
    content, words = archive(array()), struct.pack("<HH", flags, method)
    return spoilt(spoilt(content, 6, words), content.index(b"PK\1\2") + 8, words)


def riff(*chunks: tuple[bytes, bytes]) -> bytes:
    body = b"WAVE" + b"".join(kind + struct.pack("<I", len(data)) + data for kind, data in chunks)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def sound(channels: int = 1, rate: int = 1000, block: int = 2, bits: int = 16, kind: int = 1) -> bytes:
    """The chunk that says what kind of sound it is."""
    return struct.pack("<HHIIHH", kind, channels, rate, rate * block, block, bits)


DATA = (b"data", bytes(400))
HEADER = "{'descr': '<f8', 'fortran_order': False, 'shape': (20,), }"


def mat_of_tag_11() -> bytes:
    """The tag miDOUBLE, 9, of the first numbers is made 11, which no type has."""
    content = good("mat")["x.mat"]
    return spoilt(content, content.index(struct.pack("<II", 9, 8)), b"\x0b")


def wav_cut() -> bytes:
    return good("wav")["x.wav"][:-100]


def step_without(pattern: str) -> bytes:
    return re.sub(pattern.encode(), b"", good("step")["x.step"], count=1)


MADE = {
    "npz-zlib": ("npz", packed_wrongly(zipfile.ZIP_DEFLATED), "x.npz: not an NPZ file that can be read"),
    "npz-bzip2": ("npz", packed_wrongly(zipfile.ZIP_BZIP2), "x.npz: not an NPZ file that can be read"),
    "npz-lzma": ("npz", packed_wrongly(zipfile.ZIP_LZMA), "x.npz: not an NPZ file that can be read"),
    "npz-locked": ("npz", declared(1, 0), "x.npz: not an NPZ file that can be read"),
    "npz-method": ("npz", declared(0, 97), "x.npz: not an NPZ file that can be read"),
    "npz-header-open": ("npz", archive(npy("{'descr': (((")), "x.npz: not an NPZ file that can be read"),
    "npz-header-long": ("npz", archive(npy(HEADER.ljust(12_000))), "x.npz: not an NPZ file that can be read"),
    "npz-header-count": ("npz", archive(npy(HEADER.replace("20", "9" * 30))), "x.npz: not an NPZ file that can be read"),
    "npz-objects": ("npz", archive(npy(HEADER.replace("<f8", "|O"))), "x.npz: not an NPZ file that can be read"),
    "wav-no-format": ("wav", riff(DATA), "x.wav: not a WAV file that can be read"),
    "wav-no-block": ("wav", riff((b"fmt ", sound(block=0)), DATA), "x.wav: not a WAV file that can be read"),
    "wav-no-channel": ("wav", riff((b"fmt ", sound(channels=0)), DATA), "x.wav: "),
    "wav-odd-channels": ("wav", riff((b"fmt ", sound(channels=7)), DATA), "x.wav: "),
    "wav-short-format": ("wav", riff((b"fmt ", sound()[:9]), DATA), "x.wav: not a WAV file that can be read"),
    "wav-no-chunk": ("wav", riff()[:14], "x.wav: not a WAV file that can be read"),
    "wav-cut": ("wav", wav_cut(), "x.wav: "),
    "csv-three-axes-short": ("csv", b"time,acceleration_x,acceleration_y\n0,1,2\n0.001,2,1\n", "x.csv: "),
    "mat-tag": ("mat", mat_of_tag_11(), "x.mat: "),
}
"""Format, content, and the words of its refusal, by name."""


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with Worker() as made:
        yield made


@pytest.mark.parametrize("name", MADE)
def test_what_was_found_is_refused_in_words(worker: Worker, name: str) -> None:
    kind, content, words = MADE[name]
    told = worker.read(kind, content)
    assert told["kind"] == "refused", told
    assert words in told["text"]
