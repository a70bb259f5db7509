"""How finely a scene is rendered: the mesh of each body, the texture of each swatch, and what is left out of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hapscene.scene.mesh import Mesh


@dataclass(frozen=True)
class BodyFidelity:
    """A body as it is felt.

    Attributes:
        mesh: that is felt in the place of its own, with its painting's faces told by `face_of`; None for its own.
    """

    mesh: Mesh | None = None


@dataclass(frozen=True)
class SwatchFidelity:
    """A swatch as it is felt.

    Attributes:
        order: of its texture's models; None for its own.
        update_ticks: after how many ticks the texture's filter follows force and speed [count].
        left_out: names of effects that nobody would feel.
    """

    order: int | None = None
    update_ticks: int = 1
    left_out: tuple[str, ...] = ()


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
