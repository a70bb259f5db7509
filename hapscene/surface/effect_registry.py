"""Installed effects, found through the entry-point group `hapscene.effects`."""

from typing import Final

from hapscene.errors import EffectError
from hapscene.plugin_registry import Offer, PluginRegistry
from hapscene.surface.effect import Effect

__all__ = ["GROUP", "listed", "load_effect"]

GROUP: Final = "hapscene.effects"
"""Entry-point group of effect plugins."""

REGISTRY: Final = PluginRegistry(GROUP, "effect", Effect, EffectError)


def listed() -> dict[str, Offer[Effect]]:
    """Return all installed effects by name, in alphabetical order, each imported or with its error."""
    return REGISTRY.listed()


def load_effect(name: str) -> Effect:
    """Return an effect by name.

    Raises:
        EffectError: the effect is unknown, offered by two packages, not importable, or not an `Effect` of that name.
    """
    return REGISTRY.load(name)
