"""The question of triangles: what a finer mesh costs, and what it buys on a round surface; others beside it."""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Final

import numpy as np

from hapscene.perception import DIRECTION_DEG
from hapscene.recording import Recording
from hapscene.renderer import Renderer

from ..accuracy import DEPTH_MIN_M, angle_deg, distances
from ..case import Case, short, sphere_cases
from ..peer import PEERS, SIDE_BY_SIDE, SIDE_BY_SIDE_SOURCE, TRIANGLES
from ..tick_time import hot
from .measuring import spread_us
from .question import Measure, Point, Question, Setting

SUBDIVISIONS: Final = (3, 4, 5, 6, 7, 8, 9)
"""Of the icosahedron [count]: 1.3 k to 5.2 M triangles."""

TICKS: Final = 10_000
"""Length of the path [count], the one that others were measured on."""

GAP_LEAST_UM: Final = 1e-3
"""Under which a gap is drawn as this [µm]: what is known of others is no finer than a nanometre."""

DIRECTION_COUNT: Final = 20480
"""Triangles with which others' direction was looked at [count]."""

OURS: Final = "hapscene"


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    sizes = (3, 5, 6) if quick else SUBDIVISIONS
    ticks = 2000 if quick else TICKS
    return [Setting(OURS, short(20 * 4**k), {"subdivisions": k, "ticks": ticks}) for k in sizes]


@cache
def _case(subdivisions: int, ticks: int) -> Case:
    return sphere_cases((subdivisions,), ticks)[0]


def error(subdivisions: int, ticks: int) -> dict[str, float]:
    case = _case(subdivisions, ticks)
    return errors(case, Renderer(case.scene(), effects=["wall"]).run(case.p_WT_m))


def errors(case: Case, felt: Recording) -> dict[str, float]:
    """Against the round surface, and against the facets themselves; 99 % of the ticks in contact."""
    on = felt.touching & (felt.depth_m > DEPTH_MIN_M)
    tool, proxy = felt.p_WT_m[on], felt.p_WP_m[on]
    gap_m = np.abs(distances(case.mesh.triangles_m, proxy, tool)[0])
    return {
        "direction": float(np.percentile(angle_deg(felt.f_W_N[on], tool), 99)),
        "gap": max(1e6 * float(np.percentile(gap_m, 99)), GAP_LEAST_UM),
    }


def time(subdivisions: int, ticks: int) -> tuple[float, float]:
    case = _case(subdivisions, ticks)
    return spread_us(hot(Renderer(case.scene(), effects=["wall"]), case.p_WT_m).contact_ns)


def advice(points: Sequence[Point]) -> str:
    ours = [p for p in points if not p.source]
    felt = [p for p in ours if p.errors["direction"] > DIRECTION_DEG]
    first, last = ours[0], ours[-1]
    return (
        f"Take the mesh as fine as it comes: {last.label} triangles cost {last.median_us:.2g} µs at the median, "
        f"{last.median_us / first.median_us:.1f} times as much as {first.label}, which are off by "
        f"{first.errors['direction']:.2g}° on a sphere of 50 mm"
        + (", and that is felt" if first in felt else ", which nobody feels either")
        + ". Not where memory or loading counts: both grow as the triangles do, the tick hardly."
    )


def _cited() -> Iterator[Point]:
    """Others' points: gap, and direction where it was looked at."""
    known = {peer.name: peer for peer in PEERS}
    for peer in SIDE_BY_SIDE:
        for count, median_us, p99_us in zip(TRIANGLES, peer.median_us, peer.p99_us, strict=True):
            other = known.get(peer.name)
            errors = {"gap": max(1e6 * other.gap_m if other else 0.0, GAP_LEAST_UM)}
            if other and count == DIRECTION_COUNT:
                errors["direction"] = other.direction_deg[1]
            yield Point(peer.name, short(count), median_us, p99_us, errors, SIDE_BY_SIDE_SOURCE)


QUESTION: Final = Question(
    name="triangles",
    title="What does a fine mesh cost?",
    measures=(
        Measure("direction", "direction of the force from the round surface's (99 % of ticks)", "°", DIRECTION_DEG,
                "Barbagli et al. 2006"),
        Measure("gap", "proxy off the facets (99 % of ticks)", "µm"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions="An icosphere of 50 mm, pressed 2 mm and slid over at 0.1 m/s; the contact part of a tick, hot, each "
    "tick's the least of five runs. Truth: the round surface; the facets, by their planes. Cited: others' contact on "
    "the same path on another machine, hapscene's beside them for the machine's sake. It leaves out hapscene's force, "
    "its whole tick holds more than theirs, so a fair figure lies between; CHAI3D static solves one constraint a tick "
    "and gets 5 of 37 known cases right. Directions of others were looked at with 20 k triangles alone.",
    per="contact",
    cited=tuple(_cited()),
)  # fmt: skip
