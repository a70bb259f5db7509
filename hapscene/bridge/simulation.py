"""Two-rate coupling of haptic rendering with a simulation that moves the bodies of a scene.

During each simulation step, its poses are rendered for as many ticks as it lasts. The impulse of the tool on each
body is applied as a constant wrench in the next step, so that the momentum that the hand loses goes to the body. If
steps are longer than ticks, poses are predicted: a body continues with its velocity, under the force of the tool and
the other forces of the last step, and is led to the simulated pose within the next step. Constant poses would cause
force steps.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, Final, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import PathError, SceneError, no_such, warn
from hapscene.geometry import numbers, positions
from hapscene.records import ROW, records
from hapscene.surface.device_clipping import STIFFNESS, WALL

if TYPE_CHECKING:
    from hapscene.loop.reference_trajectory import ReferenceTrajectory
    from hapscene.loop.result import ClosedLoopResult
    from hapscene.loop.twin import Twin
    from hapscene.render.moving_bodies import MovingBodies
    from hapscene.render.recording import Recording
    from hapscene.render.renderer import Command, Renderer

__all__ = ["Bridge", "ChatterWarning", "Simulation", "crosses", "free_mobility"]

Array = NDArray[np.float64]

RATIO_MAX: Final = 4.0
"""Largest stable K T²/m of a spring K and a mass m, with the force held over a step T of the semi-implicit Euler
method [1]. There, the eigenvalues of [[1 − K T²/m, 1], [−K T²/m, 1]] leave the unit circle through −1."""


class ChatterWarning(UserWarning):
    """A body is too light for its stiffness and the simulation step: it will chatter when it is pushed."""


class Simulation(Protocol):
    """The interface of a simulation: three methods, and two constant attributes.

    Attributes:
        names: names of the bodies that it moves, as in the scene.
        step_s: length of a step [s].
    """

    @property
    def names(self) -> Sequence[str]: ...

    @property
    def step_s(self) -> float: ...

    def read(self, X_WB: Array) -> None:
        """Write the present poses of the bodies to X_WB (n, 4, 4)."""

    def mobility(self, body: int) -> ArrayLike:
        """The present mobility (6, 6) of a body: it maps a wrench (6,) to an acceleration (6,).

        The first three components are of the body's origin, the others of the rotation, all in W: N, N·m, m/s²,
        rad/s². For a free body, see `free_mobility`; for a body that forces do not move, zeros.
        """

    def advance(self, wrench_W: Array) -> None:
        """Run one step with wrenches (n, 6): forces on the bodies, and torques about their origins [N, N·m]."""


def free_mobility(
    mass_kg: float, inertia_B_kg_m2: ArrayLike, R_WB: ArrayLike, com_B_m: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """Mobility (6, 6) of a free body, as `Simulation.mobility` returns it.

    Args:
        mass_kg: its mass.
        inertia_B_kg_m2: inertia about the centre of mass in the body frame, (3, 3), or (3,) if the axes are principal.
        R_WB: (3, 3) rotation of the body.
        com_B_m: (3,) centre of mass in the body frame.
    """
    inertia, R = np.asarray(inertia_B_kg_m2, np.float64), np.asarray(R_WB, np.float64)
    turn = R @ np.linalg.inv(np.diag(inertia) if inertia.ndim == 1 else inertia) @ R.T
    c = crosses([R @ np.asarray(com_B_m, np.float64)])[0]
    return np.block([[np.eye(3) / mass_kg - c @ turn @ c, c @ turn], [-turn @ c, turn]])


@cache
def ratio_max(count: int) -> float:
    """Largest stable K T²/m of a spring K and a mass m that is simulated in steps T of `count` ticks [1].

    For one tick it is `RATIO_MAX`. For more, the body is predicted. With the rendered position x, its velocity v and
    the simulated position p, to which it is led by p − x within the step, in units of a step: a tick is the first
    matrix below, the end of a step the second. The limit is where an eigenvalue leaves the unit circle: 1.75 for two
    ticks, 2.24 for many.
    """
    if count < 2:
        return RATIO_MAX

    def largest(ratio: float) -> float:
        h, k = 1.0 / count, ratio / count  # of x, v, the lead, p
        tick = np.array([[1.0 - h * k, h, h, 0.0], [-k, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
        end = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]])
        step = end @ np.linalg.matrix_power(tick, count)
        return float(np.abs(np.linalg.eigvals(step)).max())

    low, high = 0.5, RATIO_MAX
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if largest(middle) <= 1.0 + 1e-9 else (low, middle)
    return low


class Bridge:
    """Couples a renderer with a simulation.

    Args:
        simulation: an object with the methods of `Simulation`.

    Attributes:
        simulation: as given.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._tools: list[tuple[Renderer, MovingBodies]] = []
        self._jumps: set[str] = set(simulation.names)

    def __repr__(self) -> str:
        return f"<Bridge: {len(self.simulation.names)} moving; steps of {1e3 * self.simulation.step_s:g} ms>"

    @overload
    def step(
        self,
        renderer: "Renderer",
        p_WT: "ArrayLike | Callable[[], ArrayLike]",
        each: "Callable[[Command], object] | None" = None,
    ) -> "Command": ...
    @overload
    def step(
        self,
        renderer: "Sequence[Renderer]",
        p_WT: "ArrayLike | Callable[[], ArrayLike]",
        each: "Callable[[list[Command]], object] | None" = None,
    ) -> "list[Command]": ...
    def step(self, renderer: Any, p_WT: Any, each: Any = None) -> Any:
        """Run one step of the simulation with the haptic ticks in it; return the command of the last tick.

        If steps are shorter than ticks, some have no tick, and the last command is returned again.

        Args:
            renderer: renderer of a scene with the bodies of the simulation; or a list of them, one for each tool, with
                the same ticks. The bodies get the sum of the forces of all tools.
            p_WT: (3,) position of the tool at the end of the step [m], to which it moves linearly; or a function that
                returns the position, or a pose (4, 4), at each tick. For a list of tools, one of these for each.
            each: called with the command of each tick, for a device; with a list of commands for a list of tools.

        Raises:
            PathError: positions that are not three numbers for each tool.
            SceneError: a body of the simulation is not in the scene, or the tools have different ticks.
        """
        several = not hasattr(renderer, "step")
        tools = self._bind(*renderer) if several else self._bind(renderer)
        count = self._count(tools[0][0].tick_s)
        read = p_WT if callable(p_WT) else _straight([one for one, _ in tools], p_WT, count)

        def tick() -> None:
            places = numbers(read())
            each_of = (4, 4) if places.shape[-2:] == (4, 4) else (3,)
            if places.size != math.prod(each_of) * len(tools):
                raise PathError(f"p_WT has {places.size} numbers; expected three for each of {len(tools)} tools [m]")
            places = places.reshape(-1, *each_of)
            made = [one.step(p, bodies) for (one, bodies), p in zip(tools, places, strict=True)]
            self._command = made if several else made[0]
            if each is not None:
                each(self._command)

        self._advance(count, tick)
        return self._command

    def run(self, renderer: "Renderer", p_WT: ArrayLike) -> "Recording":
        """Render a path (n, 3) [m], one position per tick, while the simulation runs; return the recording.

        Raises:
            PathError: a path that is empty, of another shape, or not finite.
            SceneError: a body of the simulation is not in the scene.
        """
        path = positions(np.ascontiguousarray(numbers(p_WT)))
        n, done = len(path), 0
        rows, a_m_s2 = records(n, ROW), np.zeros((n, renderer.block))
        ((_, bodies),) = self._bind(renderer)

        def tick() -> None:
            nonlocal done
            renderer.step(path[done], bodies)
            rows[done], a_m_s2[done] = renderer._row[0], renderer._samples[0]
            done += 1

        while done < n:
            self._advance(min(self._count(renderer.tick_s), n - done), tick)
        renderer._ticks -= n
        return renderer.recording(rows, a_m_s2)

    def run_twin(self, twin: "Twin", intent: "ReferenceTrajectory") -> "ClosedLoopResult":
        """Simulate a reference trajectory of a hand in closed loop, as `Twin.run`, while the simulation runs.

        Raises:
            SceneError: a body of the simulation is not in the scene.
        """
        from hapscene.loop.twin import Run

        ((_, bodies),), done = self._bind(twin.renderer), 0
        twin.begin(intent)
        run = Run(twin, intent, bodies.index, bodies.poses, bodies.teleported)
        while done < len(intent):
            count = min(self._count(twin.renderer.tick_s), len(intent) - done)
            self._advance(count, lambda: run.advance(1))
            done += count
        return run.result()

    def teleport(self, name: str) -> None:
        """Move a body to its simulated pose in the next step, without contact on the way.

        Raises:
            SceneError: the simulation does not move such a body.
        """
        if name not in self.simulation.names:
            raise SceneError(no_such("moving body", name, self.simulation.names))
        self._jumps.add(name)

    def _bind(self, *renderers: "Renderer") -> "list[tuple[Renderer, MovingBodies]]":
        """The tools: each renderer with its slots of the bodies; created for each new renderer."""
        if not renderers or list(renderers) != [one for one, _ in self._tools]:
            if len({one.tick_s for one in renderers}) != 1:
                raise SceneError("expected one or more renderers with the same tick_s")
            n = len(self.simulation.names)
            self._tools = [(one, one.moving_bodies(self.simulation.names)) for one in renderers]
            for _, bodies in self._tools[1:]:
                bodies.poses = self._tools[0][1].poses  # one array for all
            renderer = renderers[0]
            self._jumps = set(self.simulation.names)
            self._pending_s = max(0.0, renderer.tick_s - self.simulation.step_s)  # so that the first step has a tick
            self._X_WB = np.tile(np.eye(4), (n, 1, 1))
            self._twist, self._push, self._held, self._rest = np.zeros((4, n, 6))
            self._warned: set[int] = set()
        return self._tools

    def _count(self, tick_s: float) -> int:
        """Number of ticks in the next step."""
        self._pending_s += self.simulation.step_s
        count = math.floor(self._pending_s / tick_s * (1.0 + 1e-12) + 1e-9)
        self._pending_s = max(0.0, self._pending_s - count * tick_s)
        return count

    def _given(self) -> Array:
        """The total impulse (n, 6) of all tools on each body."""
        total: Array = np.sum([one.world.impulse[bodies.index] for one, bodies in self._tools], axis=0)
        return total

    def _advance(self, count: int, tick: Callable[[], None]) -> None:
        """Run `count` ticks, then one step with the impulses of the ticks."""
        simulation, (renderer, bodies) = self.simulation, self._tools[0]
        slow = simulation.step_s > renderer.tick_s * (1.0 + 1e-9)
        led = self._read_poses(bodies, slow)
        dt_s = simulation.step_s / max(count, 1)
        twist, pending, pushed = self._twist.copy(), *np.zeros((2, len(self._twist), 6))
        mobility: dict[int, Array] = {}
        for _ in range(count):
            was = self._given()
            tick()
            given = self._given() - was
            pending += given
            for i in np.flatnonzero(given.any(axis=1)).tolist():
                if i not in mobility:
                    mobility[i] = np.asarray(simulation.mobility(i), np.float64)
                pushed[i] += mobility[i] @ given[i]
                twist[i] += mobility[i] @ given[i]
            self._check(mobility)
            if slow:
                twist += self._rest * dt_s
                _move(bodies.X_WB, (twist + led) * dt_s)
        self._push = pushed / simulation.step_s
        # if steps are shorter than ticks, the whole impulse goes into one step: a force held over a tick adds energy
        simulation.advance(pending / simulation.step_s)

    def _read_poses(self, bodies: "MovingBodies", slow: bool) -> Array:
        """Read the poses of the bodies; return the twist (n, 6) that leads predicted bodies there within a step."""
        X_WB = np.empty_like(self._X_WB)
        X_WB[:, 3] = (0.0, 0.0, 0.0, 1.0)
        self.simulation.read(X_WB)
        lost = [not np.isfinite(X).all() for X in self._X_WB + bodies.X_WB]  # the simulation diverged and was reset
        jumps = [i for i, name in enumerate(bodies.names) if name in self._jumps or lost[i]]
        for _, slots in self._tools:
            slots.teleported[jumps] = 1
        self._jumps.clear()
        if not slow:
            bodies.X_WB = X_WB
            return self._twist
        self._X_WB[jumps] = bodies.X_WB[jumps] = X_WB[jumps]
        twist = _between(self._X_WB, X_WB) / self.simulation.step_s
        twist[jumps] = self._twist[jumps] = self._push[jumps] = self._held[jumps] = 0.0
        rest = (twist - self._twist) / self.simulation.step_s - self._push
        for part in (slice(0, 3), slice(3, 6)):  # an impact lasts one step and is not extrapolated
            size, before = (np.linalg.norm(a[:, part], axis=1) for a in (rest, self._held))
            self._rest[:, part] = rest[:, part] * np.minimum(1.0, before / np.maximum(size, 1e-300))[:, None]
        self._X_WB, self._twist, self._held = X_WB, twist, rest
        return _between(bodies.X_WB, X_WB) / self.simulation.step_s

    def _check(self, mobility: dict[int, Array]) -> None:
        """Warn once of each touched body that is too light."""
        touches = [(one, bodies, one.surface.touch[0]) for one, bodies in self._tools]
        if not any(touch.began for _, _, touch in touches):
            return
        tick_s = self._tools[0][0].tick_s
        period_s = max(self.simulation.step_s, tick_s)
        most = ratio_max(math.ceil(period_s / tick_s - 1e-9))
        for i in mobility.keys() - self._warned:
            ratio = stiffness_N_m = 0.0  # of all tools on the body, as springs side by side
            for renderer, bodies, touch in touches:
                if bodies.index[i] == touch.body:
                    line = np.concatenate((touch.nhat_W, np.cross(touch.p_WC_m - bodies.X_WB[i, :3, 3], touch.nhat_W)))
                    stiffness = renderer._fit.given[touch.swatch][WALL, STIFFNESS]
                    stiffness_N_m += stiffness
                    ratio += float(line @ mobility[i] @ line) * stiffness * period_s**2
            if ratio > most:
                self._warned.add(i)
                least_kg = stiffness_N_m * period_s**2 / most
                warn(
                    f"body {bodies.names[i]!r} will chatter: its effective mass at the contact is "
                    f"{1e3 * least_kg * most / ratio:.3g} g; at {stiffness_N_m:.0f} N/m and steps of "
                    f"{1e3 * period_s:.3g} ms, at least {1e3 * least_kg:.3g} g is stable. Use a heavier body, a softer "
                    f"swatch, or steps shorter by a factor of {(ratio / most) ** 0.5:.2g}",
                    ChatterWarning,
                )


