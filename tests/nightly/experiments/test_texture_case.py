"""Textures in the real tick: nothing explodes, nothing is louder than it should be, and what a tick cannot sample."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.surface.swatch import Swatch
from hapscene_experiments.texture_case import (
    SPEED_M_S,
    adversaries,
    blends,
    buzz,
    draw_texture,
    felt_frequency,
    sampling,
    shipped,
    striped,
    stroke,
    switched,
)


@pytest.fixture(scope="module")
def blended():
    return blends()


def test_blends(blended) -> None:
    for answer in blended:
        assert answer.ok, answer


@pytest.mark.parametrize("cases", [switched, adversaries, shipped, sampling, buzz])
def test_answers(cases) -> None:
    answers = cases()
    assert answers
    for answer in answers:
        assert answer.ok, answer


def test_stripes_are_crossed_when_they_should() -> None:
    swatches = [Swatch("a"), Swatch("b"), Swatch("c")]
    seen = stroke(swatches, 300, 10_000.0, ticks_each=5)
    assert seen.touching[1:].all()
    assert seen.slip_m_s[1:] == pytest.approx(SPEED_M_S, rel=1e-6)
    changed = np.flatnonzero(np.diff(seen.swatch[1:]))
    assert set(np.diff(changed)) == {5}


def test_stripes_are_painted_in_turn() -> None:
    scene = striped([Swatch("a"), Swatch("b")], 1e-3, 4)
    names = [scene.swatches[i].name for i in scene.bodies[0].face_swatch]
    assert names == ["a", "a", "b", "b"] * 2


def test_too_fast_a_grating_is_felt_as_another() -> None:
    assert felt_frequency(0.2) == pytest.approx(200.0, abs=2.0)
    assert felt_frequency(0.9) == pytest.approx(100.0, abs=2.0)


def test_chart(tmp_path: Path, blended) -> None:
    draw_texture(blended, tmp_path / "texture.png")
    assert (tmp_path / "texture.png").read_bytes().startswith(b"\x89PNG")
