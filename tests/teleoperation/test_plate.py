"""The plate, and the gesture that explores it."""

import numpy as np
import pytest

from hapscene.constants import TICK_S
from hapscene.device.sim.hand import grip_named
from hapscene.teleoperation.plate import REST_S, SPAN_M, START_M, explore, plate


def test_plate() -> None:
    """Its faces form a closed surface, seen from outside, with the top at z = 0."""
    (body,) = plate("wood").bodies
    a, b, c = body.mesh.triangles_m.transpose(1, 0, 2)
    assert body.name == "plate" and body.mesh.bounds_m.tolist() == [[-0.1, -0.1, -0.02], [0.1, 0.1, 0.0]]
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(0.2 * 0.2 * 0.02)


@pytest.mark.parametrize(("taps", "strokes"), [(2, 2), (3, 4)])
def test_gesture(taps: int, strokes: int) -> None:
    gesture = explore("medium", 500.0, taps, strokes)
    path, held = gesture.intent.target_W_m, grip_named("medium")
    depth_m = 1.0 / held.k_N_m + 1.0 / 500.0  # 1 N
    assert np.all(gesture.intent.grip[:, :2] == (held.k_N_m, held.b_Ns_m)) and not path[:, 1].any()
    rest = round(REST_S / TICK_S)
    np.testing.assert_allclose(path[:200], np.tile(START_M, (200, 1)), atol=1e-15)
    np.testing.assert_allclose(path[-rest:], np.tile(START_M, (rest, 1)), atol=1e-15)
    assert len(gesture.parts["tap"]) == taps and gesture.parts["tap"][0][0] == 201
    for (first, last), x_m in zip(gesture.parts["tap"], np.linspace(-0.02, 0.02, taps), strict=True):
        tap = path[first:last]
        assert tap[:, 2].min() == pytest.approx(-depth_m) and tap[np.argmin(tap[:, 2]), 0] == pytest.approx(x_m)
    ((first, last),) = gesture.parts["stroke"]
    press = path[gesture.parts["tap"][-1][1] : first]
    held_down = press[press[:, 2] < -depth_m + 1e-9]
    assert len(held_down) >= 300 and np.abs(held_down[:300, 0]).max() < 1e-12
    way = path[first:last]
    np.testing.assert_allclose(way[:, 2], -depth_m, atol=1e-12)
    duration_s = np.cumsum([0.0, *(2.0 * SPAN_M / speed_m_s for speed_m_s in (0.06, 0.1, 0.15, 0.2)[:strokes])])
    assert len(way) == pytest.approx(duration_s[-1] / TICK_S, abs=strokes)
    ends = way[(duration_s[:-1] / TICK_S).round().astype(int) + 2, 0]
    np.testing.assert_allclose(ends, -SPAN_M * (-1.0) ** np.arange(strokes), atol=1e-4)
