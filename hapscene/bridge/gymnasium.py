"""A reinforcement-learning environment: a `gymnasium.Env` in which a tool is moved and its contact is observed."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from hapscene.bridge.simulation import Array, Bridge, Simulation
from hapscene.errors import SceneError
from hapscene.render.renderer import Command, Renderer

if TYPE_CHECKING:
    from gymnasium import Env

__all__ = ["touch_env"]


def touch_env(
    renderer: Renderer,
    low_m: ArrayLike,
    high_m: ArrayLike,
    reward: Callable[[Array], float],
    terminated: Callable[[Array], bool] = lambda observed: False,
    simulation: Simulation | None = None,
    restart: Callable[[np.random.Generator], ArrayLike] | None = None,
    count: int = 20,
) -> "Env[Array, Array]":
    """Return an environment in which an agent moves a tool and observes contact.

    An action is a position (3,) in a box [m], to which the tool moves linearly in `count` ticks. An observation (12,)
    has the position of the tool [m], the force on the hand [N], the surface normal, penetration depth [m], slip speed
    [m/s], and 1 in contact.

    Args:
        renderer: renderer of the scene.
        low_m, high_m: (3,) corners of the box.
        reward, terminated: functions of an observation.
        simulation: simulation that moves the bodies; then `count` is the number of its steps.
        restart: resets the simulation with the given random generator, and returns the start position (3,); by default
            the start is random in the box.
        count: number of ticks, or of simulation steps, per action.

    Raises:
        SceneError: gymnasium is not installed.
    """
    try:
        from gymnasium import Env, spaces
    except ImportError:
        raise SceneError("gymnasium is not installed; run: pip install 'hapscene[gymnasium]'") from None

    class TouchEnv(Env[Array, Array]):
        action_space = spaces.Box(np.array(low_m, np.float64), np.array(high_m, np.float64), dtype=np.float64)
        observation_space = spaces.Box(-np.inf, np.inf, (12,), np.float64)

        def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Array, dict[str, Any]]:
            super().reset(seed=seed)
            draw, box = self.np_random, self.action_space
            self._tool_m = np.array(restart(draw) if restart else draw.uniform(box.low, box.high), np.float64)
            renderer.reset(self._tool_m)
            self._feel = partial(Bridge(simulation).step, renderer) if simulation else renderer.step
            return self._observed(self._feel(self._tool_m)), {}

        def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
            feels = [self._feel(place_m) for place_m in np.linspace(self._tool_m, action, count + 1)[1:]]
            self._tool_m = np.array(action, np.float64)
            observed = self._observed(feels[-1])
            return observed, float(reward(observed)), bool(terminated(observed)), False, {}

        def _observed(self, command: Command) -> Array:
            c = command.contact
            felt = np.zeros(6) if c is None else (*c.nhat_W, c.depth_m, c.slip_m_s, 1.0)
            return np.array([*self._tool_m, *command.f_W_N, *felt])

    return TouchEnv()
