"""A simulation that moves the bodies of a scene, and a renderer that touches them, in one loop of two rates.

Each step of the simulation: its poses are felt for as many ticks as it lasts, and what the tool gave to each body in
them is applied to it as a wrench over the step, so that what the hand loses the body gets. A simulation slower than the
tick is predicted between its steps: a body goes on with its velocity, under the tool's force and what held against it in
the last step, and is led to where the simulation has it within the next one. Poses held instead make steps of force.
"""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import PathError, SceneError, warn
from hapscene.geometry import numbers, positions
from hapscene.records import ROW, records

if TYPE_CHECKING:
    from hapscene.moving_bodies import MovingBodies
    from hapscene.recording import Recording
    from hapscene.renderer import Command, Renderer

Array = NDArray[np.float64]

HELD_MAX: Final = 4.0
"""Most K T²/m of a spring K to a mass m whose force is held for a step T, of the semi-implicit Euler method [1]: there
the eigenvalues of its matrix [[1 − K T²/m, 1], [−K T²/m, 1]] leave the unit circle, through −1."""

PREDICTED_MAX: Final = 2.237
"""The same where the body is predicted between steps, in ticks much shorter than them [1]. With θ² = K T²/m, the felt
place x, the velocity v in units of a step and the simulated place p, of which x is led by p − x, a step is

    x' = x cos θ + (v + p − x) sin θ / θ,    v' = −θ x sin θ + (v + p − x) cos θ − (p − x),    p' = p + v'

whose largest eigenvalue is 1 in size there. Below, it damps."""


class ChatterWarning(UserWarning):
    """A body that is too light for its stiffness and the simulation's step: pushed, it will chatter."""


