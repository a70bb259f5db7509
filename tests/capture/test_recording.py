"""Reading recordings: columns, units, sample rates and invalid files."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat, wavfile

from hapscene.capture import load_recording
from hapscene.capture.io.recording import CUTOFF_HZ, InterpolatedWarning, dft321, one_axis
from hapscene.capture.io.streams import clean, filtered
from hapscene.errors import CaptureError

CSV = "speed,force,accel,friction\n100,2,1,0.5\n200,1,-1,0.25\n"
COLUMNS = {"acceleration": "accel"}
UNITS = {"acceleration": "g", "speed": "mm/s", "force": "N"}


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "recording.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_columns_and_units(tmp_path: Path) -> None:
    recording = load_recording(write(tmp_path, CSV), 1000.0, columns=COLUMNS, units=UNITS)
    assert recording.rate_Hz == 1000.0
    assert np.allclose(recording.acceleration_m_s2, [9.80665, -9.80665])
    assert np.allclose(recording.speed_m_s, [0.1, 0.2])
    assert np.allclose(recording.tangential_force_N, [1.0, 0.25])


@pytest.mark.parametrize(
    ("text", "change", "expected"),
    [
        (CSV, {"rate_Hz": None}, "--rate"),
        (CSV, {"columns": {"accel": "accel"}}, "'accel'"),
        (CSV, {"units": None}, "--units acceleration=m/s2"),
        (CSV, {"units": UNITS | {"weight": "N"}}, "'weight'"),
        (CSV, {"columns": {"acceleration": "accel+speed+force+friction"}}, "three columns"),
        ("1,2\n3,4\n", {"columns": None}, "--columns acceleration="),
        ("accel,accel\n1,2\n", {}, "duplicate"),
        ("accel\n1\nx\n", {}, "line 3, column 1: .*'x'"),
        ("# of oak\naccel,force\n1,2\n\n3\n", {}, "line 5"),
        (b"\xff\xfe\x00\x81", {}, "UTF-8"),
        ("accel;force\n1,5;2\n1,5;2,2,2\n", {}, "line 3, column 2: .*'2,2,2'"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_invalid_files_and_arguments_are_reported(
    text: str | bytes, change: dict[str, object], expected: str, tmp_path: Path
) -> None:
    arguments = {"rate_Hz": 1000.0, "columns": COLUMNS, "units": UNITS} | change
    with pytest.raises(CaptureError, match=f"recording.csv: .*{expected}"):
        load_recording(write(tmp_path, text), **arguments)


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"nothing\.csv: no such file"):
        load_recording(tmp_path / "nothing.csv", 1000.0)


NOISE = np.random.default_rng(0).standard_normal((3, 4000))


@pytest.mark.parametrize(
    "text",
    ["1 2\n3 4\n", "1;2\n3;4\n", "# by hand\n1\t2\n3\t4\n", "# by hand\na,b\n1,2\n3,4\n", "a b\n1 2\n3 4\n"],
)
def test_text_formats(text: str, tmp_path: Path) -> None:
    names = ("a", "b") if "a" in text.replace("hand", "") else ("1", "2")
    columns = {"acceleration": names[0], "force": names[1]}
    recording = load_recording(
        write(tmp_path, text), 1000.0, columns=columns, units={"acceleration": "m/s2", "force": "N"}
    )
    assert recording.acceleration_m_s2.tolist() == [1.0, 3.0]
    assert recording.force_N is not None and recording.force_N.tolist() == [2.0, 4.0]


def test_the_time_column_gives_the_sample_rate(tmp_path: Path) -> None:
    path = write(tmp_path, "time,acceleration\n0.0,1\n0.5,2\n1.0,3\n")
    assert load_recording(path, units={"acceleration": "g", "time": "ms"}).rate_Hz == pytest.approx(2000.0)
    assert load_recording(path, 7.0, units={"acceleration": "g"}).rate_Hz == 7.0
    path = write(tmp_path, "time,acceleration\n0.0,1\n0.5,2\n1.9,3\n")
    with pytest.raises(CaptureError, match="'time'"):
        load_recording(path, units={"acceleration": "g"})


@pytest.mark.parametrize("kind", ["int16", "int32", "uint8", "float32"])
def test_wav_states_its_rate_and_needs_a_full_scale(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "stroke.wav"
    wave = 0.5 * np.sin(np.arange(1000) / 10)
    full = {"int16": 32768, "int32": 2147483648, "uint8": 128, "float32": 1}[kind]
    wavfile.write(
        path,
        8000,
        np.round(full * wave + (128 if kind == "uint8" else 0)).astype(kind) if full > 1 else wave.astype(kind),
    )
    recording = load_recording(path, units={"acceleration": "98 m/s2"})
    assert recording.rate_Hz == 8000.0
    np.testing.assert_allclose(
        recording.acceleration_m_s2, 98.0 * wave, atol=98.0 * (0.01 if kind == "uint8" else 1e-4)
    )
    with pytest.raises(CaptureError, match="--units acceleration="):
        load_recording(path)


def test_three_channels_of_a_wav_are_three_axes(tmp_path: Path) -> None:
    wavfile.write(tmp_path / "a.wav", 8000, NOISE.T.astype(np.float32))
    recording = load_recording(tmp_path / "a.wav", units={"acceleration": "g"})
    want = one_axis(9.80665 * NOISE, 8000.0)
    np.testing.assert_allclose(recording.acceleration_m_s2, want, atol=1e-4)
    single = load_recording(tmp_path / "a.wav", columns={"acceleration": "2"}, units={"acceleration": "m/s2"})
    np.testing.assert_allclose(single.acceleration_m_s2, NOISE[1], atol=1e-6)


@pytest.mark.parametrize("suffix", ["npz", "mat"])
def test_arrays_by_name(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"r.{suffix}"
    t = np.arange(4000) / 2000.0
    position = np.stack([0.03 * np.sin(5 * t), 0.04 * np.sin(5 * t)])
    arrays = dict(acceleration=NOISE.T, force=NOISE[0], position_x=position[0], position_y=position[1], depth=NOISE[1])
    arrays = {**arrays, "rate_Hz": 2000.0}
    (np.savez(path, **arrays) if suffix == "npz" else savemat(path, arrays))
    units = {"acceleration": "g", "force": "mN", "position": "m", "depth": "mm"}
    recording = load_recording(path, units=units)
    assert recording.rate_Hz == 2000.0
    np.testing.assert_allclose(recording.acceleration_m_s2, one_axis(9.80665 * NOISE, 2000.0))
    assert recording.force_N is not None and recording.depth_m is not None and recording.speed_m_s is not None
    np.testing.assert_allclose(recording.force_N, 1e-3 * NOISE[0])
    np.testing.assert_allclose(recording.depth_m, 1e-3 * NOISE[1])
    np.testing.assert_allclose(recording.speed_m_s[200:-200], np.abs(0.25 * np.cos(5 * t))[200:-200], atol=2e-3)


def test_tangential_force_of_two_axes(tmp_path: Path) -> None:
    path = write(tmp_path, "acceleration,tangential_force_x,tangential_force_y\n1,3,4\n2,6,8\n")
    recording = load_recording(path, 1000.0, units={"acceleration": "g", "tangential_force": "N"})
    assert recording.tangential_force_N is not None and recording.tangential_force_N.tolist() == [5.0, 10.0]


def test_few_missing_samples_are_interpolated(tmp_path: Path) -> None:
    stream = np.arange(1000.0)
    stream[500:505] = np.nan
    np.savez(tmp_path / "r.npz", acceleration=stream, rate_Hz=1000.0, units=np.array(["acceleration=m/s2"]))
    with pytest.warns(InterpolatedWarning):
        recording = load_recording(tmp_path / "r.npz")
    np.testing.assert_allclose(recording.acceleration_m_s2, np.arange(1000.0))
    stream[:100] = np.nan
    np.savez(tmp_path / "r.npz", acceleration=stream, rate_Hz=1000.0)
    with pytest.raises(CaptureError, match=r"10\.5 % of the samples are missing"):
        load_recording(tmp_path / "r.npz", units={"acceleration": "g"})


@pytest.mark.parametrize("suffix", ["wav", "npz", "mat", "hsrec"])
def test_a_damaged_file_is_reported(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"r.{suffix}"
    path.write_bytes(b"RIFF" + bytes(range(200)))
    with pytest.raises(CaptureError, match=f"r.{suffix}: "):
        load_recording(path, 1000.0)


def test_pickled_objects_and_text_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "r.npz", acceleration=np.array([{}, {}], dtype=object))
    with pytest.raises(CaptureError, match="pickled"):
        load_recording(tmp_path / "r.npz", 1000.0)
    np.savez(tmp_path / "r.npz", acceleration=np.array(["a", "b"]))
    with pytest.raises(CaptureError, match="no columns"):
        load_recording(tmp_path / "r.npz", 1000.0)
    np.savez(tmp_path / "r.npz", acceleration=np.ones(5), force=np.ones(6))
    with pytest.raises(CaptureError, match="acceleration 5, force 6"):
        load_recording(tmp_path / "r.npz", 1000.0)


@pytest.mark.parametrize("value", [1e200, -1e200, np.inf, 1e5])
@pytest.mark.parametrize("column", ["acceleration_y", "force"])
def test_invalid_value_raises_with_its_row_and_column(column: str, value: float, tmp_path: Path) -> None:
    streams = {"acceleration_x": np.ones(2000), "acceleration_y": np.ones(2000), "force": np.ones(2000)}
    units = {"acceleration": "100 m/s2", "force": "N"}
    streams[column][76] = value
    np.savetxt(
        tmp_path / "r.csv", np.stack([*streams.values()], axis=1), delimiter=",", header=",".join(streams), comments=""
    )
    np.savez(tmp_path / "r.npz", **streams)
    for name in ("r.csv", "r.npz"):
        if column == "force" and value == 1e5:
            load_recording(tmp_path / name, 1000.0, units=units)
            continue
        with pytest.raises(CaptureError) as caught:
            load_recording(tmp_path / name, 1000.0, units=units)
        assert all(word in str(caught.value) for word in (name, column, "row 77", f"{value:g}"))


# DFT321 with known results.


RATE_HZ = 10_000.0
AXES = np.random.default_rng(0).standard_normal((3, 20_000))


@pytest.mark.parametrize("count", [1000, 1001])
def test_dft321_preserves_the_power_at_each_frequency(count):
    axes = AXES[:, :count]
    together = np.abs(np.fft.rfft(dft321(axes))) ** 2
    apart = (np.abs(np.fft.rfft(axes)) ** 2).sum(axis=0)
    np.testing.assert_allclose(together, apart, rtol=1e-9, atol=1e-9)
    assert (dft321(axes) ** 2).sum() == pytest.approx((axes**2).sum(), rel=1e-12)


def test_a_vibration_in_one_direction_is_recovered():
    """A vibration along u gives the same signal, scaled by |u|, with the sign of the sum of u."""
    for u in ([1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.6, 0.0, -0.8]):
        want = np.sign(np.sum(u)) * np.linalg.norm(u) * AXES[0]
        np.testing.assert_allclose(dft321(np.outer(u, AXES[0])), want, atol=1e-10)
        passed = filtered(want, RATE_HZ, CUTOFF_HZ, "highpass")
        np.testing.assert_allclose(one_axis(np.outer(u, AXES[0]), RATE_HZ), passed, atol=1e-9)
    np.testing.assert_allclose(dft321(np.stack([AXES[0]] * 3)), np.sqrt(3) * AXES[0], atol=1e-10)


def test_the_power_over_time_is_preserved():
    """A transform of the whole recording would spread a burst into the silence before it."""
    axes = AXES.copy()
    axes[:, :10_000] = 0.0
    y = one_axis(axes, RATE_HZ)
    assert np.abs(y[:8500]).max() < 0.01 * y.std()
    assert (y[10_000:] ** 2).sum() == pytest.approx((AXES[:, 10_000:] ** 2).sum(), rel=0.04)


def test_the_spectrum_of_each_axis_is_preserved():
    tones = np.sin(2.0 * np.pi * np.array([[100.0], [200.0], [300.0]]) * np.arange(20_000) / RATE_HZ)
    power = np.abs(np.fft.rfft(one_axis(tones, RATE_HZ))) ** 2
    lines = [power[line - 10 : line + 11].sum() for line in (200, 400, 600)]
    np.testing.assert_allclose(np.array(lines) / power.sum(), 1 / 3, atol=0.03)


def test_rotating_gravity_is_removed():
    t_s = np.arange(20_000) / RATE_HZ
    turn = 9.81 * np.stack([np.sin(3 * t_s), np.cos(3 * t_s), 0.0 * t_s])
    still, turned = (clean(one_axis(0.1 * AXES + by, RATE_HZ), RATE_HZ).acceleration_m_s2 for by in (0.0, turn))
    assert np.std((turned - still)[2000:-2000]) < 0.02 * np.std(still)


def test_one_axis_is_unchanged_and_four_are_refused():
    np.testing.assert_array_equal(one_axis(AXES[:1], RATE_HZ), AXES[0])
    for bad in (np.zeros((4, 100)), np.zeros((0, 100))):
        with pytest.raises(CaptureError, match="one to three axes"):
            one_axis(bad, RATE_HZ)


def test_torque_grip_angle_and_direction(tmp_path: Path) -> None:
    """The streams are read by name or by column, or computed from a position."""
    rng = np.random.default_rng(0)
    count, rate_Hz = 4000, 2000.0
    heading = np.linspace(0.0, 5.0, count)
    place_m = np.cumsum([np.cos(heading), np.sin(heading)], axis=1) * 0.1 / rate_Hz
    arrays = {
        "acceleration": rng.standard_normal(count), "torque": 30.0 * np.eye(3)[:, :1] + np.zeros((3, count)),
        "grip": np.full(count, 500.0), "contact_angle": np.full(count, 20.0),
        "position": np.vstack([*place_m, 0 * heading]),
    }  # fmt: skip
    path = tmp_path / "a.npz"
    np.savez(path, rate_Hz=rate_Hz, **arrays)
    units = {"acceleration": "m/s2", "torque": "mNm", "grip_force": "gf", "position": "m", "contact_angle": "deg"}
    recording = load_recording(path, columns={"grip_force": "grip"}, units=units)
    np.testing.assert_allclose(recording.torque_Nm, 0.03)
    np.testing.assert_allclose(recording.grip_force_N, 4.903325)
    np.testing.assert_allclose(recording.contact_angle_rad, np.pi / 9)
    inner = slice(100, -100)
    assert recording.direction_rad is not None and recording.speed_m_s is not None
    off = np.angle(np.exp(1j * (recording.direction_rad - heading)))[inner]
    assert np.abs(off).max() < 1e-3 and np.abs(recording.speed_m_s[inner] - 0.1).max() < 1e-5
    np.savez(path, rate_Hz=rate_Hz, **arrays | {"direction": np.full(count, 90.0)})
    recording = load_recording(path, units=units | {"direction": "°"})  # a column has priority
    np.testing.assert_allclose(recording.direction_rad, np.pi / 2)
    with pytest.raises(CaptureError, match=r"grip_force: .*one column"):
        load_recording(path, columns={"grip_force": "torque_x+torque_y"}, units=units)


def test_decimal_commas_with_semicolons(tmp_path: Path) -> None:
    """As saved by spreadsheets with European settings, with and without a header."""
    rows = ["0,5;1,25;-3", "1,5e-1;2;4,0"] * 20
    for head, columns in (("accel;force;speed\r\n", COLUMNS), ("", {"acceleration": "1", "force": "2", "speed": "3"})):
        text = b"\xef\xbb\xbf" + (head + "\r\n".join(rows)).encode()
        recording = load_recording(
            write(tmp_path, text), 1000.0, columns=columns, units={"acceleration": "m/s2", "force": "N", "speed": "m/s"}
        )
        np.testing.assert_allclose(recording.acceleration_m_s2[:2], [0.5, 0.15])
        assert recording.force_N is not None and recording.speed_m_s is not None
        np.testing.assert_allclose(recording.force_N[:2], [1.25, 2.0])
