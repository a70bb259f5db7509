"""Published data sets: each layout on files made to its description, and what is said where one is not as described."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from hapscene.capture.batch import find_recordings
from hapscene.capture.published_layouts import GAP_S, files_of, recognised, surfaces
from hapscene.capture.recording_file import BridgedWarning, load_recording
from hapscene.capture.recording_source import read_parquet
from hapscene.cli import main
from hapscene.confined import confined
from hapscene.errors import CaptureError

pytestmark = pytest.mark.nightly

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


def test_lmt_joins_three_axes_and_asks_for_the_unit(tmp_path: Path) -> None:
    folder = lmt_folder(tmp_path)
    file = folder / "G1EpoxyRasterPlate_Movement_Y_train2.txt"
    with pytest.raises(CaptureError, match=r"the unit of acceleration .* is not known"):
        load_recording(file)
    recording = load_recording(file, units={"acceleration": "g"})
    assert recording.rate_Hz == 1e4 and len(recording.acceleration_m_s2) == 4800
    assert rms(recording.acceleration_m_s2) == pytest.approx(G * 3.0 / math.sqrt(2), rel=0.02)  # 1² + 2² + 2² = 3²
    assert recording.force_N is None and recording.speed_m_s is None


def test_lmt_surface_is_all_its_recordings(tmp_path: Path) -> None:
    folder = lmt_folder(tmp_path, ("G1EpoxyRasterPlate", "G6Carpet"))
    whole = load_recording(folder / "G6Carpet", units={"acceleration": "m/s2"}, layout="lmt")
    assert len(whole.acceleration_m_s2) == 2 * 4800
    near_seam = np.abs(whole.acceleration_m_s2[4700:4900]).max()
    assert near_seam < 1.2 * 3.0  # gravity differs by 9.81 between the two, and is taken out before
    assert surfaces(tmp_path, "lmt") == [folder / "G1EpoxyRasterPlate", folder / "G6Carpet"]
    assert len(files_of(folder / "G6Carpet", "lmt")) == 6
    with pytest.raises(CaptureError, match=r"has 2 surfaces; name one, as .*G1EpoxyRasterPlate"):
        load_recording(folder, units={"acceleration": "g"}, layout="lmt")


def test_lmt_before_108_is_one_axis(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "G9TextileVersion1_query3.txt", np.sin(np.arange(3000)))
    recording = load_recording(tmp_path / "G9TextileVersion1_query3.txt", units={"acceleration": "m/s2"})
    assert recording.rate_Hz == 1e4 and recording.acceleration_m_s2[1] == pytest.approx(math.sin(1.0))


def test_own_columns_and_other_names_are_as_ever(tmp_path: Path) -> None:
    file = lmt_folder(tmp_path) / "G1EpoxyRasterPlate_Movement_Y_train2.txt"
    recording = load_recording(file, 5e3, columns={"acceleration": "1"}, units={"acceleration": "m/s2"})
    assert recording.rate_Hz == 5e3 and rms(recording.acceleration_m_s2) == pytest.approx(math.sqrt(2), rel=0.01)
    other = file.with_name("lmt108_G1EpoxyRasterPlate_Movement_X_test1.txt")
    other.write_bytes(file.read_bytes())
    assert recognised(other) is None


# Cluster: three tables with times of their own; the machine's direction, speed and force in the name.


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


@pytest.mark.parametrize("parquet", [False, True])
def test_cluster_puts_its_streams_on_one_even_time(tmp_path: Path, parquet: bool) -> None:
    recording = load_recording(cluster_recording(tmp_path, "17_135_40_500_0", parquet=parquet))
    assert recording.rate_Hz == 6000.0 and len(recording.acceleration_m_s2) == pytest.approx(2.0 * 6000, rel=0.02)
    assert rms(recording.acceleration_m_s2) == pytest.approx(0.3 * G / math.sqrt(2), rel=0.02)
    assert recording.force_N is not None and recording.speed_m_s is not None and recording.direction_rad is not None
    t_s = 0.00113 + np.arange(len(recording.force_N)) / 6000.0
    np.testing.assert_allclose(recording.force_N, 0.5 + 0.1 * t_s, atol=2e-5)
    np.testing.assert_allclose(recording.speed_m_s[600:-600], 0.05, rtol=1e-6)  # 30 and 40 mm/s: 50
    np.testing.assert_allclose(recording.direction_rad, np.radians(-135.0))  # clockwise


def test_cluster_without_its_other_tables_has_what_the_name_says(tmp_path: Path) -> None:
    recording = load_recording(cluster_recording(tmp_path, "0_0_60_1000_1", leave_out=("force", "position")))
    assert recording.force_N is not None and recording.speed_m_s is not None
    assert set(recording.force_N) == {1.0} and recording.speed_m_s == pytest.approx(0.06)


def test_cluster_surface_is_all_its_strokes(tmp_path: Path) -> None:
    for name in ("17_0_20_500_0", "17_90_20_500_0", "3_0_20_500_0"):
        cluster_recording(tmp_path, name)
    accel = tmp_path / "sensor_data" / "accel"
    assert surfaces(tmp_path, "cluster") == [accel / "17", accel / "3"]  # the other folders hold no surfaces
    recording = load_recording(accel / "17", layout="cluster")
    assert recording.direction_rad is not None
    assert {round(math.degrees(angle)) % 360 for angle in np.unique(recording.direction_rad)} == {0, 270}
    assert recording.speed_m_s is not None
    np.testing.assert_allclose(recording.speed_m_s[600:-600], 0.05, rtol=0.2)  # the way back is none of it


def test_cluster_gaps_are_missing_samples(tmp_path: Path) -> None:
    file = cluster_recording(tmp_path, "0_0_20_500_0")
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[:5000] + lines[5030:]))
    with pytest.warns(BridgedWarning, match=r"\d+ of acceleration_x"):
        recording = load_recording(file)
    assert recording.bridged["acceleration_x"] == pytest.approx(30, abs=3) and GAP_S < 30 / 6000
    file.write_text("\n".join(lines[:5000] + lines[6000:]))
    with pytest.raises(CaptureError, match="% of the samples are missing"):
        load_recording(file)
    file.write_text("\n".join(lines[:5000] + lines[5030:]))
    cluster_recording(tmp_path, "0_90_20_500_0")
    with pytest.warns(BridgedWarning):  # of the one alone: the other's are whole
        joined = load_recording(file.with_name("0"), layout="cluster")
    assert joined.bridged["acceleration_x"] == recording.bridged["acceleration_x"]


@pytest.mark.parametrize(
    ("row", "message"),
    [("1e7,0,0,0", "samples from .* would take"), ("inf,0,0,0", "finite"), ("1.9,nan,0,0", "finite numbers expected")],
)
def test_cluster_refuses_what_no_table_of_it_has(tmp_path: Path, row: str, message: str) -> None:
    file = cluster_recording(tmp_path, "0_0_20_500_0", leave_out=("force", "position"))
    file.write_text("\n".join([*file.read_text().splitlines()[:5000], row]))
    with pytest.raises(CaptureError, match=message):
        load_recording(file)


def test_a_file_that_is_called_by_its_date_is_no_published_one(tmp_path: Path) -> None:
    write_csv(tmp_path / "2024_11_23_10_05.csv", {"acceleration": np.sin(np.arange(4000.0))})
    recording = load_recording(tmp_path / "2024_11_23_10_05.csv", 1e4, units={"acceleration": "g"})
    assert len(recording.acceleration_m_s2) == 4000


# HaTT's recordings: XML with rate and units.


def hatt_text(nested: bool, units: str = "m/s^2", rate: str = "10000", values: bool = False) -> str:
    """Ten thousand samples as the report describes them."""
    t_s = np.arange(10_000) / 1e4
    wave = np.sin(2 * np.pi * 200.0 * t_s)

    def listed(stream: np.ndarray) -> str:
        if values:
            return "".join(f"<value>{x:.6f}</value>" for x in stream)
        return " ".join(f"{x:.6f}" for x in stream)

    axes = {axis: size * wave for axis, size in {"x": 1.0, "y": 2.0, "z": 2.0}.items()}
    if nested:
        accel = "<Accel>" + "".join(f"<{axis}>{listed(x)}</{axis}>" for axis, x in axes.items()) + "</Accel>"
    else:
        accel = "".join(f"<Accel{axis.upper()}>{listed(x)}</Accel{axis.upper()}>" for axis, x in axes.items())
    return (
        f"<recording><material>ABS</material><SampleRate>{rate}</SampleRate><AccelUnits>{units}</AccelUnits>"
        f"<ForceUnits>N</ForceUnits><SpeedUnits>mm/s</SpeedUnits>{accel}"
        f"<ForceNormal>{listed(0 * t_s + 1.5)}</ForceNormal><ForceTangential>{listed(0 * t_s + 0.5)}</ForceTangential>"
        f"<Speed>{listed(0 * t_s + 80.0)}</Speed></recording>"
    )


@pytest.mark.parametrize("nested", [True, False])
@pytest.mark.parametrize("values", [True, False])
def test_hatt_recording_says_its_rate_and_units(tmp_path: Path, nested: bool, values: bool) -> None:
    (tmp_path / "ABS_1.xml").write_text(hatt_text(nested, values=values))
    recording = load_recording(tmp_path / "ABS_1.xml")
    assert recording.rate_Hz == 1e4 and rms(recording.acceleration_m_s2) == pytest.approx(3.0 / math.sqrt(2), rel=0.01)
    for stream, value in ((recording.force_N, 1.5), (recording.tangential_force_N, 0.5), (recording.speed_m_s, 0.08)):
        assert stream is not None and stream == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (hatt_text(True, rate="fast"), "<SampleRate>: a number of Hz expected, found 'fast'"),
        (hatt_text(True, units="counts"), "no unit 'counts' of acceleration"),
        (hatt_text(True).replace("<Speed>", "<Speed>0.1 "), "different lengths"),
        (hatt_text(True).replace("<Speed>", "<Speed>oops "), "<Speed>: finite numbers expected"),
        ("<modelSet><SampleRate>1000</SampleRate></modelSet>", "no acceleration"),
        ("<!DOCTYPE a><a/>", "has a DOCTYPE"),
        ("<a", "not XML"),
    ],
)
def test_hatt_refuses_what_is_not_as_described(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(CaptureError, match=message):
        load_recording(tmp_path / "a.xml")


# Proton Pack: two bytes an axis, uneven axes as it was wired.


@pytest.mark.parametrize(("new", "range_g"), [(False, 16.0), (True, 3.0)])
def test_proton_reads_the_vibration_of_either_accelerometer(tmp_path: Path, new: bool, range_g: float) -> None:
    t_s = 1.4e9 + np.arange(6000) / 3000.0
    wave = np.sin(2 * np.pi * 200.0 * (t_s - t_s[0]))
    counts = {axis: np.round(2048 + size * wave) for axis, size in {"y": 300.0, "z": 600.0, "x": 600.0}.items()}
    if new:
        counts |= {"y2": counts["z"], "z": 0 * wave}
    columns = {"Timestamp": t_s, " Teensy dt": 0 * wave, " Packet number": 0 * wave} | {
        f" FT{i}": 0 * wave for i in range(30)
    }
    for axis, i in {"y": 18, "z": 20, "x": 22, "y2": 24}.items():
        high, low = np.divmod(counts.get(axis, 0 * wave), 256)
        columns |= {f" FT{i}": high, f" FT{i + 1}": low}
    write_csv(tmp_path / "episode" / "teensy.ft.csv", columns)
    for path in (tmp_path / "episode", tmp_path / "episode" / "teensy.ft.csv"):
        recording = load_recording(path)
        assert recording.rate_Hz == pytest.approx(3000.0, rel=1e-6)
        level = 900.0 / 4096 * range_g * G / math.sqrt(2)
        assert rms(recording.acceleration_m_s2) == pytest.approx(level, rel=0.01)
        assert recording.force_N is None and recording.speed_m_s is None


# As typed, and in batches.


def test_errors_are_one_sentence(tmp_path: Path) -> None:
    folder = lmt_folder(tmp_path)
    with pytest.raises(CaptureError, match="no layout 'sens3'; there are: cluster, hatt, lmt, proton"):
        load_recording(folder, layout="sens3")
    with pytest.raises(CaptureError, match="no recording in the layout 'cluster'"):
        load_recording(folder, layout="cluster")
    with pytest.raises(CaptureError, match="no recordings in the layout 'proton'"):
        find_recordings([tmp_path], "proton")
    (folder / "G1EpoxyRasterPlate_Movement_X_train1.txt").write_text("1\n2\n")
    with pytest.raises(CaptureError, match="its axes have different lengths"):
        load_recording(folder / "G1EpoxyRasterPlate_Movement_Y_train1.txt", units={"acceleration": "g"})
    stray = tmp_path / "0_0_20_500_0.csv"
    write_csv(stray, {"time": [0.0, 1.0], "X": [0.0, 1.0]})
    with pytest.raises(CaptureError, match="in the folder accel"):
        load_recording(stray, layout="cluster")


def test_parquet_is_read_as_other_tables_are(tmp_path: Path) -> None:
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


def test_parquet_is_read_with_whatever_memory_is_enough(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    place = tmp_path / "oak.parquet"
    pq.write_table(pa.table({"force": np.full(1000, 2.0)}), place)
    for memory_B in (100_000_000, 140_000_000):
        with place.open("rb") as file:
            how = {"by": "pyarrow", "memory_B": memory_B, "output_B": 10**6, "imports": ("pyarrow.parquet",)}
            assert set(confined(read_parquet, file, str(place), **how).arrays["0 force"]) == {2.0}


def test_parquet_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    pq.write_table(pa.table({"acceleration": np.zeros(5_000_000)}), tmp_path / "bomb.parquet")
    with pytest.raises(CaptureError, match="unpacks to"):
        load_recording(tmp_path / "bomb.parquet", 1e4, units={"acceleration": "g"})


def test_a_swatch_of_each_surface_is_fitted_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(1)
    folder = tmp_path / LMT
    folder.mkdir(parents=True)
    for surface in ("G1EpoxyRasterPlate", "G6Carpet"):
        for axis in "XYZ":
            np.savetxt(folder / f"{surface}_Movement_{axis}_train1.txt", rng.standard_normal(20_000), fmt="%.6f")
    words = ["--layout", "lmt", "--units", "acceleration=m/s2", "--order", "8", "--jobs", "1"]
    out = tmp_path / "swatches"
    assert main(["capture", "batch", str(folder), "-o", str(out), *words]) == 0
    assert sorted(f.name for f in out.glob("*.swatch")) == ["G1EpoxyRasterPlate.swatch", "G6Carpet.swatch"]
    capsys.readouterr()
    assert main(["capture", "batch", str(folder), "-o", str(out), *words]) == 0
    assert "2" in capsys.readouterr().out
    one = tmp_path / "carpet.swatch"
    fit = ["capture", "fit", str(folder / "G6Carpet"), "-o", str(one), "--layout", "lmt", "--order", "8"]
    assert main([*fit, "--units", "acceleration=m/s2"]) == 0 and one.is_file()
