"""The other process of a servo: builds the twin, runs the loop in a thread without the GIL, and answers."""

import threading
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hapscene.clock import new_clock
from hapscene.contact.prediction import PREDICTED
from hapscene.device.arm import new_arm
from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.servo.servo_loop import ServoBodies, request_realtime_priority, serve
from hapscene.servo.shared_memory import Channel, open_channel

if TYPE_CHECKING:
    from hapscene.renderer import Renderer
    from hapscene.scene.body import Body
    from hapscene.scene.scene import Scene
    from hapscene.surface.swatch import Swatch
    from hapscene.twin import Twin


def run(wire: Connection, name: str, length: int) -> None:
    """The process's main function: `name` and `length` are of the channel; the arguments of `Twin` come first.

    Ends when it is told to, or when the application is gone. Answers every message with (None, result) or (error text,
    None).
    """
    from hapscene.twin import Twin

    channel = desk = None
    twins: list[Twin] = []
    warnings.formatwarning = lambda message, *place: f"hapscene: note: {message}\n"  # whose line it was nobody can see
    try:
        made = _heard(wire)
        devices, bodies = made.pop("devices"), made.pop("bodies")
        twins += [Twin(device=device, **made) for device in devices]
        channel = open_channel(length, twins[0].renderer.block, name, bodies=bodies, tools=len(twins))
        desk = Desk(made["scene"], twins, channel)
        wire.send((None, None))
        while True:
            order, arguments = _heard(wire)
            if order == "stop":
                break
            try:
                wire.send((None, getattr(desk, order)(*arguments)))
            except HapsceneError as error:
                wire.send((str(error), None))
            except Exception as error:  # a fault of ours, or of an effect's: what is felt goes on
                wire.send((f"the order {order!r} failed: {type(error).__name__}: {error!s:.200}", None))
    except (EOFError, ConnectionError, KeyboardInterrupt):
        pass  # the application is gone; where signals cannot be held off, Ctrl-C reaches both
    except HapsceneError as error:
        wire.send((str(error), None))
    except BaseException:
        wire.send((f"the servo's process failed:\n{traceback.format_exc()}", None))
        raise
    finally:
        if desk is not None:
            desk.end()
        desk = None
        twins.clear()  # they look at the memory that is given back
        if channel is not None:
            channel.close(unlink=False)


def _heard(wire: Connection) -> Any:
    """What the application sends.

    Raises:
        EOFError: it is gone, maybe in the middle of a word.
    """
    try:
        return wire.recv()
    except OSError:
        raise EOFError from None


class Desk:
    """What the application may order. Orders that the running loop would not survive stop it for one to three ticks."""

    def __init__(self, scene: "Scene", twins: "Sequence[Twin]", channel: Channel) -> None:
        self._scene = scene
        self._twins = tuple(twins)
        self._channel = channel
        self._hands = np.zeros((len(twins), 5, 3))
        self._clock = new_clock()
        self._loop: threading.Thread | None = None
        self._started = False
        count = len(channel.frames)
        self._bodies = ServoBodies(
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
            twin.reset((0.0, 0.0, 0.0))
        channel.channel.pause = 1
        serve(*self._arguments())  # has it compiled, and returns at once

    @property
    def _renderers(self) -> "list[Renderer]":
        return [twin.renderer for twin in self._twins]

    def start(self, places_m: Sequence[tuple[float, float, float]], grip: NDArray[np.float64]) -> None:
        """Run, the tools at rest at their places (3,), held there by a grip as the aim has it (3,)."""
        for twin, place_m in zip(self._twins, places_m, strict=True):
            new_arm(twin.device, place_m, twin.X_WD)  # raises where it is out of reach
        self.rest()
        for twin, place_m in zip(self._twins, places_m, strict=True):
            twin.reset(place_m)
        self._channel.frames["seen"] = 0.0  # impulses begin anew
        self._bodies.predicted.view(np.uint8)[:] = 0
        for aim, place_m in zip(self._channel.aims, places_m, strict=True):  # the application waits meanwhile
            aim["count"] |= 1
            aim["aim"][:] = place_m, grip, (0.0, 0.0, 0.0)
            aim["count"] += 1
        self._hands[:, :3] = 0.0
        self._hands[:, 0] = self._hands[:, 1] = places_m
        self._started = True
        self._go()

    def resume(self) -> None:
        """Go on from where `rest` stopped, contact and memory kept."""
        if not self._started:
            raise HapsceneError("a servo that never started has nothing to resume: start it")
        if self._loop is None:
            self._go()

    def tune(self, swatch: str, numbers: Mapping[str, float]) -> None:
        """Change numbers of a swatch; single numbers are written whole, so the loop goes on."""
        for renderer in self._renderers:
            renderer.tune(swatch, **numbers)

    def tune_field(self, effect: str, numbers: Mapping[str, float]) -> None:
        """Change numbers of an effect of the scene, likewise."""
        for renderer in self._renderers:
            renderer.tune_field(effect, **numbers)

    def repaint(self, swatches: "Sequence[Swatch]", painted: Sequence[NDArray[np.int16]]) -> None:
        """Take over swatches, and which face of each body wears which."""
        before = self._scene.swatches, [body.face_swatch for body in self._scene.bodies]
        self._paint(swatches, painted)
        try:
            self._take_scene()
        except BaseException:
            self._paint(*before)
            raise

    def add(self, body: "Body", like: int | None, swatches: "Sequence[Swatch]") -> None:
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

    def remove(self, body: str) -> None:
        """Feel a body no more."""
        with self._between_ticks():
            for renderer in self._renderers:
                renderer.remove(body)

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

    def rest(self) -> bool:
        """Stop the loop; says whether it ran."""
        if self._loop is None:
            return False
        self._channel.channel.pause = 1
        self._loop.join()
        self._loop = None
        return True

    def end(self) -> None:
        """Stop for good, and let go of the shared memory."""
        self.rest()
        for renderer in self._renderers:
            renderer.world = renderer.world._replace(impulse=np.zeros_like(renderer.world.impulse))

    def _paint(self, swatches: "Sequence[Swatch]", painted: Sequence[NDArray[np.int16]]) -> None:
        self._scene.swatches = list(swatches)
        for body, face_swatch in zip(self._scene.bodies, painted, strict=True):
            body.face_swatch = face_swatch

    def _take_scene(self) -> None:
        """Feel the scene as it is now."""
        prepared = [renderer.prepare_painting(self._scene) for renderer in self._renderers]
        with self._between_ticks():
            for renderer, painting in zip(self._renderers, prepared, strict=True):
                renderer.take_painting(painting)

    @contextmanager
    def _between_ticks(self) -> Iterator[None]:
        """The loop stands meanwhile."""
        running = self.rest()
        try:
            yield
        finally:
            if running:
                self._go()

    def _go(self) -> None:
        self._channel.channel.pause = 0
        self._loop = threading.Thread(target=self._tick, daemon=True)
        self._loop.start()

    def _tick(self) -> None:
        request_realtime_priority()
        serve(*self._arguments())

    def _arguments(self) -> tuple[Any, ...]:
        c, renderers = self._channel, self._renderers
        worlds, surfaces = tuple(r.world for r in renderers), tuple(r.surface for r in renderers)
        twins = tuple(twin.body for twin in self._twins)
        rings = c.rows, c.felt, c.a_m_s2, c.a_handle_m_s2
        return worlds, surfaces, twins, self._bodies, c.channel[0], c.aims, *rings, self._hands, self._clock
