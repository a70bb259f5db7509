"""The frame and the fading of effects of the scene."""

from types import SimpleNamespace

import numpy as np
import pytest

from hapscene.errors import EffectError
from hapscene.records import OUTPUT, TOUCH, records
from hapscene.surface.field_frame import (
    EASE_S,
    FADED_MOST,
    POINT_MAX,
    add_force,
    eased,
    fade,
    field_array,
    to_frame,
    turn,
)

R = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
T = np.array([0.1, -0.2, 0.3])
TABLE = np.concatenate((R.ravel(), T, (7.0,)))
V = np.array([0.5, -1.5, 2.5])


def test_points_and_vectors_are_transformed() -> None:
    np.testing.assert_allclose(to_frame(TABLE, V), R.T @ (V - T))
    np.testing.assert_allclose(turn(TABLE, tuple(V)), R @ V)
    out = records(1, OUTPUT)[0]
    out.f_W_N = 1.0, 2.0, 3.0
    add_force(out, TABLE, -4.0, tuple(V))
    np.testing.assert_allclose(out.f_W_N, (1.0, 2.0, 3.0) - 4.0 * R @ V)


def test_a_faded_spring() -> None:
    assert [fade(q) for q in (0.0, 0.5, 1.0, 2.0)] == [1.0, 0.25, 0.0, 0.0]
    q = np.linspace(0.0, 1.0, 10_001)
    assert max(d * fade(d * d) for d in q) == pytest.approx(FADED_MOST, rel=1e-6)
    touch = records(1, TOUCH)[0]
    touch.tick_s = 1e-3
    for tick, share in ((0, 0.0), (10, 0.01 / EASE_S), (50, 1.0), (500, 1.0)):
        touch.tick = tick
        assert eased(touch) == pytest.approx(share)


def test_arrays_of_settings() -> None:
    assert field_array("x", {"p": (1, 2, 3)}, "p", "rows").tolist() == [[1.0, 2.0, 3.0]]
    assert field_array("x", {"p": np.zeros((POINT_MAX, 3))}, "p", "rows").shape == (POINT_MAX, 3)
    many = np.zeros((POINT_MAX + 1, 3))
    for bad in (None, "here", [], [[1, 2]], np.zeros((1, 1, 3)), [[0, 0, np.inf]], many, SimpleNamespace()):
        with pytest.raises(EffectError, match="'x'"):
            field_array("x", {"p": bad}, "p", "rows")
