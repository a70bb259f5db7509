"""The other process of a servo: opens the devices, runs the loop, and answers.

Simulated devices, and those whose vendor's thread calls the tick, are driven by compiled code without the GIL. Others
are read and written by Python before and after each tick, in a thread of a process that does little else.
"""

import gc
import signal
import sys
import threading
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from multiprocessing.connection import Connection as Pipe
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import VIRTUAL, new_clock
from hapscene.compiled.bound_call import BoundCall
from hapscene.contact.prediction import PREDICTED
from hapscene.device.driver import Connection, VendorConnection, new_state
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.device.model import limits_of
from hapscene.device.safety import begin_safety, resume_safety, safety_of, simulated_safety
from hapscene.device.sim.arm import new_arm, read_arm
from hapscene.errors import DeviceError, HapsceneError
from hapscene.geometry import rigid
from hapscene.loop.checkpoint import memory_of
from hapscene.loop.driver import CALLED, SCHEDULED, TIMED, Bodies, Loop, bound, new_loop, wait_at
from hapscene.loop.session_log import log_of, note_order, settings_of, write_log
from hapscene.loop.shared_memory import Channel, open_channel, write_text
from hapscene.loop.timing import TIMING, request_realtime_priority, start_timer
from hapscene.records import records
from hapscene.render.renderer import Renderer
from hapscene.render.tick import use_moving_bodies
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import Painting
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

if TYPE_CHECKING:
    from hapscene.loop import Twin

__all__ = ["Desk", "open_twins", "run"]


WATCH_S: Final = 0.1
"""How often devices are asked what troubles them [s]."""

SWITCH_S: Final = 1e-4
"""How long a thread of Python may keep the loop waiting that reads and writes a device [s]; Python's own is 5 ms."""


def run(wire: Pipe, life: Pipe, name: str, length: int) -> None:
    """The process's main function: `name` and `length` are of the channel; the arguments of `Twin` come first.

    Ends when it is told to, when the application is gone, or at SIGTERM. Answers every message with (None, result) or
    (error text, None); `life` hears at the end that all devices are closed.
    """
    from hapscene.loop import Twin

    signal.signal(signal.SIGTERM, _end)
    channel = desk = None
    twins: list[Twin] = []
    opened: list[Connection] = []
    ending = ""
    warnings.formatwarning = lambda message, *place: f"hapscene: note: {message}\n"  # whose line it was nobody can see
    try:
        made = _heard(wire)
        bodies, folder = made.pop("bodies"), made.pop("log_folder")
        twins += open_twins(made, opened)
        channel = open_channel(length, twins[0].renderer.block, name, bodies=bodies, tools=len(twins))
        settings = settings_of([twin.renderer for twin in twins], made.get("settings"))
        desk = Desk(made["scene"], twins, channel, folder, settings)
        wire.send((None, desk.made))
        while True:
            while opened and not wire.poll(WATCH_S):
                desk.look_after()
            order, arguments = _heard(wire)
            if order == "stop":
                break
            wire.send(desk.answer(order, arguments))
    except (EOFError, ConnectionError, KeyboardInterrupt):
        # the application is gone; where signals cannot be held off, Ctrl-C reaches both
        ending = "the application was gone"
    except HapsceneError as error:
        wire.send((str(error), None))
    except BaseException:
        wire.send((f"the servo's process failed:\n{traceback.format_exc()}", None))
        raise
    finally:
        try:
            if desk is not None:
                desk.end()
        finally:
            for connection in opened:
                connection.close()
                connection.state = new_state()  # not of the shared memory any more
            with suppress(OSError):
                life.send(None)
        if desk is not None:
            desk.write_faults()
            if ending:
                desk.write_log(ending)
        desk = None
        twins.clear()  # they look at the memory that is given back
        if channel is not None:
            channel.close(unlink=False)


