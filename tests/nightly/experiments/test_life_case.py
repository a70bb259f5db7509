"""Textures that live, switch and go on, on a stiff wall: they do not feed themselves, and are as loud as they say."""

import pytest

from hapscene_experiments.life_case import growth, life_cases, wall_N_m


@pytest.fixture(scope="module")
def answers():
    return life_cases()


def test_answers(answers) -> None:
    assert len(answers) == 9
    for answer in answers:
        assert answer.ok, answer


def test_two_strokes_part_above_the_limit_and_meet_below_it_as_the_wall_alone_has_them() -> None:
    for share in (0.9, 1.1):
        alone, alive = (growth(name, share * wall_N_m()) for name in ("no texture", "alive"))
        assert (alone > 0.0) == (share > 1.0) and alive == pytest.approx(alone, rel=0.2)
