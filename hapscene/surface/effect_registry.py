"""The effects there are: ours and anybody's, through the entry-point group `hapscene.effects`."""

from typing import Final

from hapscene.errors import EffectError
from hapscene.plugin_registry import Offer, PluginRegistry
from hapscene.surface.effect import Effect

__all__ = ["GROUP", "listed", "load_effect"]

GROUP: Final = "hapscene.effects"
"""Name of the entry-point group that effect plugins join."""

REGISTRY: Final = PluginRegistry(GROUP, "effect", Effect, EffectError)


def listed() -> dict[str, Offer[Effect]]:
    """All installed effects by name, in alphabetical order, each imported or with its error."""
    return REGISTRY.listed()


def load_effect(name: str) -> Effect:
    """The effect called `name`.

    Raises:
        EffectError: no such effect, offered by two packages, not importable, or not an `Effect` of that name.
    """
    return REGISTRY.load(name)
