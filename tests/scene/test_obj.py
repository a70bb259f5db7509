"""The OBJ reader: order, names, colours, and errors with line numbers."""

import numpy as np
import pytest

from hapscene.errors import MeshError
from hapscene.scene.mesh_file import load_mesh


def read(tmp_path, text, **files):
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "mesh.obj").write_text(text)
    return load_mesh(tmp_path / "mesh.obj", "m")


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def test_order_names_and_shared_vertices_are_preserved(tmp_path):
    text = SQUARE + (
        "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n"
        "o door\nusemtl steel\nf 1/1/1 2/2/1 3/3/1\nusemtl wood\nf 1/2/1 3/1/1 4/4/1\no frame\nusemtl steel\nf 4 3 2\n"
    )
    mesh = read(tmp_path, text)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [3, 2, 1]])
    assert len(mesh.vertices_m) == 4  # not split where texture coordinates differ
    assert [mesh.group_names[g] for g in mesh.group] == ["door/steel", "door/wood", "frame/steel"]


def test_faces_before_the_first_texture_coordinate_have_none(tmp_path):
    mesh = read(tmp_path, SQUARE + "f 1 2 3 4\nvt 0.25 0.5\nvt 1\nf 4/1 3/2 2/1\nf 1 2/1 3\n")
    assert np.isnan(mesh.uv[[0, 1, 3]]).all()
    assert mesh.uv[2].tolist() == [[0.25, 0.5], [1.0, 0.0], [0.25, 0.5]]
    assert np.isnan(read(tmp_path, SQUARE + "f 1 2 3\nvt 0 0\n").uv).all()
    assert read(tmp_path, SQUARE + "f 1 2 3\n").uv is None


def test_polygons_negative_indices_comments_and_continued_lines(tmp_path):
    mesh = read(tmp_path, "# a square\n" + SQUARE + "f -4 -3 \\\n -2 -1\n")
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3]])


def test_colours_from_materials_and_textures(tmp_path):
    from PIL import Image

    picture = Image.new("RGB", (2, 2))
    picture.putdata([(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)])
    picture.save(tmp_path / "p.png")
    text = (
        "mtllib m.mtl\n"
        + SQUARE
        + (
            "vt 0.25 0.75\nvt 0.75 0.25\nusemtl plain\nf 1 2 3\nusemtl picture\nf 1/1 2/1 3/1\nf 1/2 2/2 3/2\n"
            "usemtl unknown\nf 1 2 3\n"
        )
    )
    mtl = b"newmtl plain\nKd 0 0.5 1\nnewmtl picture\nKd 1 1 1\nmap_Kd p.png\n"
    mesh = read(tmp_path, text, **{"m.mtl": mtl})
    np.testing.assert_allclose(mesh.colour_rgb[0], (0, 127, 255), atol=1)
    np.testing.assert_array_equal(mesh.colour_rgb[1:], [(255, 0, 0), (255, 255, 0), (160, 160, 160)])


def test_colours_of_vertices(tmp_path):
    text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n"
    assert read(tmp_path, text).colour_rgb.tolist() == [[85, 85, 85]]
    with pytest.raises(MeshError, match="line 1"):
        read(tmp_path, "v 0 0 0 red 0 0\n")
    weighted = "v 0 0 0 1\nv 1 0 0 0.5 0.5\nv 0 1 0 1\nf 1 2 3\n"  # too few numbers for a colour
    assert read(tmp_path, weighted).colour_rgb is None


@pytest.mark.parametrize(
    ("line", "place"),
    [
        ("f 1 2 5", "line 5"),
        ("f 1 2 0", "line 5"),
        ("f 1 2", "line 5"),
        ("f 1 two 3", "line 5"),
        ("v 1 2 x", "line 5"),
        ("vn 0 1 -", "line 5"),
        ("vt 0 0\nf 1/1 2/2 3/1", "line 6"),
    ],
)
def test_error_names_the_line(tmp_path, line, place):
    with pytest.raises(MeshError, match=place):
        read(tmp_path, SQUARE + line + "\n")


def test_too_long_line_raises(tmp_path):
    (tmp_path / "fan.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * 200_000)
    with pytest.raises(MeshError, match="line 4"):
        load_mesh(tmp_path / "fan.obj", "m")
