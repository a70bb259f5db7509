"""Untrusted recordings: limited memory, no crash, no silently shortened data."""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import butter, sosfiltfilt

from hapscene.capture import fit_swatch, load_recording
from hapscene.capture.io.formats import read_mat
from hapscene.capture.io.hatt import read_models
from hapscene.capture.io.hsrec import FIRST_LINE, load_record
from hapscene.capture.io.streams import BLOCK, filtered
from hapscene.errors import CaptureError, FormatError, SwatchError

UNITS = {"acceleration": "g", "force": "N", "speed": "m/s"}


def chunk(kind: bytes, first: int, payload: bytes) -> bytes:
    body = struct.pack("<4sIQ", kind, len(payload), first) + payload
    return body + struct.pack("<I", zlib.crc32(body))


def record(*firsts: int, columns: int = 1) -> Callable[[Path], None]:
    listed = [{"name": f"c{i}", "unit": "g", "scale": 1.0} for i in range(columns)]
    head = chunk(b"HEAD", 0, json.dumps({"rate_Hz": 1000.0, "columns": listed}).encode())
    return lambda path: write(path, FIRST_LINE + head + b"".join(chunk(b"DATA", first, bytes(400)) for first in firsts))


def write(path: Path, content: bytes) -> None:
    path.write_bytes(content)


NOISE = np.random.default_rng(0)


def test_a_record_with_a_huge_gap_is_refused(tmp_path: Path) -> None:
    record(0, 100_000_000)(tmp_path / "gap.hsrec")
    with pytest.raises(CaptureError, match=r"gap\.hsrec: .*100,000,100 samples"):
        load_record(tmp_path / "gap.hsrec")


def test_a_record_with_a_damaged_chunk_inside_is_refused(tmp_path: Path) -> None:
    record(0, 100, 200)(tmp_path / "a.hsrec")
    whole = (tmp_path / "a.hsrec").read_bytes()
    (tmp_path / "a.hsrec").write_bytes(whole[:-600] + whole[-500:])
    with pytest.raises(CaptureError, match=r"a\.hsrec: damaged at byte"):
        load_record(tmp_path / "a.hsrec")


@pytest.mark.parametrize("rate_Hz", [1e-9, 1e12, 0.0, -1.0, float("nan"), float("inf")])
def test_an_invalid_sample_rate_is_refused(rate_Hz: float, tmp_path: Path) -> None:
    stream = NOISE.normal(size=(2000, 3))
    np.savez(tmp_path / "a.npz", acceleration=stream, position=stream, rate_Hz=rate_Hz)
    with pytest.raises(CaptureError, match=r"a\.npz: "):
        load_recording(tmp_path / "a.npz", units={"acceleration": "g", "position": "m"})
    np.savez(tmp_path / "a.npz", acceleration=stream[:, 0], rate_Hz=rate_Hz)
    with pytest.raises(CaptureError):
        fit_swatch(load_recording(tmp_path / "a.npz", units={"acceleration": "g"}))


@pytest.mark.parametrize("wrong", ["compressed", "encrypted", "truncated", "no header"])
def test_an_array_that_numpy_does_not_write_is_refused(wrong: str, tmp_path: Path) -> None:
    packed = io.BytesIO()
    np.save(packed, np.zeros(1000))
    content = b"x" * 200 if wrong == "no header" else packed.getvalue()[: 4000 if wrong == "truncated" else None]
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("acceleration.npy", content, zipfile.ZIP_BZIP2 if wrong == "compressed" else None)
    if wrong == "encrypted":
        data = bytearray((tmp_path / "a.npz").read_bytes())
        data[data.index(b"PK\x01\x02") + 8] |= 1
        (tmp_path / "a.npz").write_bytes(data)
    says = {"compressed": "encryption", "encrypted": "encryption", "truncated": "exceeds", "no header": "header"}
    with pytest.raises(CaptureError, match=says[wrong]):
        load_recording(tmp_path / "a.npz", 1000.0, units={"acceleration": "g"})


def test_a_matlab_file_states_its_units(tmp_path: Path) -> None:
    units = np.array(["acceleration=g", "force=mN"])  # which MATLAB makes of one length
    numbers = {"acceleration": np.arange(1000.0), "force": np.arange(1000, dtype=np.int16), "rate_Hz": 1000.0}
    savemat(tmp_path / "a.mat", {**numbers, "units": units, "note": "by hand", "cell": np.array([{}, 1], object)})
    recording = load_recording(tmp_path / "a.mat")
    assert recording.acceleration_m_s2[-1] == pytest.approx(999 * 9.80665) and recording.rate_Hz == 1000.0
    assert recording.force_N is not None and recording.force_N[-1] == pytest.approx(0.999)
    with (tmp_path / "a.mat").open("rb") as file:
        assert {name: str(array.dtype) for name, array in read_mat(file, 12_000).items()} == {
            "acceleration": "float64", "force": "int16", "rate_Hz": "float64", "units": "<U14",
        }  # fmt: skip


@pytest.mark.parametrize("held", [{"a": np.zeros(500)}, {"a": np.zeros((2, 500), np.int32)}])
def test_a_matlab_file_is_unpacked_only_as_far_as_allowed(held: dict[str, object], tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", held | {"note": "y" * 4000})  # text is not read, and does not count
    with (tmp_path / "a.mat").open("rb") as file:
        assert list(read_mat(file, 4000)) == list(held)
        file.seek(0)
        with pytest.raises(FormatError, match="4,000 bytes"):
            read_mat(file, 3999)


def test_a_toolkit_file_with_too_many_elements_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(f"<modelSet>{'<a/>' * 900_000}</modelSet>")
    with pytest.raises(SwatchError, match="more than 800,000 elements"):
        read_models(tmp_path / "a.xml")


def test_long_signals_are_filtered_as_by_scipy_to_the_bit() -> None:
    signal = NOISE.normal(size=2 * BLOCK + 77)
    for kind, cutoff_Hz, order in (("highpass", 10.0, 4), ("lowpass", 100.0, 4), ("highpass", 20.0, 2)):
        wanted = sosfiltfilt(butter(order, cutoff_Hz, kind, fs=1e4, output="sos"), signal)
        assert np.array_equal(filtered(signal, 1e4, cutoff_Hz, kind, order=order), wanted)


def test_a_signalling_nan_is_a_missing_sample(tmp_path: Path) -> None:
    columns = {name: np.ones(2000, np.float32) for name in UNITS} | {"rate_Hz": 1000.0}
    columns["force"][7:8] = np.array([0x7FA00000], np.uint32).view(np.float32)
    np.savez(tmp_path / "a.npz", **columns)
    with pytest.warns(UserWarning) as caught:
        load_recording(tmp_path / "a.npz", units=UNITS)
    assert [str(one.message).partition(": ")[2] for one in caught] == ["missing samples interpolated: 1 of force"]
