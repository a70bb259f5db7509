"""Contacts beyond a spring and Coulomb friction, in closed loop: the answers of closed forms and of SciPy."""

from pathlib import Path

import pytest

from hapscene_experiments.border_case import border_cases
from hapscene_experiments.contact_case import deep_damping, draw_contact, rest_of_omni, squeal, torn_off


@pytest.mark.parametrize("cases", [deep_damping, torn_off, squeal, rest_of_omni, border_cases])
def test_answers(cases) -> None:
    answers = cases()
    assert answers
    for answer in answers:
        assert answer.ok, answer


def test_chart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of made-up figures; those that are drawn are held to the closed forms above."""
    for name, value in (("limit_of_motion", 100.0), ("swing", 1e-3), ("dragged", (0.0, 0.0)), ("solved", (0.1, 1e-3))):
        monkeypatch.setattr(f"hapscene_experiments.contact_case.{name}", lambda *_, value=value: value)
    draw_contact(tmp_path / "contact.png")
    assert (tmp_path / "contact.png").read_bytes().startswith(b"\x89PNG")