class Simulation(Protocol):
    """What a bridge needs of a simulation: three methods, and two numbers that stay.

    Attributes:
        names: of the bodies that it moves, as the scene calls them.
        step_s: how long one of its steps is [s].
    """

    names: Sequence[str]
    step_s: float

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
    x, y, z = R @ np.asarray(com_B_m, np.float64)
    c = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[np.eye(3) / mass_kg - c @ turn @ c, c @ turn], [-turn @ c, turn]])


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
        goal = None if callable(p_WT) else numbers(p_WT)
        if goal is not None and goal.shape != (3,):
            raise PathError(f"a position is three numbers in metres; it has {goal.size}")
        last = renderer.surface.memory["p_WT_m"][0].copy() if renderer._started else goal

        def tick(k: int) -> None:
            at = p_WT() if callable(p_WT) else last + (goal - last) * ((k + 1) / count)
            self._command = renderer.step(at, bodies)
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

        def tick(_: int) -> None:
            nonlocal done
            renderer.step(path[done], bodies)
            rows[done], a_m_s2[done] = renderer._row[0], renderer._samples[0]
            done += 1

        while done < n:
            self._advance(renderer, min(self._count(renderer.tick_s), n - done), tick)
        renderer._ticks -= n
        return renderer.recording(rows, a_m_s2)

    def teleport(self, name: str) -> None:
        """In the next step the body appears where the simulation has put it, touching nothing on its way.

        Raises:
            SceneError: the simulation moves no such body.
        """
        from hapscene.errors import no_such

        if name not in self.simulation.names:
            raise SceneError(no_such("moving body", name, self.simulation.names))
        self._jumps.add(name)

    def _bind(self, renderer: "Renderer") -> "MovingBodies":
        """The slots of the bodies; anew for another renderer."""
        if self._bodies is None or renderer is not self._renderer:
            n = len(self.simulation.names)
            self._renderer, self._bodies = renderer, renderer.moving(self.simulation.names)
            self._jumps = set(self.simulation.names)
            self._late_s = max(0.0, renderer.tick_s - self.simulation.step_s)  # the first step has a tick
            self._pending = np.zeros((n, 6))
            self._X_WB, self._twist, self._push, self._rest = np.tile(np.eye(4), (n, 1, 1)), *np.zeros((3, n, 6))
            self._warned: set[int] = set()
        return self._bodies

    def _count(self, tick_s: float) -> int:
        """How many ticks fall into the next step."""
        self._late_s += self.simulation.step_s
        count = math.floor(self._late_s / tick_s * (1.0 + 1e-12) + 1e-9)
        self._late_s = max(0.0, self._late_s - count * tick_s)
        return count

    def _advance(self, renderer: "Renderer", count: int, tick: Callable[[int], None]) -> None:
        """One step: `count` ticks on its bodies, then what they were given goes to the simulation."""
        assert self._bodies is not None
        simulation, bodies = self.simulation, self._bodies
        slow = simulation.step_s > renderer.tick_s * (1.0 + 1e-9)
        led = self._see(bodies, slow)
        dt_s = simulation.step_s / max(count, 1)
        twist, pushed = self._twist.copy(), np.zeros_like(self._twist)
        mobility: dict[int, Array] = {}
        for k in range(count):
            was = np.zeros_like(self._pending) if not renderer._started else renderer.world.impulse[bodies.index]
            tick(k)
            given = renderer.world.impulse[bodies.index] - was
            self._pending += given
            for i in np.flatnonzero(given.any(axis=1)).tolist():
                if i not in mobility:
                    mobility[i] = np.asarray(simulation.mobility(i), np.float64)
                pushed[i] += mobility[i] @ given[i]
                twist[i] += mobility[i] @ given[i]
            self._check(renderer, bodies, mobility, slow)
            if slow:
                twist += self._rest * dt_s
                _move(bodies.X_WB, (twist + led) * dt_s)
        self._push = pushed / simulation.step_s
        steps = 1 if slow else math.ceil((renderer.tick_s - self._late_s) / simulation.step_s - 1e-9)  # to the next tick
        share = self._pending / max(steps, 1)
        self._pending -= share
        simulation.advance(share / simulation.step_s)

    def _see(self, bodies: "MovingBodies", slow: bool) -> Array:
        """Read where the bodies are; the twist (n, 6) that leads the predicted ones there within a step."""
        X_WB = np.empty_like(self._X_WB)
        X_WB[:, 3] = (0.0, 0.0, 0.0, 1.0)
        self.simulation.read(X_WB)
        jumps = [bodies.names.index(name) for name in self._jumps]
        bodies.teleported[jumps] = 1
        self._jumps.clear()
        if not slow:
            bodies.X_WB = X_WB
            return self._twist
        self._X_WB[jumps] = bodies.X_WB[jumps] = X_WB[jumps]
        twist = _between(self._X_WB, X_WB) / self.simulation.step_s
        twist[jumps] = self._twist[jumps] = self._push[jumps] = 0.0
        rest = (twist - self._twist) / self.simulation.step_s - self._push
        for part in (slice(0, 3), slice(3, 6)):  # what holds against a push is not more than it
            most, size = (np.linalg.norm(a[:, part], axis=1) for a in (self._push, rest))
            rest[:, part] *= np.minimum(1.0, most / np.maximum(size, 1e-300))[:, None]
        self._X_WB, self._twist, self._rest = X_WB, twist, rest
        return _between(bodies.X_WB, X_WB) / self.simulation.step_s

    def _check(self, renderer: "Renderer", bodies: "MovingBodies", mobility: dict[int, Array], slow: bool) -> None:
        """Warn of a touched body that is too light, once."""
        touch = renderer.surface.touch[0]
        for i in mobility.keys() - self._warned if touch.began else ():
            if bodies.index[i] != touch.body:
                continue
            n, r = touch.nhat_W, touch.p_WP_m - bodies.X_WB[i, :3, 3]
            line = np.concatenate((n, np.cross(r, n)))
            period_s = max(self.simulation.step_s, renderer.tick_s)
            stiffness_N_m = renderer._fit.given[touch.swatch][-1, "stiffness_N_m"]
            most = PREDICTED_MAX if slow else HELD_MAX
            ratio = float(line @ mobility[i] @ line) * stiffness_N_m * period_s**2
            if ratio > most:
                self._warned.add(i)
                warn(
                    f"body {bodies.names[i]!r} will chatter: pushed at {stiffness_N_m:.0f} N/m it is as a mass of "
                    f"{1e3 * stiffness_N_m * period_s**2 / ratio:.3g} g, and steps of {1e3 * period_s:.3g} ms hold "
                    f"{1e3 * stiffness_N_m * period_s**2 / most:.3g} g or more (K T²/m of {ratio:.3g}, at most "
                    f"{most:.3g}): make it heavier, softer, or the steps {(ratio / most) ** 0.5:.2g} times as short",
                    ChatterWarning,
                )


def _between(X_from: Array, X_to: Array) -> Array:
    """The motions (n, 6), of origin and rotation, from poses to others (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    turn = X_to[:, :3, :3] @ X_from[:, :3, :3].transpose(0, 2, 1)
    return np.hstack((X_to[:, :3, 3] - X_from[:, :3, 3], Rotation.from_matrix(turn).as_rotvec()))


def _move(X_WB: Array, motion: Array) -> None:
    """Move poses (n, 4, 4) by motions (n, 6)."""
    from scipy.spatial.transform import Rotation

    X_WB[:, :3, 3] += motion[:, :3]
    X_WB[:, :3, :3] = Rotation.from_rotvec(motion[:, 3:]).as_matrix() @ X_WB[:, :3, :3]
