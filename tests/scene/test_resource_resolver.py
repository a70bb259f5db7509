"""Access to files that a mesh file refers to."""

import os
import tempfile
import zipfile
from pathlib import Path

import pytest

from hapscene.errors import MeshError
from hapscene.scene.mesh_file import FolderResources, load_mesh

BESIDE = ("data.bin", "my%20data.bin", "my data.bin", "deep/more.bin", "./data.bin", "../elsewhere/data.bin")


@pytest.fixture
def part(tmp_path: Path) -> Path:
    """The path of a mesh file, with other files inside and outside of its folder."""
    folder = tmp_path / "in"
    (folder / "deep").mkdir(parents=True)
    for name in ("data.bin", "my data.bin", "deep/more.bin"):
        (folder / name).write_bytes(b"beside")
    (tmp_path / "secret.bin").write_bytes(b"secret")
    return folder / "part.gltf"


@pytest.mark.parametrize("name", [*BESIDE, "C:\\Users\\me\\data.bin"])
def test_file_in_the_folder_is_found(part: Path, name: str) -> None:
    assert FolderResources(part, 100)[name] == b"beside"


@pytest.mark.parametrize(
    "name", ["../secret.bin", "https://example.org/secret.bin", "gone.bin", "", ".", "a\0b", "x" * 5000, "link.bin"]
)
def test_file_elsewhere_raises(part: Path, name: str) -> None:
    if hasattr(os, "symlink"):
        (part.parent / "link.bin").symlink_to("../secret.bin")
    with pytest.raises(MeshError, match="part") as error:
        FolderResources(part, 100).get(name)
    assert len(str(error.value)) < len(str(part)) + 300
    with pytest.raises(MeshError):
        FolderResources(part, 100).get(str(part.parent.parent / "secret.bin"))


def test_total_size_is_limited(part: Path) -> None:
    files = FolderResources(part, 17)
    assert files["data.bin"] == files["data.bin"] == b"beside"
    with pytest.raises(MeshError):
        files.get("deep/more.bin")


def test_symbolic_link(part: Path, tmp_path: Path) -> None:
    part.touch()
    (tmp_path / "data.bin").write_bytes(b"beside the link")
    (tmp_path / "own.bin").write_bytes(b"own")
    (tmp_path / "link.gltf").symlink_to(part)
    files = FolderResources(tmp_path / "link.gltf", 100)
    assert (files["data.bin"], files["own.bin"]) == (b"beside", b"own")


def test_file_in_an_archive(tmp_path: Path) -> None:
    """A mesh of an archive has its colours from the folder of the mesh, and leaves no file behind."""
    obj = "mtllib my%20colours.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
    with zipfile.ZipFile(tmp_path / "part.zip", "w") as archive:
        archive.writestr("in/part.obj", obj)
        archive.writestr("in/my colours.mtl", "newmtl red\nKd 1 0 0\n")
        archive.writestr("../out.bin", "unpacked into the folder too")
    tempfile.tempdir = str(tmp_path / "temporary")
    Path(tempfile.tempdir).mkdir()
    try:
        mesh = load_mesh(tmp_path / "part.zip", "m")
    finally:
        tempfile.tempdir = None
    assert mesh.colour_rgb is not None and mesh.colour_rgb.tolist() == [[255, 0, 0]]
    assert list((tmp_path / "temporary").iterdir()) == [] and not (tmp_path / "out.bin").exists()
