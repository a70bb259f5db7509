"""The servo's process: builds the twin, runs the loop in a thread that holds no GIL, and answers the application."""

import threading
import traceback
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np

from hapscene.clock import new_clock
from hapscene.errors import HapsceneError
from hapscene.servo.channel import Channel, open_channel
from hapscene.servo.loop import serve

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene
    from hapscene.twin import Twin


def run(wire: Connection, name: str, length: int, made: Mapping[str, Any]) -> None:
    """The process's main function: `made` are the arguments of `Twin`, `name` and `length` those of the channel.

    Ends when it is told to, or when the application is gone. Answers every message with (None, result) or (error text,
    None).
    """
    from hapscene.twin import Twin

    channel = desk = None
    try:
        twin = Twin(**made)
        channel = open_channel(length, twin.renderer.block, name)
        desk = Desk(twin, channel)
        wire.send((None, None))
        while True:
            order, arguments = wire.recv()
            if order == "stop":
                break
            try:
                wire.send((None, getattr(desk, order)(*arguments)))
            except HapsceneError as error:
                wire.send((str(error), None))
    except (EOFError, KeyboardInterrupt):
        pass  # the application is gone, or is going: Ctrl-C reaches both
    except HapsceneError as error:
        wire.send((str(error), None))
    except BaseException:
        wire.send((f"the servo's process failed:\n{traceback.format_exc()}", None))
        raise
    finally:
        if desk is not None:
            desk.rest()
            del desk
        if channel is not None:
            channel.close(unlink=False)


class Desk:
    """What the application may order. Orders that the running loop would not survive stop it for less than a tick."""

    def __init__(self, twin: "Twin", channel: Channel) -> None:
        self._twin = twin
        self._channel = channel
        self._aim = np.zeros((5, 3))
        self._clock = new_clock()
        self._loop: threading.Thread | None = None
        twin.reset((0.0, 0.0, 0.0))
        channel.channel.pause = 1
        serve(*self._arguments())  # has it compiled, and returns at once

    def start(self, p_WT_m: tuple[float, float, float]) -> None:
        """Run, the tool at rest at a place (3,)."""
        self.rest()
        self._twin.reset(p_WT_m)
        self._aim[:3] = 0.0
        self._aim[0] = self._aim[1] = p_WT_m
        self._go()

    def tune(self, swatch: str, numbers: Mapping[str, float]) -> None:
        """Change numbers of a swatch; single numbers are written whole, so the loop goes on."""
        self._twin.renderer.tune(swatch, **numbers)

    def repaint(self, scene: "Scene") -> None:
        """Take over a scene's swatches and what is painted with them."""
        surface = self._twin.renderer.prepare_surface(scene)
        running = self.rest()
        self._twin.renderer.take_surface(scene, surface)
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

    def _go(self) -> None:
        self._channel.channel.pause = 0
        self._loop = threading.Thread(target=serve, args=self._arguments(), daemon=True)
        self._loop.start()

    def _arguments(self) -> tuple[Any, ...]:
        renderer, c = self._twin.renderer, self._channel
        state = (renderer.world, renderer.surface, self._twin.body)
        return *state, c.channel[0], c.rows, c.felt, c.a_m_s2, c.a_handle_m_s2, self._aim, self._clock
