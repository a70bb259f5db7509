"""The brush: distances against sampling, what is painted against its definition, walls, gaps and seams."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.creation import box, cylinder

from hapscene.paint.brush import segment_triangle
from hapscene.paint.shape import FACING_RAD, Shape
from hapscene.scene.mesh import Mesh

from .conftest import mesh_of, plate_mesh

coordinate = st.integers(-4, 4).map(float)  # whole numbers: parallel, touching and degenerate cases come often
vector = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=100, deadline=None)
@given(vector, vector, vector, vector, vector)
def test_distance_of_segment_and_triangle(p, q, a, b, c) -> None:
    found = math.sqrt(segment_triangle(p, q, a, b, c))
    share = np.linspace(0.0, 1.0, 201)[:, None]
    places = np.array(p) + share * (np.array(q) - np.array(p))
    triangle = np.array([[a, b, c]])
    if np.linalg.norm(np.cross(triangle[0, 1] - triangle[0, 0], triangle[0, 2] - triangle[0, 0])) == 0.0:
        return  # the other library needs an area
    near = trimesh.triangles.closest_point(np.repeat(triangle, len(places), axis=0), places)
    sampled = float(np.linalg.norm(near - places, axis=1).min())
    half_step = float(np.linalg.norm(np.array(q) - np.array(p))) / 400.0
    assert sampled - half_step - 1e-9 <= found <= sampled + 1e-9


def test_a_triangle_without_area_is_its_edges() -> None:
    assert segment_triangle((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (3.0, 0.0, 0.0)) == 1.0
    assert segment_triangle((0.0, 2.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)) == 1.0


def top_face(shape: Shape, x: float, y: float) -> tuple[int, np.ndarray]:
    found = shape.pick(np.array([x, y, 1.0]), np.array([0.0, 0.0, -1.0]))
    assert found is not None
    return found[0], found[2]


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-0.0199, 0.0199)] * 4), st.floats(0.0005, 0.01))
def test_on_a_plate_it_paints_the_capsule_and_the_way(ends, radius_m) -> None:
    shape = PLATE
    (f, p), (g, q) = top_face(shape, *ends[:2]), top_face(shape, *ends[2:])
    painted = np.zeros(len(shape.normal), bool)
    painted[shape.brush((f, g), (p, q), radius_m)] = True
    top = shape.normal[:, 2] > 0.5
    way, off = q - p, shape.centroid_m - p
    t = np.clip(off @ way / max(way @ way, 1e-300), 0.0, 1.0)
    away = np.linalg.norm(off - t[:, None] * way, axis=1)
    clear = np.abs(away - radius_m) > 1e-9  # not on the border, where rounding decides
    assert painted[top & clear & (away < radius_m)].all()
    assert not painted[~top].any()  # neither the back, 1 mm below, nor the rim
    # what is painted beyond the capsule is crossed by the way, or within a tenth of the radius of it
    for face in np.flatnonzero(painted & clear & (away > radius_m)):
        a, b, c = (tuple(v.tolist()) for v in shape.corner_m[face])
        near = math.sqrt(segment_triangle(tuple(p.tolist()), tuple(q.tolist()), a, b, c))
        assert near <= 0.1 * radius_m + 1e-12 or face in (f, g)


PLATE = Shape(plate_mesh())


def test_a_way_over_large_faces_has_no_gaps() -> None:
    shape = Shape(plate_mesh(cells=2))  # faces of 10 mm, a brush of 0.5 mm
    (f, p), (g, q) = top_face(shape, -0.019, -0.013), top_face(shape, 0.018, 0.016)
    painted = set(shape.brush((f, g), (p, q), 0.0005).tolist())
    for t in np.linspace(0.0, 1.0, 400):
        x, y, _ = p + t * (q - p)
        assert top_face(shape, x, y)[0] in painted


def test_the_next_sheet_is_not_reached() -> None:
    sheets = [trimesh.creation.box((0.04, 0.04, 1e-4)).subdivide().subdivide().subdivide() for _ in range(2)]
    sheets[1].apply_translation((0.0, 0.0, 3e-4))
    shape = Shape(mesh_of(trimesh.util.concatenate(sheets)))
    face, p = top_face(shape, 0.001, 0.002)
    painted = shape.brush((face, face), (p, p), 0.008)
    assert len(painted) > 4
    assert (shape.centroid_m[painted, 2] > 3e-4).all()


def test_round_a_bend_it_paints_as_far_as_it_looks_the_same_way() -> None:
    shape = Shape(mesh_of(cylinder(radius=0.005, height=0.1, sections=180)))
    found = shape.pick(np.array([1.0, 0.0, 0.001]), np.array([-1.0, 0.0, 0.0]))
    assert found is not None
    face, _, p = found
    painted = shape.brush((face, face), (p, p), 0.2)
    turn = np.arccos(np.clip(shape.normal @ shape.normal[face], -1.0, 1.0))
    np.testing.assert_array_equal(painted, np.flatnonzero(turn <= FACING_RAD))


def test_a_way_over_an_edge_paints_both_sides() -> None:
    shape = Shape(mesh_of(box((0.04, 0.04, 0.04)).subdivide().subdivide().subdivide()))
    top, p = top_face(shape, 0.018, 0.001)
    side, _, q = shape.pick(np.array([1.0, 0.001, 0.018]), np.array([-1.0, 0.0, 0.0]))  # type: ignore[misc]
    painted = shape.brush((top, side), (p, q), 0.004)
    assert {0, 2} == set(np.argmax(np.abs(shape.normal[painted]), axis=1).tolist())


@pytest.mark.parametrize("seam", ["t-junction", "soup"])
def test_seams_do_not_stop_it(seam: str) -> None:
    if seam == "soup":  # no two faces share a vertex
        whole = plate_mesh(cells=3)
        mesh = Mesh(whole.vertices_m[whole.faces].reshape(-1, 3), np.arange(3 * len(whole.faces)).reshape(-1, 3))
        count = len(Shape(whole).brush((0, 0), (Shape(whole).centroid_m[0],) * 2, 0.005))
        assert len(Shape(mesh).brush((0, 0), (Shape(mesh).centroid_m[0],) * 2, 0.005)) == count > 10
        return
    vertices = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [1, 0, 0], [1, -1, 0]]) * 0.01
    mesh = Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3], [0, 5, 4], [4, 5, 1]]))  # 4 lies on the edge from 0 to 1
    shape = Shape(mesh)
    assert shape.brush((0, 0), (shape.centroid_m[0],) * 2, 0.02).tolist() == [0, 1, 2, 3]
