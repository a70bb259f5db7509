"""The servo as the application sees it: a hand to aim, swatches to tune, and what was felt."""

import math
import multiprocessing
import operator
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.clock import now_here_ns
from hapscene.constants import ACCELERATION_RATE_HZ, REACH_MAX_M, TICK_S
from hapscene.contact.deformation import shape_of
from hapscene.contact.prediction import HORIZON_S
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.device.model import DEVICES, DeviceLike
from hapscene.device.sim.hand import Grip, grip_named
from hapscene.errors import DeviceError, HapsceneError, PathError, SceneError, no_such
from hapscene.flags import Flag, flag_of
from hapscene.geometry import numbers, positions
from hapscene.handle.plant import Plant
from hapscene.loop.heartbeat import Heartbeat
from hapscene.loop.session_log import SessionLog, log_of, note_order
from hapscene.loop.shared_memory import Channel, open_channel, read_text
from hapscene.loop.timing import TimingStatistics
from hapscene.records import ROW, block_of
from hapscene.render.contact_events import ContactEvent, events_of
from hapscene.render.contact_info import Impulse
from hapscene.render.renderer import OTHER_BODIES
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import Painting
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import SwatchLike

if TYPE_CHECKING:
    from hapscene.handle.live_process import LiveHandle

__all__ = ["Servo", "ServoState", "TickLog", "TimingStatistics"]

RING_S: Final = 8.0
"""How much of the past is held [s]: a page that hangs for some seconds loses nothing."""

START_S: Final = 300.0
"""How long the process may take to be ready [s]: on its first run ever it compiles, which may take two minutes."""

BODY_ROOM: Final = 1024
"""Bodies that may be added to a servo while it runs, also in the place of removed ones [count]: 0.5 kB each."""

ANSWER_S: Final = 20.0
"""How long it may take to answer [s]."""

BUILD_S: Final = 120.0
"""How long it may take where it builds a search [s]: of 5 M faces 3 s, on a machine that has nothing else to do."""