def _straight(renderers: "Sequence[Renderer]", p_WT: ArrayLike, count: int) -> Callable[[], Array]:
    """Return a function that gives the positions (tools, 3) of the next `count` ticks on lines from the present ones
    to `p_WT`."""
    goal = numbers(p_WT)
    if goal.size != 3 * len(renderers):
        raise PathError(f"p_WT has {goal.size} numbers; expected three for each of {len(renderers)} tools [m]")
    goal = goal.reshape(-1, 3)
    starts = zip(renderers, goal, strict=True)
    start = np.array([one.surface.memory["p_WT_m"][0] if one._started else p for one, p in starts])
    path = iter(start + (goal - start) * (np.arange(1, count + 1) / max(count, 1))[:, None, None])
    return lambda: next(path)


def _between(X_from: Array, X_to: Array) -> Array:
    """Motions (n, 6) of origin and rotation between poses (n, 4, 4)."""
    turn = X_to[:, :3, :3] @ X_from[:, :3, :3].transpose(0, 2, 1)
    axis = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1
    )
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
    axis *= (angle / np.maximum(sine, 1e-300))[:, None]
    return np.hstack((X_to[:, :3, 3] - X_from[:, :3, 3], axis))


def _move(X_WB: Array, motion: Array) -> None:
    """Move poses (n, 4, 4) by motions (n, 6)."""
    X_WB[:, :3, 3] += motion[:, :3]
    angle = np.linalg.norm(motion[:, 3:], axis=1)[:, None, None]
    axis = crosses(motion[:, 3:])
    turn = np.eye(3) + np.sinc(angle / np.pi) * axis + 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2 * (axis @ axis)
    X_WB[:, :3, :3] = turn @ X_WB[:, :3, :3]


def crosses(v: ArrayLike) -> Array:
    """Cross-product matrices (n, 3, 3) of v (n, 3)."""
    x, y, z = np.asarray(v, np.float64).T
    o = np.zeros_like(x)
    return np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)
