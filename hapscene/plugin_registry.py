"""What installed packages offer under a name, through an entry-point group: effects, devices.

A package offers one by naming it in its own pyproject.toml (see `examples/third_party_effect`):

    [project.entry-points."hapscene.effects"]
    buzz = "hapscene_buzz:EFFECT"

`load` imports the module of the wanted one and no other. `listed` imports all, and a plugin that fails is listed with
its error, so that it cannot take the others with it.
"""

import sys
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Generic, TypeVar

from hapscene.errors import HapsceneError, no_such

__all__ = ["Offer", "PluginRegistry"]

T = TypeVar("T")


@dataclass(frozen=True)
class Offer(Generic[T]):
    """What an installed package offers: `plugin`, or the `error` that keeps it from use."""

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
        noun: what messages call one of them.
        kind: the class that each is an instance of; it has a `name`.
        error: what is raised.
    """

    group: str
    noun: str
    kind: type[T]
    error: type[HapsceneError]

    def listed(self) -> dict[str, Offer[T]]:
        """All installed ones by name, in alphabetical order, each imported or with its error."""
        return {name: self._listed(name, points) for name, points in sorted(self._points().items())}

    def load(self, name: str) -> T:
        """The one called `name`.

        Raises:
            HapsceneError: of the class `error`: there is none, or it is offered by two packages, not importable, or not
                of the kind, or not of that name.
        """
        points = self._points()
        if name not in points:
            raise self.error(no_such(self.noun, name, points))
        return self._load(name, points[name])

    def names(self) -> list[str]:
        """Names of all that are installed, none of them imported."""
        return sorted(self._points())

    def _points(self) -> dict[str, list[EntryPoint]]:
        """Entry points of the group by name: more than one where packages clash."""
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
            raise self.error(f"{self.noun} {name!r} is offered twice, by {packages}: uninstall one of them")
        (point,) = points
        origin = f"{self.noun} {name!r} of {_described(point)}"
        try:
            plugin: Any = point.load()
        except Exception as reason:  # a plugin's import may raise anything; the others must live on
            raise self.error(f"{origin} cannot be imported: {type(reason).__name__}: {reason}") from reason
        if not isinstance(plugin, self.kind):
            article = "an" if self.kind.__name__[0] in "AEIOU" else "a"
            expected = f"{article} {self.kind.__name__}"
            raise self.error(f"{origin}: expected {expected} there, found {type(plugin).__name__}")
        called: Any = vars(plugin)["name"]
        if called != name:
            raise self.error(
                f"{origin} calls itself {called!r}: entry point and {self.kind.__name__} need the same name"
            )
        return plugin


@lru_cache(maxsize=16)
def _installed(group: str, places: tuple[tuple[str, int], ...]) -> tuple[EntryPoint, ...]:
    """A group's entry points, read anew once a place of modules is another: that takes tens of milliseconds."""
    return tuple(entry_points(group=group))


def _changed_ns(place: str) -> int:
    try:
        return Path(place).stat().st_mtime_ns
    except OSError:
        return 0


def _origin(point: EntryPoint) -> tuple[str, str]:
    """Name and version of the package that offers an entry point."""
    return (point.dist.name, point.dist.version) if point.dist else ("unknown", "")


def _described(point: EntryPoint) -> str:
    return f"{' '.join(_origin(point)).strip()} ({point.value})"
