"""Handles to play on, by name."""

import pytest

from hapscene.errors import HandleError
from hapscene.handle.handle_output import is_output, open_output


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("spoon", {}, "no handle to play on 'spoon'; there are: .*audio"),
        ("serial", {"prot": "x"}, "no option 'prot'; there are: .*port"),
        ("serial", {"limit_N": "much"}, "option limit_N is a number, is 'much'"),
        ("serial", {}, "which port"),
        ("usb", {"id": "teensy"}, "is VENDOR:PRODUCT in hexadecimal digits"),
    ],
)
def test_what_cannot_be_opened_is_said_in_words(name: str, options: dict[str, str], words: str) -> None:
    with pytest.raises(HandleError, match=words):
        open_output(name, options)


def test_ours_are_there() -> None:
    assert is_output("audio") and is_output("serial") and is_output("usb") and not is_output("my.handle")
