"""Checkpoints: the memory of a tick as bytes, copied now and then by the loop, and restored for a replay."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import HapsceneError

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["keep_memory", "memory_of", "remember"]

CHECKPOINT_TICKS: Final = 10_000
"""How many ticks pass between two copies of what they remember [count]: 40 µs of each ten seconds."""


def memory_of(world: "World", surface: "Surface") -> tuple[NDArray[np.uint8], ...]:
    """Views of all that a tick reads and changes, whatever it is."""
    arrays: list[Any] = [world.bodies, world.ball_W_m, world.near, world.moved, world.proxy]
    arrays += [surface.states, surface.muted, surface.touch, surface.memory]
    return tuple(np.atleast_1d(array).view(np.ndarray).reshape(-1).view(np.uint8) for array in arrays)


_ADDRESSES: Final = ("search", "shape_search", "face", "mesh_row", "shape_face", "next")
"""Fields of a body that are of this process alone, or of how it was loaded."""


def remember(world: "World", surface: "Surface", memory: NDArray[np.uint8]) -> None:
    """Put a copy of what a tick remembered back.

    Raises:
        HapsceneError: it is of another scene.
    """
    parts = memory_of(world, surface)
    if sum(map(len, parts)) != len(memory):
        raise HapsceneError(
            "the scene has other bodies or effects than the recorded one, or it was recorded by another version"
        )
    own = {name: world.bodies[name].copy() for name in _ADDRESSES}
    at = 0
    for part in parts:
        part[:] = memory[at : at + len(part)]
        at += len(part)
    for name, values in own.items():
        world.bodies[name] = values


@native
def keep_memory(channel: Any, parts: Any, checkpoints: Any, ticks: NDArray[np.int64], length: int) -> None:
    """Copy what the next tick remembers, when it is time to: so often that of the last `length` ticks some have one."""
    if channel.done < channel.checkpoint_due:
        return
    channel.checkpoint_due = channel.done + min(CHECKPOINT_TICKS, length // 4)
    slot = checkpoints[channel.checkpoint_count % len(checkpoints)]
    ticks[channel.checkpoint_count % len(ticks)] = -1
    at = 0
    for part in parts:
        if at + len(part) > len(slot):
            return
        for i in range(len(part)):
            slot[at + i] = part[i]
        at += len(part)
    ticks[channel.checkpoint_count % len(ticks)] = channel.done
    channel.checkpoint_count += 1
