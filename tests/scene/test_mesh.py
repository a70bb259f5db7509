"""Meshes: arrays, digests, groups, conversion from trimesh."""

import numpy as np
import pytest
import trimesh

from hapscene.errors import MeshError
from hapscene.scene.material import Material
from hapscene.scene.mesh import Mesh, Part, join

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)


def test_normals():
    mesh = Mesh(VERTICES, np.concatenate([FACES, [[0, 1, 1]]]))
    expected = [(0, 0, -1), (0, -1, 0), (-1, 0, 0), np.ones(3) / np.sqrt(3), (0, 0, 0)]
    np.testing.assert_allclose(mesh.normals, expected, atol=1e-15)


@pytest.mark.parametrize(("up", "turned"), [("z", [[2, 3, 5], [0, 0, 4]]), ("y", [[2, -5, 3], [0, -4, 0]])])
def test_parts_are_joined_in_metres_with_z_up(up, turned):
    corners = np.array([[2.0, 3.0, 5.0], [0.0, 0.0, 4.0], [7.0, 7.0, 0.0]])
    one, two = (np.array([order]) for order in ([0, 1, 2], [2, 1, 0]))
    parts = [Part(corners.copy(), one, np.array([0]), ["a"]), Part(corners + 1.0, two, np.array([0]), ["a"])]
    mesh = join(parts, "mm", None, up, scale=10.0)
    np.testing.assert_allclose(mesh.vertices_m[:2], 0.01 * np.array(turned), rtol=1e-12)
    assert not np.signbit(mesh.vertices_m[mesh.vertices_m == 0.0]).any()
    assert mesh.faces.tolist() == [[0, 1, 2], [5, 4, 3]] and mesh.group_names == ("a",) and parts == []


def test_digest_depends_only_on_content():
    mesh = Mesh(VERTICES, FACES)
    assert mesh.digest == Mesh(VERTICES.copy(), FACES, group_names=("other",)).digest
    moved = VERTICES.copy()
    moved[0, 0] = 1e-300
    assert mesh.digest != Mesh(moved, FACES).digest
    assert mesh.digest != Mesh(VERTICES, FACES[[1, 0, 2, 3]]).digest


def test_bounds_ignore_unused_vertices():
    mesh = Mesh(np.concatenate([VERTICES, [[9, 9, 9]]]), FACES)
    np.testing.assert_array_equal(mesh.bounds_m, [[0, 0, 0], [1, 1, 1]])
    assert mesh.diagonal_m == pytest.approx(np.sqrt(3))


def test_faces_of_matches_full_names_and_parts():
    mesh = Mesh(VERTICES, FACES, np.array([0, 1, 2, 2]), ("door/steel", "door/wood", "steel"))
    assert mesh.faces_of("door").tolist() == [True, True, False, False]
    assert mesh.faces_of("steel").tolist() == [True, False, True, True]
    assert mesh.faces_of("door/wood").tolist() == [False, True, False, False]
    with pytest.raises(MeshError, match="stel"):
        mesh.faces_of("stel")


def nan_at(index):
    vertices = VERTICES.copy()
    vertices[index, 1] = np.nan
    return vertices


@pytest.mark.parametrize(
    ("vertices", "faces", "place"),
    [
        (nan_at(2), FACES, "vertex 2"),
        (VERTICES, FACES[:0], ""),
        (VERTICES, FACES + 1, "face 1"),
        (VERTICES, FACES[:, :2], "(M, 3)"),
        (VERTICES, FACES * 1.0, ""),
        (VERTICES * 1e9, FACES, "unit"),
        (VERTICES * 0, FACES, "0 m"),
        (VERTICES - (0, 20e3, 0), FACES, "y = -20000 m"),
    ],
)
def test_invalid_arrays_raise(vertices, faces, place):
    with pytest.raises(MeshError) as caught:
        Mesh(vertices, faces)
    assert place in str(caught.value)


@pytest.mark.parametrize("name", ["group", "material"])
def test_index_of_a_name_out_of_range_raises(name):
    more = {"materials": (Material(), Material())} if name == "material" else {"group_names": ("a", "b")}
    least = -1 if name == "material" else 0
    for wrong in (least - 1, 2):
        with pytest.raises(MeshError, match=name):
            Mesh(VERTICES, FACES, **{name: np.array([0, 1, wrong, 1], np.int16)}, **more)
    made = Mesh(VERTICES, FACES, **{name: np.array([0, 1, least, 1], np.int16)}, **more)
    assert getattr(made, name).tolist() == [0, 1, least, 1]


def test_from_trimesh_requires_units():
    box = trimesh.creation.box((1, 1, 1))
    with pytest.raises(MeshError, match="unit"):
        Mesh.from_trimesh(box)
    box.units = "inches"
    assert Mesh.from_trimesh(box).diagonal_m == pytest.approx(0.0254 * np.sqrt(3))


@pytest.mark.parametrize("index", [-9, 4])
def test_invalid_index_of_a_face_with_texture_coordinates_raises(index):
    faces, visual = FACES.copy(), trimesh.visual.TextureVisuals(uv=np.zeros((4, 2)))
    faces[2, 1] = index
    with pytest.raises(MeshError, match="face 2"):
        Mesh.from_trimesh(trimesh.Trimesh(VERTICES, faces, visual=visual, process=False), "m")


def test_from_trimesh_scene_applies_poses_and_reflections():
    box = trimesh.creation.box((1, 1, 1))
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 1, 1, 1])
    mirror[0, 3] = 5
    scene.add_geometry(box, node_name="left")
    scene.add_geometry(box, node_name="right", transform=mirror)
    mesh = Mesh.from_trimesh(scene, "m")
    assert mesh.group_names == ("left", "right")
    right = mesh.faces_of("right")
    np.testing.assert_allclose(mesh.triangles_m[right].min(axis=(0, 1)), [4.5, -0.5, -0.5])
    outward = np.einsum("ij,ij->i", mesh.normals[right], mesh.triangles_m[right].mean(axis=1) - [5, 0, 0])
    assert (outward > 0).all()
