"""The teleoperation experiment of the paper: the handle reduces the error of the base motors."""

import numpy as np
import pytest

from hapscene_evidence.paper.remote_figure import Rendering, compare_handles


@pytest.fixture(scope="module")
def renderings() -> list[Rendering]:
    return compare_handles(("none", "inverse"), taps=3, strokes=4)


def test_handle_reduces_the_error_of_the_base_motors(renderings: list[Rendering]) -> None:
    alone, handle = renderings
    assert alone.errors["stroke"] > 90.0 and handle.errors["stroke"] < 25.0
    assert handle.errors["all"] < 0.7 * alone.errors["all"]


def test_latency_is_removed(renderings: list[Rendering]) -> None:
    """Within the strokes desired and rendered acceleration are aligned to the sample."""
    _, handle = renderings
    desired, rendered = handle.desired_m_s2, handle.rendered_m_s2
    strokes = slice(len(desired) // 2, len(desired) * 3 // 4)
    lags = np.arange(-20, 21)
    match = [np.dot(desired[strokes], np.roll(rendered, lag)[strokes]) for lag in lags]
    assert abs(lags[int(np.argmax(match))]) <= 1
