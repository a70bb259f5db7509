"""Touch as something to learn: a `gymnasium.Env` in which a tool is moved, and what it feels is observed."""

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
    """An environment in which the tool goes to a place (3,) in a box [m], straight, in `count` ticks, or steps of the
    `simulation` that moves bodies. Observed (12,): the tool [m], the force on the hand [N], the surface's normal; depth
    [m], slip [m/s], 1 where it touches: what `reward` and `terminated` are of. `restart`, given the generator, puts the
    simulation back and says where the tool begins (3,); without it, that is anywhere in the box."""
    try:
        from gymnasium import Env, spaces
    except ImportError:
        raise SceneError("to learn by touch needs one more package: pip install 'hapscene[gymnasium]'") from None

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
