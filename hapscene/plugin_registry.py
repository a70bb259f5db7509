"""Registry of plugins of installed packages, such as effects and devices, by entry-point group.

A package provides a plugin by an entry point in its pyproject.toml (see `examples/third_party_effect`):

    [project.entry-points."hapscene.effects"]
    buzz = "hapscene_buzz:EFFECT"

`load` imports only the module of the requested plugin. `listed` imports all plugins; a plugin that fails is listed with
its error.
"""

import sys
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Generic, TypeVar

from hapscene.errors import HapsceneError, no_such

__all__ = ["Offer", "PluginRegistry"]

T = TypeVar("T")


@dataclass(frozen=True)
class Offer(Generic[T]):
    """A plugin of an installed package: the `plugin`, or the `error` with which it failed."""

    name: str
    distribution: str
    version: str
    module: str
    plugin: T | None = None
    error: str | None = None


@dataclass(frozen=True)
class PluginRegistry(Generic[T]):
    """The plugins of one group.

    Attributes:
        group: name of the entry-point group.
        noun: name of a plugin in messages.
        kind: class of the plugins, which has an attribute `name`.
        error: class of the errors that are raised.
    """

    group: str
    noun: str
    kind: type[T]
    error: type[HapsceneError]

    def listed(self) -> dict[str, Offer[T]]:
        """All installed plugins by name, in alphabetical order, each imported or with its error."""
        return {name: self._listed(name, points) for name, points in sorted(self._points().items())}

    def load(self, name: str) -> T:
        """Import the plugin called `name`.

        Raises:
            HapsceneError: (the class `error`) the plugin is unknown, provided by two packages, cannot be imported, or
                has another class or name.
        """
        points = self._points()
        if name not in points:
            raise self.error(no_such(self.noun, name, points))
        return self._load(name, points[name])

    def names(self) -> list[str]:
        """Names of all installed plugins, without importing them."""
        return sorted(self._points())

    def _points(self) -> dict[str, list[EntryPoint]]:
        """Entry points of the group by name: several if packages conflict."""
        points: dict[str, list[EntryPoint]] = {}
        for point in _installed(self.group, tuple((place, _changed_ns(place)) for place in sys.path)):
            points.setdefault(point.name, []).append(point)
        return points

    def _listed(self, name: str, points: list[EntryPoint]) -> Offer[T]:
        distribution, version = _origin(points[0])
        plugin, error = None, None
        try:
            plugin = self._load(name, points)
        except self.error as reason:
            error = str(reason)
        return Offer(name, distribution, version, points[0].module, plugin, error)

    def _load(self, name: str, points: list[EntryPoint]) -> T:
        if len(points) > 1:
            packages = " and ".join(sorted(_described(point) for point in points))
            raise self.error(f"{self.noun} {name!r} is provided by two packages, {packages}: uninstall one")
        (point,) = points
        origin = f"{self.noun} {name!r} of {_described(point)}"
        try:
            plugin = point.load()
        except Exception as reason:  # the import of a plugin may raise any error
            raise self.error(f"{origin} cannot be imported: {type(reason).__name__}: {reason}") from reason
        if not isinstance(plugin, self.kind):
            article = "an" if self.kind.__name__[0] in "AEIOU" else "a"
            expected = f"{article} {self.kind.__name__}"
            raise self.error(f"{origin}: expected {expected}, found {type(plugin).__name__}")
        called = vars(plugin)["name"]
        if called != name:
            raise self.error(
                f"{origin} has the name {called!r}: entry point and {self.kind.__name__} must have the same name"
            )
        return plugin


@lru_cache(maxsize=16)
def _installed(group: str, places: tuple[tuple[str, int], ...]) -> tuple[EntryPoint, ...]:
    """Entry points of a group, cached until `sys.path` or its folders change: reading takes tens of milliseconds."""
    return tuple(entry_points(group=group))


def _changed_ns(place: str) -> int:
    try:
        return Path(place).stat().st_mtime_ns
    except OSError:
        return 0


def _origin(point: EntryPoint) -> tuple[str, str]:
    """Name and version of the package that provides an entry point."""
    return (point.dist.name, point.dist.version) if point.dist else ("unknown", "")


def _described(point: EntryPoint) -> str:
    return f"{' '.join(_origin(point)).strip()} ({point.value})"
