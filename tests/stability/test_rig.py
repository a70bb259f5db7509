"""The setup of stability trials: guiding, releasing and pushing hand, against mechanics."""

import numpy as np
import pytest

from hapscene.device.sim.hand import GRIPS
from hapscene.device.sim.omni import Omni
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.stability.rig import AT_M, HOLD, SHEET_M, Rig, sheet
from hapscene.surface.swatch import Swatch

TICK_S, MASS_KG = 1e-3, 0.05


def rig(delay_ticks: int = 0, b_Ns_m: float = 0.0) -> Rig:
    return Rig(PointMass(MASS_KG, b_Ns_m), TICK_S, delay_ticks, stiffness_N_m=200.0)


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


def test_equilibrium() -> None:
    found = rig(b_Ns_m=1.0).release(0.01, 0.0, 2.0, 200)
    assert -found.p_W_m[:, 2] == pytest.approx(0.01, abs=1e-6)
    tuned = rig(b_Ns_m=1.0)
    tuned.tune(1000.0, 0.5)
    assert -tuned.release(0.01, 0.0, 10.0, 200).p_W_m[:, 2] == pytest.approx(0.01, abs=1e-6)


def test_push_on_continues() -> None:
    whole = rig().release(0.01, 0.05, 3.0, 60)
    cut = rig()
    parts = [cut.release(0.01, 0.05, 3.0, 25), cut.push_on(3.0, 35)]
    assert np.array_equal(np.concatenate([part.p_W_m for part in parts]), whole.p_W_m)


def test_throw() -> None:
    found = rig().throw(0.01, 0.5, 60)
    z = found.p_W_m[:, 2]
    landed = int(np.argmax(z < 0.0))
    assert landed == pytest.approx(0.01 / 0.5 / TICK_S, abs=1)
    assert z[:landed] == pytest.approx(0.01 - 0.5 * TICK_S * np.arange(landed), abs=1e-9)  # no gravity
    assert not found.f_hand_W_N.any() and found.recording.touching[landed + 1]


def test_follow_and_stay() -> None:
    depth = np.concatenate((np.full(5, -0.002), np.linspace(-0.002, 0.003, 50)))
    tool = rig()
    followed, stayed = tool.follow(depth, GRIPS["firm"]), tool.stay(0.003, 2000, GRIPS["firm"])
    assert followed.p_W_m[0] == pytest.approx([*AT_M, 0.002], abs=1e-6)
    assert -stayed.p_W_m[-1, 2] == pytest.approx(0.003 * 500.0 / (500.0 + 200.0), rel=1e-3)  # springs in series


def test_the_guiding_hand_is_stiff_and_critically_damped() -> None:
    for stiffness, damping in ((200.0, 0.0), (1e6, 0.0), (200.0, 500.0)):
        tool = Rig(PointMass(MASS_KG, 0.3), TICK_S, stiffness_N_m=stiffness, damping_Ns_m=damping)
        grip = tool._lead()
        most = max(MASS_KG / TICK_S**2, stiffness, (damping + 0.3) / TICK_S)
        assert grip.k_N_m == pytest.approx(HOLD * most)
        assert grip.b_Ns_m / (2.0 * np.sqrt(grip.k_N_m * MASS_KG)) == pytest.approx(1.0)


def test_release_requires_a_point_mass() -> None:
    with pytest.raises(HapsceneError, match="Omni"):
        Rig(Omni(), TICK_S).release(0.01, 0.0, 1.0, 5)
