"""The process of a servo: opens the devices, runs the loop, and executes orders of the application.

Simulated devices, and devices whose vendor's library calls the tick from its own thread, are driven by compiled code
without the GIL. Other devices are read before and written after each tick by a Python thread of this process.
"""

import gc
import os
import signal
import sys
import threading
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from multiprocessing.connection import Connection as Pipe
from multiprocessing.connection import wait as ready_among
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import VIRTUAL, new_clock
from hapscene.compiled.bound_call import BoundCall
from hapscene.contact.prediction import PREDICTED
from hapscene.device.driver import DRIVER_FIELDS, Connection, VendorConnection, new_state
from hapscene.device.driver_registry import DRIVERS, DeviceChoice
from hapscene.device.model import DeviceLike, limits_of
from hapscene.device.safety import begin_safety, resume_safety, safety_of, simulated_safety
from hapscene.device.sim.arm import new_arm, read_arm
from hapscene.errors import DeviceError, HapsceneError, UsageWarning
from hapscene.geometry import rigid
from hapscene.loop.checkpoint import memory_of
from hapscene.loop.driver import (
    BLOCKING,
    CALLED,
    ENDED,
    SCHEDULED,
    TIMED,
    Bodies,
    Exchange,
    Loop,
    bound,
    new_loop,
    remove_stale_force,
)
from hapscene.loop.session_log import log_of, note_order, settings_of, write_log
from hapscene.loop.shared_memory import Channel, open_channel, write_text
from hapscene.loop.timing import TIMING, request_realtime_priority, start_timer, wait_for_tick
from hapscene.records import Records, records
from hapscene.render.renderer import Renderer
from hapscene.render.tick import use_fading, use_moving_bodies
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import Painting
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

if TYPE_CHECKING:
    from hapscene.loop import Twin

__all__ = ["OrderHandler", "open_twins", "run"]

WATCH_S: Final = 0.1
"""Period at which devices are checked for errors [s]."""

ABSENT: Final = 4
"""Added to the reasons in `Surface.muted` of all effects of a tool that touches nothing."""

SWITCH_S: Final = 1e-4
"""Longest time that another Python thread may delay the thread that reads and writes a device [s]; Python's default is
5 ms."""


def run(wire: Pipe, life: Pipe, name: str, length: int) -> None:
    """Main function of the process; receives the arguments of `Twin` first.

    It ends on the order "stop", when the application has ended, or at SIGTERM. It answers each order with (None,
    result) or (error text, None). Before it is ready, it sends the stages of the start as (None, text).

    Args:
        wire: connection for orders and answers.
        life: gets a message when all devices are closed.
        name, length: name of the shared memory and length of its ring buffers.
    """
    from hapscene.loop import Twin

    signal.signal(signal.SIGTERM, _end)
    channel = handler = None
    interrupted = False
    twins: list[Twin] = []
    opened: list[Connection] = []
    ending = ""
    # the source line is of no use to the user
    warnings.formatwarning = lambda message, *place: f"hapscene: note: {message}\n"
    try:
        made = _receive(wire)
        bodies, folder = made.pop("bodies"), made.pop("log_folder")
        faces = sum(len(body.mesh.faces) for body in made["scene"].bodies)
        wire.send((None, f"search structures of {faces:,} faces"))
        twins += open_twins(made, opened)
        channel = open_channel(length, twins[0].renderer.block, name, bodies=bodies, tools=len(twins))
        settings = settings_of([twin.renderer for twin in twins], made.get("settings"))
        wire.send((None, "compiled code, which the first run makes"))
        handler = OrderHandler(made["scene"], twins, channel, folder, settings)
        wire.send((None, handler.made))
        _answer_orders(wire, life, handler)
    except (EOFError, ConnectionError, KeyboardInterrupt) as error:
        # the application has ended; where signals cannot be blocked, Ctrl-C reaches both processes
        ending, interrupted = "the application has ended", isinstance(error, KeyboardInterrupt)
    except HapsceneError as error:
        wire.send((str(error), None))
    except BaseException:
        wire.send((f"the servo's process failed:\n{traceback.format_exc()}", None))
        raise
    finally:
        try:
            if handler is not None:
                handler.end()
        finally:
            for connection in opened if handler is None else handler.connections:
                connection.close()
                connection.state = new_state()  # no longer in the shared memory
            if not interrupted:  # otherwise a thread may still write a force, and the watchdog removes it afterwards
                with suppress(OSError):
                    life.send(None)
        if handler is not None:
            handler.write_faults()
            if ending:
                handler.write_log(ending)
        handler = None
        twins.clear()  # they hold views of the shared memory
        if channel is not None:
            channel.close(unlink=False)


