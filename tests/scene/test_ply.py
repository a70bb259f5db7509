"""Export of meshes as PLY."""

import io
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from hapscene.errors import MeshError
from hapscene.scene.material import Material, picture_file
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.ply import declared_counts, mesh_to_ply, ply_groups, save_mesh


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


@pytest.mark.parametrize("group", [[0, 2, 0], [0, -1, 2], [0, 3, 2]])
def test_groups_without_a_name_in_the_header_are_ignored(group):
    face: Any = {"face": {"data": {"group": np.array(group)}}}
    loaded = SimpleNamespace(geometry={"": SimpleNamespace(faces=np.zeros((3, 3)), metadata={"_ply_raw": face})})
    found = ply_groups(mesh_to_ply(random_mesh()), loaded)
    assert found is None if group[1] != 2 else (found[0].tolist(), found[1]) == (group, list(random_mesh().group_names))


def test_materials_and_their_pictures_are_kept(tmp_path):
    """Also of a picture that two materials share, and of one that is damaged."""
    red, grey = Image.new("RGB", (2, 3), (200, 10, 30)), Image.new("L", (5, 1), 77)
    broken = Image.open(io.BytesIO(picture_file(red)[0][:-20]))
    base, glow = "baseColorTexture", "emissiveTexture"
    more = {"metallic": 0.25, "roughness": 0.5, "emissive": (0.1, 0.2, 0.3), "alpha": "MASK", "cutoff": 0.75}
    textures = {base: red}, {base: grey, glow: red}, {glow: broken}
    materials = tuple(Material(f"m {k}", (0.2, 0.4, 0.6, 0.8), textures=of, **more) for k, of in enumerate(textures))
    uv, index = np.random.default_rng(1).random((80, 3, 2), np.float32), np.arange(80, dtype=np.int16) % 4 - 1
    save_mesh(replace(random_mesh(), uv=uv, materials=materials, material=index), tmp_path / "m.ply")
    back = load_mesh(tmp_path / "m.ply", "m")
    np.testing.assert_array_equal(back.uv, uv)
    np.testing.assert_array_equal(back.material, index)
    assert [one.numbers for one in back.materials] == [one.numbers for one in materials]
    found = [{name: np.asarray(picture).tolist() for name, picture in one.textures.items()} for one in back.materials]
    pixels = [np.asarray(picture).tolist() for picture in (red, grey)]
    assert found == [{base: pixels[0]}, {base: pixels[1], glow: pixels[0]}, {}]


@pytest.mark.parametrize("name", ["m.stl", "no_folder/m.ply"])
def test_invalid_path_raises_and_writes_nothing(tmp_path, name):
    with pytest.raises(MeshError, match="m"):
        save_mesh(random_mesh(), tmp_path / name)
    assert not list(tmp_path.iterdir())


HEAD = "ply\nformat ascii 1.0\n"
VERTEX = "element vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 0\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize("elements", ["", VERTEX, f"comment hapscene scene 1\n{VERTEX}{FACE}"])
def test_file_without_faces_raises(tmp_path, elements):
    (tmp_path / "m.ply").write_text(f"{HEAD}{elements}end_header\n")
    with pytest.raises(MeshError, match="faces"):
        load_mesh(tmp_path / "m.ply", "m")


@pytest.mark.parametrize("content", [b"plx\nelement face 1\nend_header\n", b"ply\nelement face 1\n"])
def test_content_without_a_header_raises(content):
    with pytest.raises(MeshError, match="no header"):
        declared_counts(content, "m")


def strips(kind: str, *of_strips: list[int], index: str = "int") -> bytes:
    """A square of four vertices with a colour each, and its strips."""
    rows = [(0, 0, 0, 9), (1, 0, 0, 9), (0, 1, 0, 9), (1, 1, 0, 9)]
    header = "\n".join(
        [
            *("ply", f"format {kind} 1.0", "element vertex 4", *(f"property float {axis}" for axis in "xyz")),
            *("property uchar flag", f"element tristrips {len(of_strips)}"),
            *(f"property list int {index} vertex_indices", "end_header", ""),
        ]
    )
    if kind == "ascii":
        lines = [*rows, *((len(strip), *strip) for strip in of_strips)]
        return (header + "\n".join(" ".join(map(str, line)) for line in lines) + "\n").encode()
    order = "<" if "little" in kind else ">"
    vertices = np.array(rows, [("x", f"{order}f4"), ("y", f"{order}f4"), ("z", f"{order}f4"), ("flag", "u1")])
    lists = [np.array([len(strip), *strip], f"{order}i4").tobytes() for strip in of_strips]
    return header.encode() + vertices.tobytes() + b"".join(lists)


KINDS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("kind", KINDS)
def test_triangle_strips(tmp_path, kind):
    (tmp_path / "m.ply").write_bytes(strips(kind, [0, 1, 2, 3, -1, 3, 1, 0], [0, 1, 1, 2, 3], [], [2]))
    mesh = load_mesh(tmp_path / "m.ply", "m")
    assert mesh.faces.tolist() == [[0, 1, 2], [2, 1, 3], [3, 1, 0], [1, 2, 3]]
    assert mesh.vertices_m.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_triangle_strips_raise(tmp_path, kind):
    whole = strips(kind, [0, 1, 2, 3])
    face = b"element face 1\nproperty list uchar int vertex_indices\nend_header"
    damaged = [whole[:-5], strips(kind, [0, 1, 4]), strips(kind, [0, 1]), whole.replace(b"end_header", face)]
    damaged += [strips(kind, [0, 1, 2], index="word"), whole.replace(b"element tristrips 1", b"element tristrips 9")]
    damaged += [strips("ascii", [0, 1, 10**20]), whole.replace(b"format", b"comment")]
    for content in damaged:
        (tmp_path / "m.ply").write_bytes(content)
        with pytest.raises(MeshError, match=r"m\.ply"):
            load_mesh(tmp_path / "m.ply", "m")
