"""Terminal output."""

import sys

import pytest

from hapscene.cli.console import (
    format_size,
    print_error,
    print_in_place,
    print_lines,
    print_note,
    print_progress,
    ready_streams,
    table,
)


def test_control_characters_are_escaped(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdout", sys.stdout)  # restored afterwards
    monkeypatch.setattr("sys.stderr", sys.stderr)
    ready_streams()
    print_progress("reading a\nb\x1b[2J … ")
    print_progress("1.20 s\n")
    print_lines(["made:", "  a\nmade:\x9b"])
    print_error("a\nb\x1b")
    print("a\x1b\u202e\nb", file=sys.stdout)
    sys.stdout.writelines(["a\x07\n"])
    output = capsys.readouterr()
    expected = "reading a\\nb\\x1b[2J … 1.20 s\nmade:\n  a\\nmade:\\u009b\na\\x1b\\u202e\nb\na\\x07\n"
    assert (output.out, output.err) == (expected, "hapscene: a b\\x1b\n")
    print_in_place("50\r %")
    assert capsys.readouterr().out == "\r50\\r %\x1b[K"


def test_sizes_have_three_digits() -> None:
    sizes = [format_size(size_B) for size_B in (0, 684, 999.6, 12_345, 65_500_000, 2.5e9)]
    assert sizes == ["0 B", "684 B", "1 kB", "12.3 kB", "65.5 MB", "2.5 GB"]


def test_columns_of_a_table_are_aligned() -> None:
    assert table([("a", "bb", "c"), ("long", "b", "")]) == ["a     bb  c", "long  b"]


def test_a_note_waits_for_the_end_of_the_line(capsys: pytest.CaptureFixture[str]) -> None:
    print_note("first")
    print_progress("loading … ")
    print_note("second")
    assert capsys.readouterr().err == "hapscene: note: first\n"
    print_progress("1.20 s\n")
    assert capsys.readouterr().err == "hapscene: note: second\n"
