"""Mesh check and repair on meshes with known defects."""

import numpy as np
import pytest
import trimesh

from hapscene.errors import MeshError
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_doctor import examine, length, repair
from hapscene.scene.mesh_structure import height_of

BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
V, F = np.array(BALL.vertices), np.array(BALL.faces)


def joined(*parts):
    start = np.cumsum([0] + [len(v) for v, _ in parts])
    faces = [f + s for (_, f), s in zip(parts, start, strict=False)]
    return Mesh(np.concatenate([v for v, _ in parts]), np.concatenate(faces))


def counts(mesh: Mesh) -> dict[str, int]:
    return {finding.kind: finding.count for finding in examine(mesh).findings}


def flipped(faces, chosen):
    faces = faces.copy()
    faces[chosen] = faces[chosen][:, ::-1]
    return faces


def t_junction(gap_m: float) -> Mesh:
    """Two triangles on one side of an edge, one on the other."""
    vertices = [[0, 0, 0], [0.1, 0, 0], [0.05, 0.1, 0], [0.05, -0.1, 0], [0.05, gap_m, 0]]
    return Mesh(np.array(vertices, float), np.array([[0, 3, 1], [0, 4, 2], [4, 1, 2]]))


SHORT = np.array([[0.1, 0.1 - 4e-6, 0], [0, 0.1, 0], [0, 0, 0], [0.1, 0, 0], [0.1 - 4e-6, 0.1, 0]])  # from 0 to 4
FAN = Mesh(
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]]), np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
)
INWARD = F[:, ::-1]
TIPS = np.concatenate([np.eye(3), -np.eye(3)])  # an octahedron, whose faces all reach its middle planes
SIDES = np.array([[0, 1, 2], [1, 0, 5], [0, 2, 4], [2, 1, 3], [5, 4, 3], [4, 5, 0], [5, 3, 1], [3, 4, 2]])

BROKEN = {
    "whole": (Mesh(V, F), {}),
    "turned": (Mesh(V, flipped(F, slice(100, 300))), {"mixed_winding": 200}),
    "inside out": (Mesh(V, F[:, ::-1]), {"inside_out": 1280}),
    "doubled": (Mesh(V, np.concatenate([F, F[:50], F[:10, [1, 2, 0]]])), {"doubled_faces": 60}),
    "back to back": (Mesh(V, np.concatenate([F[:1], F[:1, ::-1]])), {"open_edges": 3, "opposed_faces": 1}),
    "open": (Mesh(V, F[1:]), {"open_edges": 3}),
    "collapsed": (Mesh(V, np.concatenate([F, F[:7, [0, 0, 1]]])), {"zero_area": 7}),
    "soup": (Mesh(V[F].reshape(-1, 3), np.arange(3 * len(F)).reshape(-1, 3)), {"duplicate_vertices": 3840 - 642}),
    "t-junction": (t_junction(1e-8), {"open_edges": 7}),
    "crack": (t_junction(5e-6), {"open_edges": 7, "cracks": 1}),
    "gap": (t_junction(1e-3), {"open_edges": 7}),
    "short edge": (Mesh(SHORT, np.array([[2, 3, 0], [2, 0, 4], [2, 4, 1]])), {"open_edges": 5}),
    "three at an edge": (FAN, {"open_edges": 6, "nonmanifold_edges": 1}),
    "cavity": (joined((V, F), (V * 0.5, F[:, ::-1])), {}),
    "cavity aside": (joined((TIPS, SIDES), (TIPS * 0.05 - 0.2, SIDES[:, ::-1])), {}),
    "other cavity aside": (joined((TIPS, SIDES), (TIPS * 0.05 + 0.2, SIDES[:, ::-1])), {}),
    "cavity with a solid inside out": (joined((V, F), (V * 0.6, INWARD), (V * 0.3, INWARD)), {"inside_out": 1280}),
}


@pytest.mark.parametrize("name", BROKEN)
def test_defects_are_found(name):
    mesh, expected = BROKEN[name]
    found = counts(mesh)
    assert found.keys() == expected.keys()
    assert all(count is None or found[kind] == count for kind, count in expected.items())


@pytest.mark.parametrize("name", BROKEN)
def test_repair_preserves_vertices_and_is_complete(name):
    mesh, _ = BROKEN[name]
    mended, done = repair(mesh)
    fixable = any(finding.defect.fixable for finding in examine(mesh).findings)
    assert bool(done) == fixable
    assert not any(finding.defect.fixable for finding in examine(mended).findings)
    places = {tuple(v) for v in mesh.vertices_m.tolist()}
    assert {tuple(v) for v in mended.vertices_m.tolist()} == places
    assert repair(mended) == (mended, [])


def test_a_crack_is_as_wide_as_its_widest_gap():
    (crack,) = (finding for finding in examine(BROKEN["crack"][0]).findings if finding.kind == "cracks")
    assert crack.more.endswith(f" {length(5e-6)} wide")


def test_repair_preserves_groups_and_colours():
    group, colour = np.arange(len(F)) % 3, np.random.default_rng(0).integers(0, 256, (len(F), 3))
    vertices, faces = np.concatenate([V, V]), flipped(F, slice(40, 80))
    faces[::2] += len(V)
    faces[7] = faces[7, [0, 0, 1]]
    faces = np.concatenate([faces, faces[:1]])
    mesh = Mesh(vertices, faces, np.append(group, 0), ("a", "b", "c"), np.concatenate([colour, colour[:1]]))
    mended, done = repair(mesh)
    kept = np.delete(np.arange(len(F)), 7)
    np.testing.assert_array_equal(mended.group, group[kept])
    np.testing.assert_array_equal(mended.colour_rgb, colour[kept])
    np.testing.assert_array_equal(mended.triangles_m.sum(axis=1), V[F[kept]].sum(axis=1))
    assert [line.split()[0] for line in done] == ["merged", "deleted", "deleted", "reversed"]
    assert len(mended.vertices_m) == len(V)


def test_repair_without_remaining_faces_raises():
    with pytest.raises(MeshError):
        repair(Mesh(V, F[:, [0, 0, 1]]))


def test_height_of_a_triangle_is_that_over_its_longest_side():
    found = height_of(np.array([[(0, 0, 0), (4, 0, 0), (1, 0.5, 0)], [(1, 1, 1)] * 3], float))
    np.testing.assert_allclose(found, [0.5, 0.0])


def test_group_names_are_escaped():
    mesh = Mesh(V, F, np.arange(len(F)) % 2, ("a\x1b[31m", "b\nc"))
    assert "2 groups: a\\x1b[31m, b\\nc" in examine(mesh).text()
