"""Regressions found by fuzzing: the reader refuses each file with an error that names the file."""

import io
import re
import struct
import sys
import zipfile
from collections.abc import Iterator

import numpy as np
import pytest

from tests.nightly.fuzz.harness import Worker, good

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the worker's limits are Linux's")


def npy(header: str, data: bytes = b"") -> bytes:
    """Return an npy file with the given header, which may be invalid."""
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
    """Return the content with bytes replaced from `at` on; a negative `at` counts from the end."""
    at = at % len(content)
    return content[:at] + value + content[at + len(value) :]


def packed_wrongly(method: int) -> bytes:
    """Return an archive with damaged compressed data."""
    return spoilt(archive(array(), method=method), 30 + len("acceleration.npy") + 12, b"\xff\0\xff\0\xff")


def declared(flags: int, method: int) -> bytes:
    """Return an archive with these flags and this method in both headers of its member."""
    content, words = archive(array()), struct.pack("<HH", flags, method)
    return spoilt(spoilt(content, 6, words), content.index(b"PK\1\2") + 8, words)


def riff(*chunks: tuple[bytes, bytes]) -> bytes:
    body = b"WAVE" + b"".join(kind + struct.pack("<I", len(data)) + data for kind, data in chunks)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def sound(channels: int = 1, rate: int = 1000, block: int = 2, bits: int = 16, kind: int = 1) -> bytes:
    """Return the content of the format chunk of a WAV file."""
    return struct.pack("<HHIIHH", kind, channels, rate, rate * block, block, bits)


DATA = (b"data", bytes(400))
HEADER = "{'descr': '<f8', 'fortran_order': False, 'shape': (20,), }"


TOKEN = HEADER.replace("<f8", "<U1").replace("20", "1")


def touch_with(member: str, content: bytes) -> bytes:
    """Return a touch recording with one array replaced."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(good("touch")["x.npz"])) as whole, zipfile.ZipFile(out, "w") as made:
        for name in whole.namelist():
            made.writestr(name, content if name == f"{member}.npy" else whole.read(name))
    return out.getvalue()


def npz_at(rate_Hz: float) -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, rate_Hz=rate_Hz, acceleration=np.zeros((150, 3)))
    return out.getvalue()


def mat_of_tag_11() -> bytes:
    """Replace the first type tag miDOUBLE (9) by 11, which is not a type."""
    content = good("mat")["x.mat"]
    return spoilt(content, content.index(struct.pack("<II", 9, 8)), b"\x0b")


def without(name: str, start: int, end: int) -> bytes:
    """Return the valid file of a format without the bytes from `start` to `end`."""
    content = next(iter(good(name).values()))
    return content[:start] + content[end:]


def other(name: str, pattern: str, new: str) -> bytes:
    """Return the valid file of a format with the first match of a pattern replaced."""
    content = next(iter(good(name).values()))
    changed = re.sub(pattern.encode(), new.encode(), content, count=1)
    assert changed != content
    return changed


def painted_of_nan() -> bytes:
    """Replace the first coordinate of the painted glTF by NaN."""
    content = good("painted-glb")["x.glb"]
    start = 28 + struct.unpack_from("<I", content, 12)[0]
    return spoilt(content, start, struct.pack("<f", np.nan))


MADE = {
    "npz-zlib": ("npz", lambda: packed_wrongly(zipfile.ZIP_DEFLATED)),
    "npz-lzma": ("npz", lambda: packed_wrongly(zipfile.ZIP_LZMA)),
    "npz-locked": ("npz", lambda: declared(1, 0)),
    "npz-method": ("npz", lambda: declared(0, 97)),
    "npz-header-open": ("npz", lambda: archive(npy("{'descr': ((("))),
    "npz-header-deep": ("npz", lambda: archive(npy("(" * 9000))),
    "npz-header-long": ("npz", lambda: archive(npy(HEADER.ljust(12_000)))),
    "npz-header-count": ("npz", lambda: archive(npy(HEADER.replace("20", "9" * 30)))),
    "npz-objects": ("npz", lambda: archive(npy(HEADER.replace("<f8", "|O")))),
    "npz-letters": ("npz", lambda: archive(npy(TOKEN, b"\xff" * 4), "units.npy")),
    "npz-rate-nan": ("npz", lambda: npz_at(np.nan)),
    "path-control-characters": ("path", lambda: b"\x1b[2J\n"),
    "wav-no-format": ("wav", lambda: riff(DATA)),
    "wav-no-channel": ("wav", lambda: riff((b"fmt ", sound(channels=0)), DATA)),
    "wav-short-format": ("wav", lambda: riff((b"fmt ", sound()[:9]), DATA)),
    "wav-cut": ("wav", lambda: without("wav", -100, 10**6)),
    "hsrec-cut-within": ("hsrec", lambda: without("hsrec", -250, -150)),
    "csv-three-axes-short": ("csv", lambda: b"time,acceleration_x,acceleration_y\n0,1,2\n1,2,1\n"),
    "mat-tag": ("mat", mat_of_tag_11),
    "touch-header-open": ("touch", lambda: touch_with("t_s", npy("{'descr': ((("))),
    "touch-half-a-row": ("touch", lambda: touch_with("t_s", npy(HEADER.replace("20", "0.5")))),
    "touch-letters": ("touch", lambda: touch_with("body_names", npy(TOKEN, b"\xff" * 4))),
    "stl-text-no-loop": ("stl-text", lambda: without("stl-text", 1141, 1441)),
    "off-fewer-faces-declared": ("off", lambda: other("off", "42 80 ", "42 8 ")),
    "study-long-number": ("study", lambda: other("study", r"people = \d+", "people = " + "9" * 5000)),
    "step-no-such-point": ("step", lambda: other("step", "#3,#4,#8,#7", "#3,#999,#8,#7")),
    "step-cut-within": ("step", lambda: without("step", 700, 1000)),
    "step-empty": ("step", lambda: b"ISO-10303-21END-ISO-10303-21"),
    "scene-pose": ("scene", lambda: other("scene", r'"pose": \[', '"pose": [[0], ')),
    "painted-glb-nan": ("painted-glb", painted_of_nan),
}
"""Format and content of each invalid file, by name."""


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    with Worker() as made:
        yield made


@pytest.mark.parametrize("name", MADE)
def test_invalid_file_is_refused(worker: Worker, name: str) -> None:
    kind, content = MADE[name]
    result = worker.read(kind, content())
    assert result["kind"] == "refused" or result.get("warned"), result
