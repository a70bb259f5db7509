"""A follower that is a body of a simulation."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.operation import Impairment, Operation, OperationResult
from hapscene.teleoperation.plate import plate
from tests.teleoperation.delays import WALL_N_M

Array = NDArray[np.float64]

MASS_KG, DAMPING_NS_M = 0.045, 0.1
START_M = (0.0, 0.0, 0.002)


class Wall:
    """A point mass `tip`, an elastic wall below z = 0, and a fixed body."""

    names = ("post", "tip")

    def __init__(self, step_s: float) -> None:
        self.step_s, self.p_m, self.v_m_s = step_s, np.array(START_M), np.zeros(3)

    def read(self, X_WB: Array) -> None:
        X_WB[:] = np.eye(4)
        X_WB[1, :3, 3] = self.p_m

    def mobility(self, body: int) -> Array:
        raise NotImplementedError  # which a follower is not asked for

    def contact(self, body: int) -> Array:
        return np.array([0.0, 0.0, WALL_N_M * max(-self.p_m[2], 0.0)])

    def advance(self, wrench_W: Array) -> None:
        assert not wrench_W[0].any() and not wrench_W[1, 3:].any()
        f_N = wrench_W[1, :3] + self.contact(1) - DAMPING_NS_M * self.v_m_s
        self.v_m_s = self.v_m_s + f_N / MASS_KG * self.step_s
        self.p_m = self.p_m + self.v_m_s * self.step_s


def operated(scene: Any, intent: ReferenceTrajectory, line: Impairment | None = None) -> OperationResult:
    body = "tip" if isinstance(scene, Wall) else None
    bare: dict[str, Any] = {"device": PointMass(MASS_KG, DAMPING_NS_M), "compensator": "none", "effects": ("wall",)}
    operation = Operation(scene, START_M, line=line, body=body, **bare)
    for side in (operation.leader, operation.follower):
        side.end.state.allowance_J = 1.0
    return operation.run(intent)


@pytest.mark.nightly
def test_it_agrees_with_a_follower_on_a_scene() -> None:
    """The same mass at the same wall: down, press, along, up."""
    t = np.linspace(0.0, 1.0, 2000)[:, None]
    intent = ReferenceTrajectory.along(
        np.array(START_M) + t * [0.01, 0.0, 0.0] - 0.008 * np.sin(np.pi * t) * [0.0, 0.0, 1.0], "firm"
    )
    swatch = Swatch("wall", stiffness_N_m=WALL_N_M)
    ours, theirs = operated(Wall(1e-4), intent, Impairment(0.003)), operated(plate(swatch), intent, Impairment(0.003))
    assert theirs.f_leader_W_N[:, 2].max() > 0.5
    assert np.abs(ours.f_leader_W_N - theirs.f_leader_W_N).max() < 0.02
    assert np.abs(ours.follower_W_m - theirs.follower_W_m).max() < 5e-5
    assert np.abs(ours.f_contact_W_N - theirs.f_contact_W_N).max() < 0.05
    assert np.mean(ours.touching == theirs.touching) > 0.99
    received = [o.a_follower_m_s2.ravel() for o in (ours, theirs)]
    assert np.corrcoef(received)[0, 1] > 0.99 and ours.latency_s == theirs.latency_s


def test_unknown_contact_force_is_nan() -> None:
    class Mute(Wall):
        names, contact = ("post", "tip"), None  # type: ignore[assignment]

        def advance(self, wrench_W: Array) -> None:
            self.p_m = self.p_m + 1e-6

    felt = operated(Mute(1e-3), ReferenceTrajectory.hold(START_M, 5))
    assert np.isnan(felt.f_contact_W_N).all() and not felt.touching.any()


def test_diverging_simulation_is_an_error() -> None:
    class Bursting(Wall):
        def advance(self, wrench_W: Array) -> None:
            self.p_m = self.p_m * (np.nan if self.p_m[2] < 0.0019 else 0.999)

    with pytest.raises(HapsceneError, match="diverged"):
        operated(Bursting(1e-3), ReferenceTrajectory.hold(START_M, 500))


def test_invalid_steps_and_bodies() -> None:
    for step_s in (2e-3, 4e-4, 0.0):
        with pytest.raises(HapsceneError, match="simulation step"):
            Operation(Wall(step_s), START_M, body="tip")
    with pytest.raises(HapsceneError, match="'tap'"):
        Operation(Wall(1e-3), START_M, body="tap")
    with pytest.raises(HapsceneError, match="post, tip"):
        Operation(Wall(1e-3), START_M)
