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


def test_interpolation_does_not_overshoot(tmp_path: Path) -> None:
    rows = "".join(f"{t:g},0,0,{z:g}\n" for t, z in ((0, 1.0), (0.01, 1.0), (0.02, 0.0), (0.03, 0.0), (0.05, 0.0)))
    _, p_WT = load_path(write(tmp_path / "path.csv", "t,x,y,z\n" + rows), TICK_S)
    assert len(p_WT) == 51
    assert p_WT[:, 2].min() == 0.0 and p_WT[:, 2].max() == 1.0
    assert (np.diff(p_WT[:, 2]) <= 0).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; expected CSV with the header t,x,y,z"),
        ("t,x,y,z\n", "holds 0 rows; expected at least 2"),
        ("t,x,y,z\n0,0,0,0\n", "holds 1 rows; expected at least 2"),
        ("t,x,y\n0,0,0\n0.001,0,0\n", "line 1: column 'z' is not among the columns t, x, y"),
        ("t,x,x,y,z\n0,0,0,0,0\n", "line 1: column 'x' is twice"),
        ("t;x;y;z\n0;0;0;0\n", "line 1: column 't' is not among"),
        ("t,x,y,z\n0,0,0,0\n0.001,nan,0,0\n", "line 3: x is nan; expected a finite number"),
        ("t,x,y,z\n0,0,0,0\n\n0.001,0,0,-inf\n", "line 4: z is -inf; expected a finite number"),
        ("t,x,y,z\n0,0,0,0\n0.001,0,abc,0\n", "line 3: y is 'abc'; expected a number"),
        ("t,x,y,z\n0,0,0,0\n0.001,0,,0\n", "line 3: y is ''; expected a number"),
        ("t,x,y,z\n0,0,0,0\n0.001,0,0\n", "line 3: has 3 cells; expected 4"),
        (
            "t,x,y,z\n0,0,0,0\n0.002,0,0,0\n0.001,0,0,0\n",
            "line 4: t is 0.001 s after 0.002 s; expected time that",
        ),
        (
            "t,x,y,z\n0,0,0,0\n0.002,0,0,0\n0.002,0,0,0\n",
            "line 4: t is 0.002 s after 0.002 s; expected time that",
        ),
        ("t,x,y,z\n0,0,0,0\n60,0,0,0\n", "line 3: t is 60 s after 0 s; expected at most 10 s between rows"),
        (
            "t,x,y,z\n0,0,0,0\n0.001,0,20000,0\n",
            "line 3: y is 20000 m; expected at most 10000 m .is the path in mm",
        ),
        (
            "t,x,y,z\n" + "".join(f"{9 * k},0,0,0\n" for k in range(500)),
            "expected at most 3600 s .is t in ms",
        ),
        ("t,x,y,z\n0,0,0,0\n0.0001,0,0,0\n", "lasts 0.0001 s; expected more than one tick"),
        ('t,x,y,z\n0,0,0,"' + "9" * 200_000 + '"\n', "is not CSV text"),
    ],
)
def test_bad_path_is_one_readable_error(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path / "path.csv", text)
    with pytest.raises(PathError, match=message) as caught:
        load_path(path, TICK_S)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_missing_file_and_folder_and_binary(tmp_path: Path) -> None:
    with pytest.raises(PathError, match="no such file"):
        load_path(tmp_path / "none.csv", TICK_S)
    with pytest.raises(PathError, match="cannot be read"):
        load_path(tmp_path, TICK_S)
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)) * 4)
    with pytest.raises(PathError, match="is not CSV text"):
        load_path(tmp_path / "binary.csv", TICK_S)
