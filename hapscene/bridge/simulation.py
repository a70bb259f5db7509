"""A simulation that moves the bodies of a scene, and a renderer that touches them, in one loop of two rates.

In each step of the simulation its poses are felt for as many ticks as it lasts, and what the tool gave to each body in
them is applied to it as a wrench over the step, so that what the hand loses the body gets. A simulation slower than the
tick is predicted between its steps: a body goes on with its velocity, under the tool's force and what held against it
in the last step, and is led to where the simulation has it within the next one. Poses held would make steps of force.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Final, Protocol

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

__all__ = ["RATIO_MAX", "Array", "Bridge", "ChatterWarning", "Simulation", "crosses", "free_mobility", "ratio_max"]

Array = NDArray[np.float64]

RATIO_MAX: Final = 4.0
"""Most K T²/m of a spring K to a mass m, its force held for a step T of the semi-implicit Euler method [1]: there the
eigenvalues of [[1 − K T²/m, 1], [−K T²/m, 1]] leave the unit circle, through −1."""


class ChatterWarning(UserWarning):
    """A body that is too light for its stiffness and the simulation's step: pushed, it will chatter."""


class Simulation(Protocol):
    """What a bridge needs of a simulation: three methods, and two numbers that stay.

    Attributes:
        names: of the bodies that it moves, as the scene calls them.
        step_s: how long one of its steps is [s].
    """

    @property
    def names(self) -> Sequence[str]: ...

    @property
    def step_s(self) -> float: ...

    def read(self, X_WB: Array) -> None:
        """Write the present poses of the bodies into X_WB (n, 4, 4)."""

    def mobility(self, body: int) -> ArrayLike:
        """How the body of this index gives way now: a wrench (6,) times it (6, 6) is acceleration (6,).

        First three numbers of the body's origin, then three of rotation, all in W: N, N·m, m/s², rad/s². Of a free
        body: `free_mobility`. Of one that no force moves: zeros.
        """

    def advance(self, wrench_W: Array) -> None:
        """One step, under forces on the bodies and torques about their origins (n, 6) [N, N·m]."""


