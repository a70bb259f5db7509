"""Files that a mesh file names: found beside it, and nowhere else."""

import os
import zipfile
from pathlib import Path

import pytest

from hapscene.errors import MeshError, SceneError
from hapscene.scene.resource_resolver import ArchiveResources, FolderResources

BESIDE = ("data.bin", "my%20data.bin", "my data.bin", "deep/more.bin", "./data.bin", "../elsewhere/data.bin")


@pytest.fixture
def part(tmp_path: Path) -> Path:
    """A mesh file's place, with files in its folder and out of it."""
    folder = tmp_path / "in"
    (folder / "deep").mkdir(parents=True)
    for name in ("data.bin", "my data.bin", "deep/more.bin"):
        (folder / name).write_bytes(b"beside")
    (tmp_path / "secret.bin").write_bytes(b"secret")
    return folder / "part.gltf"


@pytest.mark.parametrize("name", [*BESIDE, "C:\\Users\\me\\data.bin"])
def test_what_lies_beside_is_found(part: Path, name: str) -> None:
    assert FolderResources(part, 100)[name] == b"beside"


@pytest.mark.parametrize(
    "name", ["../secret.bin", "https://example.org/secret.bin", "gone.bin", "", ".", "a\0b", "x" * 5000, "link.bin"]
)
def test_what_does_not_is_named(part: Path, name: str) -> None:
    if hasattr(os, "symlink"):
        (part.parent / "link.bin").symlink_to("../secret.bin")
    with pytest.raises(SceneError, match="part") as error:
        FolderResources(part, 100, SceneError).get(name)
    assert len(str(error.value)) < len(str(part)) + 300
    with pytest.raises(MeshError):
        FolderResources(part, 100).get(str(part.parent.parent / "secret.bin"))


def test_all_together_are_no_larger_than_is_read(part: Path) -> None:
    files = FolderResources(part, 17)
    assert files["data.bin"] == files["data.bin"] == b"beside"
    with pytest.raises(MeshError):
        files.get("deep/more.bin")


def test_beside_a_link_and_beside_the_file_itself(part: Path, tmp_path: Path) -> None:
    part.touch()
    (tmp_path / "data.bin").write_bytes(b"beside the link")
    (tmp_path / "own.bin").write_bytes(b"own")
    (tmp_path / "link.gltf").symlink_to(part)
    files = FolderResources(tmp_path / "link.gltf", 100)
    assert (files["data.bin"], files["own.bin"]) == (b"beside", b"own")


def test_in_an_archive(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "part.zip", "w") as archive:
        for name in ("in/part.gltf", "in/my data.bin", "./in/deep.bin", "top.bin"):
            archive.writestr(name, name)
    with zipfile.ZipFile(tmp_path / "part.zip") as archive:
        packed = ArchiveResources(tmp_path / "part.zip", archive, "in/part.gltf")
        assert packed["my%20data.bin"] == b"in/my data.bin" and packed["deep.bin"] == b"./in/deep.bin"
        assert packed["../top.bin"] == packed["top.bin"] == b"top.bin"
        with pytest.raises(MeshError, match="gone"):
            packed.get("gone.bin")
