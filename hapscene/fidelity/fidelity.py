"""The level of detail of a scene: the mesh of each body, and the texture of each swatch."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hapscene.scene.mesh import Mesh

__all__ = ["BodyFidelity", "Fidelity", "Level", "SwatchFidelity"]


@dataclass(frozen=True)
class BodyFidelity:
    """Level of detail of a body.

    Attributes:
        mesh: mesh to use instead of its own, whose groups are the swatches of the scene; None for its own.
    """

    mesh: Mesh | None = None


@dataclass(frozen=True)
class SwatchFidelity:
    """Level of detail of a swatch.

    Attributes:
        order: order of the texture models; None for their own.
        update_ticks: interval at which the filter of the texture adapts to force and speed [ticks].
    """

    order: int | None = None
    update_ticks: int = 1


@dataclass(frozen=True)
class Level:
    """A level of detail of a scene.

    Attributes:
        bodies, swatches: by name; bodies and swatches that are not named are unchanged.
        cost: difference [JND] on test paths, time of a tick [µs], memory [bytes], loading time [s], by name.
    """

    bodies: Mapping[str, BodyFidelity] = field(default_factory=dict)
    swatches: Mapping[str, SwatchFidelity] = field(default_factory=dict)
    cost: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Fidelity:
    """The level of detail that a scene needs, as measured on a machine.

    Attributes:
        level: the level of detail.
        made: conditions of the measurement by name: device, handle, budget, JND, machine, versions, seed.
    """

    level: Level = Level()
    made: Mapping[str, Any] = field(default_factory=dict)
