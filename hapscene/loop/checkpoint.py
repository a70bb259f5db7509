"""Checkpoints: the state of a tick as bytes, copied periodically by the loop, and restored for a replay."""

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native
from hapscene.errors import HapsceneError
from hapscene.records import Record

if TYPE_CHECKING:
    from hapscene.contact.world import World
    from hapscene.surface.surface_arrays import Surface

__all__ = ["memory_of", "restore_checkpoint", "write_checkpoint"]

CHECKPOINT_TICKS: Final = 10_000
"""Ticks between two checkpoints [count]: 40 µs every ten seconds."""


def memory_of(world: "World", surface: "Surface") -> tuple[NDArray[np.uint8], ...]:
    """Return byte views of all arrays that a tick reads and changes."""
    arrays: list[NDArray[np.generic]] = [world.bodies, world.ball_W_m, world.near, world.moved, world.proxy, world.ball]
    arrays += [surface.states, surface.muted, surface.touch, surface.memory]
    return tuple(np.atleast_1d(array).view(np.ndarray).reshape(-1).view(np.uint8) for array in arrays)


_ADDRESSES: Final = (
    *("search", "face", "tree", "tree_face", "next"),
    *("shape_search", "shape_face", "shape_tree"),
)
"""Fields of a body that are specific to this process, or to how the body was loaded."""


def restore_checkpoint(world: "World", surface: "Surface", memory: NDArray[np.uint8]) -> None:
    """Write a checkpoint back to the arrays of a tick.

    Raises:
        HapsceneError: the checkpoint belongs to another scene or version.
    """
    parts = memory_of(world, surface)
    if sum(map(len, parts)) != len(memory):
        raise HapsceneError(
            f"the checkpoint has {len(memory):,} bytes, expected {sum(map(len, parts)):,}: it was recorded with other "
            "bodies, other effects or another version of hapscene"
        )
    own = {name: world.bodies[name].copy() for name in _ADDRESSES}
    at = 0
    for part in parts:
        part[:] = memory[at : at + len(part)]
        at += len(part)
    for name, values in own.items():
        world.bodies[name] = values


@native
def write_checkpoint(
    channel: Record,
    parts: tuple[NDArray[np.uint8], ...],
    checkpoints: NDArray[np.uint8],
    ticks: NDArray[np.int64],
    length: int,
) -> None:
    """Write a checkpoint before the next tick if one is due: at least four for `length` ticks of the ring buffers."""
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