def _end(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt


def open_twins(made: dict[str, Any], opened: list[Connection]) -> "list[Twin]":
    """What closes the loop over each of the application's devices; the real ones are opened, and put into `opened`."""
    devices, force_N = made.pop("devices"), made.pop("force_N")
    twins = [_twin(device, opened, made) for device in devices]
    if force_N is not None:
        for twin in twins:
            twin.safety.force_N = min(float(twin.safety.force_N[0]), force_N)
    return twins


def _twin(device: Any, opened: list[Connection], made: dict[str, Any]) -> "Twin":
    """What closes the loop over a device; a real one is opened, and put into `opened`."""
    from hapscene.loop import Twin

    if not isinstance(device, DeviceChoice):
        twin = Twin(device=device, **made)
        twin.safety = simulated_safety()
        return twin
    driver = DRIVERS.load(device.name)
    for name in ("limits", "delay_ticks"):
        if made.get(name):
            raise HapsceneError(f"{name}: only of simulated devices; what {device.name!r} bears its driver says")
    if driver.model is not None:
        made = made | {"limits": limits_of(driver.model, made["tick_s"])}
    if made.get("X_WD") is not None:
        made = made | {"X_WD": rigid(made["X_WD"], f"device {device.name!r}")}  # a scale would be one of the force
    opened.append(connection := device.open())
    twin = Twin(device=connection, **made)
    twin.safety = safety_of(driver)
    return twin


def _heard(wire: Pipe) -> Any:
    """What the application sends.

    Raises:
        EOFError: it is gone, maybe in the middle of a word.
    """
    try:
        return wire.recv()
    except OSError:
        raise EOFError from None


NO_REPLAY: Final = np.iinfo(np.int64).max
"""`CHANNEL.changed` where a log cannot be replayed: bodies were added, removed or deformed, or a fidelity is used."""


class Desk:
    """Orders of the application. Those that replace the arrays of the running loop stop it: to bind it takes 12 ms."""

    def __init__(
        self,
        scene: Scene,
        twins: "Sequence[Twin]",
        channel: Channel,
        log_folder: str | None = None,
        made: Mapping[str, Any] | None = None,
        clock: NDArray[np.int64] | None = None,
    ) -> None:
        """`clock`: of `new_clock`; with a virtual time nothing ticks by itself, but as `advance` is called."""
        self._scene, self._log_folder, self.made = scene, log_folder, dict(made or {})
        self._twins = tuple(twins)
        self._channel = channel
        self._hands = np.zeros((len(twins), 5, 3))
        self._clock = new_clock() if clock is None else clock
        self._stop: Callable[[], object] | None = None  # waits until the loop has ended, which runs
        self._turning: Iterator[None] = iter(())
        self._started = False
        self._faults: list[str] = []
        self._tuned: list[tuple[str, str, dict[str, float]]] = []
        self._timing = records(1, TIMING)[0]
        self._connections = [twin.device for twin in self._twins if isinstance(twin.device, Connection)]
        count = len(channel.frames)
        self._bodies = Bodies(
            frames=channel.frames,
            predicted=records(count, PREDICTED),
            moving=channel.moving,
            given=np.zeros((count, 6)),
            X_WB=np.tile(np.eye(4), (1, count, 1, 1)),
            teleported=np.zeros(count, np.int64),
            jumps=np.zeros((len(twins), count), np.int64),
        )
        for twin, impulse in zip(self._twins, channel.impulse, strict=True):
            twin.renderer.world = twin.renderer.world._replace(impulse=impulse)  # where the application sees it
            use_moving_bodies(twin.renderer.world, twin.renderer.surface)  # not in the midst of the loop
        for twin, state in zip(self._twins, channel.states, strict=True):
            if isinstance(twin.device, Connection):
                slot = state.reshape(1).view(np.recarray)
                slot[:] = twin.device.state
                twin.device.state = slot
            twin.reset((0.0, 0.0, 0.0))
        vendors = [device for device in self._connections if isinstance(device, VendorConnection)]
        if vendors and len(self._twins) > 1:
            raise DeviceError("a device whose vendor's thread calls the tick is the only one of its servo")
        channel.channel.pause = 1
        if self._renderers[0].fidelity is not None:  # which a log does not hold
            channel.channel.changed = NO_REPLAY
        parts = (part for r in self._renderers for part in memory_of(r.world, r.surface))
        channel.channel.checkpoint_size = sum(len(part) for part in parts)
        driven = bool(self._connections) or bool(self._clock[VIRTUAL])  # by Python, tick by tick
        pace = SCHEDULED if vendors else CALLED if driven else TIMED
        channel.channel.pace, channel.channel.until = pace, np.iinfo(np.int64).max
        self._bind()  # compiled before the loop is needed
        if self._connections and not self._clock[VIRTUAL]:
            gc.freeze()  # nothing that is there now is looked through again while devices wait
            sys.setswitchinterval(SWITCH_S)

    @property
    def _renderers(self) -> list[Renderer]:
        return [twin.renderer for twin in self._twins]

    def answer(self, order: str, arguments: Sequence[Any]) -> tuple[str | None, Any]:
        """Do what the application orders: (None, result), or (error text, None)."""
        try:
            return None, getattr(self, order)(*arguments)
        except HapsceneError as error:
            return str(error), None
        except Exception as error:  # a fault of ours, or of an effect's: what is felt goes on
            return f"the order {order!r} failed: {type(error).__name__}: {error!s:.200}", None

    def advance(self, ticks: int) -> None:
        """Tick so often, at a virtual time; not at all at rest."""
        deque(islice(self._turning, ticks), 0)

    def start(self, places_m: Sequence[tuple[float, float, float]], grip: NDArray[np.float64]) -> None:
        """Run, the tools at rest at their places (3,), held there by a grip as the aim has it (3,)."""
        for twin, place_m in zip(self._twins, places_m, strict=True):
            new_arm(twin.device, place_m, twin.X_WD)  # raises where it is out of reach
        self.rest()
        for twin, place_m in zip(self._twins, places_m, strict=True):
            twin.reset(place_m)
            if isinstance(twin.device, Connection):
                twin.device.read()
                twin.renderer.reset(np.array(read_arm(twin.body.arm)))
        self._channel.frames["seen"] = 0.0  # impulses begin anew
        self._bodies.predicted.view(np.uint8)[:] = 0
        for aim, place_m in zip(self._channel.aims, places_m, strict=True):  # the application waits meanwhile
            aim["count"] |= 1
            aim["aim"][:] = place_m, grip, (0.0, 0.0, 0.0)
            aim["count"] += 1
        self._hands[:, :3] = 0.0
        self._hands[:, 0] = self._hands[:, 1] = places_m
        self._started = True
        self._begin()

    def resume(self) -> None:
        """Go on from where `rest` stopped, contact and memory kept."""
        if not self._started:
            raise HapsceneError("a servo that never started has nothing to resume: start it")
        if self._stop is None:
            self._begin()

    def look_after(self) -> None:
        """Tell the application what troubles the devices, and whether one is gone; then write what led there."""
        self.write_faults()
        for connection in self._connections:
            write_text(self._channel.notice, connection.reason(int(connection.state.trouble[0])))
            if isinstance(connection, VendorConnection):
                try:
                    connection.check()
                except Exception as error:
                    self.rest()
                    self._note_fault(error)

    def tune(self, swatch: str, numbers: Mapping[str, float]) -> None:
        """Change numbers of a swatch; single numbers are written whole, so the loop goes on."""
        for renderer in self._renderers:
            renderer.tune(swatch, **numbers)
        note_order(self._tuned, "tune", swatch, numbers)
        self._note_change()

    def tune_field(self, effect: str, numbers: Mapping[str, float]) -> None:
        """Change numbers of an effect of the scene, likewise."""
        for renderer in self._renderers:
            renderer.tune_field(effect, **numbers)
        note_order(self._tuned, "tune_field", effect, numbers)
        self._note_change()

    def mute(self, effect: str, muted: bool) -> None:
        """Switch an effect off, or on again."""
        for renderer in self._renderers:
            renderer.mute(effect, muted)
        note_order(self._tuned, "mute", effect, {"muted": muted})
        self._note_change()

    def repaint(self, swatches: Sequence[Swatch], painted: Sequence[Painting]) -> None:
        """Take over swatches, and the faces of each body with what is painted finer."""
        before = self._scene.swatches, [(body.face_swatch, body.fine) for body in self._scene.bodies]
        self._paint(swatches, painted)
        try:
            self._take_scene()
        except BaseException:
            self._paint(*before)
            raise

    def add(self, body: Body, like: int | None, swatches: Sequence[Swatch]) -> None:
        """Feel one more body, of the mesh that the body number `like` has unless that is None."""
        if like is not None:
            body = replace(body, mesh=self._scene.bodies[like].mesh)
        before = self._scene.swatches
        self._scene.swatches = list(swatches)
        self._scene.bodies.append(body)
        try:
            self._take_scene()
        except BaseException:
            self._scene.swatches = before
            self._scene.bodies.pop()
            raise
        self._channel.channel.changed = NO_REPLAY

    def remove(self, body: str) -> None:
        """Feel a body no more."""
        with self._between_ticks():
            for renderer in self._renderers:
                renderer.remove(body)
        self._channel.channel.changed = NO_REPLAY

    def deform(self, body: str, vertices_m: NDArray[np.float64]) -> None:
        """Give a body another shape; the loop goes on, but for the first time."""
        for renderer in self._renderers:
            world = renderer.world
            try:
                renderer.deform(body, vertices_m)
            finally:
                if renderer.world is not world:
                    with self._between_ticks():
                        pass  # it goes on with the new one
        self._channel.channel.changed = NO_REPLAY

    def write_faults(self) -> None:
        """Write what led to the faults that were noted since."""
        while self._faults:
            self.write_log(self._faults.pop())

    def write_log(self, reason: str) -> None:
        """Write the last minute, where the application has named a folder, and any tick is complete."""
        channel = self._channel
        if self._log_folder is not None and channel.channel[0].done > 0:
            note = write_log(log_of(channel, self._scene, self.made, self._tuned, reason), self._log_folder)
            print(f"hapscene: note: {note}", file=sys.stderr, flush=True)

    def rest(self) -> bool:
        """Stop the loop; says whether it ran."""
        self._channel.channel.pause = 1
        if self._stop is None:
            return False
        self._stop()
        self._stop = None
        return True

    def end(self) -> None:
        """Stop for good, and let go of the shared memory."""
        self.rest()
        for renderer in self._renderers:
            renderer.world = renderer.world._replace(impulse=np.zeros_like(renderer.world.impulse))

    def _paint(self, swatches: Sequence[Swatch], painted: Sequence[Painting]) -> None:
        self._scene.swatches = list(swatches)
        for body, (face_swatch, fine) in zip(self._scene.bodies, painted, strict=True):
            body.face_swatch, body.fine = face_swatch, fine

    def _take_scene(self) -> None:
        """Feel the scene as it is now."""
        prepared = [renderer.prepare_painting(self._scene) for renderer in self._renderers]
        with self._between_ticks():
            for renderer, painting in zip(self._renderers, prepared, strict=True):
                renderer.apply_painting(painting)

    @contextmanager
    def _between_ticks(self) -> Iterator[None]:
        """The loop stands meanwhile, and a real device has no force."""
        running = self.rest()
        try:
            yield
        finally:
            if running:
                for twin in self._twins:
                    resume_safety(twin.body.safety[0])
                self._go()

    def _begin(self) -> None:
        """Go on after a pause: forces begin anew."""
        for twin in self._twins:
            begin_safety(twin.body.safety[0])
        self._go()

    def _go(self) -> None:
        self._note_change()
        vendor = self._connections[0] if self._connections else None
        if isinstance(vendor, VendorConnection):
            self._calls = self._bind()
            vendor.schedule(self._calls[0].address, self._calls[0].context)
            self._stop = vendor.unschedule
            self._channel.channel.pause = 0  # only now: the library may take its time, and the watchdog waits for ticks
            return
        self._channel.channel.pause = 0
        if self._clock[VIRTUAL]:
            self._turning = self._turns()
            self._stop = partial(deque, self._turning, 0)
            return
        loop = threading.Thread(target=self._run, daemon=True)
        loop.start()
        self._stop = loop.join

    def _run(self) -> None:
        request_realtime_priority()
        if self._connections:
            deque(self._turns(), 0)
        else:
            self._bind()[0]()

    def _turns(self) -> Iterator[None]:
        """Read, tick, write, with devices that Python reads and writes; a tick each time that it is asked."""
        tick, wait = self._bind()
        pause, waiting = (self._channel.channel[name].view(np.ndarray) for name in ("pause", "waiting"))
        connections = self._connections
        try:
            while pause[0] == 0:
                wait()
                waiting[0] = 1
                for connection in connections:
                    connection.read()
                waiting[0] = 0
                tick()
                waiting[0] = 1
                for connection in connections:
                    connection.write()
                waiting[0] = 0
                yield
        except Exception as error:  # of a device or a driver: it is gone
            self._note_fault(error)
        waiting[0] = 0
        for connection in connections:  # no force is held over a pause
            connection.state.f_D_N = 0.0
            with suppress(Exception):
                connection.write()
        self._channel.channel.pause = 1  # also after a fault: a watchdog that waits for ticks would end the process

    def _bind(self) -> tuple[BoundCall, BoundCall]:
        """The compiled driver and the wait for a tick, on all that there is now; the first tick is due from now on."""
        loop = self._loop()
        calls = bound(loop), BoundCall(wait_at, loop.timer)
        start_timer(loop.timer)  # last: to bind takes some ms, by which the first ticks would be late
        return calls

    def _note_change(self) -> None:
        """What ticks remember is to be copied anew: from here on they give something else."""
        row, running = self._channel.channel[0], self._stop is not None
        row.changed = max(row.changed, row.done + running)
        row.checkpoint_due = min(row.changed, row.done + 1)

    def _note_fault(self, error: Exception) -> None:
        text = str(error) if isinstance(error, HapsceneError) else f"{type(error).__name__}: {error}"
        if not self._channel.fault[0]:
            write_text(self._channel.fault, text)
            self._faults.append(text)

    def _loop(self) -> Loop:
        c = self._channel
        return new_loop(
            self._renderers,
            [twin.body for twin in self._twins],
            c.channel[0],
            self._clock,
            timing=self._timing,
            bodies=self._bodies,
            aims=c.aims,
            hands=self._hands,
            rows=c.rows,
            felt=c.felt,
            a_m_s2=c.a_m_s2,
            a_handle_m_s2=c.a_handle_m_s2,
            checkpoints=c.checkpoints,
            checkpoint_ticks=c.checkpoint_ticks,
        )
