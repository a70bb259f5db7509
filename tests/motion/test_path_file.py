"""Recorded paths of the tool."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import PathError
from hapscene.motion.path_file import load_path

TICK_S = 1e-3


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_rows_on_the_ticks_are_taken_to_the_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    p_WT = rng.normal(size=(500, 3))
    rows = "".join(f"{5 + k / 1000!r},{x!r},{y!r},{z!r}\n" for k, (x, y, z) in enumerate(p_WT.tolist()))
    t_s, loaded = load_path(write(tmp_path / "path.csv", "t,x,y,z\n" + rows), TICK_S)
    assert np.array_equal(loaded, p_WT)
    assert t_s[0] == 5.0 and len(t_s) == 500


def test_columns_may_be_more_and_in_any_order(tmp_path: Path) -> None:
    text = "\ufeffnote, z,t,grip,x,y\r\na,3,0,,1,2\r\n\r\nb,6,0.001,,4,5\r\n"
    t_s, p_WT = load_path(write(tmp_path / "path.csv", text), TICK_S)
    assert p_WT.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert t_s.tolist() == [0, 0.001]


def test_rows_off_the_ticks_are_interpolated(tmp_path: Path) -> None:
    t_s = np.sort(np.random.default_rng(3).uniform(0, 1, 400))
    rows = "".join(f"{t:.9f},{np.sin(6 * t):.9f},{np.cos(6 * t):.9f},0.5\n" for t in t_s)
    grid_s, p_WT = load_path(write(tmp_path / "path.csv", "t,x,y,z\n" + rows), TICK_S)
    np.testing.assert_allclose(np.diff(grid_s), TICK_S, atol=1e-12)
    assert t_s[0] - 1e-8 <= grid_s[0] and grid_s[-1] <= t_s[-1] + 1e-8
    np.testing.assert_allclose(p_WT[:, 0], np.sin(6 * grid_s), atol=1e-3)
    np.testing.assert_allclose(p_WT[:, 2], 0.5, atol=1e-15)
    _, p_WT = load_path(write(tmp_path / "path.csv", "t,x,y,z\n0,0,0,0\n0.0011,1.1,0,0\n0.002,2,0,0\n"), TICK_S)
    np.testing.assert_allclose(p_WT[:, 0], (0.0, 1.0, 2.0), atol=1e-12)


def test_interpolation_does_not_overshoot(tmp_path: Path) -> None:
    rows = "".join(f"{t:g},0,0,{z:g}\n" for t, z in ((0, 1.0), (0.01, 1.0), (0.02, 0.0), (0.03, 0.0), (0.05, 0.0)))
    _, p_WT = load_path(write(tmp_path / "path.csv", "t,x,y,z\n" + rows), TICK_S)
    assert len(p_WT) == 51
    assert p_WT[:, 2].min() == 0.0 and p_WT[:, 2].max() == 1.0
    assert (np.diff(p_WT[:, 2]) <= 0).all()


def test_memory_is_checked_before_the_ticks_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, asked = write(tmp_path / "path.csv", "t,x,y,z\n0,0,0,0\n0.05,0,0,0\n0.06,0,0,0\n"), []
    monkeypatch.setattr("hapscene.motion.path_file.check_memory", lambda *given: asked.append(given[:2]))
    assert len(load_path(path, TICK_S)[0]) == 61
    assert asked == [(3 * 212 + 61 * 32, path.stat().st_size)]


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("", ""),
        ("t,x,y,z\n0,0,0,0\n", "1 row"),
        ("t,x,y\n0,0,0\n0.001,0,0\n", "no column 'z'"),
        ("t,x,x,y,z\n0,0,0,0,0\n", "duplicate"),
        ("t,x,y,z\n0,0,0,0\n0.001,nan,0,0\n", "row 2: x"),
        ("t,x,y,z\n0,0,0,0\n\n0.001,0,0,-inf\n", "row 2: z"),
        ("t,x,y,z\n0,0,0,0\n0.001,0,abc,0\n", "line 3, column 3"),
        ("t,x,y,z\n0,0,0,0\n0.001,0,0\n", "line 3"),
        ("t,x,y,z\n0,0,0,0\n0.002,0,0,0\n0.001,0,0,0\n", "row 3: t"),
        ("t,x,y,z\n0,0,0,0\n0.002,0,0,0\n0.002,0,0,0\n", "row 3: t"),
        ("t,x,y,z\n0,0,0,0\n60,0,0,0\n", "row 2: t"),
        ("t,x,y,z\n0,0,0,0\n0.001,0,20000,0\n", "row 2: y"),
        ("t,x,y,z\n" + "".join(f"{9 * k},0,0,0\n" for k in range(500)), "3600 s"),
        ("t,x,y,z\n0,0,0,0\n0.0001,0,0,0\n", "0.0001 s"),
        ('t,x,y,z\n0,0,0,"' + "9" * 200_000 + '"\n', ""),
        ("\0\x01", ""),
    ],
)
def test_invalid_path_error_names_the_row(tmp_path: Path, text: str, place: str) -> None:
    path = write(tmp_path / "path.csv", text)
    with pytest.raises(PathError) as caught:
        load_path(path, TICK_S)
    assert str(caught.value).startswith(str(path)) and place in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "path.csv", "t,x,y,z\n0,0,0,0\n0.001,0,0,0\n")
    monkeypatch.setattr("hapscene.motion.path_file.BYTES_MAX", path.stat().st_size)
    load_path(path, TICK_S)
    monkeypatch.setattr("hapscene.motion.path_file.BYTES_MAX", path.stat().st_size - 1)
    with pytest.raises(PathError, match=r"path\.csv"):
        load_path(path, TICK_S)


@pytest.mark.parametrize("name", ["none.csv", "."])
def test_a_path_that_cannot_be_read(tmp_path: Path, name: str) -> None:
    with pytest.raises(PathError):
        load_path(tmp_path / name, TICK_S)
