"""The closest point that planes allow: three-plane corners, wedges, and what makes a point the closest."""

from itertools import combinations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hapscene.contact import planes
from hapscene.contact.world import DROPPED, PROXY, SAVED
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
@example(walls=[(DOWN, 0.0), (np.array([5.96e-8, 0.0, 1.0]), 0.0)], tool=(-1.0, 0.0, 0.0))
@example(walls=[(DOWN, 0.0), (np.array([np.sin(1e-5), 0.0, np.cos(1e-5)]), 0.0)], tool=(-1.0, 0.0, 0.0))
def test_solution_satisfies_the_kkt_conditions(walls, tool):
    """The Karush–Kuhn–Tucker conditions hold for the closest point only.

    The solver fails only if planes are dependent to within `PARALLEL`, such as two that face each other at a millionth
    of a radian.
    """
    normals = np.array([n for n, _ in walls])
    offsets = np.array([-d for _, d in walls])  # the origin is allowed, so a closest point exists
    proxy = held_by(normals, offsets)
    found, p = planes.nearest(proxy, tool, 0.0)
    push = proxy.push_m[: len(walls)]
    if not found:
        assert least_determinant(normals) < 10.0 * planes.PARALLEL
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
    assert not planes.restore_plane(w, over, under)
    proxy.dropped_count, proxy.offset_m[DROPPED] = 1, -1.0  # dropped now, but far below
    assert not planes.restore_plane(w, over, under)
    proxy.dropped_count = 2
    for p, goal in ((over, (0.02, 0.02, 0.995e-6)), (under, under), (over, (-0.02, 0.02, -1e-4))):
        assert not planes.restore_plane(w, p, goal)  # the goal is free, the proxy is below, the goal is beside the face
    assert planes.restore_plane(w, over, under)
    assert (proxy.count, proxy.met[0], proxy.offset_m[0]) == (1, 2, 0.0)
    assert not planes.restore_plane(w, over, under) and proxy.count == 1  # it holds the proxy already
    proxy.body[0] = 7
    proxy.dropped_count = 9 * SAVED  # more than there are slots
    assert planes.restore_plane(w, over, (0.02, 0.02, 0.98e-6)) and proxy.count == 2


FIELDS = ("offset_m", "skin_m", "body", "face", "side", "met")


def fill(proxy, count: int):
    """Planes whose fields all differ; returns a function that says which of them are in the slots."""
    for i in range(count):
        proxy.nhat_W[i] = (i, i + 0.1, i + 0.2)
        for k, name in enumerate(FIELDS):
            proxy[name][i] = 10 * (i + 1) + k
    proxy.count = count
    before = proxy.copy()

    def slots() -> list[int]:
        found = [int(proxy.offset_m[i] / 10) - 1 for i in range(proxy.count)]
        for i, k in enumerate(found):
            assert proxy.nhat_W[i].tolist() == before.nhat_W[k].tolist()
            assert all(proxy[name][i] == before[name][k] for name in FIELDS)
        return found

    return slots


def test_planes_are_dropped_whole_and_in_order():
    proxy = records(1, PROXY)[0]
    slots = fill(proxy, 4)
    proxy.push_m[:4] = (0.0, 2.0, 0.0, 3.0)
    planes.drop_idle(proxy)
    assert slots() == [1, 3] and proxy.push_m[:2].tolist() == [2.0, 3.0]
    slots = fill(proxy, 3)
    planes.drop_oldest(proxy)
    assert slots() == [1, 2]
    slots = fill(proxy, 3)
    planes.drop_planes_of(proxy, proxy.body[1])
    assert slots() == [0, 2]
    planes.copy_plane(proxy, 1, 0)
    assert slots() == [2, 2]


def test_planes_that_a_ray_met_are_trusted_until_the_proxy_moves():
    proxy = held_by(np.eye(3), np.zeros(3))
    for first, moved, met in (
        (2, 0.5, [0, 2, 1]),
        (3, planes.NEARBY - 0.1, [0, 2, 0]),
        (3, planes.NEARBY + 0.1, [0, 0, 0]),
    ):
        proxy.met[:3] = (1, 2, 1)
        planes.trust(proxy, first, moved * 1e-6)
        assert proxy.met[:3].tolist() == met


def test_planes_of_faces_that_do_not_extend_below_the_proxy_are_dropped(world, triangle):
    w = world(triangle)
    proxy = w.proxy[0]
    for met, x_m, dropped in ((0, 0.02, False), (1, -0.02, False), (0, -0.02, True)):
        proxy.count, proxy.met[0] = 1, met
        assert planes.drop_unsupported(w, (x_m, 0.02, 1e-4)) is dropped
        assert (proxy.count, proxy.dropped_count) == (1 - dropped, int(dropped))
