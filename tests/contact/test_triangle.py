"""Geometry of faces: plane, point-over-face test, barycentric coordinates, frames."""

import numpy as np
import pytest
import trimesh

from hapscene.contact.triangle import (
    corners,
    is_narrow,
    lies_over,
    plane,
    to_body,
    to_body_last,
    to_world,
    weights,
)


def test_plane_points_out_counter_clockwise():
    normal, offset = plane((0.0, 0.0, 2.0), (1.0, 0.0, 2.0), (0.0, 1.0, 2.0))
    assert normal == (0.0, 0.0, 1.0)
    assert offset == 2.0


def test_a_narrow_triangle_is_lower_than_the_least_height_over_its_longest_edge():
    a, b, c = (0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (1.0, 0.5, 0.0)
    assert not is_narrow(a, b, c, 0.49) and is_narrow(a, b, c, 0.51) and is_narrow(c, a, b, 0.51)
    assert is_narrow(a, a, a, 0.0)


def test_corners_equal_the_mesh(world, triangle):
    w = world(triangle)
    np.testing.assert_array_equal(corners(w, w.bodies[0], 0), triangle.vertices)
    assert w.corners_m.ctypes.data % 32 == 0 and w.corners_m.strides[0] == 96  # a face lies in two cache lines


@pytest.mark.parametrize(
    ("x", "y", "margin_m", "over"),
    [
        (0.02, 0.02, 0.0, True),
        (0.0, 0.05, 0.0, True),
        (-1e-6, 0.05, 0.0, False),
        (-1e-6, 0.05, 2e-6, True),
        (0.051, 0.051, 0.0, False),
        (0.051, 0.051, 0.0015, True),  # 1 mm · √2 past the slanted edge
    ],
)
def test_lies_over(world, triangle, x, y, margin_m, over):
    w = world(triangle)
    for height in (-0.3, 0.0, 1e-6, 5.0):
        assert bool(lies_over(w, w.bodies[0], 0, (x, y, height), margin_m)) is over


def test_barycentric_coordinates(world, triangle, turned):
    mesh = triangle.copy()
    mesh.vertices = triangle.vertices @ turned.T + 10.0
    w = world(mesh)
    at = np.array([0.2, 0.3, 0.5])
    above = to_body(w.bodies[0], tuple(at @ mesh.vertices + 0.01 * mesh.face_normals[0]))
    np.testing.assert_allclose(weights(corners(w, w.bodies[0], 0), above), at)


def test_frames_of_a_moved_body(world, triangle, turned):
    w = world(triangle)
    body = w.bodies[0]
    body.R_WB, body.p_WB_m = turned, (1.0, 2.0, 3.0)
    p = (0.3, -0.2, 0.1)
    expected = trimesh.transform_points([p], trimesh.transformations.compose_matrix(translate=(1, 2, 3)))[0]
    np.testing.assert_allclose(to_world(body, p), turned @ p + (1.0, 2.0, 3.0))
    np.testing.assert_allclose(to_body(body, to_world(body, p)), p)
    np.testing.assert_allclose(to_body(body, tuple(expected)), turned.T @ p)
    assert to_body_last(body, p) == p  # the last pose is the one at loading
