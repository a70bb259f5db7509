"""Tables and archives of numbers: what is read, and what is refused with its place."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import FormatError
from hapscene.io.number_files import LINE_MAX, open_npz, read_table


def test_tables(tmp_path: Path) -> None:
    for text, wanted, columns in (
        ('"a";b\n1,5;2\n-3;4\n', (), {"a": [1.5, -3.0], "b": [2.0, 4.0]}),
        ("1 2\n3 4\n", (), {"1": [1.0, 3.0], "2": [2.0, 4.0]}),
        ("# note\n\na,b,c\n1,2,x\n", ("b", "a"), {"b": [2.0], "a": [1.0]}),
        ("# note\n5\t6\n", (), {"1": [5.0], "2": [6.0]}),
    ):
        (tmp_path / "a.csv").write_text(text)
        found = read_table(tmp_path / "a.csv", wanted)
        assert {name: column.tolist() for name, column in found.items()} == columns and list(found) == list(columns)


def test_what_is_no_table_is_refused(tmp_path: Path) -> None:
    for text, words in {
        "a,a\n1,2\n": "duplicate",
        "a,b\n": "no numbers",
        "": "must begin",
        "a,b\n1,2,3\n4,5,6\n": "names 2 columns.*have 3",
        "a,b\n1,2\n# x\n3,4,5\n": "line 4: 2 columns expected, 3 found",
        "a;b\n1,5;2\n\n3;2,z\n": "line 4, column 2: .* '2,z'",
        "a\n" + "1" * (LINE_MAX + 1): "line 2 is longer",
    }.items():
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(FormatError, match=words):
            read_table(tmp_path / "a.csv")
    with pytest.raises(FormatError, match="no column 'c'; expected c, found a"):
        read_table(tmp_path / "a.csv", ["c"])


def test_archives_whose_headers_lie_are_refused(tmp_path: Path) -> None:
    for shape, fits in (((2, 3), True), ((), True), ((1000,), False), ((-5, 2), False)):
        file = io.BytesIO()
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
            archive.writestr("x.npy", file.getvalue() + bytes(48))
        if fits:
            with open_npz(tmp_path / "a.npz", 10_000, "") as arrays:
                assert arrays.names == ["x"] and arrays.header("x") == (shape, np.dtype("<f8"))
                assert not arrays.read("x").any()
            continue
        with pytest.raises(FormatError, match="exceeds"), open_npz(tmp_path / "a.npz", 10_000, "") as arrays:
            arrays.header("x")