def _answer_orders(wire: Pipe, life: Pipe, handler: "OrderHandler") -> None:
    """Answer the orders of the application until "stop", and meanwhile check the devices for errors."""
    watched, ends = True, [] if os.name == "nt" else [life]  # which the end of the watchdog wakes
    while True:
        while handler.connections and wire not in (ready := ready_among([wire, *ends], WATCH_S)):
            if life in ready:
                watched, ends = False, []
            handler.check_devices(watched)
        order, arguments = _receive(wire)
        if order == "stop":
            return
        wire.send(handler.answer(order, arguments))


def _end(signum: int, frame: object) -> None:
    signal.signal(signum, signal.SIG_IGN)  # a second signal would interrupt the closing of the devices
    raise KeyboardInterrupt


def open_twins(made: dict[str, Any], opened: list[Connection]) -> "list[Twin]":
    """Make a twin for each device of the application; real devices are opened and appended to `opened`."""
    devices, force_N = made.pop("devices"), made.pop("force_N")
    twins = [_twin(device, opened, made) for device in devices]
    if force_N is not None:
        for twin in twins:
            twin.safety.force_N = min(float(twin.safety.force_N[0]), force_N)
    return twins


def _twin(device: "DeviceLike | DeviceChoice", opened: list[Connection], made: dict[str, Any]) -> "Twin":
    """Make the twin of one device; a real device is opened and appended to `opened`."""
    from hapscene.loop import Twin

    if not isinstance(device, DeviceChoice):
        twin = Twin(device=device, **made)
        twin.safety = simulated_safety()
        return twin
    driver = DRIVERS.load(device.name)
    for name in ("limits", "delay_ticks"):
        if made.get(name):
            raise HapsceneError(
                f"{name} is for simulated devices only; the driver of {device.name!r} states what the device can do"
            )
    if driver.model is not None:
        made = made | {"limits": limits_of(driver.model, made["tick_s"])}
    if made.get("X_WD") is not None:
        made = made | {"X_WD": rigid(made["X_WD"], f"device {device.name!r}")}  # scale would also scale forces
    opened.append(connection := device.open())
    twin = Twin(device=connection, **made)
    twin.safety = safety_of(driver)
    return twin


def _share(connection: Connection, state: Records) -> None:
    """Move the state of a connection to other memory, (1,) DEVICE_STATE; the log of the buttons there is continued."""
    for name in DRIVER_FIELDS:
        state[name] = connection.state[name]
    connection.state = state


def _receive(wire: Pipe) -> Any:
    """Return the next message of the application.

    Raises:
        EOFError: the application has ended, possibly while it was sending.
    """
    try:
        return wire.recv()
    except OSError:
        raise EOFError from None


NO_REPLAY: Final = np.iinfo(np.int64).max
"""Value of `CHANNEL.changed` if a log cannot be replayed, because bodies were added, removed or deformed."""


