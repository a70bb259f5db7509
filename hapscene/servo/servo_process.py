"""The other process of a servo: builds the twin, runs the loop in a thread without the GIL, and answers."""

import threading
import traceback
import warnings
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np

from hapscene.clock import new_clock
from hapscene.contact.prediction import PREDICTED
from hapscene.errors import HapsceneError
from hapscene.records import records
from hapscene.servo.servo_loop import ServoBodies, request_realtime_priority, serve
from hapscene.servo.shared_memory import Channel, open_channel

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene
    from hapscene.twin import Twin


def run(wire: Connection, name: str, length: int) -> None:
    """The process's main function: `name` and `length` are of the channel; the arguments of `Twin` come first.

    Ends when it is told to, or when the application is gone. Answers every message with (None, result) or (error text,
    None).
    """
    from hapscene.twin import Twin

    channel = twin = desk = None
    warnings.formatwarning = lambda message, *place: f"hapscene: note: {message}\n"  # whose line it was nobody can see
    try:
        twin = Twin(**_heard(wire))
        channel = open_channel(length, twin.renderer.block, name, len(twin.renderer.world.bodies))
        desk = Desk(twin, channel)
        wire.send((None, None))
        while True:
            order, arguments = _heard(wire)
            if order == "stop":
                break
            try:
                wire.send((None, getattr(desk, order)(*arguments)))
            except HapsceneError as error:
                wire.send((str(error), None))
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
        twin = desk = None  # they look at the memory that is given back
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
    """What the application may order. Orders that the running loop would not survive stop it for less than a tick."""

    def __init__(self, twin: "Twin", channel: Channel) -> None:
        self._twin = twin
        self._channel = channel
        self._aim = np.zeros((5, 3))
        self._clock = new_clock()
        self._loop: threading.Thread | None = None
        self._started = False
        count = len(channel.frames)
        self._bodies = ServoBodies(
            channel.frames,
            records(count, PREDICTED),
            channel.moving,
            np.tile(np.eye(4), (1, count, 1, 1)),
            np.zeros(count, np.int64),
        )
        twin.renderer.world = twin.renderer.world._replace(impulse=channel.impulse)  # where the application sees it
        twin.reset((0.0, 0.0, 0.0))
        channel.channel.pause = 1
        serve(*self._arguments())  # has it compiled, and returns at once

    def start(self, p_WT_m: tuple[float, float, float]) -> None:
        """Run, the tool at rest at a place (3,)."""
        self.rest()
        self._twin.reset(p_WT_m)
        self._channel.frames["seen"] = 0.0  # impulses begin anew
        self._bodies.predicted.view(np.uint8)[:] = 0
        self._aim[:3] = 0.0
        self._aim[0] = self._aim[1] = p_WT_m
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
        self._twin.renderer.tune(swatch, **numbers)

    def repaint(self, scene: "Scene") -> None:
        """Take over a scene's swatches and what is painted with them."""
        painting = self._twin.renderer.prepare_painting(scene)
        running = self.rest()
        self._twin.renderer.take_painting(painting)
        if running:
            self._go()

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
        world = self._twin.renderer.world
        self._twin.renderer.world = world._replace(impulse=np.zeros_like(world.impulse))

    def _go(self) -> None:
        self._channel.channel.pause = 0
        self._loop = threading.Thread(target=self._tick, daemon=True)
        self._loop.start()

    def _tick(self) -> None:
        request_realtime_priority()
        serve(*self._arguments())

    def _arguments(self) -> tuple[Any, ...]:
        renderer, c = self._twin.renderer, self._channel
        state = (renderer.world, renderer.surface, self._twin.body, self._bodies)
        return *state, c.channel[0], c.rows, c.felt, c.a_m_s2, c.a_handle_m_s2, self._aim, self._clock