_AT: Final = {name: int(place[1]) // 8 for name, place in dict(ROW.fields or {}).items()}
"""Where each field of a row begins, in numbers of 8 bytes."""

_VECTORS: Final = [(name, _AT[name]) for name in ("p_WT_m", "p_WP_m", "nhat_W", "f_W_N")]


class ServoState(NamedTuple):
    """The newest tick.

    Attributes:
        tick: its number, from 0; −1 before the first.
        p_WT_m, p_WP_m, nhat_W, f_W_N: (3,) tool as the encoders have it, proxy, normal, force on the hand.
        target_W_m: (3,) where the hand means the tool to be.
        depth_m, slip_m_s: as in `Recording`.
        touching: whether the tool is inside a surface.
        body, face, swatch: what is touched; −1 in the air.
        flags: what went wrong or was limited.
        age_s: how long ago the tick was complete, also at rest; infinite before the first. While the servo ticks, much
            more than a tick says that its process hangs, or is stopped.
    """

    tick: int
    p_WT_m: NDArray[np.float64]
    p_WP_m: NDArray[np.float64]
    nhat_W: NDArray[np.float64]
    f_W_N: NDArray[np.float64]
    depth_m: float
    slip_m_s: float
    touching: bool
    body: int
    face: int
    swatch: int
    flags: Flag
    age_s: float = 0.0

    def __repr__(self) -> str:
        place, force = (", ".join(f"{v:.4g}" for v in vector) for vector in (self.p_WT_m, self.f_W_N))
        where = f"touching body {self.body}" if self.touching else "in the air"
        return f"<ServoState: tick {self.tick}, {where}; tool ({place}) m, force ({force}) N>"


class TickLog(NamedTuple):
    """What was felt over n ticks that followed one another.

    Attributes:
        first: number of the first tick.
        rows: (n,) ROW, copied.
        a_m_s2, a_handle_m_s2: (n, block) accelerations asked for, and of the handle.
    """

    first: int
    rows: Any
    a_m_s2: NDArray[np.float64]
    a_handle_m_s2: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"<TickLog: ticks {self.first} to {self.first + len(self.rows) - 1}>"


class Servo:
    """The tick in real time, in a process of its own, with a simulated hand and device.

    Args:
        scene: what is there, as it is now.
        device: what the hand holds: a simulated device, or its name, which brings its limits along, as `Twin` has it;
            or a real one by its driver's name (`hapscene device list`), with options by `hapscene.device.choose`. A
            list of them for several tools, which touch the scene in one loop, and are called by their numbers from 0.
        tick_s, a_rate_Hz: as `Renderer` has them.
        handle: what the first tool's accelerations are played on: a simulated handle, or a real one by its name, as
            "audio", with options by `hapscene.device.choose`.
        handle_file: of a real one that was identified (`hapscene device identify`): its compensator drives it.
        log_folder: where the session log is written when a device or the application is gone (`save_log`).
        force_N: largest force that a real device is sent, where its own limit is not lower.
        patience_s: after how long without a call of the application the force ends [s]: a program that hangs. One that
            is killed, stopped or suspended is noticed within 20 ms without it.
        ring_s: how much of the past is held [s].
        made: more arguments of `Twin`: effects, settings, seed, handle, compensator, X_WD, fidelity; limits and
            delay_ticks of a simulated device.

    Attributes:
        scene: a copy of its own, as it is felt: bodies are added to it and removed from it, and painted.
        body_names: of its bodies, by their numbers, also of those that were removed.

    Use it as a context: memory is taken and the process starts on entry; both end on exit, and with the application,
    however that ends. Ctrl-C, and a terminal that closes, do not reach it: what becomes of it is the application's
    affair.

    Raises:
        HapsceneError: on entry, what `Twin` refuses, or too little shared memory; from then on, by whatever is asked of
            a servo whose process has ended.
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
        **made: Any,
    ) -> None:
        self.tick_s, self.a_rate_Hz = tick_s, a_rate_Hz
        given: list[Any] = list(device) if isinstance(device, list | tuple) else [device]
        devices = [_device(one) for one in given]
        if not devices:
            raise HapsceneError('a servo has a device at least, or several: ["omni", "falcon"]')
        if not patience_s > 0.0 or not 0.0 < ring_s < math.inf:
            raise HapsceneError(f"patience_s and ring_s must be above 0, are {patience_s} and {ring_s}")
        if force_N is not None and not force_N >= 0.0:
            raise HapsceneError(f"force_N must be 0 or more, is {force_N}")
        self._patience_s = patience_s
        self._live_handle = DeviceChoice(handle) if isinstance(handle, str) else handle
        self._handle_file = None if handle_file is None else os.fspath(handle_file)
        if isinstance(self._live_handle, DeviceChoice):
            self._live_handle.checked(handle=True)  # refused before all starts
        elif handle is not None:
            made["handle"] = handle
        self._choices = [one for one in devices if isinstance(one, DeviceChoice)]
        self.scene = scene.copy()
        self._tools, self._room = len(devices), len(scene.bodies) + BODY_ROOM
        own = {"devices": devices, "bodies": self._room, "force_N": force_N}
        own["log_folder"] = None if log_folder is None else os.fspath(log_folder)
        self._made = {"scene": self.scene, **own, "tick_s": tick_s, "a_rate_Hz": a_rate_Hz, **made}
        self._block = block_of(tick_s, a_rate_Hz)
        self._length = max(math.ceil(ring_s / tick_s), 2)
        self.body_names = [body.name for body in scene.bodies]
        self._index_of = {name: index for index, name in enumerate(self.body_names)}
        self._moving: set[int] = set()
        self._told = np.zeros((self._room, 6))
        self._aim: Any = None  # views of what is opened below: at the very end they must go before it
        self._ticks: Any = None
        self._frames: Any = None
        self._fault: Any = None
        self._opened: Channel | None = None
        self._closed = False
        self._process: Any = None
        self._watchdog: Any = None
        self._played: LiveHandle | None = None
        self._heartbeat: Heartbeat | None = None
        self._asked: Any = None
        self._now_ns = now_here_ns  # the loop's clock
        self._wire: Any = None
        self._shared = False  # both have the memory, and nobody else will
        # Orders go one after the other, and each to its end: in a thread that neither Ctrl-C nor another one cuts short
        self._lane = ThreadPoolExecutor(1, "hapscene orders")
        self._cancelled = False
        self._told_made: dict[str, Any] = {}
        self._tuned: list[tuple[str, str, dict[str, float]]] = []

    def __repr__(self) -> str:
        begun = "not begun" if self._process is None else "running" if self.alive else "ended"
        state = "closed" if self._closed else begun
        return f"<Servo: {state}; ticks of {1e3 * self.tick_s:g} ms, a_rate_Hz={self.a_rate_Hz:g}>"

    def __enter__(self) -> "Servo":
        if self._closed or self._opened is not None:
            raise HapsceneError("a servo is entered once; make a new one")
        try:
            with _shielded():  # it starts Python's resource tracker
                self._opened = open_channel(self._length, self._block, bodies=self._room, tools=self._tools)
            self._opened.channel.pause = 1
            self._look(self._opened)
            self._begin(self._opened)
            self._opened.memory.unlink()  # from now on it goes with the two processes, even if both are killed
            self._shared = True
        except BaseException:
            self.close()
            raise
        return self

    def _begin(self, shared: Channel) -> None:
        """Start the processes that run the loop and watch it, and the heartbeat of this one."""
        from hapscene.loop.servo_process import run

        context = multiprocessing.get_context("spawn")  # a fork would carry over threads and locks of the application
        self._wire, theirs = context.Pipe()
        life, dying = context.Pipe(duplex=False)
        arguments = (theirs, dying, shared.memory.name, self._length)
        process = context.Process(target=run, args=arguments, name="hapscene servo", daemon=True)
        made = ForkingPickler.dumps(self._made)
        with _shielded():
            process.start()
        self._process = process
        if self._cancelled:
            process.kill()
            raise HapsceneError("the start of the servo was cancelled")
        theirs.close()
        dying.close()
        if any(DRIVERS.load(choice.name).force for choice in self._choices):
            self._start_watchdog(context, life)
        life.close()
        self._send(made)  # not as arguments: to a process that died at once, they would be written for ever
        self._told_made = self._answer(START_S)
        self._heartbeat = Heartbeat(shared.channel["pulse"].view(np.ndarray), self._patience_s)
        self._asked = self._heartbeat.asked
        if isinstance(self._live_handle, DeviceChoice):
            self._start_handle(self._live_handle)

    def _start_watchdog(self, context: Any, life: Any) -> None:
        """Have a third process see to it that no force is left if the servo's dies."""
        from hapscene.loop.watchdog import watch

        assert self._opened is not None
        here, there = context.Pipe(duplex=False)
        shape = self._length, self._block, self._room, self._tools
        arguments = (life, there, self._opened.memory.name, shape, self._process.pid, self._choices)
        self._watchdog = context.Process(target=watch, args=arguments, name="hapscene watchdog", daemon=True)
        with _shielded():
            self._watchdog.start()
        there.close()
        if not here.poll(START_S):
            raise HapsceneError("the servo's watchdog did not start: no device is driven without it")
        try:
            here.recv()
        except EOFError:
            raise HapsceneError("the servo's watchdog has ended at its start: no device is driven without it") from None

    def _start_handle(self, choice: DeviceChoice) -> None:
        """Have a process play what the first tool's channel asks for."""
        from hapscene.handle.live_process import LiveHandle

        assert self._opened is not None
        shape = {"length": self._length, "block": self._block, "bodies": self._room, "tools": self._tools}
        shared = shape | {"name": self._opened.memory.name}
        options = dict(choice.options)
        with _shielded():
            self._played = LiveHandle(shared, self.a_rate_Hz, 0, choice.name, options, handle=self._handle_file)

    def handle_report(self) -> dict[str, float]:
        """How a real handle plays: latency [s], drift of its clock [ppm], counts of what went wrong; empty without one.

        Raises:
            HandleError: it plays no more, and why.
        """
        return {} if self._played is None else self._played.update_report()

    def turn_handle(self, volume: float) -> None:
        """Have a real handle play from now on at this share of its gain, 0 … 1; nothing without one.

        Raises:
            HandleError: it plays no more, and why.
        """
        if self._played is not None:
            self._played.set_volume(volume)

    def _look(self, shared: Channel) -> None:
        """Keep views of what is often read or written: by name, each look costs microseconds."""
        channel = shared.channel.view(np.ndarray)
        aims = shared.aims.view(np.ndarray)
        self._aim = [(aims["aim"][tool], aims["count"][tool : tool + 1]) for tool in range(self._tools)]
        numbers = (channel[name] for name in ("done", "done_ns"))
        self._ticks = shared.rows.view(np.ndarray), *numbers
        self._frames = shared.frames.view(np.ndarray)
        self._fault = shared.fault

    def __exit__(self, *error: object) -> None:
        self.close()

    def cancel(self) -> None:
        """Have a start that is under way in another thread fail at once: it may take as long as `START_S`."""
        self._cancelled = True
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        """End the process, kindly if it listens, and give its memory back. Once is enough; twice does no harm."""
        self._closed = True
        self._lane.shutdown(wait=False, cancel_futures=True)
        if self._opened is None:
            return
        if self._process is not None:
            if self._shared:  # else it may be in the middle of being told what it is
                try:
                    self._wire.send(("stop", ()))
                    self._process.join(ANSWER_S)
                except (OSError, ValueError):
                    pass
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
        if self._wire is not None:
            self._wire.close()
        if self._played is not None:
            self._played.close()
        if self._watchdog is not None:
            self._watchdog.join(ANSWER_S)
            if self._watchdog.is_alive():
                self._watchdog.kill()
        if self._heartbeat is not None:
            self._heartbeat.stop()
        self._aim = self._ticks = self._frames = self._fault = None
        self._opened.close(unlink=not self._shared)
        self._opened = None

    @property
    def _channel(self) -> Channel:
        """The memory of a process that runs: what is left of one that has ended would be taken for the present."""
        if self._closed:
            raise HapsceneError("this servo is closed; make a new one")
        if self._opened is None or self._process is None:
            raise HapsceneError("this servo does not run; use it as a context: with Servo(…) as servo")
        if not self._process.is_alive():
            raise HapsceneError(self._gone())
        self._asked[0] += 1
        if self._fault[0]:
            raise DeviceError(read_text(self._fault))
        return self._opened

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.is_alive()

    @property
    def notice(self) -> str:
        """What troubles a real device, and what helps; empty where nothing does.

        Raises:
            HapsceneError: the process has ended.
            DeviceError: a device is gone.
        """
        return read_text(self._channel.notice)

    def device_state(self, *, tool: int = 0) -> Any:
        """What a real device last said: (DEVICE_STATE,) a copy: readiness, buttons, warmth.

        Raises:
            HapsceneError: as `state` has them.
        """
        return self._channel.states[self._number(tool)].copy()

    def start(self, p_WT: ArrayLike, grip: str | Grip = "light") -> None:
        """Start to touch, the tool at rest at `p_WT` (3,) [m], the hand aiming there; several tools at (tools, 3).

        Raises:
            PathError: not three finite numbers for each.
            HapsceneError: out of the device's reach.
        """
        places = positions(numbers(p_WT).reshape(1, -1) if self._tools == 1 else np.atleast_2d(numbers(p_WT)))
        if len(places) != self._tools:
            raise PathError(f"{self._tools} tools start at as many places; these are {len(places)}")
        held = grip_named(grip) if isinstance(grip, str) else grip
        self._order("start", [tuple(p) for p in places.tolist()], held.row())
        self._told[:] = 0.0

    def rest(self) -> None:
        """Stop to touch: no ticks until the next `start`, or `resume`."""
        self._order("rest")

    pause = rest

    def resume(self) -> None:
        """Go on after `pause` from where it stopped, contact kept.

        Raises:
            HapsceneError: it never started.
        """
        self._order("resume")

    def aim(
        self, p_WT: ArrayLike, grip: str | Grip = "light", push_W_N: Sequence[float] = (0.0, 0.0, 0.0), *, tool: int = 0
    ) -> None:
        """Have the hand mean a tool to be at `p_WT` (3,) [m], held by `grip`, pushed by `push_W_N` (3,) [N].

        Raises:
            PathError: not three finite numbers.
            HapsceneError: no such grip or tool, or the process has ended.
        """
        held = grip_named(grip) if isinstance(grip, str) else grip
        p, push = numbers(p_WT), numbers(push_W_N)
        if p.size != 3 or push.size != 3:
            raise PathError(f"a hand aims at, and pushes with, three numbers; not {p.size} and {push.size}")
        p, push = p.reshape(3), push.reshape(3)
        if not max(np.abs(p).max(), np.abs(push).max()) <= REACH_MAX_M:  # NaN is not, either
            positions(np.array([p, push]))  # says what is wrong
        row = held.row()
        _ = self._channel  # raises where none runs
        aim, count = self._aim[self._number(tool)]
        count[0] |= 1  # also where Ctrl-C once left it odd
        aim[0], aim[1], aim[2] = p, row, push
        count[0] += 1

    def move(
        self,
        body: str,
        X_WB: ArrayLike,
        *,
        v_W_m_s: ArrayLike | None = None,
        w_W_rad_s: ArrayLike | None = None,
        seen: Impulse | None = None,
        teleport: bool = False,
    ) -> None:
        """Say where a body is by now: as often as you know it, some 60 times a second.

        Between two such frames it is predicted (`hapscene.contact.prediction`): without velocities it goes straight to
        each frame in the time between two; with them it goes on; one that is `free` is pushed as well.

        Args:
            body: its name.
            X_WB: (4, 4) its pose. An invalid one is flagged (`Flag.POSE_REFUSED`), and the last valid one kept.
            v_W_m_s: (3,) velocity of its centre of mass.
            w_W_rad_s: (3,) how fast it turns.
            seen: how much of the tool's impulse this contains; without it, as much as `impulse` told last.
            teleport: it appears there, and meets nothing on its way.

        Raises:
            SceneError: no such body, a pose that is no matrix (4, 4), or a velocity that is not three numbers.
            HapsceneError: the process has ended.
        """
        index = self._index(body)
        if np.shape(X_WB) != (4, 4):
            raise SceneError(f"pose of body {body!r}: a pose is a matrix (4, 4), not {np.shape(X_WB)}")
        pose, v = numbers(X_WB), np.zeros(6)
        got = self._told[index].copy()
        given = (v, v_W_m_s, 0), (v, w_W_rad_s, 3), *((got, part, 3 * k) for k, part in enumerate(seen or ()))
        for out, values, at in given:
            if values is None:
                continue
            vector = numbers(values)
            if vector.shape != (3,) or at > 3 or not np.isfinite(vector).all():
                raise SceneError(
                    f"body {body!r}: velocities, and the impulse it has seen, are three finite numbers each"
                )
            out[at : at + 3] = vector
        shared = self._channel
        frame = self._frames[index]
        frame["count"] |= 1
        frame["time_ns"], frame["lasts_s"] = self._now_ns(), HORIZON_S
        frame["X_WB"], frame["v"], frame["seen"] = pose, v, got
        frame["jumps"] += teleport
        frame["count"] += 1
        if index not in self._moving:
            shared.moving[len(self._moving)] = index
            self._moving.add(index)
            shared.channel[0].moving_count = len(self._moving)

    def free(
        self, body: str, mass_kg: float, *, inertia_B_kg_m2: ArrayLike, com_B_m: ArrayLike = (0.0, 0.0, 0.0)
    ) -> None:
        """Have a body that is moved be pushed by the tool between its frames, as its mass and inertia have it.

        Args:
            body: its name.
            mass_kg: infinite for one that is not pushed.
            inertia_B_kg_m2: (3,) or (3, 3) about its centre of mass, in its own axes.
            com_B_m: (3,) its centre of mass.

        Raises:
            SceneError: no such body; a mass or an inertia that no body has.
        """
        index, inertia, mass = self._index(body), numbers(inertia_B_kg_m2), numbers(mass_kg)
        inertia = np.diag(inertia) if inertia.shape == (3,) else inertia
        above_0 = np.finfo(np.float64).tiny  # whose inverse is finite, too
        known = inertia.shape == (3, 3) and np.isfinite(inertia).all() and mass.shape == () and mass >= above_0
        good = known and (np.linalg.eigvalsh(inertia) >= above_0).all()
        if not (good and np.abs(inertia - inertia.T).max() <= 1e-6 * np.abs(inertia).max()):
            raise SceneError(f"body {body!r}: mass and inertia must be above 0, the inertia (3,) or (3, 3), symmetric")
        com_m = numbers(com_B_m)
        if com_m.shape != (3,) or not np.abs(com_m).max() <= REACH_MAX_M:
            raise SceneError(f"body {body!r}: its centre of mass is three finite numbers in metres")
        _ = self._channel
        frame = self._frames[index]
        frame["lightness"] = 1.0 / mass_kg
        frame["com_B_m"] = com_m
        frame["yields_B"] = np.linalg.inv(inertia) if math.isfinite(mass_kg) else 0.0

    def impulse(self, body: str) -> Impulse:
        """What the tools have given a body since the last `start`: running totals, so that a missed look loses nothing.

        Raises:
            SceneError: no such body.
            HapsceneError: the process has ended.
        """
        index, shared = self._index(body), self._channel
        given = shared.impulse[:, index]
        total = given.sum(axis=0)
        while not np.array_equal(total, again := given.sum(axis=0)):  # a tick wrote meanwhile
            total = again
        self._told[index] = total
        return Impulse(total[:3], total[3:])

    def events(self, since: int = 0, *, tool: int = 0) -> tuple[list[ContactEvent], int]:
        """What began, ended or changed from tick `since` on, and from which tick on to ask the next time.

        Goes back as far as `ring_s`.

        Raises:
            HapsceneError: the process has ended.
        """
        log = self.read(max(_whole(since) - 1, 0), tool=tool)  # with the tick before: what changes, changes from there
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
        """Change numbers of a swatch while it is felt, as `Renderer.tune` does."""
        self._order("tune", swatch, numbers)
        note_order(self._tuned, "tune", swatch, numbers)

    def tune_field(self, effect: str, **numbers: float) -> None:
        """Change numbers of an effect of the scene while it is felt, as `Renderer.tune_field` does."""
        self._order("tune_field", effect, numbers)
        note_order(self._tuned, "tune_field", effect, numbers)

    def mute(self, effect: str, muted: bool = True) -> None:
        """Switch an effect off, or on again, while it is felt, as `Renderer.mute` does."""
        self._order("mute", effect, muted)
        note_order(self._tuned, "mute", effect, {"muted": muted})

    def repaint(self, scene: Scene) -> None:
        """Feel another painting of the same bodies from now on: their swatches and face by face which.

        Raises:
            SceneError: other bodies.
        """
        self._in_turn(lambda: self._repaint(scene))

    def _repaint(self, scene: Scene) -> None:
        given = {body.name: body for body in scene.bodies}
        if given.keys() - {body.name for body in self.scene.bodies}:
            raise SceneError(OTHER_BODIES)
        painted: list[Painting] = []
        for body in self.scene.bodies:
            new = given.get(body.name)
            if body.name not in self._index_of:  # it was removed
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
        """Add a body to what is felt: as `Scene.add` does, to the servo's own `scene`. Touching goes on meanwhile.

        Raises:
            MeshError, SceneError, SwatchError: as `Scene.add` has them.
            HapsceneError: more than `BODY_ROOM` bodies were added.
        """
        body: Body = self._in_turn(lambda: self._add(mesh, name, unit, swatch, pose, two_sided))
        return body

    def _add(self, mesh: Any, name: str | None, unit: str | None, swatch: Any, pose: Any, two_sided: bool) -> Body:
        if len(self.scene.bodies) == self._room:
            raise HapsceneError(f"{BODY_ROOM:,} bodies were added to this servo, and no more fit in; start a new one")
        swatches, sources = list(self.scene.swatches), list(self.scene.swatch_source)
        body = self.scene.add(mesh, name, unit=unit, swatch=swatch, pose=pose, two_sided=two_sided)
        bodies = self.scene.bodies
        like = next((i for i, other in enumerate(bodies[:-1]) if other.mesh is body.mesh), None)
        sent = body if like is None else replace(body, mesh=None)  # type: ignore[arg-type]  # it is there already
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
        """Take a body out of what is felt. Its number is not given to another, its name may be; its memory stays.

        Raises:
            SceneError: no such body.
        """
        self._in_turn(lambda: self._remove(body))

    def _remove(self, body: str) -> None:
        index = self._index(body)
        self._talk("remove", body)
        del self._index_of[body]
        self.scene.rename(index, f"{body} (removed)")

    def deform(self, body: str, vertices_m: ArrayLike) -> None:
        """Give a body another shape while it is felt, as `Renderer.deform` does.

        Raises:
            SceneError: no such body, not as many places as the mesh has vertices, or not finite ones.
        """
        index = self._index(body)
        self._order("deform", body, shape_of(vertices_m, len(self.scene.bodies[index].mesh.vertices_m), body))

    def state(self, *, tool: int = 0) -> ServoState:
        """The newest complete tick of a tool.

        Raises:
            HapsceneError: the process has ended; one that only hangs is seen by the state's age.
        """
        _ = self._channel  # raises where none runs
        rows, done, done_ns = self._ticks
        rows = rows[self._number(tool)]
        while True:
            count, at_ns = done.item(), done_ns.item()
            row = bytearray(rows[(count - 1) % self._length].tobytes())  # to copy a record takes longer
            if done.item() < count + self._length - 1:
                break
        real, whole = np.frombuffer(row), np.frombuffer(row, np.int64)
        vectors = {name: real[at : at + 3] for name, at in _VECTORS}
        return ServoState(
            tick=count - 1,
            **vectors,
            depth_m=float(real[_AT["depth_m"]]),
            slip_m_s=float(real[_AT["slip_m_s"]]),
            touching=bool(whole[_AT["touching"]]),
            body=int(whole[_AT["body"]]),
            face=int(whole[_AT["face"]]),
            swatch=int(whole[_AT["swatch"]]),
            flags=flag_of(int(whole[_AT["flags"]])),
            age_s=max(self._now_ns() - at_ns, 0) * 1e-9 if count else math.inf,
        )

    def read(self, since: int = 0, *, tool: int = 0, after_end: bool = False) -> TickLog:
        """What a tool felt from tick `since` on, or from as far back as `ring_s`.

        Args:
            since: number of a tick.
            tool: its number.
            after_end: whether a process that has ended is asked too: for what it felt until then.

        Raises:
            HapsceneError: the process has ended, and `after_end` is not set; or the servo is closed.
        """
        shared = self._opened if after_end and self._opened is not None else self._channel
        done = int(shared.channel[0].done)
        first = max(_whole(since), done - self._length, 0)
        slots = np.arange(first, max(done, first)) % self._length
        number = self._number(tool)
        taken = [part[number, slots] for part in (shared.rows, shared.a_m_s2, shared.a_handle_m_s2)]
        over = max(int(shared.channel[0].done) + 1 - self._length - first, 0)  # written over meanwhile
        return TickLog(first + over, *(part[over:] for part in taken))

    def session_log(self, reason: str = "asked for") -> SessionLog:
        """The last ticks (`ring_s`), with what is needed to replay them; also after the process has ended.

        Raises:
            HapsceneError: the servo is closed.
        """
        if self._opened is None:
            raise HapsceneError("this servo is closed, and its session log with it")
        return log_of(self._opened, self.scene, self._told_made, self._tuned, reason)

    def save_log(self, folder: "str | os.PathLike[str]", reason: str = "asked for") -> None:
        """Write `session_log` into a folder; `hapscene play --replay FOLDER` replays it.

        Raises:
            HapsceneError: the servo is closed, or the folder cannot be written.
        """
        log = self.session_log(reason)
        try:
            log.save(os.fspath(folder))
        except OSError as error:
            raise HapsceneError(f"{folder}: cannot be written: {error.strerror or error}") from None

    def timing(self) -> TimingStatistics:
        """How well the loop has kept time since the process started.

        Raises:
            HapsceneError: the process has ended.
        """
        channel = self._channel.channel[0]
        return TimingStatistics(channel.late.copy(), channel.busy.copy(), int(channel.missed))

    def _order(self, order: str, *arguments: Any) -> Any:
        """Send an order when its turn comes; return its result."""
        return self._in_turn(lambda: self._talk(order, *arguments))

    def _in_turn(self, do: Callable[[], Any]) -> Any:
        _ = self._channel  # raises where none runs
        try:
            turn = self._lane.submit(do)
        except RuntimeError:  # it was closed meanwhile
            raise HapsceneError("this servo is closed; make a new one") from None
        return turn.result()

    def _talk(self, order: str, *arguments: Any) -> Any:
        _ = self._channel
        self._send(ForkingPickler.dumps((order, arguments)))
        return self._answer(BUILD_S if order in ("add", "repaint", "deform") else ANSWER_S)

    def _send(self, pickled: Any) -> None:
        try:
            self._wire.send_bytes(pickled)
        except (OSError, ValueError):
            raise HapsceneError(self._gone()) from None

    def _answer(self, patience_s: float) -> Any:
        try:
            if not self._wire.poll(patience_s):
                self._process.kill()  # a late answer would be taken for that to the next order
                raise HapsceneError(f"the servo's process did not answer within {patience_s:g} s, and was ended")
            error, result = self._wire.recv()
        except (EOFError, OSError):
            raise HapsceneError(self._gone()) from None
        if error is not None:
            raise HapsceneError(error)
        return result

    def _gone(self) -> str:
        self._process.join(1.0)
        ended = f"the servo's process has ended (exit code {self._process.exitcode})"
        if self._watchdog is not None and self._process.exitcode == -9:
            ended += ": killed, or ended by its watchdog after it stood still for 50 ms: is the computer too busy?"
        return f"{ended}; start a new one"


def _device(device: "DeviceLike | DeviceChoice") -> "DeviceLike | DeviceChoice":
    """A simulated device as it is; one that is not simulated as what the servo opens."""
    if not isinstance(device, str) or device in DEVICES:
        return device
    if device not in DRIVERS.names():
        raise HapsceneError(no_such("device", device, (*DEVICES, *DRIVERS.names())))
    return DeviceChoice(device)


def _whole(tick: int) -> int:
    try:
        return operator.index(tick)
    except TypeError:
        raise HapsceneError(f"a tick is a whole number, not {tick!r:.40}") from None


@contextmanager
def _shielded() -> Iterator[None]:
    """A process started within gets none of the signals that a terminal sends to all processes of a job.

    So Ctrl-Z stops the application alone, and ends the force, where it would stop the servo and its watchdog with it.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    terminal = (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, terminal)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
