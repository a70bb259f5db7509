"""Published data sets: simulated recordings in their layouts, and errors."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from hapscene.capture.io.datasets import GAP_SAMPLES, read_dataset
from hapscene.capture.io.formats import read_parquet
from hapscene.capture.io.recording import InterpolatedWarning, load_recording
from hapscene.errors import CaptureError
from hapscene.io.confined import confined

G = 9.80665

Columns = Mapping[str, Sequence[float] | np.ndarray]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values[500:-500]))))


def write_csv(path: Path, columns: Columns) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")


# LMT: a number a line, an axis a file, 10 kHz, no unit.


LMT = Path("AccelScansComponents") / "Movement" / "Training"


def lmt_folder(root: Path, surfaces: Sequence[str] = ("G1EpoxyRasterPlate",), takes: int = 2) -> Path:
    folder = root / LMT
    folder.mkdir(parents=True)
    t_s = np.arange(4800) / 1e4
    for surface in surfaces:
        for take in range(1, takes + 1):
            for axis, size in {"X": 1.0, "Y": 2.0, "Z": 2.0}.items():
                wave = size * np.sin(2 * np.pi * 200.0 * t_s) + 9.81 * take * (axis == "Z")
                np.savetxt(folder / f"{surface}_Movement_{axis}_train{take}.txt", wave, fmt="%.9f")
    return folder


def test_lmt_combines_three_axes_and_needs_a_unit(tmp_path: Path) -> None:
    folder = lmt_folder(tmp_path)
    file = folder / "G1EpoxyRasterPlate_Movement_Y_train2.txt"
    with pytest.raises(CaptureError, match="--units acceleration"):
        load_recording(file)
    recording = load_recording(file, units={"acceleration": "g"})
    assert recording.rate_Hz == 1e4 and len(recording.acceleration_m_s2) == 4800
    assert rms(recording.acceleration_m_s2) == pytest.approx(G * 3.0 / math.sqrt(2), rel=0.02)  # 1² + 2² + 2² = 3²
    assert recording.force_N is None and recording.speed_m_s is None


def test_lmt_before_108_is_one_axis(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "G9TextileVersion1_query3.txt", np.sin(np.arange(3000)))
    recording = load_recording(tmp_path / "G9TextileVersion1_query3.txt", units={"acceleration": "m/s2"})
    assert recording.rate_Hz == 1e4 and recording.acceleration_m_s2[1] == pytest.approx(math.sin(1.0))


def test_given_columns_and_other_names_bypass_the_data_sets(tmp_path: Path) -> None:
    file = lmt_folder(tmp_path) / "G1EpoxyRasterPlate_Movement_Y_train2.txt"
    recording = load_recording(file, 5e3, columns={"acceleration": "1"}, units={"acceleration": "m/s2"})
    assert recording.rate_Hz == 5e3 and rms(recording.acceleration_m_s2) == pytest.approx(math.sqrt(2), rel=0.01)
    other = file.with_name("lmt108_G1EpoxyRasterPlate_Movement_X_test1.txt")
    other.write_bytes(file.read_bytes())
    assert read_dataset(other) is None


# Cluster: three tables with separate time stamps.


def cluster_recording(root: Path, name: str, *, parquet: bool = False, leave_out: Sequence[str] = ()) -> Path:
    """A stroke as described: accel [g] and force [N] at uneven 6 kHz, position [mm] at 100 Hz."""
    rng = np.random.default_rng(3)
    t_s = 0.001 + np.cumsum(rng.choice([130e-6, 160e-6, 210e-6], 12_000))
    slow_s = np.arange(0.0, t_s[-1], 0.01)
    waves = [size * np.sin(2 * np.pi * 200.0 * t_s) + still for size, still in ((0.1, 0.0), (0.2, 0.0), (0.2, -1.0))]
    tables: dict[str, tuple[np.ndarray, Columns]] = {
        "accel": (t_s, dict(zip("XYZ", waves, strict=True))),
        "force": (t_s, {"force": 0.5 + 0.1 * t_s}),
        "position": (slow_s, {"X": 30.0 * slow_s, "Y": 45.0 - 40.0 * slow_s}),
    }
    for kind, (times_s, columns) in tables.items():
        if kind in leave_out:
            continue
        file = root / "sensor_data" / kind / f"{name}.{'parquet' if parquet else 'csv'}"
        if parquet:
            pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
            file.parent.mkdir(parents=True, exist_ok=True)
            time_ns = np.round(1e9 * times_s).astype(np.int64)
            pq.write_table(pa.table({"time_ns": time_ns, **columns}), file)
        else:
            write_csv(file, {"time": times_s, **columns})
    return root / "sensor_data" / "accel" / f"{name}.{'parquet' if parquet else 'csv'}"


@pytest.mark.parametrize("parquet", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_cluster_streams_are_resampled_to_common_times(tmp_path: Path, parquet: bool) -> None:
    recording = load_recording(cluster_recording(tmp_path, "17_135_40_500_0", parquet=parquet))
    assert recording.rate_Hz == 6000.0 and len(recording.acceleration_m_s2) == pytest.approx(2.0 * 6000, rel=0.02)
    assert rms(recording.acceleration_m_s2) == pytest.approx(0.3 * G / math.sqrt(2), rel=0.02)
    assert recording.force_N is not None and recording.speed_m_s is not None and recording.direction_rad is not None
    t_s = 0.00113 + np.arange(len(recording.force_N)) / 6000.0
    np.testing.assert_allclose(recording.force_N, 0.5 + 0.1 * t_s, atol=2e-5)
    np.testing.assert_allclose(recording.speed_m_s[600:-600], 0.05, rtol=1e-6)  # 30 and 40 mm/s: 50
    np.testing.assert_allclose(recording.direction_rad[600:-600], np.arctan2(-40.0, 30.0), atol=1e-6)


def test_cluster_gaps_are_missing_samples(tmp_path: Path) -> None:
    file = cluster_recording(tmp_path, "0_0_20_500_0")
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[:5000] + lines[5030:]))
    with pytest.warns(InterpolatedWarning, match=r"\d+ of acceleration_x"):
        recording = load_recording(file)
    assert recording.bridged["acceleration_x"] == pytest.approx(30, abs=3) and GAP_SAMPLES < 30
    file.write_text("\n".join(lines[:5000] + lines[6000:]))
    with pytest.raises(CaptureError, match="acceleration_x"):
        load_recording(file)


@pytest.mark.parametrize(
    ("row", "message"),
    [("1e7,0,0,0", "samples from .* needs"), ("inf,0,0,0", "finite"), ("0,0,0,0", "time stamps")],
)
def test_cluster_refuses_forged_tables(tmp_path: Path, row: str, message: str) -> None:
    file = cluster_recording(tmp_path, "0_0_20_500_0", leave_out=("force", "position"))
    file.write_text("\n".join([*file.read_text().splitlines()[:5000], row]))
    with pytest.raises(CaptureError, match=message):
        load_recording(file)


def test_a_file_named_by_date_belongs_to_no_data_set(tmp_path: Path) -> None:
    write_csv(tmp_path / "2024_11_23_10_05.csv", {"acceleration": np.sin(np.arange(4000.0))})
    recording = load_recording(tmp_path / "2024_11_23_10_05.csv", 1e4, units={"acceleration": "g"})
    assert len(recording.acceleration_m_s2) == 4000


@pytest.mark.nightly  # a process
def test_parquet(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = pa.table({"accel": np.arange(1000) % 7 / 7.0, "note": ["x"] * 1000, "force": np.full(1000, 2.0)})
    pq.write_table(table, tmp_path / "oak.parquet")
    how = {"columns": {"acceleration": "accel"}, "units": {"acceleration": "m/s2", "force": "N"}}
    recording = load_recording(tmp_path / "oak.parquet", 1e4, **how)
    assert recording.force_N is not None and set(recording.force_N) == {2.0}
    np.testing.assert_array_equal(recording.acceleration_m_s2, np.arange(1000) % 7 / 7.0)
    whole = (tmp_path / "oak.parquet").read_bytes()
    for broken in (b"", whole[: len(whole) // 2]):
        (tmp_path / "oak.parquet").write_bytes(broken)
        with pytest.raises(CaptureError, match=r"oak\.parquet: "):
            load_recording(tmp_path / "oak.parquet", 1e4, **how)


@pytest.mark.nightly  # a process
def test_parquet_with_limited_memory(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    place = tmp_path / "oak.parquet"
    pq.write_table(pa.table({"force": np.full(1000, 2.0)}), place)
    for memory_B in (100_000_000, 140_000_000):
        with place.open("rb") as file:
            how = {"by": "pyarrow", "memory_B": memory_B, "output_B": 10**6, "imports": ("pyarrow.parquet",)}
            assert set(confined(read_parquet, file, 10**6, **how).arrays["force"]) == {2.0}


@pytest.mark.nightly  # a process
def test_parquet_with_too_much_content_is_refused(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    pq.write_table(pa.table({"acceleration": np.zeros(5_000_000)}), tmp_path / "bomb.parquet")
    with pytest.raises(CaptureError, match="unpacks to"):
        load_recording(tmp_path / "bomb.parquet", 1e4, units={"acceleration": "g"})
