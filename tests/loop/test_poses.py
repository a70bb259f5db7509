"""Moving bodies in the closed loop: a platform carries the tool, and the twin equals the renderer."""

from collections.abc import Callable

import numpy as np
import pytest

from hapscene.device.sim.point import PointMass
from hapscene.errors import SceneError
from hapscene.loop import ReferenceTrajectory, Twin
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene

MASS = PointMass(0.045, 2.0)


def lift(scene: Scene, z_m: np.ndarray) -> dict[str, np.ndarray]:
    X_WB = np.tile(scene.bodies[0].X_WB, (len(z_m), 1, 1))
    X_WB[:, 2, 3] += z_m
    return {"plate": X_WB}


def test_rising_platform_carries_the_tool(plate_of: Callable[..., Scene]) -> None:
    scene = plate_of()
    twin = Twin(scene, MASS, effects=["wall"])
    twin.reset((0.0, 0.0, 1e-4))
    twin.run(ReferenceTrajectory.hold((0.0, 0.0, 0.0), 1000, "none", push_W_N=(0.0, 0.0, -1.0)))
    speed_m_s = 0.03
    way_m = np.minimum(speed_m_s * 1e-3 * np.arange(1, 2001), 0.03)
    result = twin.run(
        ReferenceTrajectory.hold((0.0, 0.0, 0.0), 2000, "none", push_W_N=(0.0, 0.0, -1.0)), lift(scene, way_m)
    )
    assert result.recording.touching.all()
    assert result.p_W_m[-1, 2] == pytest.approx(0.03 - 1.0 / 500.0, abs=1e-6)
    assert result.v_W_m_s[900, 2] == pytest.approx(speed_m_s, rel=1e-3)
    assert result.rest_m_s < 1e-5
    still = twin.run(ReferenceTrajectory.hold((0.0, 0.0, 0.0), 100, "none", push_W_N=(0.0, 0.0, -1.0)))
    assert still.recording.p_WP_m[:, 2] == pytest.approx(0.03, abs=1e-9)  # the platform stays at its last pose


def test_twin_equals_the_renderer(plate_of: Callable[..., Scene]) -> None:
    scene = plate_of(friction_static=0.4, friction_dynamic=0.3)
    poses = lift(scene, 0.004 * np.sin(np.arange(600) / 50.0))
    result = Twin(scene, MASS).run(
        ReferenceTrajectory.hold((0.0, 0.0, 0.001), 600, "light", push_W_N=(0.3, 0.0, -1.0)), poses
    )
    again = Renderer(scene).run(result.recording.p_WT_m, poses)
    assert 0 < result.recording.touching.sum() < 600
    for name in ("p_WP_m", "f_W_N", "slip_m_s", "flags"):
        assert np.array_equal(getattr(again, name), getattr(result.recording, name)), name


def test_poses_of_unknown_body_are_rejected(plate_of: Callable[..., Scene]) -> None:
    twin = Twin(plate_of(), MASS)
    with pytest.raises(SceneError, match="chair"):
        twin.run(ReferenceTrajectory.hold((0.0, 0.0, 0.0), 3), {"chair": np.tile(np.eye(4), (3, 1, 1))})
