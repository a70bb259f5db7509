"""The levels of a renderer, made in Python: all that a step (`hapscene.fidelity.level_step`) writes anew."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.contact.world import Shapes
from hapscene.errors import HapsceneError
from hapscene.fidelity.level_step import LEVEL_STATE, SINCE, Levels
from hapscene.records import records
from hapscene.surface.surface_arrays import Surface

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene


STEPPED: Final = ("paint_start", "param_start", "table_start", "fold_mass_kg")
"""What a step writes anew of a surface."""


def one_surface(surfaces: Sequence[Surface]) -> tuple[Surface, list[Surface]]:
    """The first of surfaces, with the faces, numbers and tables of all behind its own; and each as it lies in that.

    They have the same bodies, swatches and effects. What they have by face, by parameter and in tables is shared, so
    that whoever writes to one of those views writes to what is felt at its level.
    """
    first = surfaces[0]
    if len(surfaces) == 1:
        return first, [first]
    fine = np.cumsum([0, *(len(one.leaf_start) - 1 for one in surfaces)])
    leaves = np.cumsum([0, *(len(one.leaf) for one in surfaces)])
    paint = np.concatenate([s.paint - (s.paint < 0) * np.int32(n) for s, n in zip(surfaces, fine, strict=False)])
    leaf = np.concatenate([one.leaf for one in surfaces])
    starts = [s.leaf_start[:-1] + n for s, n in zip(surfaces, leaves, strict=False)]
    leaf_start = np.concatenate([*starts, leaves[-1:]])
    params = np.concatenate([one.params for one in surfaces])
    tables = np.concatenate([one.tables for one in surfaces])
    views, at = [], np.zeros(3, np.int64)
    for one in surfaces:
        views.append(
            first._replace(
                paint=paint,
                leaf=leaf,
                leaf_start=leaf_start,
                params=params,
                tables=tables,
                paint_start=one.paint_start + at[0],
                param_start=one.param_start + at[1],
                table_start=one.table_start + at[2],
                fold_mass_kg=one.fold_mass_kg.copy(),
            )
        )
        at += len(one.paint), len(one.params), len(one.tables)
        # the effects of the scene are the same at all levels
        views[-1].param_start[-1], views[-1].table_start[-1] = views[0].param_start[-1], views[0].table_start[-1]
    return views[0]._replace(**{name: getattr(views[0], name).copy() for name in STEPPED}), views


def make_levels(scenes: "Sequence[Scene]", shapes: Shapes | None, views: Sequence[Surface], budget_ns: int) -> Levels:
    """The levels whose scenes these are, felt at the first. Without `shapes` there are none."""
    count = len(scenes) if shapes is not None else 0
    bodies = len(scenes[0].bodies) if count else 0
    levels = Levels(
        state=records(1, LEVEL_STATE),
        search=np.zeros((count, bodies), np.int64),
        center_B_m=np.zeros((count, bodies, 3)),
        radius_m=np.zeros((count, bodies)),
        face=np.zeros((count, bodies), np.int64),
        side=np.zeros(bodies, np.int64),
        **{name: np.array([getattr(view, name) for view in views])[:count] for name in STEPPED},
    )
    levels.state.count, levels.state.budget_ns = max(count, 1), budget_ns
    for k, scene in enumerate(scenes[:count]):
        for b, mesh in enumerate(body.mesh for body in scene.bodies):
            assert shapes is not None
            search = shapes.searches[id(mesh)]
            levels.search[k, b], levels.face[k, b] = search.handle, shapes.first[id(mesh)]
            levels.center_B_m[k, b], levels.radius_m[k, b] = search.center_m, search.radius_m
    return levels


def with_views(levels: Levels, views: Sequence[Surface]) -> Levels:
    """The levels with another painting."""
    count = len(levels.search)
    return levels._replace(**{name: np.array([getattr(view, name) for view in views])[:count] for name in STEPPED})


def put_level(surface: Surface, levels: Levels) -> None:
    """Have a surface that was made anew be at the level that is felt: after a reset, or with another painting."""
    level = int(levels.state[0].level)
    for name in STEPPED if level > 0 else ():
        getattr(surface, name)[:] = getattr(levels, name)[level]
    surface.memory.level = level
    if level > 0 and surface.memory[0].stepped == 0:
        surface.memory.stepped = SINCE


def checked_budget_ns(budget_us: float | None) -> int:
    """A budget in ns, 0 for none.

    Raises:
        HapsceneError: it is not above 0.
    """
    if budget_us is not None and not 0.0 < budget_us < math.inf:
        raise HapsceneError(f"budget_us must be above 0, as 50 is, is {budget_us}")
    return round(1e3 * budget_us) if budget_us is not None else 0
