"""The closest point that planes allow: three-plane corners, wedges, and what makes a point the closest."""

from itertools import combinations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hapscene.contact.planes import PARALLEL, nearest, restore_plane
from hapscene.contact.world import DROPPED, PROXY
from hapscene.records import records


def held_by(normals, offsets, skin_m: float = 1e-6):
    """A proxy held by planes nhat · x ≥ offset."""
    proxy = records(1, PROXY)[0]
    for i, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
        proxy.nhat_W[i] = normal
        proxy.offset_m[i] = offset
        proxy.skin_m[i] = skin_m
    proxy.count = len(offsets)
    return proxy


vectors = st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 3)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: np.array(v) / np.linalg.norm(v))


def least_determinant(normals) -> float:
    """Of the Gram matrices of two and of three normals: 0 where they are dependent."""
    gram = normals @ normals.T
    sets = [rows for count in (2, 3) for rows in combinations(range(len(normals)), count)]
    return min((float(np.linalg.det(gram[np.ix_(rows, rows)])) for rows in sets), default=1.0)


DOWN = np.array([0.0, 0.0, -1.0])


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(directions, st.floats(0, 0.1)), min_size=1, max_size=4), vectors)
@example(planes=[(DOWN, 0.0), (np.array([5.96e-8, 0.0, 1.0]), 0.0)], tool=(-1.0, 0.0, 0.0))
@example(planes=[(DOWN, 0.0), (np.array([np.sin(1e-5), 0.0, np.cos(1e-5)]), 0.0)], tool=(-1.0, 0.0, 0.0))
def test_solution_satisfies_the_kkt_conditions(planes, tool):
    """The Karush–Kuhn–Tucker conditions hold for the closest point only.

    The solver fails only if planes are dependent to within `PARALLEL`, such as two that face each other at a millionth
    of a radian.
    """
    normals = np.array([n for n, _ in planes])
    offsets = np.array([-d for _, d in planes])  # the origin is allowed, so a closest point exists
    proxy = held_by(normals, offsets)
    found, p = nearest(proxy, tool, 0.0)
    push = proxy.push_m[: len(planes)]
    if not found:
        assert least_determinant(normals) < 10.0 * PARALLEL
        assert p == tool and not push.any()
        return
    above = normals @ p - offsets
    rounding = 1e-8 + 1e-13 * push.sum()
    assert (push >= 0.0).all()
    assert above.min() > -rounding
    assert np.abs(above[push > 0.0]).max(initial=0.0) < rounding
    np.testing.assert_allclose(np.array(tool) + push @ normals, p, atol=rounding)


def test_only_planes_dropped_in_this_tick_are_restored(world, triangle):
    """Slots of earlier ticks still hold planes, which are not restored."""
    w = world(triangle)
    proxy = w.proxy[0]
    for slot in (DROPPED, DROPPED + 1):
        proxy.nhat_W[slot], proxy.skin_m[slot], proxy.face[slot], proxy.side[slot] = (0.0, 0.0, 1.0), 1e-6, 0, 1.0
    proxy.face[DROPPED + 1] = 0
    over, under = (0.02, 0.02, 1e-4), (0.02, 0.02, -1e-4)
    proxy.dropped_count, proxy.count = 0, 0
    assert not restore_plane(w, over, under)
    proxy.dropped_count, proxy.offset_m[DROPPED] = 1, -1.0  # dropped now, but far below
    assert not restore_plane(w, over, under)
    proxy.dropped_count = 2
    assert restore_plane(w, over, under)
    assert (proxy.count, proxy.met[0], proxy.offset_m[0]) == (1, 2, 0.0)