class OrderHandler:
    """Executes orders of the application. Orders that replace arrays of the running loop pause it, for about 12 ms."""

    def __init__(
        self,
        scene: Scene,
        twins: "Sequence[Twin]",
        channel: Channel,
        log_folder: str | None = None,
        made: Mapping[str, object] | None = None,
        clock: NDArray[np.int64] | None = None,
    ) -> None:
        """Prepare the loop without starting it.

        `clock` is from `new_clock`. On a virtual clock, ticks run only in `advance`.
        """
        self._scene, self._log_folder, self.made = scene, log_folder, dict(made or {})
        self._twins = tuple(twins)
        self._channel = channel
        self._hands = np.zeros((len(twins), 5, 3))
        self._clock = new_clock() if clock is None else clock
        self._stop: Callable[[], object] | None = None  # stops the loop and waits until it has ended
        self._ticks: Iterator[None] = iter(())
        self._started = False
        self._absent: set[int] = set()  # tools that touch nothing
        self._stopped_ns = 0  # time of the last tick before an order stopped the loop; 0: it was not stopped
        self._faults: list[str] = []
        self._tuned: list[tuple[str, str, dict[str, float]]] = []
        self._timing = records(1, TIMING)[0]
        self.connections = [twin.device for twin in self._twins if isinstance(twin.device, Connection)]
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
        self._share_twins()
        self._vendors = [device for device in self.connections if isinstance(device, VendorConnection)]
        channel.channel.pause = 1
        parts = (part for r in self._renderers for part in memory_of(r.world, r.surface))
        channel.channel.checkpoint_size = sum(len(part) for part in parts)
        self._alone = len(self._twins) == 1 and bool(self._vendors)  # the vendor's thread calls the tick
        by_python = any(not device.compiled() for device in self._own_connections())
        driven = by_python or bool(self._clock[VIRTUAL])  # tick by tick, from Python
        pace = SCHEDULED if self._alone else CALLED if driven else TIMED
        channel.channel.pace, channel.channel.until = pace, np.iinfo(np.int64).max
        self._bind()  # compiles before the loop starts
        if self.connections and not self._clock[VIRTUAL]:
            gc.freeze()  # keeps existing objects out of garbage collections, which would delay devices
            sys.setswitchinterval(SWITCH_S)

    def _share_twins(self) -> None:
        """Move what the application reads of the twins to the shared memory, and reset them there."""
        for twin, impulse, state in zip(self._twins, self._channel.impulse, self._channel.states, strict=True):
            twin.renderer.world = twin.renderer.world._replace(impulse=impulse)
            # so that no body that moves later interrupts the loop
            use_moving_bodies(twin.renderer.world, twin.renderer.surface)
            if isinstance(twin.device, Connection):
                _share(twin.device, state.reshape(1).view(np.recarray))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UsageWarning)  # the first start has another position
                twin.reset((0.0, 0.0, 0.0))

    @property
    def _renderers(self) -> list[Renderer]:
        return [twin.renderer for twin in self._twins]

    def answer(self, order: str, arguments: Sequence[object]) -> tuple[str | None, object]:
        """Execute an order; return (None, result) or (error text, None)."""
        try:
            return None, getattr(self, order)(*arguments)
        except HapsceneError as error:
            return str(error), None
        except Exception as error:  # an internal error or one of an effect must not end the loop
            return f"the order {order!r} failed: {type(error).__name__}: {error!s:.200}", None

    def advance(self, ticks: int) -> None:
        """Run this many ticks on a virtual clock; none while the loop is paused."""
        deque(islice(self._ticks, ticks), 0)

    def start(
        self,
        places_m: Sequence[tuple[float, float, float]],
        grip: NDArray[np.float64],
        tool: int | None = None,
    ) -> NDArray[np.float64]:
        """Start with the tools at rest at their positions (3,), held by a grip (3,) as in `AIM`; or only one tool,
        while those that were started before go on. Return the impulse (b, 6) of these tools, which starts from 0."""
        chosen = range(len(self._twins)) if tool is None else [tool]
        for k, place_m in zip(chosen, places_m, strict=True):
            new_arm(self._twins[k].device, place_m, self._twins[k].X_WD)  # raises an error if it is out of reach
        if tool is not None and not self._started:
            self._absent.update(range(len(self._twins)))
        self._absent.difference_update(chosen)
        running = self.pause() and tool is not None
        self._stopped_ns = int(self._timing.began_ns) if running else 0
        given: NDArray[np.float64] = self._channel.impulse[list(chosen)].sum(axis=0)
        if tool is None:
            self._channel.frames["applied"] = 0.0
            self._bodies.predicted.view(np.uint8)[:] = 0
        else:  # the prediction goes on with the impulses of the other tools
            self._channel.frames["applied"] -= given
            self._bodies.predicted["given"] -= given
            self._bodies.predicted["frame_applied"] -= given
        for k, place_m in zip(chosen, places_m, strict=True):
            twin, aim = self._twins[k], self._channel.aims[k]
            twin.reset(place_m)
            if isinstance(twin.device, Connection):
                twin.device.read()
                twin.renderer.reset(np.array(read_arm(twin.tool.arm)))
            moving = self._channel.moving[: int(self._channel.channel[0].moving_count)]
            if twin.renderer.world.proxy[0].enclosing - 1 not in moving:  # a moving body has its pose in the first tick
                twin.renderer.warn_if_inside()
            aim["count"] |= 1  # the application waits for the answer meanwhile
            aim["aim"][:] = place_m, grip, (0.0, 0.0, 0.0)
            aim["count"] += 1
            self._hands[k, :3] = place_m, place_m, (0.0, 0.0, 0.0)
        self._started = True
        self._mute_absent()
        for k, twin in enumerate(self._twins):
            (begin_safety if k in chosen or not running else resume_safety)(twin.tool.safety[0])  # ramps up, or goes on
        self._channel.channel.stop_force = 0  # before the first tick, which would otherwise count as a safety stop
        self._run_loop()
        return given

    def withdraw(self, tool: int) -> None:
        """Let a tool touch nothing until its next start."""
        self._absent.add(tool)
        self._mute_absent()
        self._note_change()

    def _mute_absent(self) -> None:
        for k, renderer in enumerate(self._renderers):
            muted = renderer.surface.muted
            muted[:] = muted | ABSENT if k in self._absent else muted & ~ABSENT

    def resume(self) -> None:
        """Continue after `pause`, with contact and state kept."""
        if not self._started:
            raise HapsceneError("resume: the servo was never started; call start first")
        if self._stop is None:
            self._start_loop()
        self._channel.channel.stop_force = 0

    def check_devices(self, watched: bool = True) -> None:
        """Report errors of the devices and the end of the watchdog to the application, and write the log if one
        occurred."""
        if not watched and self._stop is not None:
            self._note_fault(DeviceError("the watchdog has ended; start a new servo"))
            self.pause()
        self.write_faults()
        reasons = [connection.reason(int(connection.state.trouble[0])) for connection in self.connections]
        write_text(self._channel.notice, "; ".join(filter(None, reasons)))
        for device in self.connections if self._stop is not None else ():  # a paused vendor's thread calls no tick
            try:
                device.check()
            except Exception as error:
                self._note_fault(error)
                self.pause()

    def recover(self, choices: Sequence[DeviceChoice]) -> None:
        """Close all devices and open them again, after a fault; the loop stays paused.

        Raises:
            DeviceError: a device cannot be opened. The fault remains.
        """
        self.pause()
        twins = [twin for twin in self._twins if isinstance(twin.device, Connection)]
        try:
            for k, (twin, choice) in enumerate(zip(twins, choices, strict=True)):
                before = self.connections[k]
                before.close()
                twin.device = self.connections[k] = choice.open()
                _share(self.connections[k], before.state)
            write_text(self._channel.fault, "")  # `check_devices` may have noted it again meanwhile
        except DeviceError as error:
            self._note_fault(error)
            raise
        finally:
            self._vendors = [device for device in self.connections if isinstance(device, VendorConnection)]

    def home(self) -> None:
        """Take the present positions of the devices that are not ready as their home positions."""
        waiting = [connection for connection in self.connections if connection.state.ready[0] == 0]
        able = [connection for connection in waiting if type(connection).home is not Connection.home]
        if not able:
            raise DeviceError("no device waits for its home position")
        with self._between_ticks():
            for connection in able:
                connection.home()

    def change(self, order: str, name: str, arguments: dict[str, float]) -> None:
        """Change parameters of a swatch or effect, by one of the methods `ORDERS` of the renderer.

        The loop continues, because single numbers are written atomically.
        """
        for renderer in self._renderers:
            getattr(renderer, order)(name, **arguments)
        self._mute_absent()
        note_order(self._tuned, order, name, arguments)
        self._note_change()

    def repaint(self, swatches: Sequence[Swatch], painted: Sequence[Painting]) -> None:
        """Change the swatches and the painted faces of each body."""
        before = self._scene.swatches, [(body.face_swatch, body.fine) for body in self._scene.bodies]
        self._paint(swatches, painted)
        try:
            self._apply_scene()
        except BaseException:
            self._paint(*before)
            raise

    def add(self, body: Body, like: int | None, swatches: Sequence[Swatch]) -> None:
        """Add a body. `like` is the number of a body with the same mesh, or None."""
        if like is not None:
            body = replace(body, mesh=self._scene.bodies[like].mesh)
        before = self._scene.swatches
        self._scene.swatches = list(swatches)
        self._scene.bodies.append(body)
        try:
            self._apply_scene()
        except BaseException:
            self._scene.swatches = before
            self._scene.bodies.pop()
            raise
        self._channel.channel.changed = NO_REPLAY

    def remove(self, body: str) -> None:
        """Remove a body from contact."""
        for renderer in self._renderers:
            use_fading(renderer.surface, False)  # compiles before the loop pauses
        with self._between_ticks():
            for renderer in self._renderers:
                renderer.remove(body)
        self._channel.channel.changed = NO_REPLAY

    def deform(self, body: str, vertices_m: NDArray[np.float64]) -> None:
        """Change the shape of a body. The loop continues, except for the first shape of a body."""
        for renderer in self._renderers:
            world = renderer.world
            try:
                renderer.deform(body, vertices_m)
            finally:
                if renderer.world is not world:
                    with self._between_ticks():
                        pass  # the loop continues with the new world
        self._channel.channel.changed = NO_REPLAY

    def write_faults(self) -> None:
        """Write a session log for each fault since the last call."""
        while self._faults:
            self.write_log(self._faults.pop())

    def write_log(self, reason: str) -> None:
        """Write a session log if the application named a folder and a tick is complete."""
        channel = self._channel
        if self._log_folder is not None and channel.channel[0].done > 0:
            note = write_log(log_of(channel, self._scene, self.made, self._tuned, reason), self._log_folder)
            print(f"hapscene: note: {note}", file=sys.stderr, flush=True)

    def pause(self) -> bool:
        """Stop the loop; return whether it was running."""
        self._channel.channel.pause = 1
        if self._stop is None:
            return False
        try:
            self._stop()
        except DeviceError as error:  # a vendor's library does not take the force away
            self._note_fault(error)
            self.write_faults()
            os.kill(os.getpid(), signal.SIGTERM if os.name == "nt" else signal.SIGKILL)  # the watchdog opens the device
        self._stop = None  # not before: a signal may interrupt the line above
        return True

    def end(self) -> None:
        """Stop the loop and release the shared memory."""
        self.pause()
        self._channel.channel.stop_force = 1  # a handle is silent at once
        for renderer in self._renderers:
            renderer.world = renderer.world._replace(impulse=np.zeros_like(renderer.world.impulse))

    def _paint(self, swatches: Sequence[Swatch], painted: Sequence[Painting]) -> None:
        self._scene.swatches = list(swatches)
        for body, (face_swatch, fine) in zip(self._scene.bodies, painted, strict=True):
            body.face_swatch, body.fine = face_swatch, fine

    def _apply_scene(self) -> None:
        """Use the present swatches, painted faces and bodies of the scene."""
        prepared = [renderer.prepare_painting(self._scene) for renderer in self._renderers]
        with self._between_ticks():
            for renderer, painting in zip(self._renderers, prepared, strict=True):
                renderer.apply_painting(painting)

    @contextmanager
    def _between_ticks(self) -> Iterator[None]:
        """Pause the loop for the body of the context; a real device has no force meanwhile."""
        running = self.pause()
        self._stopped_ns = int(self._timing.began_ns) if running else 0
        try:
            yield
        finally:
            if running:
                for twin in self._twins:
                    resume_safety(twin.tool.safety[0])
                self._run_loop()

    def _start_loop(self) -> None:
        """Start the loop; forces ramp up from 0."""
        for twin in self._twins:
            begin_safety(twin.tool.safety[0])
        self._channel.channel.stop_force = 0  # before the first tick, which would otherwise count as a safety stop
        self._run_loop()

    def _run_loop(self) -> None:
        self._note_change()
        # the vendors' libraries first: they may take long to start, and the watchdog expects ticks
        if self._alone:
            self._calls = list(self._bind())
            self._vendors[0].schedule(self._calls[0].address, self._calls[0].context)
            self._channel.channel.pause = self._channel.channel.waiting = 0
            self._stop = partial(self._end_loop, lambda: None)
            return
        row, now = self._channel.channel[0], int(self._clock[VIRTUAL])
        exchanges = [Exchange(row, vendor.state[0], new_clock(now)) for vendor in self._vendors]
        self._calls = [BoundCall(remove_stale_force, given) for given in exchanges]
        for vendor, call in zip(self._vendors, self._calls, strict=True):
            vendor.schedule(call.address, call.context)
        self._channel.channel.pause, self._channel.channel.waiting = 0, BLOCKING  # until the first tick is due
        if self._clock[VIRTUAL]:
            self._ticks = self._device_loop()
            self._stop = partial(self._end_loop, partial(deque, self._ticks, 0))
            return
        loop = threading.Thread(target=self._loop_thread, daemon=True)
        loop.start()
        self._stop = partial(self._end_loop, loop.join)

    def _end_loop(self, join: Callable[[], object]) -> None:
        """Wait until the loop has ended, and end the exchange with the vendors' threads."""
        join()
        self._channel.channel.waiting = BLOCKING if self._vendors else ENDED
        with ExitStack() as stack:  # all of them, also if one raises
            for vendor in self._vendors:
                stack.callback(vendor.unschedule)
        self._channel.channel.waiting = ENDED

    def _loop_thread(self) -> None:
        request_realtime_priority()
        if self._channel.channel[0].pace == CALLED:
            deque(self._device_loop(), 0)
        else:
            drive = self._bind()[0]
            self._channel.channel.waiting = 0
            drive()
            self._stop_forces()

    def _device_loop(self) -> Iterator[None]:
        """Read, tick and write devices that Python drives; one tick each time the iterator advances."""
        tick, wait = self._bind()
        pause, waiting = (self._channel.channel[name].view(np.ndarray) for name in ("pause", "waiting"))
        connections, waiting[0] = self._own_connections(), 0
        try:
            while pause[0] == 0:
                wait()
                waiting[0] = BLOCKING
                for connection in connections:
                    connection.read()
                waiting[0] = 0
                tick()
                waiting[0] = BLOCKING
                for connection in connections:
                    connection.write()
                waiting[0] = 0
                yield
        except Exception as error:  # a device or its driver failed
            self._note_fault(error)
        self._stop_forces()
        self._channel.channel.pause, waiting[0] = 1, ENDED  # also after a fault

    def _own_connections(self) -> list[Connection]:
        return [device for device in self.connections if device not in self._vendors]

    def _stop_forces(self) -> None:
        """Send a force of zero; the watchdog waits for it until `_end_loop`."""
        self._channel.channel.waiting = BLOCKING
        for connection in self._own_connections():  # no force during a pause
            connection.state.f_D_N = 0.0
            with suppress(Exception):
                connection.write()

    def _bind(self) -> tuple[BoundCall, BoundCall]:
        """Bind the compiled driver and the wait for a tick to the present arrays; the first tick is one period away."""
        loop = self._loop()
        calls = bound(loop), BoundCall(wait_for_tick, loop.timer)
        start_timer(loop.timer)  # last, because binding takes some ms, which would delay the first ticks
        if self._stopped_ns:  # ticks that an order has cost count as missed
            loop.timer.channel.missed += (loop.timer.timing.began_ns - self._stopped_ns) // loop.timer.tick_ns - 1
            self._stopped_ns = 0
        return calls

    def _note_change(self) -> None:
        """Request a new checkpoint: from here on the recorded state no longer leads to the same output."""
        row, running = self._channel.channel[0], self._stop is not None
        row.changed = max(row.changed, row.done + running)
        row.checkpoint_due = min(row.changed, row.done + 1)

    def _note_fault(self, error: Exception) -> None:
        text = str(error) if isinstance(error, HapsceneError) else f"{type(error).__name__}: {error}"
        if not self._channel.fault[0]:
            write_text(self._channel.fault, text)
            self._faults.append(text)

    def _drivers(self) -> NDArray[np.uintp]:
        """Compiled drivers, as in `Loop`; none if Python calls them."""
        if self._channel.channel[0].pace != TIMED:
            return np.zeros((0, 4), np.uintp)
        calls = [device.compiled() or () for device in self._own_connections()]
        return np.array(
            [[x for call in pair for x in (call.address, call.context)] for pair in calls], np.uintp
        ).reshape(-1, 4)

    def _loop(self) -> Loop:
        c = self._channel
        return new_loop(
            self._renderers,
            [twin.tool for twin in self._twins],
            c.channel[0],
            self._clock,
            timing=self._timing,
            bodies=self._bodies,
            aims=c.aims,
            hands=self._hands,
            rows=c.rows,
            loop_rows=c.loop_rows,
            a_m_s2=c.a_m_s2,
            a_handle_m_s2=c.a_handle_m_s2,
            checkpoints=c.checkpoints,
            checkpoint_ticks=c.checkpoint_ticks,
            drivers=self._drivers(),
        )
