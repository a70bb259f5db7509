"""The reinforcement-learning environment: checker, observations, seeds, reset of a simulation."""

import sys
import warnings
from typing import Any

import numpy as np
import pytest
import trimesh
from gymnasium.utils.env_checker import check_env

import hapscene

LOW_M, HIGH_M = (-0.02, -0.02, 0.04), (0.02, 0.02, 0.07)
STIFFNESS_N_M = 650.0


class Puck:
    """0.1 kg, that a tool pushes down without an end."""

    names, step_s = ("box",), 1e-3

    def __init__(self) -> None:
        self.back()

    def back(self, rng: Any = None) -> tuple[float, float, float]:
        self.z_m = self.v_m_s = 0.0
        return 0.0, 0.0, 0.06

    def read(self, X_WB: Any) -> None:
        X_WB[0] = np.eye(4)
        X_WB[0, 2, 3] = self.z_m

    def mobility(self, body: int) -> Any:
        return np.diag([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])

    def advance(self, wrench_W: Any) -> None:
        self.v_m_s += 10.0 * wrench_W[0, 2] * self.step_s
        self.z_m += self.v_m_s * self.step_s


@pytest.fixture(scope="module")
def renderer() -> hapscene.Renderer:
    scene = hapscene.Scene()
    swatch = hapscene.Swatch("test", stiffness_N_m=STIFFNESS_N_M)
    scene.add(trimesh.creation.box(3 * [0.1]), name="box", unit="m", swatch=swatch)
    return hapscene.Renderer(scene)


def env_of(renderer: hapscene.Renderer, **more: Any) -> Any:
    return hapscene.bridge.touch_env(renderer, LOW_M, HIGH_M, lambda seen: -abs(seen[5] - 1.0), **more)


@pytest.mark.parametrize("moves", [False, True])
def test_checker_of_gymnasium(renderer: hapscene.Renderer, moves: bool) -> None:
    puck = Puck()
    env = env_of(renderer, simulation=puck, restart=puck.back) if moves else env_of(renderer)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*(infinity|normalized|spec|render)")
        check_env(env)


def test_observations(renderer: hapscene.Renderer) -> None:
    env = env_of(renderer, terminated=lambda seen: bool(seen[11]))
    seen, _ = env.reset(seed=3)
    assert (seen[:3] == env.np_random.__class__(np.random.PCG64(3)).uniform(LOW_M, HIGH_M)).all()
    seen, reward, ended, *_ = env.step(np.array([0.0, 0.0, 0.06]))
    assert seen == pytest.approx([0.0, 0.0, 0.06, *9 * [0.0]], abs=1e-12) and reward == -1.0 and not ended
    for _ in range(30):
        seen, reward, ended, *_ = env.step(np.array([0.0, 0.0, 0.049]))
    assert seen[:3] == pytest.approx([0.0, 0.0, 0.049])
    assert seen[5] == pytest.approx(STIFFNESS_N_M * 1e-3, rel=1e-6) and reward == -abs(seen[5] - 1.0)
    assert seen[6:] == pytest.approx([0.0, 0.0, 1.0, 1e-3, 0.0, 1.0], abs=1e-6) and ended


def test_reset_of_a_simulation_and_seeds(renderer: hapscene.Renderer) -> None:
    puck = Puck()
    env = env_of(renderer, simulation=puck, restart=puck.back)
    episodes = []
    for _ in range(2):
        start, _ = env.reset(seed=5)
        assert puck.z_m == 0.0
        env.action_space.seed(5)
        episodes.append(np.array([start] + [env.step(env.action_space.sample())[0] for _ in range(20)]))
        assert puck.v_m_s < -1e-3 and episodes[-1][:, 11].any()
    assert episodes[0].tobytes() == episodes[1].tobytes()


def test_missing_gymnasium(renderer: hapscene.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(hapscene.HapsceneError, match=r"pip install 'hapscene\[gymnasium\]'"):
        env_of(renderer)
