"""The effects there are: ours and anybody's, through the entry-point group `hapscene.effects`.

A package adds an effect by naming it in its own pyproject.toml (see `examples/third_party_effect`):

    [project.entry-points."hapscene.effects"]
    buzz = "hapscene_buzz:EFFECT"

`load_effect` imports the module of the wanted effect and no other. `listed` imports all, and a plugin that
fails is listed with its error, so that it cannot take the others with it.
"""

import difflib
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points

from hapscene.errors import EffectError, no_such
from hapscene.surface.effect import Effect

GROUP = "hapscene.effects"
"""Name of the entry-point group that effect plugins join."""


@dataclass(frozen=True)
class Listed:
    """An effect that an installed package offers: `effect`, or the `error` that keeps it from use."""

    name: str
    distribution: str
    version: str
    module: str
    effect: Effect | None = None
    error: str | None = None


def listed() -> dict[str, Listed]:
    """All installed effects by name, in alphabetical order, each imported or with its error."""
    return {name: _listed(name, points) for name, points in sorted(_points().items())}


def load_effect(name: str) -> Effect:
    """The effect called `name`.

    Raises:
        EffectError: no such effect, offered by two packages, not importable, or not an `Effect` of that name.
    """
    points = _points()
    if name not in points:
        close = difflib.get_close_matches(name, points, n=1)
        hint = f". Did you mean {close[0]!r}?" if close else ""
        raise EffectError(no_such("effect", name, points) + hint)
    return _load(name, points[name])


def _points() -> dict[str, list[EntryPoint]]:
    """Entry points of the group by name: more than one where packages clash."""
    points: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=GROUP):
        points.setdefault(point.name, []).append(point)
    return points


def _listed(name: str, points: list[EntryPoint]) -> Listed:
    distribution, version = _origin(points[0])
    effect, error = None, None
    try:
        effect = _load(name, points)
    except EffectError as reason:
        error = str(reason)
    return Listed(name, distribution, version, points[0].module, effect, error)


def _load(name: str, points: list[EntryPoint]) -> Effect:
    if len(points) > 1:
        packages = " and ".join(sorted(_described(point) for point in points))
        raise EffectError(f"effect {name!r} is offered twice, by {packages}: uninstall one of them")
    (point,) = points
    origin = f"effect {name!r} of {_described(point)}"
    try:
        effect = point.load()
    except Exception as reason:  # a plugin's import may raise anything; the others must live on
        raise EffectError(f"{origin} cannot be imported: {type(reason).__name__}: {reason}") from reason
    if not isinstance(effect, Effect):
        raise EffectError(f"{origin}: expected an Effect there, found {type(effect).__name__}")
    if effect.name != name:
        raise EffectError(f"{origin} calls itself {effect.name!r}: entry point and Effect need the same name")
    return effect


def _origin(point: EntryPoint) -> tuple[str, str]:
    """Name and version of the package that offers an entry point."""
    return (point.dist.name, point.dist.version) if point.dist else ("unknown", "")


def _described(point: EntryPoint) -> str:
    return f"{' '.join(_origin(point)).strip()} ({point.value})"
