"""Figures, their quantiles, and the table they are kept in."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene_benchmarks.sheet import Sheet, spread


def test_spread_is_of_nearest_ranks() -> None:
    values = np.random.default_rng(0).permutation(np.arange(1, 1001))
    assert spread(values) == {"median": 500, "p99": 990, "p99.9": 999, "max": 1000}


def test_spread_of_one() -> None:
    assert set(spread([3.0]).values()) == {3.0}


def test_spread_of_nothing_says_so() -> None:
    with pytest.raises(HapsceneError, match="touched no body"):
        spread([])


def test_sheet_comes_back_from_its_file(tmp_path: Path) -> None:
    sheet = Sheet()
    sheet.add("machine", "processor", "a, b")
    sheet.add_spread("one", "contact", [1000.0, 2000.0, 3000.0], "µs", 1e-3)
    sheet.write(tmp_path / "bench.csv")
    read = Sheet.read(tmp_path / "bench.csv")
    assert list(read) == list(sheet)
    assert read.text("machine", "processor") == "a, b"
    assert read.number("one", "contact median") == 2.0
    assert read.cases("o") == ["one"]


def test_sheet_names_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(HapsceneError, match="no figure 'b' of 'a'"):
        Sheet().number("a", "b")
    (tmp_path / "other.csv").write_text("x,y\n1,2\n")
    with pytest.raises(HapsceneError, match="expected the columns case, figure, value, unit"):
        Sheet.read(tmp_path / "other.csv")
