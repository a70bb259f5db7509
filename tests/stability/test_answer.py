"""An answer is judged by its tolerance, and none is no answer."""

from hapscene.stability.answer import Answer


def test_judged() -> None:
    assert Answer("a", "", 2.0, 2.1, 0.06).ok and not Answer("a", "", 2.0, 2.1, 0.04).ok
    assert Answer("a", "", 0.0, 0.1, 0.2).ok and not Answer("a", "", 0.0, -0.3, 0.2).ok
    assert Answer("a", "", 4.2, 1.0, 0.0, at_most=True).ok and not Answer("a", "", 4.2, 4.3, 0.0, at_most=True).ok


def test_nothing_found_is_wrong() -> None:
    assert not Answer("a", "", 1.0, float("nan"), 0.5).ok
    assert not Answer("a", "", 1.0, float("nan"), 0.5, at_most=True).ok
