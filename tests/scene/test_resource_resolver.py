"""Access to files that a mesh file refers to."""

import os
from pathlib import Path

import pytest

from hapscene.errors import MeshError
from hapscene.scene.mesh_file import FolderResources

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
