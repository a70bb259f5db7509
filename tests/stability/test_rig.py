"""The setup of stability trials: a guiding and a releasing hand, against mechanics."""

import numpy as np
import pytest

from hapscene.device.sim.hand import GRIPS
from hapscene.device.sim.point import PointMass
from hapscene.stability.rig import AT_M, SHEET_M, sheet
from hapscene.surface.swatch import Swatch
from tests.stability.free_rig import FreeRig

TICK_S, MASS_KG = 1e-3, 0.05


def rig(delay_ticks: int = 0) -> FreeRig:
    return FreeRig(PointMass(MASS_KG), TICK_S, delay_ticks, stiffness_N_m=200.0)


def test_sheet() -> None:
    (body,) = sheet(Swatch("wall"), 0.1).bodies
    assert body.mesh.bounds_m[:, :2].tolist() == [[-0.05, -0.05], [0.05, 0.05]] and not np.ptp(
        body.mesh.vertices_m[:, 2]
    )
    up = np.cross(*(body.mesh.triangles_m[:, k] - body.mesh.triangles_m[:, 0] for k in (1, 2)))
    assert np.all(up[:, 2] > 0.0) and max(map(abs, AT_M)) < SHEET_M / 4 and AT_M[0] != AT_M[1]


@pytest.mark.parametrize("delay_ticks", [0, 2])
@pytest.mark.parametrize("speed_m_s", [0.0, 0.1, -0.2])
def test_release(speed_m_s: float, delay_ticks: int) -> None:
    """After the release, only the held wall force and the push act; the first tick is computed by hand."""
    found = rig(delay_ticks).release(0.01, speed_m_s, 3.0, 40)
    acted = 200.0 * (0.01 - speed_m_s * TICK_S * delay_ticks)  # the wall force, delayed
    speed = speed_m_s + (3.0 - acted) / MASS_KG * TICK_S
    assert -found.v_W_m_s[0, 2] == pytest.approx(speed, abs=2e-3)
    assert -found.p_W_m[0, 2] == pytest.approx(0.01 + 0.5 * (speed_m_s + speed) * TICK_S, abs=4e-6)
    assert len(found.p_W_m) == 40 and not (found.f_hand_W_N - [0.0, 0.0, -3.0]).any()
    np.testing.assert_allclose(found.p_W_m[:, :2], np.tile(AT_M, (40, 1)), atol=1e-12)


def test_follow_and_stay() -> None:
    depth = np.concatenate((np.full(5, -0.002), np.linspace(-0.002, 0.003, 50)))
    tool = rig()
    followed, stayed = tool.follow(depth, GRIPS["firm"]), tool.stay(0.003, 2000, GRIPS["firm"])
    assert followed.p_W_m[0] == pytest.approx([*AT_M, 0.002], abs=1e-6)
    assert -stayed.p_W_m[-1, 2] == pytest.approx(0.003 * 500.0 / (500.0 + 200.0), rel=1e-3)  # springs in series
