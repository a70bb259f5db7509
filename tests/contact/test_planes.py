"""The closest point that planes allow: three-plane corners, wedges, and what makes a point the closest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.contact.planes import nearest
from hapscene.contact.world import PROXY
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


CORNER = held_by(np.eye(3), np.zeros(3))


@pytest.mark.parametrize(
    ("goal", "closest"),
    [
        ((-1.0, -2.0, -3.0), (0.0, 0.0, 0.0)),
        ((-1.0, -2.0, 3.0), (0.0, 0.0, 3.0)),
        ((-1.0, 2.0, 3.0), (0.0, 2.0, 3.0)),
        ((1.0, 2.0, 3.0), (1.0, 2.0, 3.0)),
    ],
)
def test_corner_of_three_planes_is_exact(goal, closest):
    assert nearest(CORNER, goal, 0.0) == (True, closest)


def test_planes_are_moved_out_by_skins():
    found, p = nearest(CORNER, (-0.1, -0.2, -0.3), 1.0)
    assert found
    np.testing.assert_allclose(p, (1e-6, 1e-6, 1e-6), rtol=1e-9)


@pytest.mark.parametrize("angle_deg", [60.0, 20.0, 10.0, 1.0, 0.1, 0.01])
def test_wedge_of_two_planes_is_exact_however_flat(angle_deg):
    half = np.radians(angle_deg) / 2
    proxy = held_by([[np.sin(half), 0, np.cos(half)], [-np.sin(half), 0, np.cos(half)]], [0.0, 0.0])
    found, p = nearest(proxy, (0.0, 0.03, -0.01), 0.0)
    assert found
    np.testing.assert_allclose(p, (0.0, 0.03, 0.0), atol=1e-6)


def test_a_plane_named_twice_counts_once():
    found, p = nearest(held_by([[0, 0, 1.0], [0, 0, 1.0], [1.0, 0, 0]], [0.0, 0.0, 0.0]), (-1.0, 0.5, -1.0), 0.0)
    assert found
    assert p == (0.0, 0.5, 0.0)


def test_planes_that_enclose_nothing_are_reported():
    found, p = nearest(held_by([[0, 0, 1.0], [0, 0, -1.0]], [0.1, 0.1]), (0.0, 0.0, 0.0), 0.0)
    assert not found
    assert p == (0.0, 0.0, 0.0)


vectors = st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 3)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: np.array(v) / np.linalg.norm(v))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(directions, st.floats(0, 0.1)), min_size=1, max_size=4), vectors)
def test_allowed_by_all_and_pushed_by_none_that_pulls(planes, tool):
    """The conditions of Karush, Kuhn and Tucker: they hold for the closest point alone."""
    normals = np.array([n for n, _ in planes])
    offsets = np.array([-d for _, d in planes])  # the origin is allowed, so a closest point exists
    proxy = held_by(normals, offsets)
    found, p = nearest(proxy, tool, 0.0)
    push = proxy.push_m[: len(planes)]
    above = normals @ p - offsets
    assert found
    assert (push >= 0.0).all()
    assert above.min() > -1e-8
    assert np.abs(above[push > 0.0]).max(initial=0.0) < 1e-8
    np.testing.assert_allclose(np.array(tool) + push @ normals, p, atol=1e-8 + 1e-12 * push.sum())
