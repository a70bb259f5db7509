"""The servo: the haptic loop in real time, in a separate process, and the interface to it for an application."""

import math
import operator
import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, REACH_MAX_M, TICK_S
from hapscene.contact.deformation import shape_of
from hapscene.contact.prediction import HORIZON_S
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.device.model import DEVICES, DeviceLike
from hapscene.device.sim.hand import Grip, grip_named
from hapscene.errors import HapsceneError, PathError, SceneError, no_such
from hapscene.flags import Flag
from hapscene.geometry import numbers, positions
from hapscene.handle.plant import Plant
from hapscene.loop.servo_connection import ServoConnection
from hapscene.loop.servo_state import STOPS, ButtonEvent, Mode, ServoState, TickLog, button_events_of, state_of
from hapscene.loop.session_log import SessionLog, log_of, note_order
from hapscene.loop.shared_memory import read_text
from hapscene.loop.timing import TimingStatistics
from hapscene.records import Record, block_of
from hapscene.render.contact_info import Contact, ContactEvent, Impulse, events_of
from hapscene.render.moving_bodies import warn_of_refused
from hapscene.render.renderer import OTHER_BODIES, warn_of_far
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import Painting
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import SwatchLike

__all__ = ["BODY_ROOM", "Servo"]

RING_S: Final = 8.0
"""Length of the ring buffers of ticks [s]: an application that blocks for some seconds loses nothing."""

BODY_ROOM: Final = 1024
"""Bodies that can be added to a running servo, including replacements of removed ones [count]: 0.5 kB each."""

BUTTON_S: Final = 0.005
"""Interval at which `Servo.on_button` looks for events [s]."""


