"""How finely a scene is rendered: the mesh of each body, the texture of each swatch."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hapscene.scene.mesh import Mesh

__all__ = ["BodyFidelity", "Fidelity", "Level", "SwatchFidelity"]


@dataclass(frozen=True)
class BodyFidelity:
    """How a body is rendered.

    Attributes:
        mesh: used in place of its own, its groups the scene's swatches; None for its own.
    """

    mesh: Mesh | None = None


@dataclass(frozen=True)
class SwatchFidelity:
    """How a swatch is rendered.

    Attributes:
        order: of its texture's models; None for its own.
        update_ticks: after how many ticks the texture's filter follows force and speed [count].
    """

    order: int | None = None
    update_ticks: int = 1


@dataclass(frozen=True)
class Level:
    """One way to render a scene.

    Attributes:
        bodies, swatches: by name; what is not named is as it is.
        told: what it costs: error [JND] on unseen paths, time [µs], memory [bytes], time to load [s].
    """

    bodies: Mapping[str, BodyFidelity] = field(default_factory=dict)
    swatches: Mapping[str, SwatchFidelity] = field(default_factory=dict)
    told: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Fidelity:
    """What a scene needs on a machine.

    Attributes:
        level: how the scene is rendered.
        made: scene's digest, device, handle, budget, JND, machine, versions, seed: by name.
    """

    level: Level = Level()
    made: Mapping[str, Any] = field(default_factory=dict)
