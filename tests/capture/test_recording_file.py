"""Reading recordings: what a file does not say is asked for."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.capture import load_surface_recording
from hapscene.errors import CaptureError

CSV = "speed,force,accel,friction\n100,2,1,0.5\n200,1,-1,0.25\n"
COLUMNS = {"acceleration": "accel"}
UNITS = {"acceleration": "g", "speed": "mm/s", "force": "N"}


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "recording.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_columns_and_units(tmp_path: Path) -> None:
    recording = load_surface_recording(write(tmp_path, CSV), 1000.0, COLUMNS, UNITS)
    assert recording.rate_Hz == 1000.0
    assert np.allclose(recording.acceleration_m_s2, [9.80665, -9.80665])
    assert np.allclose(recording.speed_m_s, [0.1, 0.2])
    assert np.allclose(recording.tangential_force_N, [1.0, 0.25])


def test_one_value_a_line(tmp_path: Path) -> None:
    path = write(tmp_path, "  5.7e-02\r\n -1.0e+00\r\n")
    recording = load_surface_recording(path, 1000.0, units={"acceleration": "m/s2"})
    assert recording.acceleration_m_s2.tolist() == [0.057, -1.0]
    assert recording.force_N is recording.speed_m_s is recording.tangential_force_N is None


@pytest.mark.parametrize(
    ("text", "change", "message"),
    [
        (CSV, {"rate_Hz": None}, "give rate_Hz="),
        (CSV, {"columns": None}, r'no column "acceleration"; there are: speed, force, accel, friction: give columns'),
        (CSV, {"columns": {"acceleration": "acc"}}, "no column 'acc'; there are"),
        (CSV, {"columns": {"accel": "accel"}}, "no quantity 'accel'"),
        (CSV, {"units": None}, r'the unit of acceleration .* give units=\{"acceleration": "m/s2"\}'),
        (CSV, {"units": UNITS | {"force": "lb"}}, "no unit 'lb' of force; there are: N"),
        ("", {}, "header"),
        ("1,2\n3,4\n", {}, "header"),
        ("accel\n", {}, "columns expected"),
        ("accel\n1\nx\n", {}, "not a table of numbers"),
        ("accel,force\n1,2\n3\n", {}, "not a table of numbers"),
        ("accel,force\n1\n3\n", {}, "2 columns expected, 1 found"),
        (b"\xff\xfe\x00\x81", {}, "not a text file"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_what_is_missing_is_told(text: str | bytes, change: dict[str, object], message: str, tmp_path: Path) -> None:
    arguments = {"rate_Hz": 1000.0, "columns": COLUMNS, "units": UNITS} | change
    with pytest.raises(CaptureError, match=message):
        load_surface_recording(write(tmp_path, text), **arguments)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"nothing\.csv: cannot be read"):
        load_surface_recording(tmp_path / "nothing.csv", 1000.0)