class Servo(ServoConnection):
    """The haptic loop in real time, in a separate process.

    Use a servo as a context manager: it allocates memory and starts the process on entry, and ends both on exit. The
    process also ends with the application, however that ends. Ctrl-C and a closed terminal do not reach the process.

    Args:
        scene: the scene, which is copied.
        device: a simulated device or its name, which sets its limits (see `Twin`), or the name of the driver of a real
            device; options of a driver are set with `hapscene.device.choose`. A list of devices makes several tools
            that touch the scene in one loop, numbered from 0.
        tick_s, a_rate_Hz: see `Renderer`.
        handle: haptography handle that plays the acceleration of the first tool: a simulated handle, or a real one by
            the name of its output, such as "audio", with options set by `hapscene.device.choose`.
        handle_file: file of a real handle that `hapscene device identify` wrote; its compensator drives the handle.
        log_folder: folder to which a session log is written when a device fails or the application ends.
        force_N: maximum force of real devices; the limit of a device applies if it is lower.
        patience_s: time without a call of the application after which the force ends [s], to detect a program that
            hangs. An application that is killed, stopped or suspended is detected within 20 ms in any case.
        ring_s: length of the ring buffers of ticks [s].
        progress: called with the stages of the start, as text.
        made: further arguments of `Twin`: effects, settings, seed, handle, compensator, X_WD, tip_radius_m;
            for simulated devices also limits and delay_ticks.

    Attributes:
        scene: the copy of the scene that is rendered, with bodies added, removed and painted since.
        body_names: names of its bodies by number, including those that were removed.
        tip_radius_m: radius of the tip.

    Raises:
        HapsceneError: on entry, if `Twin` rejects an argument or shared memory is too small; in every later call, if
            the process has ended or the tool does not exist.
    """

    def __init__(
        self,
        scene: Scene,
        device: "DeviceLike | DeviceChoice | Sequence[DeviceLike | DeviceChoice]",
        *,
        tick_s: float = TICK_S,
        a_rate_Hz: float = ACCELERATION_RATE_HZ,
        handle: Plant | DeviceChoice | str | None = None,
        handle_file: "str | os.PathLike[str] | None" = None,
        log_folder: "str | os.PathLike[str] | None" = None,
        force_N: float | None = None,
        patience_s: float = math.inf,
        ring_s: float = RING_S,
        progress: Callable[[str], None] = lambda text: None,
        **made: Any,
    ) -> None:
        given: list[Any] = list(device) if isinstance(device, list | tuple) else [device]
        devices = [_device(one) for one in given]
        if not devices:
            raise HapsceneError('device is an empty list: give at least one device, as ["omni"]')
        if not patience_s > 0.0 or not 0.0 < ring_s < math.inf:
            raise HapsceneError(f"patience_s and ring_s must be above 0, are {patience_s} and {ring_s}")
        if force_N is not None and not force_N >= 0.0:
            raise HapsceneError(f"force_N must be at least 0, is {force_N}")
        real_handle = DeviceChoice(handle) if isinstance(handle, str) else handle
        if isinstance(real_handle, DeviceChoice):
            real_handle.checked(handle=True)  # raises before anything is started
        elif handle is not None:
            made["handle"] = handle
        self.tick_s = tick_s
        self.tip_radius_m = float(made.get("tip_radius_m", 0.0))
        block = block_of(tick_s, a_rate_Hz)
        self.scene = scene.copy()
        room = len(scene.bodies) + BODY_ROOM
        own = {"devices": devices, "bodies": room, "force_N": force_N}
        own["log_folder"] = None if log_folder is None else os.fspath(log_folder)
        super().__init__(
            {"scene": self.scene, **own, "tick_s": tick_s, "a_rate_Hz": a_rate_Hz, **made},
            [one for one in devices if isinstance(one, DeviceChoice)],
            real_handle if isinstance(real_handle, DeviceChoice) else None,
            None if handle_file is None else os.fspath(handle_file),
            shape=(max(math.ceil(ring_s / tick_s), 2), block, room, len(devices)),
            a_rate_Hz=a_rate_Hz,
            patience_s=patience_s,
            progress=progress,
        )
        self.body_names = [body.name for body in scene.bodies]
        self._index_of = {name: index for index, name in enumerate(self.body_names)}
        self._moving: set[int] = set()
        self._pose_warned = self._far_warned = False
        self._reported_impulse = np.zeros((room, 6))
        self._tuned: list[tuple[str, str, dict[str, float]]] = []

    def __repr__(self) -> str:
        begun = "not started" if self._process is None else "running" if self.alive else "ended"
        state = "closed" if self._closed else begun
        return f"<Servo: {state}; ticks of {1e3 * self.tick_s:g} ms, a_rate_Hz={self.a_rate_Hz:g}>"

    def handle_report(self) -> dict[str, float]:
        """Return the state of a real handle: latency [s], clock drift [ppm] and error counts; empty without one.

        Raises:
            HandleError: the handle has stopped, and why.
        """
        return {} if self._played is None else self._played.update_report()

    def turn_handle(self, volume: float) -> None:
        """Set the share (0 to 1) of its gain at which a real handle plays; no effect without one.

        Raises:
            HandleError: the handle has stopped, and why.
        """
        if self._played is not None:
            self._played.set_volume(volume)

    @property
    def mode(self) -> Mode:
        """What the servo does.

        "running": ticks run. "stopped": ticks run, and a safety stop removes the force of a tool; it ends by itself
        when its cause is over. "paused": no ticks until `start` or `resume`. "error": a device failed, and every call
        raises its error until `recover`. "ended": the process has ended or was not started.
        """
        if self._opened is None or not self.alive:
            return "ended"
        if self._opened.fault[0]:
            return "error"
        if self._opened.channel[0].pause:
            return "paused"
        return "stopped" if any(self.state(tool=tool).flags & STOPS for tool in range(self._tools)) else "running"

    def recover(self) -> None:
        """Open all real devices again after a fault. The servo is then paused: call `start` or `resume`.

        Raises:
            HapsceneError: a device cannot be opened, or the process has ended.
        """
        if self._opened is not None:
            self._opened.fault[:] = 0
        self._order("recover", self._choices)

    def home(self) -> None:
        """Take the present position of each device that is not ready as its home position (`Driver.home`).

        Raises:
            HapsceneError: no device waits for its home position, or one failed.
        """
        self._order("home")

    @property
    def notice(self) -> str:
        """Message of a real device that needs attention; empty without one.

        Raises:
            DeviceError: a device failed.
        """
        return read_text(self._channel.notice)

    def device_state(self, *, tool: int = 0) -> Record:
        """Return a copy of the last state (DEVICE_STATE,) of a real device.

        It has readiness, buttons, temperature, orientation, velocity and gripper, as far as the device has them, in the
        device frame.
        """
        state: Record = self._channel.states[self._number(tool)].copy()
        return state

    def tool_pose(self, *, tool: int = 0) -> NDArray[np.float64]:
        """Return the pose (4, 4) of a real device's tool in W; z is along the handle, towards the hand."""
        X_WT, X_WD = np.eye(4), self._arguments.get("X_WD")
        R_WD = np.eye(3) if X_WD is None else numbers(X_WD)[:3, :3]
        X_WT[:3, :3], X_WT[:3, 3] = R_WD @ self.device_state(tool=tool).R_DT, self.state(tool=tool).p_WT_m
        return X_WT

    def button_events(self, since: int = 0, *, tool: int = 0) -> tuple[list[ButtonEvent], int]:
        """Return the events of the buttons of a device from change `since` on, and the number from which to continue.

        The last 63 changes are available.
        """
        return button_events_of(self.device_state(tool=tool), since)

    def on_button(self, call: Callable[[ButtonEvent], object], *, tool: int = 0) -> None:
        """Call a function for each button event from now on, in a separate thread, within about 10 ms."""
        _, since = self.button_events(tool=tool)

        def watch(since: int) -> None:
            while self.alive and (shared := self._opened) is not None:  # calls of this thread are no sign of life
                states = shared.states  # None once the memory is released
                events, since = ([], since) if states is None else button_events_of(states[tool].copy(), since)
                del shared, states
                for event in events:
                    call(event)
                time.sleep(BUTTON_S)

        threading.Thread(target=watch, args=(since,), name="hapscene buttons", daemon=True).start()

    def start(self, p_WT: ArrayLike, grip: str | Grip = "light", *, tool: int | None = None) -> NDArray[np.float64]:
        """Start with the tool at rest at `p_WT` (3,) [m], the target of the hand; several tools at (tools, 3).

        With `tool`, only that tool starts, at (3,). The others go on; those that were never started touch nothing.

        Returns:
            (bodies, 6) impulses of the started tools so far; `impulse` counts theirs from 0 again.

        Raises:
            PathError: not three finite numbers for each tool.
            HapsceneError: a position is out of reach of its device, or the tool does not exist.
        """
        count = self._tools if tool is None else 1
        places = positions(numbers(p_WT).reshape(1, -1) if count == 1 else np.atleast_2d(numbers(p_WT)))
        if len(places) != count:
            raise PathError(f"p_WT has {len(places)} positions, expected {count}: one for each tool")
        held = grip_named(grip) if isinstance(grip, str) else grip
        one = None if tool is None else self._number(tool)
        given = np.asarray(self._order("start", [tuple(p) for p in places.tolist()], held.row(), one))
        self._reported_impulse = np.zeros_like(given) if one is None else self._reported_impulse - given
        return given

    def withdraw(self, *, tool: int) -> None:
        """Let a tool touch nothing until its next `start`; its force ends."""
        self._order("withdraw", self._number(tool))

    @property
    def tools(self) -> int:
        """Number of tools."""
        return self._tools

    def pause(self) -> None:
        """Stop ticking until the next `start` or `resume`."""
        self._order("pause")

    def stop_force(self) -> None:
        """Remove the force of all tools within 6 ms, while ticks continue; the next `start` or `resume` brings it back.

        It only writes a number to shared memory: it may be called from a signal handler. It does nothing where no
        process runs.
        """
        if self._opened is not None:
            self._opened.channel.stop_force = 1

    def resume(self) -> None:
        """Continue after `pause` with the same contact.

        Raises:
            HapsceneError: the servo was never started.
        """
        self._order("resume")

    def aim(
        self, p_WT: ArrayLike, grip: str | Grip = "light", push_W_N: Sequence[float] = (0.0, 0.0, 0.0), *, tool: int = 0
    ) -> None:
        """Set the target of the hand: position `p_WT` (3,) [m], grip, and push force `push_W_N` (3,) [N].

        Raises:
            PathError: position or force is not three finite numbers.
            HapsceneError: the grip or the tool is unknown, or the process has ended.
        """
        held = grip_named(grip) if isinstance(grip, str) else grip
        p, push = numbers(p_WT), numbers(push_W_N)
        if p.size != 3 or push.size != 3:
            raise PathError(f"p_WT and push_W_N must be three numbers each; they have {p.size} and {push.size}")
        p, push = p.reshape(3), push.reshape(3)
        if not np.abs((p, push)).max() <= REACH_MAX_M:  # also False for NaN
            positions(np.array([p, push]))  # raises the error
        row = held.row()
        _ = self._channel  # raises if no process runs
        aim, count = self._aim[self._number(tool)]
        count[0] |= 1  # also if Ctrl-C interrupted an earlier call and left it odd
        aim[0], aim[1], aim[2] = p, row, push
        count[0] += 1

    def move(
        self,
        body: str,
        X_WB: ArrayLike,
        *,
        v_W_m_s: ArrayLike | None = None,
        w_W_rad_s: ArrayLike | None = None,
        applied: Impulse | None = None,
        teleport: bool = False,
    ) -> None:
        """Send the present pose of a body, as often as it is known: about 60 times a second.

        Between two such frames the pose is predicted (`hapscene.contact.prediction`). Without velocities it is
        interpolated with a delay of one frame; with velocities it is extrapolated. A body with a mass (`set_mass`) is
        also pushed by the tool.

        Args:
            body: name of the body.
            X_WB: (4, 4) pose. An invalid pose sets `Flag.POSE_REFUSED`, and the last valid one is kept.
            v_W_m_s: (3,) velocity of its centre of mass.
            w_W_rad_s: (3,) angular velocity.
            applied: impulse of the tool that the pose contains; by default what `impulse` returned last.
            teleport: the body appears at the pose without colliding on the way.

        Raises:
            SceneError: the body is unknown, the pose is not (4, 4), or a velocity is not three finite numbers.
        """
        index = self._index(body)
        if np.shape(X_WB) != (4, 4):
            raise SceneError(f"pose of body {body!r} has shape {np.shape(X_WB)}, expected a (4, 4) matrix")
        pose, v = numbers(X_WB), np.zeros(6)
        got = self._reported_impulse[index].copy()
        given = (v, v_W_m_s, 0), (v, w_W_rad_s, 3), *((got, part, 3 * k) for k, part in enumerate(applied or ()))
        for out, values, at in given:
            if values is None:
                continue
            vector = numbers(values)
            if vector.shape != (3,) or at > 3 or not np.isfinite(vector).all():
                raise SceneError(f"body {body!r}: velocities and impulses must be three finite numbers each")
            out[at : at + 3] = vector
        shared = self._channel
        frame = self._frames[index]
        frame["count"] |= 1
        frame["time_ns"], frame["lifetime_s"] = self._now_ns(), HORIZON_S
        frame["X_WB"], frame["v"], frame["applied"] = pose, v, got
        frame["teleport_count"] += teleport
        frame["count"] += 1
        if index not in self._moving:
            shared.moving[len(self._moving)] = index
            self._moving.add(index)
            shared.channel[0].moving_count = len(self._moving)

    def set_mass(
        self, body: str, mass_kg: float, *, inertia_B_kg_m2: ArrayLike, com_B_m: ArrayLike = (0.0, 0.0, 0.0)
    ) -> None:
        """Set mass and inertia of a moving body, so that the tool pushes it between its frames.

        Args:
            body: name of the body.
            mass_kg: mass; infinite for a body that the tool does not push.
            inertia_B_kg_m2: inertia (3,) or (3, 3) about the centre of mass, in the axes of the body.
            com_B_m: (3,) centre of mass.

        Raises:
            SceneError: the body is unknown, or mass, inertia or centre of mass are invalid.
        """
        index, inertia, mass = self._index(body), numbers(inertia_B_kg_m2), numbers(mass_kg)
        inertia = np.diag(inertia) if inertia.shape == (3,) else inertia
        above_0 = np.finfo(np.float64).tiny  # whose inverse is finite
        known = inertia.shape == (3, 3) and np.isfinite(inertia).all() and mass.shape == () and mass >= above_0
        good = known and (np.linalg.eigvalsh(inertia) >= above_0).all()
        if not (good and np.abs(inertia - inertia.T).max() <= 1e-6 * np.abs(inertia).max()):
            raise SceneError(
                f"body {body!r}: mass and inertia must be above 0, and the inertia (3,) or a symmetric (3, 3) matrix"
            )
        com_m = numbers(com_B_m)
        if com_m.shape != (3,) or not np.abs(com_m).max() <= REACH_MAX_M:
            raise SceneError(f"body {body!r}: com_B_m must be three finite numbers [m]")
        _ = self._channel
        frame = self._frames[index]
        frame["inverse_mass"] = 1.0 / mass_kg
        frame["com_B_m"] = com_m
        frame["inverse_inertia_B"] = np.linalg.inv(inertia) if math.isfinite(mass_kg) else 0.0

    def impulse(self, body: str) -> Impulse:
        """Return the total impulse of the tools on a body since the last `start`. Totals lose nothing if read rarely.

        Raises:
            SceneError: the servo has no such body.
        """
        index, shared = self._index(body), self._channel
        given = shared.impulse[:, index]
        total = given.sum(axis=0)
        while not np.array_equal(total, again := given.sum(axis=0)):  # a tick wrote meanwhile
            total = again
        self._reported_impulse[index] = total
        return Impulse(total[:3], total[3:])

    def events(self, since: int = 0, *, tool: int = 0) -> tuple[list[ContactEvent], int]:
        """Return contact events from tick `since` on, and the tick from which to continue.

        Events are available for the last `ring_s` seconds.
        """
        log = self.read(_tick_number(since) - 1, tool=tool)  # including the tick before, to detect changes
        swatch_names = [swatch.name for swatch in self.scene.swatches]
        return events_of(log.rows, log.first, since, self.body_names, swatch_names), log.first + len(log.rows)

    def _index(self, body: str) -> int:
        if body not in self._index_of:
            raise SceneError(no_such("body", body, self._index_of))
        return self._index_of[body]

    def _number(self, tool: int) -> int:
        if not 0 <= tool < self._tools:
            raise HapsceneError(f"no tool {tool}: this servo has {self._tools}, numbered from 0")
        return tool

    def tune(self, swatch: str, **numbers: float) -> None:
        """Change parameters of a swatch while ticks run; see `Renderer.tune`."""
        self._change("tune", swatch, numbers)

    def tune_field(self, effect: str, **numbers: float) -> None:
        """Change parameters of an effect of the scene while ticks run; see `Renderer.tune_field`."""
        self._change("tune_field", effect, numbers)

    def mute(self, effect: str, muted: bool = True) -> None:
        """Exclude an effect from the sum, or include it again, while ticks run; see `Renderer.mute`."""
        self._change("mute", effect, {"muted": muted})

    def _change(self, order: str, name: str, arguments: dict[str, float]) -> None:
        self._order("change", order, name, arguments)
        note_order(self._tuned, order, name, arguments)

    def repaint(self, scene: Scene) -> None:
        """Change the swatches and painted faces of the same bodies.

        Raises:
            SceneError: the scene has other bodies.
        """
        self._in_turn(lambda: self._repaint(scene))

    def _repaint(self, scene: Scene) -> None:
        given = {body.name: body for body in scene.bodies}
        if given.keys() - {body.name for body in self.scene.bodies}:
            raise SceneError(OTHER_BODIES)
        painted: list[Painting] = []
        for body in self.scene.bodies:
            new = given.get(body.name)
            if body.name not in self._index_of:  # the body was removed
                painted.append((np.zeros_like(body.face_swatch), None))
            elif new is None or len(new.face_swatch) != len(body.face_swatch):
                raise SceneError(OTHER_BODIES)
            else:
                painted.append((new.face_swatch.copy(), new.fine))
        self._talk("repaint", list(scene.swatches), painted)
        self.scene.swatches, self.scene.swatch_source = list(scene.swatches), list(scene.swatch_source)
        for body, (face_swatch, fine) in zip(self.scene.bodies, painted, strict=True):
            body.face_swatch, body.fine = face_swatch, fine

    def add(
        self,
        mesh: Mesh | str | os.PathLike[str],
        name: str | None = None,
        *,
        unit: str | None = None,
        swatch: SwatchLike | None = None,
        pose: ArrayLike | None = None,
        two_sided: bool = False,
    ) -> Body:
        """Add a body to `scene` while ticks run; the arguments are those of `Scene.add`.

        Raises:
            MeshError, SceneError, SwatchError: see `Scene.add`.
            HapsceneError: `BODY_ROOM` bodies were added already.
        """
        body: Body = self._in_turn(lambda: self._add(mesh, name, unit, swatch, pose, two_sided))
        return body

    def _add(
        self,
        mesh: Mesh | str | os.PathLike[str],
        name: str | None,
        unit: str | None,
        swatch: SwatchLike | None,
        pose: ArrayLike | None,
        two_sided: bool,
    ) -> Body:
        if len(self.scene.bodies) == self._room:
            raise HapsceneError(f"{BODY_ROOM:,} bodies were added to this servo, which is its limit; start a new servo")
        swatches, sources = list(self.scene.swatches), list(self.scene.swatch_source)
        body = self.scene.add(mesh, name, unit=unit, swatch=swatch, pose=pose, two_sided=two_sided)
        bodies = self.scene.bodies
        like = next((i for i, other in enumerate(bodies[:-1]) if other.mesh is body.mesh), None)
        # a mesh that the process has already is not sent again
        sent = body if like is None else replace(body, mesh=None)  # type: ignore[arg-type]
        try:
            self._talk("add", sent, like, list(self.scene.swatches))
        except BaseException:
            bodies.pop()
            self.scene.swatches, self.scene.swatch_source = swatches, sources
            raise
        self._index_of[body.name] = len(bodies) - 1
        self.body_names.append(body.name)
        return body

    def remove(self, body: str) -> None:
        """Remove a body from contact. Its number is not reused, but its name can be.

        Raises:
            SceneError: the servo has no such body.
        """
        self._in_turn(lambda: self._remove(body))

    def _remove(self, body: str) -> None:
        index = self._index(body)
        self._talk("remove", body)
        del self._index_of[body]
        self.scene.rename(index, f"{body} (removed)")

    def deform(self, body: str, vertices_m: ArrayLike) -> None:
        """Set a new shape of a body while ticks run; see `Renderer.deform`.

        Raises:
            SceneError: the body is unknown, the number of vertices differs from the mesh, or a vertex is not finite.
        """
        index = self._index(body)
        self._order("deform", body, shape_of(vertices_m, len(self.scene.bodies[index].mesh.vertices_m), body))

    def state(self, *, tool: int = 0) -> ServoState:
        """Return the newest complete tick of a tool.

        Raises:
            HapsceneError: the process has ended. One that hangs is recognised by the age of the state.

        Warns:
            UsageWarning: the pose of a body was refused, or the tool is far from all bodies; once each.
        """
        row, count, at_ns = self._newest(tool)
        state = state_of(bytearray(row), count - 1, max(self._now_ns() - at_ns, 0) * 1e-9)
        if state.flags & Flag.TOOL_FAR and not self._far_warned:
            self._far_warned = True
            warn_of_far(state.p_WT_m)
        if state.flags & Flag.POSE_REFUSED and not self._pose_warned:
            moving = tuple(self._moving)  # another thread may add bodies meanwhile
            self._pose_warned = warn_of_refused((self.body_names[i], self._frames[i]["X_WB"]) for i in moving)
        return state

    def contact(self, *, tool: int = 0) -> Contact | None:
        """Return the contact of the newest tick of a tool, for a simulation of a soft body; None without contact."""
        row, count, _ = self._newest(tool)
        if count == 0 or not state_of(bytearray(row), 0, 0.0).touching:
            return None
        return Contact(row, tuple(self.body_names), tuple(swatch.name for swatch in self.scene.swatches))

    def _newest(self, tool: int) -> tuple[bytes, int, int]:
        """Return the row of the newest tick of a tool, the number of ticks, and when the newest was complete [ns]."""
        _ = self._channel  # raises if no process runs
        rows, done, done_ns = self._ticks
        rows = rows[self._number(tool)]
        while True:
            count, at_ns = done.item(), done_ns.item()
            row = rows[(count - 1) % self._length].tobytes()  # to copy a record takes longer
            if done.item() < count + self._length - 1:
                return row, count, at_ns

    def read(self, since: int = 0, *, tool: int = 0) -> TickLog:
        """Return the ticks of a tool from tick `since` on, or from the oldest in the ring buffer on.

        `session_log` has the last ticks of a process that has ended.
        """
        shared = self._channel
        done = int(shared.channel[0].done)
        first = max(_tick_number(since), done - self._length, 0)
        slots = np.arange(first, done) % self._length
        number = self._number(tool)
        taken = [part[number, slots] for part in (shared.rows, shared.a_m_s2, shared.a_handle_m_s2)]
        over = max(int(shared.channel[0].done) + 1 - self._length - first, 0)  # overwritten meanwhile
        return TickLog(first + over, *(part[over:] for part in taken))

    def session_log(self, reason: str = "requested") -> SessionLog:
        """Return the last ticks (`ring_s`) and what is needed to replay them; also after the process has ended.

        Raises:
            HapsceneError: the servo is closed.
        """
        if self._opened is None:
            raise HapsceneError("this servo is closed, and its session log was discarded: save it before closing")
        return log_of(self._opened, self.scene, self._renderer_arguments, self._tuned, reason)

    def timing(self) -> TimingStatistics:
        """Return the timing statistics since the start of the process."""
        channel = self._channel.channel[0]
        return TimingStatistics(channel.late.copy(), channel.busy.copy(), int(channel.missed))


def _device(device: "DeviceLike | DeviceChoice") -> "DeviceLike | DeviceChoice":
    """Return a simulated device as given, or the choice of a real one by the name of its driver."""
    if not isinstance(device, str) or device in DEVICES:
        return device
    if device not in DRIVERS.names():
        raise HapsceneError(no_such("device", device, (*DEVICES, *DRIVERS.names())))
    return DeviceChoice(device)


def _tick_number(tick: int) -> int:
    try:
        return operator.index(tick)
    except TypeError:
        raise HapsceneError(f"a tick must be an integer, not {tick!r:.40}") from None
