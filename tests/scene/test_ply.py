"""Export of meshes as PLY."""

import numpy as np
import pytest

from hapscene.errors import MeshError
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.ply import save_mesh


def random_mesh(seed: int = 0) -> Mesh:
    rng = np.random.default_rng(seed)
    return Mesh(
        rng.normal(size=(50, 3)),
        rng.integers(0, 50, (80, 3)),
        rng.integers(0, 3, 80),
        ("wall/steel", "a name with spaces", "Öse"),
        rng.integers(0, 256, (80, 3)),
    )


def test_roundtrip_is_exact(tmp_path):
    mesh = random_mesh()
    save_mesh(mesh, tmp_path / "m.ply")
    back = load_mesh(tmp_path / "m.ply", "m")
    assert back.digest == mesh.digest and back.group_names == mesh.group_names
    np.testing.assert_array_equal(back.group, mesh.group)
    np.testing.assert_array_equal(back.colour_rgb, mesh.colour_rgb)


@pytest.mark.parametrize("name", ["m.stl", "no_folder/m.ply"])
def test_invalid_path_raises_and_writes_nothing(tmp_path, name):
    with pytest.raises(MeshError, match="m"):
        save_mesh(random_mesh(), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_group_name_with_end_of_header_is_changed(tmp_path):
    """A group name cannot always be changed, so the mesh must be readable."""
    mesh = Mesh(np.eye(3), [[0, 1, 2], [0, 2, 1]], np.array([0, 1]), ("my end_header x", "\ud800"))
    save_mesh(mesh, tmp_path / "m.ply")
    back = load_mesh(tmp_path / "m.ply", "m")
    assert back.digest == mesh.digest and back.group_names == ("my end-header x", "?")


def test_inconsistent_groups_are_ignored(tmp_path):
    save_mesh(random_mesh(), tmp_path / "m.ply")
    content = (tmp_path / "m.ply").read_bytes().replace("comment hapscene group Öse\n".encode(), b"")
    (tmp_path / "m.ply").write_bytes(content)
    assert load_mesh(tmp_path / "m.ply", "m").group_names == ("default",)


HEAD = "ply\nformat ascii 1.0\n"
VERTEX = "element vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 0\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize("elements", ["", VERTEX, f"comment hapscene scene 1\n{VERTEX}{FACE}"])
def test_file_without_faces_raises(tmp_path, elements):
    (tmp_path / "m.ply").write_text(f"{HEAD}{elements}end_header\n")
    with pytest.raises(MeshError, match="faces"):
        load_mesh(tmp_path / "m.ply", "m")


def test_triangle_strips_are_refused(tmp_path):
    strips = "element tristrips 1\nproperty list int int vertex_indices\n"
    (tmp_path / "m.ply").write_text(f"{HEAD}{VERTEX}{strips}end_header\n0\n")
    with pytest.raises(MeshError, match="triangle strips"):
        load_mesh(tmp_path / "m.ply", "m")