def free_mobility(
    mass_kg: float, inertia_B_kg_m2: ArrayLike, R_WB: ArrayLike, com_B_m: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """Mobility (6, 6) of a body that nothing holds: see `Simulation.mobility`.

    Args:
        mass_kg: its mass.
        inertia_B_kg_m2: (3, 3), or (3,) of the principal axes, about its centre of mass, in its frame.
        R_WB: (3, 3) its rotation.
        com_B_m: (3,) its centre of mass.
    """
    inertia, R = np.asarray(inertia_B_kg_m2, np.float64), np.asarray(R_WB, np.float64)
    turn = R @ np.linalg.inv(np.diag(inertia) if inertia.ndim == 1 else inertia) @ R.T
    c = crosses([R @ np.asarray(com_B_m, np.float64)])[0]
    return np.block([[np.eye(3) / mass_kg - c @ turn @ c, c @ turn], [-turn @ c, turn]])


@cache
def ratio_max(count: int) -> float:
    """Most K T²/m of a spring K to a mass m that is simulated in steps T of `count` ticks [1]: beyond, it chatters.

    Of one tick it is `RATIO_MAX`. Of more, the body is predicted: where it is felt, x, its velocity v, and where it is
    simulated, p, to which it is led by p − x within the step, in units of a step. A tick is the first matrix below, the
    end of the step the second; together they hold until an eigenvalue leaves the unit circle: at 1.75 for two ticks,
    at 2.24 for many.
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
    """A renderer and a simulation, step by step.

    Args:
        simulation: anything with the three methods of `Simulation`.

    Attributes:
        simulation: as given.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._renderer: Renderer | None = None
        self._bodies: MovingBodies | None = None
        self._jumps: set[str] = set(simulation.names)

    def __repr__(self) -> str:
        return f"<Bridge: {len(self.simulation.names)} moving; steps of {1e3 * self.simulation.step_s:g} ms>"

    def step(
        self,
        renderer: "Renderer",
        p_WT: "ArrayLike | Callable[[], ArrayLike]",
        each: "Callable[[Command], None] | None" = None,
    ) -> "Command":
        """One step of the simulation, and the ticks that fall into it; the last one's command.

        Where steps are shorter than ticks, some have no tick: the last command stays.

        Args:
            renderer: of a scene with the simulation's bodies.
            p_WT: (3,) where the tool is at the step's end [m], to which it goes straight; or what reads it, tick by
                tick.
            each: is given the command of each tick, for a device.

        Raises:
            PathError: a position that is not three numbers.
            SceneError: the scene lacks a body of the simulation.
        """
        bodies = self._bind(renderer)
        count = self._count(renderer.tick_s)
        read = p_WT if callable(p_WT) else _straight(renderer, p_WT, count)

        def tick() -> None:
            self._command = renderer.step(read(), bodies)
            if each is not None:
                each(self._command)

        self._advance(renderer, count, tick)
        return self._command

    def run(self, renderer: "Renderer", p_WT: ArrayLike) -> "Recording":
        """Touch along a path (n, 3) [m], a position per tick, while the simulation goes on; what was felt.

        Raises:
            PathError: a path that is empty, of another shape, or not finite.
            SceneError: the scene lacks a body of the simulation.
        """
        path = positions(np.ascontiguousarray(numbers(p_WT)))
        n, done = len(path), 0
        rows, a_m_s2 = records(n, ROW), np.zeros((n, renderer.block))
        bodies = self._bind(renderer)

        def tick() -> None:
            nonlocal done
            renderer.step(path[done], bodies)
            rows[done], a_m_s2[done] = renderer._row[0], renderer._samples[0]
            done += 1

        while done < n:
            self._advance(renderer, min(self._count(renderer.tick_s), n - done), tick)
        renderer._ticks -= n
        return renderer.recording(rows, a_m_s2)

    def live(self, twin: "Twin", intent: "ReferenceTrajectory") -> "ClosedLoopResult":
        """Live through an intention of a hand in closed loop, while the simulation goes on: see `Twin.run`.

        Raises:
            SceneError: the twin's scene lacks a body of the simulation.
        """
        from hapscene.loop.twin import Run

        bodies, done = self._bind(twin.renderer), 0
        twin.begin(intent)
        run = Run(twin, intent, bodies.index, bodies.poses, bodies.teleported)
        while done < len(intent):
            count = min(self._count(twin.renderer.tick_s), len(intent) - done)
            self._advance(twin.renderer, count, lambda: run.advance(1))
            done += count
        return run.result()

    def teleport(self, name: str) -> None:
        """In the next step the body appears where the simulation has put it, touching nothing on its way.

        Raises:
            SceneError: the simulation moves no such body.
        """
        if name not in self.simulation.names:
            raise SceneError(no_such("moving body", name, self.simulation.names))
        self._jumps.add(name)

    def _bind(self, renderer: "Renderer") -> "MovingBodies":
        """The slots of the bodies; anew for another renderer."""
        if self._bodies is None or renderer is not self._renderer:
            n = len(self.simulation.names)
            self._renderer, self._bodies = renderer, renderer.moving_bodies(self.simulation.names)
            self._jumps = set(self.simulation.names)
            self._late_s = max(0.0, renderer.tick_s - self.simulation.step_s)  # the first step has a tick
            self._X_WB = np.tile(np.eye(4), (n, 1, 1))
            self._twist, self._push, self._held, self._rest = np.zeros((4, n, 6))
            self._warned: set[int] = set()
        return self._bodies

    def _count(self, tick_s: float) -> int:
        """How many ticks fall into the next step."""
        self._late_s += self.simulation.step_s
        count = math.floor(self._late_s / tick_s * (1.0 + 1e-12) + 1e-9)
        self._late_s = max(0.0, self._late_s - count * tick_s)
        return count

    def _advance(self, renderer: "Renderer", count: int, tick: Callable[[], None]) -> None:
        """One step: `count` ticks on its bodies, then what they were given goes to the simulation."""
        assert self._bodies is not None
        simulation, bodies = self.simulation, self._bodies
        slow = simulation.step_s > renderer.tick_s * (1.0 + 1e-9)
        led = self._see(bodies, slow)
        dt_s = simulation.step_s / max(count, 1)
        twist, pending, pushed = self._twist.copy(), *np.zeros((2, len(self._twist), 6))
        mobility: dict[int, Array] = {}
        for _ in range(count):
            was = renderer.world.impulse[bodies.index]
            tick()
            given = renderer.world.impulse[bodies.index] - was
            pending += given
            for i in np.flatnonzero(given.any(axis=1)).tolist():
                if i not in mobility:
                    mobility[i] = np.asarray(simulation.mobility(i), np.float64)
                pushed[i] += mobility[i] @ given[i]
                twist[i] += mobility[i] @ given[i]
            self._check(renderer, bodies, mobility)
            if slow:
                twist += self._rest * dt_s
                _move(bodies.X_WB, (twist + led) * dt_s)
        self._push = pushed / simulation.step_s
        # all at once where steps are shorter than ticks: held over a tick, a spring gains energy
        simulation.advance(pending / simulation.step_s)

    def _see(self, bodies: "MovingBodies", slow: bool) -> Array:
        """Read where the bodies are; the twist (n, 6) that leads the predicted ones there within a step."""
        X_WB = np.empty_like(self._X_WB)
        X_WB[:, 3] = (0.0, 0.0, 0.0, 1.0)
        self.simulation.read(X_WB)
        lost = [not np.isfinite(X).all() for X in self._X_WB + bodies.X_WB]  # it has burst, and began anew
        jumps = [i for i, name in enumerate(bodies.names) if name in self._jumps or lost[i]]
        bodies.teleported[jumps] = 1
        self._jumps.clear()
        if not slow:
            bodies.X_WB = X_WB
            return self._twist
        self._X_WB[jumps] = bodies.X_WB[jumps] = X_WB[jumps]
        twist = _between(self._X_WB, X_WB) / self.simulation.step_s
        twist[jumps] = self._twist[jumps] = self._push[jumps] = self._held[jumps] = 0.0
        rest = (twist - self._twist) / self.simulation.step_s - self._push
        for part in (slice(0, 3), slice(3, 6)):  # a shock lasts one step, and is not expected again
            size, before = (np.linalg.norm(a[:, part], axis=1) for a in (rest, self._held))
            self._rest[:, part] = rest[:, part] * np.minimum(1.0, before / np.maximum(size, 1e-300))[:, None]
        self._X_WB, self._twist, self._held = X_WB, twist, rest
        return _between(bodies.X_WB, X_WB) / self.simulation.step_s

    def _check(self, renderer: "Renderer", bodies: "MovingBodies", mobility: dict[int, Array]) -> None:
        """Warn of a touched body that is too light, once."""
        touch = renderer.surface.touch[0]
        if not touch.began:
            return
        period_s = max(self.simulation.step_s, renderer.tick_s)
        most = ratio_max(math.ceil(period_s / renderer.tick_s - 1e-9))
        for i in mobility.keys() - self._warned:
            if bodies.index[i] != touch.body:
                continue
            line = np.concatenate((touch.nhat_W, np.cross(touch.p_WP_m - bodies.X_WB[i, :3, 3], touch.nhat_W)))
            stiffness_N_m = renderer._fit.given[touch.swatch][WALL, STIFFNESS]
            ratio = float(line @ mobility[i] @ line) * stiffness_N_m * period_s**2
            if ratio > most:
                self._warned.add(i)
                least_kg = stiffness_N_m * period_s**2 / most
                warn(
                    f"body {bodies.names[i]!r} will chatter: where it is pushed, at {stiffness_N_m:.0f} N/m, it is as "
                    f"a mass of {1e3 * least_kg * most / ratio:.3g} g, and steps of {1e3 * period_s:.3g} ms hold "
                    f"{1e3 * least_kg:.3g} g or more: make it heavier, its swatch softer, or the steps "
                    f"{(ratio / most) ** 0.5:.2g} times as short",
                    ChatterWarning,
                )


def _straight(renderer: "Renderer", p_WT: ArrayLike, count: int) -> Callable[[], Array]:
    """Gives the positions of the next `count` ticks, straight from where the tool was to (3,)."""
    goal = numbers(p_WT)
    if goal.shape != (3,):
        raise PathError(f"a position is three numbers in metres; it has {goal.size}")
    start = np.array(renderer.surface.memory["p_WT_m"][0]) if renderer._started else goal
    path = iter(start + (goal - start) * (np.arange(1, count + 1) / max(count, 1))[:, None])
    return lambda: next(path)


def _between(X_from: Array, X_to: Array) -> Array:
    """The motions (n, 6), of origin and rotation, from poses to others (n, 4, 4)."""
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
    """Matrices (n, 3, 3) that do v (n, 3) ×."""
    x, y, z = np.asarray(v, np.float64).T
    o = np.zeros_like(x)
    return np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)
