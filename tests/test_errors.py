"""What errors say: text from outside does not steer the terminal that it is shown on."""

import json
import sys
import unicodedata

import pytest

from hapscene.errors import MeshError, printable

STEERING = {
    "escape": ("a\x1b]0;title\x07b", r"a\x1b]0;title\x07b"),
    "one byte of it": ("a\x9b2Jb", r"a\u009b2Jb"),
    "delete": ("a\x7f\x08b", r"a\u007f\x08b"),
    "ends of lines": ("a\nb\rc\u2028d\x85e", r"a\nb\rc\u2028d\u0085e"),
    "direction": ("exe.\u202ekcab", r"exe.\u202ekcab"),
    "invisible": ("a\u200bb\U000e0041", r"a\u200bb\udb40\udc41"),
    "no UTF-8": (b"\xff.stl".decode("utf-8", "surrogateescape"), r"\udcff.stl"),
}


@pytest.mark.parametrize("case", STEERING)
def test_control_characters_are_replaced_by_their_code(case: str) -> None:
    given, shown = STEERING[case]
    assert printable(given) == shown


@pytest.mark.nightly
def test_no_control_character_remains_and_printable_ones_are_unchanged() -> None:
    shown = printable("".join(map(chr, range(sys.maxunicode + 1))))
    shown.encode()
    assert not {unicodedata.category(sign) for sign in set(shown)} & {"Cc", "Cf", "Cs", "Zl", "Zp"}
    assert printable("Eiche, geölt µ 木 🪵\u00a0½") == "Eiche, geölt µ 木 🪵\u00a0½"


def test_line_breaks_are_kept_on_request() -> None:
    assert printable("a\nb\x1b\n", lines=True) == "a\nb\\x1b\n"


def test_a_json_text_stays_one() -> None:
    content = {"name": "".join(text for text, _ in STEERING.values())}
    text = printable(json.dumps(content, indent=2, ensure_ascii=False), lines=True)
    assert json.loads(text) == content and "\x9b" not in text


def test_it_is_no_longer_than_asked() -> None:
    assert printable("oak", 3) == "oak"
    assert printable("oaken", 3) == "oa…"


def test_what_an_error_says_of_a_file_is_one_line_that_may_be_shown() -> None:
    assert str(MeshError("a.obj: no group 'x\x1b[2J\ny'")) == "a.obj: no group 'x\\x1b[2J\\ny'"
