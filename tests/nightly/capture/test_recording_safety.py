"""Memory and robustness of reading untrusted recordings."""

import json
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from tests.capture.test_recording_safety import record, write

UNITS = {"acceleration": "g", "force": "N", "speed": "m/s"}


def npz(path: Path, name: str, header: str, content: bytes = b"", packing: int = zipfile.ZIP_DEFLATED) -> None:
    """An archive of one array with that header."""
    text = header.encode().ljust(-(-(len(header) + 11) // 64) * 64 - 11) + b"\n"
    with zipfile.ZipFile(path, "w", packing) as archive:
        archive.writestr(f"{name}.npy", b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text + content)


def shaped(shape: str, descr: str = "'<f8'") -> Callable[[Path], None]:
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}"
    return lambda path: npz(path, "acceleration", header, bytes(800))


def packed(packing: int) -> Callable[[Path], None]:
    return lambda path: npz(path, "acceleration", str({"descr": "<f8", "fortran_order": False, "shape": (99,)}),
                            bytes(792), packing)  # fmt: skip


def spoiled(path: Path, old: bytes, new: bytes) -> None:
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))


def crossed_mat(path: Path) -> None:
    """An invalid data type, at which the reader of SciPy crashes."""
    savemat(path, {"acceleration": np.arange(1000.0)})
    spoiled(path, struct.pack("<II", 9, 8000), struct.pack("<II", 11, 8000))


def encrypted(path: Path) -> None:
    packed(zipfile.ZIP_STORED)(path)
    spoiled(path, b"PK\1\2\x14\3\x14\0\0\0", b"PK\1\2\x14\3\x14\0\1\0")


def wav(**change: int) -> Callable[[Path], None]:
    fields = {"length": 16, "kind": 1, "channels": 1, "rate": 8000, "bytes": 16_000, "block": 2, "bits": 16} | change
    size = fields.pop("size", 1000)
    head = b"RIFF" + struct.pack("<I", 1036) + b"WAVEfmt " + struct.pack("<IHHIIHH", *fields.values())
    return lambda path: write(path, head + b"data" + struct.pack("<I", size) + bytes(1000))


BOMBS: dict[str, tuple[str, Callable[[Path], Any], str]] = {
    "zeros.npz": ("rec", lambda p: np.savez_compressed(p, acceleration=np.zeros(60_000_000, "u1")), "unpacks to 60,"),
    "bytes.npz": ("rec", lambda p: np.savez(p, acceleration=np.ones(60_000_000, np.uint8)), "60,000,000 samples"),
    "zeros.mat": ("rec", lambda p: savemat(p, {"acceleration": np.zeros(8_000_000)}, do_compression=True), "unpacks"),
    "version4.mat": ("rec", lambda p: write(p, struct.pack("<5i", 0, 10**9, 9, 0, 2) + b"a\0"), "unpacks to"),
    "crossed.mat": ("rec", crossed_mat, r"SIGSEGV|damaged"),
    "gap.hsrec": ("rec", record(0, (1 << 28) - 200), "268,435,356 samples"),
    "far.hsrec": ("rec", record(1 << 63), "exceed"),
    "columns.hsrec": ("rec", record(0, columns=60_000), "header or end"),
    "line.csv": ("rec", lambda p: write(p, b"1," * 10_000_000), "line 1 is longer than 65,536 characters"),
    "long.csv": ("rec", lambda p: write(p, b"1,2,3,4,5,6,7,8\n" + b"\n" * 5_000_000), "the table needs"),
    "shape.npz": ("rec", shaped("(1000000000000,)"), "truncated or forged"),
    "nothing.npz": ("rec", shaped("(1000000000000,)", "'<U0'"), "no columns"),
    "fields.npz": ("rec", shaped("(50,)", "[('a', '<f8'), ('b', '<f8')]"), "no columns"),
    "within.npz": ("rec", shaped("(1,)", "'(1000,1000)f8'"), "truncated or forged"),
    "deep.npz": ("rec", shaped("(" + "-" * 9000 + "1,)"), "invalid header"),
    "lzma.npz": ("rec", packed(zipfile.ZIP_LZMA), "NumPy does not write"),
    "encrypted.npz": ("rec", encrypted, "NumPy does not write"),
    "claim.wav": ("rec", wav(size=1 << 30), "truncated: its header states 1,073,741,824 bytes"),
    "law.wav": ("rec", wav(kind=7), "the WAV file cannot be read"),
    "rate.wav": ("rec", wav(rate=0, bytes=0), "invalid sample rate"),
    "chunks.wav": ("rec", lambda p: write(p, b"RIFF\0\0\0\x10WAVE" + b"junk\0\0\0\0" * 2000), "chunks precede"),
    "path.csv": ("path", lambda p: write(p, b"t,x,y,z\n" + b"".join(b"%f,0,0,0\n" % (9.9 * i) for i in range(360))),
                 "lasts 3,554 s; expected at most 236 s .* for 360 rows"),
    "row.csv": ("path", lambda p: write(p, b"t,x,y,z\n" + b"0,0,0,0," * 2_000_000), "line 2 is longer than"),
}  # fmt: skip
"""Invalid files: reader, function that writes the file, expected text of the error."""


CHILD = """
import json, sys, warnings
from pathlib import Path
import numpy as np, scipy.interpolate, scipy.io.wavfile, scipy.signal
from hapscene.capture.io.recording import load_recording
from hapscene.capture.io.streams import filtered
from hapscene.errors import FormatError
from hapscene.motion.path_file import load_path
warnings.simplefilter("ignore")
filtered(np.random.normal(size=9999), 1e4, 9.0, "lowpass")
def memory(what):
    return 1024 * int(next(x for x in open("/proc/self/status") if x.startswith(what)).split()[1])
for line in sys.stdin:
    kind, path = line.split()
    Path("/proc/self/clear_refs").write_text("5")
    before = memory("VmRSS")
    try:
        load_recording(path, 1e4, units=json.loads(sys.argv[1])) if kind == "rec" else load_path(path, 1e-3)
        said = None
    except FormatError as error:
        said = str(error)
    peak = memory("VmHWM") - before
    print(json.dumps([path, said, peak]), flush=True)
"""


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, str | None, int]]:
    """Each file with the error, or None, and the peak memory [bytes] of reading it."""
    folder = tmp_path_factory.mktemp("strangers")
    order = []
    for name, (kind, make, _) in BOMBS.items():
        make(folder / name)
        order.append(f"{kind} {folder / name}\n")
    child = subprocess.run(
        [sys.executable, "-c", CHILD, json.dumps(UNITS)], input="".join(order), capture_output=True, text=True
    )
    assert child.returncode == 0, child.stderr
    rows = map(json.loads, child.stdout.splitlines())
    return {Path(path).name: (Path(path), said, peak) for path, said, peak in rows}


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux reports the peak memory of a process")
@pytest.mark.parametrize("name", BOMBS)
def test_files_that_would_fill_the_memory_are_refused(name: str, read: dict[str, Any]) -> None:
    path, said, peak_B = read[name]
    assert said is not None and said.startswith(str(path)) and "\n" not in said
    with pytest.raises(AssertionError, match=BOMBS[name][2]):
        raise AssertionError(said)
    assert peak_B <= 4 * path.stat().st_size + 20_000_000
