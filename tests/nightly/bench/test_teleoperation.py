"""The teleoperation experiment of the paper: the handle reduces the error of the base motors."""

import numpy as np
import pytest

from hapscene_evidence.bench.teleoperation import Rendering, compare_handles


@pytest.fixture(scope="module")
def renderings() -> list[Rendering]:
    return compare_handles("wood", ("none", "inverse"))


def test_handle_reduces_the_error_of_the_base_motors(renderings: list[Rendering]) -> None:
    alone, handle = renderings
    assert alone.errors["stroke"] > 0.9 and handle.errors["stroke"] < 0.25
    assert handle.errors["all"] < 0.7 * alone.errors["all"]


@pytest.mark.parametrize("grip", ["light", "medium", "firm"])
def test_two_taps_and_five_drags_on_wood(grip: str) -> None:
    """The paper's experiment: motion of base motors and handle is not counted twice."""
    inverse, adaptive = compare_handles("wood", ("inverse", "adaptive"), grip, taps=2, strokes=5)
    assert adaptive.errors["all"] < min(0.30, inverse.errors["all"] + 0.02)


def test_latency_is_removed(renderings: list[Rendering]) -> None:
    """Within the strokes desired and rendered acceleration are aligned to the sample."""
    _, handle = renderings
    desired, rendered = handle.desired_m_s2, handle.rendered_m_s2
    strokes = slice(len(desired) // 2, len(desired) * 3 // 4)
    lags = np.arange(-20, 21)
    match = [np.dot(desired[strokes], np.roll(rendered, lag)[strokes]) for lag in lags]
    assert abs(lags[int(np.argmax(match))]) <= 1
