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
from scipy.io import savemat, wavfile

from hapscene.capture.io.hsrec import RecordWriter
from hapscene.io.wire.protocol import Column, Header, Run
from tests.capture.test_recording_safety import record, write

UNITS = {"acceleration": "g", "force": "N", "speed": "m/s"}


HEADER = Header(10_000.0, (*(Column(f"acceleration_{axis}", "g", 0.01) for axis in "xyz"), Column("force", "N", 0.1)))


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


def many_members(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for i in range(12_000):
            archive.writestr(f"{i:064}", b"")


def overlapping(path: Path) -> None:
    """Two entries of one member."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", b"x" * 100)
        archive.writestr("b.npy", b"y" * 100)
        archive.infolist()[1].header_offset = 0


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
    "later.csv": ("rec", lambda p: write(p, b"1\n" + b"1," * 10_000_000), "line 2 is longer than"),
    "long.csv": ("rec", lambda p: write(p, b"1,2,3,4,5,6,7,8\n" + b"\n" * 5_000_000), "the table needs"),
    "shape.npz": ("rec", shaped("(1000000000000,)"), "truncated or forged"),
    "fortran.npz": ("rec", shaped("(1000000, 1000000)"), "truncated or forged"),
    "negative.npz": ("rec", shaped("(-1,)"), "truncated or forged"),
    "nothing.npz": ("rec", shaped("(1000000000000,)", "'<U0'"), "no columns"),
    "fields.npz": ("rec", shaped("(50,)", "[('a', '<f8'), ('b', '<f8')]"), "no columns"),
    "within.npz": ("rec", shaped("(1,)", "'(1000,1000)f8'"), "truncated or forged"),
    "deep.npz": ("rec", shaped("(" + "-" * 9000 + "1,)"), "invalid header"),
    "words.npz": ("rec", shaped("(50,"), "invalid header"),
    "lzma.npz": ("rec", packed(zipfile.ZIP_LZMA), "NumPy does not write"),
    "bzip2.npz": ("rec", packed(zipfile.ZIP_BZIP2), "NumPy does not write"),
    "encrypted.npz": ("rec", encrypted, "NumPy does not write"),
    "members.npz": ("rec", many_members, "its directory"),
    "overlap.npz": ("rec", overlapping, "the NPZ file cannot be read"),
    "claim.wav": ("rec", wav(size=1 << 30), "truncated: its header states 1,073,741,824 bytes"),
    "channels.wav": ("rec", wav(channels=0), "the WAV file cannot be read"),
    "block.wav": ("rec", wav(channels=7, block=14), "the WAV file cannot be read"),
    "bits.wav": ("rec", wav(bits=65), "the WAV file cannot be read"),
    "law.wav": ("rec", wav(kind=7), "the WAV file cannot be read"),
    "rate.wav": ("rec", wav(rate=0, bytes=0), "invalid sample rate"),
    "chunks.wav": ("rec", lambda p: write(p, b"RIFF\0\0\0\x10WAVE" + b"junk\0\0\0\0" * 2000), "chunks precede"),
    "path.csv": ("path", lambda p: write(p, b"t,x,y,z\n" + b"".join(b"%f,0,0,0\n" % (9.9 * i) for i in range(360))),
                 "lasts 3,554 s; expected at most 236 s .* for 360 rows"),
    "row.csv": ("path", lambda p: write(p, b"t,x,y,z\n" + b"0,0,0,0," * 2_000_000), "line 2 is longer than"),
}  # fmt: skip
"""Invalid files: reader, function that writes the file, expected text of the error."""


NOISE = np.random.default_rng(0)


def real_record(path: Path) -> None:
    counts = NOISE.integers(-3000, 3000, (4096, 4))
    with RecordWriter(path, HEADER) as writer:
        for start in range(0, 750_000, 4096):
            writer.write(Run(start, counts))


def real_text(path: Path, first: bytes, row: Callable[[int], str], count: int, repeated: int) -> None:
    path.write_bytes(first + "".join(map(row, range(count))).encode() * repeated)


REAL: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "doubles.npz": ("rec", lambda p: np.savez(p, acceleration=NOISE.normal(size=(500_000, 3)), force=np.ones(500_000))),
    "words.npz": ("rec", lambda p: np.savez(p, acceleration=NOISE.integers(-999, 999, (3, 1_500_000), np.int16))),
    "gaps.npz": ("rec", lambda p: np.savez(p, acceleration=np.where(np.arange(2_000_000) % 999, 1.0, np.nan))),
    "doubles.mat": ("rec", lambda p: savemat(p, {"acceleration": NOISE.normal(size=(750_000, 3))})),
    "words.wav": ("rec", lambda p: wavfile.write(p, 10_000, NOISE.integers(-999, 999, (1_500_000, 3), np.int16))),
    "counts.hsrec": ("rec", real_record),
    "text.csv": ("rec", lambda p: real_text(p, b"acceleration,force,speed\n",
                                            lambda i: f"{np.sin(i):.9f},{1 + i % 3}.5,{i % 7}e-2\n", 5_000, 80)),
    "digits.csv": ("rec", lambda p: real_text(p, b"acceleration force\n", lambda i: f"{i % 10} 1\n", 1000, 500)),
    "path.csv": ("path", lambda p: real_text(p, b"t,x,y,z\n", lambda i: f"{i * 1.0001e-3:.7f},0.0{i},0.{i},0\n",
                                             150_000, 1)),
}  # fmt: skip
"""Valid files of 2 to 20 MB."""


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
    for place, files in (("bomb", BOMBS), ("real", REAL)):
        (folder / place).mkdir()
        for name, (kind, make, *_) in files.items():
            make(folder / place / name)
            order.append(f"{kind} {folder / place / name}\n")
    child = subprocess.run(
        [sys.executable, "-c", CHILD, json.dumps(UNITS)], input="".join(order), capture_output=True, text=True
    )
    assert child.returncode == 0, child.stderr
    rows = map(json.loads, child.stdout.splitlines())
    return {f"{Path(path).parent.name}/{Path(path).name}": (Path(path), said, peak) for path, said, peak in rows}


linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux reports the peak memory of a process")


@linux
@pytest.mark.parametrize("name", BOMBS)
def test_files_that_would_fill_the_memory_are_refused(name: str, read: dict[str, Any]) -> None:
    path, said, peak_B = read[f"bomb/{name}"]
    assert said is not None and said.startswith(str(path)) and "\n" not in said
    with pytest.raises(AssertionError, match=BOMBS[name][2]):
        raise AssertionError(said)
    assert peak_B <= 4 * path.stat().st_size + 20_000_000


@linux
@pytest.mark.parametrize("name", REAL)
def test_reading_needs_at_most_four_times_the_file_size(name: str, read: dict[str, Any]) -> None:
    path, said, peak_B = read[f"real/{name}"]
    assert said is None
    assert peak_B <= 4 * path.stat().st_size + (200_000_000 if "words" in name else 50_000_000)
