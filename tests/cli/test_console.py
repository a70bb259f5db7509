"""What a command says while it works, to a pipe and to a terminal."""

import sys

import pytest

from hapscene.cli.console import complain, note, ready_streams, say, size_words, tell, tell_over


@pytest.mark.parametrize(
    ("size_B", "told"),
    [(0, "0 B"), (464, "464 B"), (1000, "1 kB"), (12_345, "12.3 kB"), (999_600, "1 MB"), (65_536_084, "65.5 MB")],
)
def test_sizes_have_three_digits(size_B: float, told: str) -> None:
    assert size_words(size_B) == told


def test_a_pipe_gets_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    say("loading … ")
    say("1.20 s\n")
    assert capsys.readouterr().out == "loading … 1.20 s\n"


def test_one_line_is_one_line_whatever_is_in_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdout", sys.stdout)  # as they were, afterwards
    monkeypatch.setattr("sys.stderr", sys.stderr)
    ready_streams()
    say("reading a\nb\x1b[2J … ")
    say("1.20 s\n")
    tell(["made:", "  a\nmade:\x9b"])
    complain("a\nb\x1b")
    print("a\x1b\u202e\nb", file=sys.stdout)
    sys.stdout.writelines(["a\x07\n"])
    said = capsys.readouterr()
    told = "reading a\\nb\\x1b[2J … 1.20 s\nmade:\n  a\\nmade:\\u009b\na\\x1b\\u202e\nb\na\\x07\n"
    assert (said.out, said.err) == (told, "hapscene: a b\\x1b\n")
    tell_over("50\r %")
    assert capsys.readouterr().out == "\r50\\r %\x1b[K"


def test_a_note_waits_for_the_end_of_the_line(capsys: pytest.CaptureFixture[str]) -> None:
    note("first")
    say("loading … ")
    note("second")
    assert capsys.readouterr().err == "hapscene: note: first\n"
    say("1.20 s\n")
    assert capsys.readouterr().err == "hapscene: note: second\n"
