"""Two tables compared: ratios as they were put in."""

from pathlib import Path

import pytest

from hapscene.errors import HapsceneError
from hapscene_evidence.bench.comparison import compared, lines
from hapscene_evidence.bench.sheet import Sheet


def sheet(path: Path, factors: tuple[float, ...], processor: str = "one") -> Path:
    made = Sheet()
    made.add("machine", "processor", processor)
    for k, factor in enumerate(factors):
        made.add(f"sphere {k} k", "contact median", factor * (k + 1), "µs")
        made.add(f"sphere {k} k", "triangles", 1000.0, "1")
    made.write(path)
    return path


def test_ratios_and_their_quartiles(tmp_path: Path) -> None:
    a, b = sheet(tmp_path / "a.csv", (1.0,) * 5), sheet(tmp_path / "b.csv", (1.0, 1.5, 2.0, 2.5, 9.0))
    words, groups, far = compared(a, b)
    assert groups == [("sphere [µs]", 5, 1.0, 1.5, 2.0, 2.5, 9.0)]
    assert far[0] == ("sphere [µs]: sphere 4 k, contact median", pytest.approx(9.0))
    assert "the same machine, or one like it" in words


def test_another_machine_is_told(tmp_path: Path) -> None:
    a, b = sheet(tmp_path / "a.csv", (1.0,)), sheet(tmp_path / "b.csv", (1.0, 2.0), "two")
    told = lines(a, b)
    assert "not the same machine: processor differ" in told
    assert "1 figures are in one of them alone" in told


def test_tables_without_a_common_figure_are_refused(tmp_path: Path) -> None:
    with pytest.raises(HapsceneError):
        compared(sheet(tmp_path / "a.csv", (1.0,)), sheet(tmp_path / "b.csv", ()))
