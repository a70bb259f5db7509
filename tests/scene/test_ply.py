"""What is written comes back to the bit, whole or not at all."""

import numpy as np
import pytest
import trimesh

from hapscene.errors import MeshError
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.ply import binary_ply, mesh_to_ply, save_mesh


def random_mesh(seed: int = 0) -> Mesh:
    rng = np.random.default_rng(seed)
    return Mesh(
        rng.normal(size=(50, 3)),
        rng.integers(0, 50, (80, 3)),
        rng.integers(0, 3, 80),
        ("wall/steel", "a name with spaces", "Öse"),
        rng.integers(0, 256, (80, 3)),
    )


def test_round_trip_is_exact(tmp_path):
    mesh = random_mesh()
    save_mesh(mesh, tmp_path / "m.ply")
    back = load_mesh(tmp_path / "m.ply", "m")
    assert back.digest == mesh.digest and back.group_names == mesh.group_names
    np.testing.assert_array_equal(back.group, mesh.group)
    np.testing.assert_array_equal(back.colour_rgb, mesh.colour_rgb)


def test_plain_files_are_read_without_trimesh_and_alike(tmp_path, monkeypatch):
    ball = trimesh.creation.icosphere(2)
    for k, content in enumerate((mesh_to_ply(random_mesh()), *(ball.export(None, "ply", **v) for v in NORMALS))):
        (tmp_path / f"{k}.ply").write_bytes(content)
        own = load_mesh(tmp_path / f"{k}.ply", "mm")
        assert binary_ply(content) is not None
        with monkeypatch.context() as patched:
            patched.setattr("hapscene.scene.mesh_file.binary_ply", lambda content: None)
            other = load_mesh(tmp_path / f"{k}.ply", "mm")
        assert own.digest == other.digest and own.group_names == other.group_names
        np.testing.assert_array_equal(own.group, other.group)
        np.testing.assert_array_equal(own.colour_rgb, other.colour_rgb)


NORMALS = ({"vertex_normal": False}, {"vertex_normal": True})


def test_files_that_have_more_or_less_are_left_to_trimesh():
    plain = mesh_to_ply(Mesh(np.eye(3), [[0, 1, 2]]))
    count = plain.index(b"end_header\n") + 11 + 72
    assert binary_ply(plain) is not None
    for content in (
        plain[:-1],
        plain + b"\0",
        plain.replace(b"little", b"big"),
        plain.replace(b"double x", b"float x"),
        plain.replace(b"property double z", b"property uchar red"),
        plain[:count] + b"\4" + plain[count + 1 :],
        trimesh.creation.icosphere(1).export(None, "ply", encoding="ascii"),
        b"ply",
    ):
        assert binary_ply(content) is None


@pytest.mark.parametrize("name", ["m.stl", "no_folder/m.ply"])
def test_where_a_mesh_cannot_be_written(tmp_path, name):
    with pytest.raises(MeshError, match="m"):
        save_mesh(random_mesh(), tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_group_called_as_the_headers_end_is_renamed(tmp_path):
    """A mesh whose group's name nobody can change must be read again."""
    mesh = Mesh(np.eye(3), [[0, 1, 2], [0, 2, 1]], np.array([0, 1]), ("my end_header x", "\ud800"))
    save_mesh(mesh, tmp_path / "m.ply")
    back = load_mesh(tmp_path / "m.ply", "m")
    assert back.digest == mesh.digest and back.group_names == ("my end-header x", "?")


def test_groups_that_do_not_fit_are_left_out(tmp_path):
    save_mesh(random_mesh(), tmp_path / "m.ply")
    content = (tmp_path / "m.ply").read_bytes().replace("comment hapscene group Öse\n".encode(), b"")
    (tmp_path / "m.ply").write_bytes(content)
    assert load_mesh(tmp_path / "m.ply", "m").group_names == ("default",)


HEAD = "ply\nformat ascii 1.0\n"
VERTEX = "element vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 0\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize("elements", ["", VERTEX, f"comment hapscene scene 1\n{VERTEX}{FACE}"])
def test_a_file_without_faces_is_refused(tmp_path, elements):
    (tmp_path / "m.ply").write_text(f"{HEAD}{elements}end_header\n")
    with pytest.raises(MeshError, match="faces"):
        load_mesh(tmp_path / "m.ply", "m")
