"""Loading of all mesh formats, and errors for damaged files."""

import tracemalloc
import warnings
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.errors import MeshError
from hapscene.scene.mesh import MeshWarning
from hapscene.scene.mesh_file import load_mesh

FLOAT32 = {"rtol": 1e-6, "atol": 1e-9}


def two_boxes() -> trimesh.Scene:
    scene = trimesh.Scene()
    shift = np.eye(4)
    shift[:3, 3] = (3, 0, 0)
    scene.add_geometry(trimesh.creation.box((1, 1, 1)), geom_name="small", node_name="small")
    scene.add_geometry(trimesh.creation.box((2, 2, 2)), geom_name="big", node_name="big", transform=shift)
    return scene


@pytest.mark.parametrize("suffix", ["stl", "stl_ascii", "obj", "ply", "ply_ascii", "off"])
def test_unitless_formats_are_scaled(tmp_path, suffix):
    kind, _, _ = suffix.partition("_")
    ball = trimesh.creation.icosphere(subdivisions=2, radius=30.0)
    path = tmp_path / f"ball.{kind}"
    options = {"encoding": "ascii"} if suffix == "ply_ascii" else {}
    exported = ball.export(file_type="stl_ascii" if suffix == "stl_ascii" else kind, **options)
    path.write_bytes(exported if isinstance(exported, bytes) else exported.encode())
    mesh = load_mesh(path, "mm")
    np.testing.assert_allclose(mesh.triangles_m, ball.triangles * 1e-3, **FLOAT32)
    assert (mesh.path, mesh.unit, mesh.group_names) == (path, "mm", ("default",))
    with pytest.raises(MeshError, match="unit"):
        load_mesh(path)


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_scene_formats_become_one_mesh_with_groups(tmp_path, suffix):
    scene = two_boxes()
    if suffix == "gltf":
        for name, content in scene.export(file_type="gltf").items():
            (tmp_path / ("boxes.gltf" if name == "model.gltf" else name)).write_bytes(content)
    else:
        scene.export(tmp_path / "boxes.glb")
    mesh = load_mesh(tmp_path / f"boxes.{suffix}")
    assert len(mesh.faces) == 24 and {"small", "big"} <= {p for n in mesh.group_names for p in n.split("/")}
    np.testing.assert_allclose(mesh.triangles_m[mesh.faces_of("big")].max(axis=(0, 1)), (4, 1, 1), rtol=1e-6)
    np.testing.assert_allclose(mesh.triangles_m[mesh.faces_of("small")].max(axis=(0, 1)), (0.5, 0.5, 0.5))


def test_faces_are_preserved(tmp_path):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [5, 5, 5]], float)
    faces = np.array([[0, 1, 2], [3, 1, 2], [0, 0, 1], [0, 1, 2]])
    for suffix in ("ply", "off", "glb"):
        trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / f"odd.{suffix}")
        mesh = load_mesh(tmp_path / f"odd.{suffix}", "m", up="z")
        np.testing.assert_array_equal(mesh.faces, faces)
        np.testing.assert_array_equal(mesh.vertices_m, vertices)


REAL = {
    "featuretype.STEP": (None, 8326, (0.127, 0.0635, 0.034925)),  # in inches
    "bunny.ply": ("m", 16301, (0.1555062, 0.15325391, 0.1205631)),
    "groups.obj": ("mm", 2308, (0.00942517, 0.00493561, 0.004)),
    "Duck.glb": (None, 4212, (1.65478397, 1.15253393, 1.54040628)),
}


@pytest.mark.parametrize("name", REAL)
def test_real_files(shared, name):
    unit, face_count, size_m = REAL[name]
    path = shared / "data" / "meshes" / name
    if not path.exists():
        pytest.skip(f"no {path}")
    if name.endswith("STEP"):
        pytest.importorskip("cascadio")
    mesh = load_mesh(path, unit)
    assert len(mesh.faces) == face_count
    np.testing.assert_allclose(mesh.bounds_m[1] - mesh.bounds_m[0], size_m, rtol=1e-4)


def ball(file_type: str, **options) -> bytes:
    exported = trimesh.creation.icosphere(subdivisions=2).export(file_type=file_type, **options)
    return exported if isinstance(exported, bytes) else exported.encode()


def ply(vertices="0 0 0\n1 0 0\n0 1 0\n", faces="3 0 1 2\n", vertex_count=3, face_count=1) -> bytes:
    return (
        f"ply\nformat ascii 1.0\nelement vertex {vertex_count}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {face_count}\nproperty list uchar int vertex_indices\nend_header\n{vertices}{faces}"
    ).encode()


SUFFIXES = ("stl", "obj", "ply", "off", "glb", "gltf", "step")

BROKEN = {
    "missing.stl": None,
    "empty.stl": b"",
    **{f"text.{s}": b"This is no mesh, it is a letter.\n" * 9 for s in SUFFIXES},
    "cut.stl": ball("stl")[:-200],
    "cut.ply": ball("ply")[:-200],
    "cut.off": ball("off")[: -len(ball("off")) // 3],
    "cut.glb": ball("glb")[:-200],
    "no_shape.step": b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n",
    "packed.zip": b"PK\3\4",
    "nan.ply": ply(vertices="0 0 0\nnan 0 0\n0 1 0\n"),
    "no_faces.ply": ply(faces="", face_count=0),
    "index.ply": ply(faces="3 0 1 3\n"),
    "huge_count.ply": ply(vertex_count=10**12),
    "no_buffer.gltf": b'{"asset":{"version":"2.0"},"buffers":[{"uri":"gone.bin","byteLength":9}],"meshes":[]}',
}


@pytest.mark.parametrize("name", BROKEN)
def test_invalid_file_raises_one_line(tmp_path, name):
    path = tmp_path / name
    if BROKEN[name] is not None:
        path.write_bytes(BROKEN[name])
    if path.suffix == ".step":
        pytest.importorskip("cascadio")
    with pytest.raises(MeshError) as error:
        load_mesh(path, "m")
    text = str(error.value)
    assert str(path) in text and "\n" not in text and len(text) - len(str(path)) < 400
    assert error.value.__cause__ is None


XYZ = "property float x\nproperty float y\nproperty float z"
MANY = 3_000_000_000

PROMISES = {
    "binary.stl": bytes(80) + MANY.to_bytes(4, "little") + bytes(100),
    "called_solid.stl": b"solid x".ljust(80) + MANY.to_bytes(4, "little") + bytes(100),
    "binary.ply": f"ply\nformat binary_little_endian 1.0\nelement vertex {MANY}\n{XYZ}\nend_header\n".encode(),
    "long_list.ply": f"ply\nformat binary_little_endian 1.0\nelement vertex 3\n{XYZ}\nelement face 1\n"
    "property list uint int vertex_indices\nend_header\n".encode()
    + bytes(36)
    + MANY.to_bytes(4, "little")
    + bytes(12),
    "vertices.off": f"OFF\n{MANY} 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".encode(),
}


@pytest.mark.parametrize("name", PROMISES)
def test_large_counts_in_header_raise_without_allocation(tmp_path, name):
    (tmp_path / name).write_bytes(PROMISES[name])
    tracemalloc.start()
    try:
        with pytest.raises(MeshError):
            load_mesh(tmp_path / name, "m")
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


CUT_OFF = b"OFF\n# made by hand\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 1 2 3\n3 0 2 3\n"


@pytest.mark.parametrize("end", [b"OFF\n# made by hand\n4", b"1 0 0\n", b"1 0 0\n0 1", b"3 0 1 3\n"])
def test_truncated_off_file_raises(tmp_path, end):
    (tmp_path / "cut.off").write_bytes(CUT_OFF[: CUT_OFF.index(end) + len(end)])
    with pytest.raises(MeshError, match=r"OFF|truncated"):
        load_mesh(tmp_path / "cut.off", "m")
    for mark in (b"", b"\xef\xbb\xbf"):  # some programs write a byte-order mark
        (tmp_path / "whole.off").write_bytes(mark + CUT_OFF)
        assert len(load_mesh(tmp_path / "whole.off", "m").faces) == 4


FACES_OFF = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 1 2 3\n3 0 2 3\n"


@pytest.mark.parametrize(
    "content",
    [
        f"\n\n  \n# OFF of a program\n\n OFF # comment\n\n4 4 6\n{FACES_OFF}\n# end\n",
        f"OFF 4 4 6\n{FACES_OFF}",
        f"OFF\n4\n4\n6\n{FACES_OFF}",
        f"COFF\n4 4\n{FACES_OFF}".replace("0 0 1\n", "0 0 1 255 0 0 255\n").replace("3 0 2 3", "3 0 2 3  255 0 0"),
        "OFF\n4 4 6\n" + FACES_OFF.replace("3 0 1 3", "3\n0 1\n\n3 # comment").replace("1 0 0", "1\n0 0"),
    ],
)
def test_off_layouts(tmp_path, content):
    (tmp_path / "a.off").write_text(content)
    mesh = load_mesh(tmp_path / "a.off", "m")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]]
    assert mesh.vertices_m.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    ("counts", "line"), [("4 2 6", 9), ("4 5 6", None), ("3 4 6", 6), ("5 4 6", None), ("x 4 6", 2)]
)
def test_off_with_wrong_counts_raises(tmp_path, counts, line):
    (tmp_path / "a.off").write_text(f"OFF\n{counts}\n{FACES_OFF}")
    with pytest.raises(MeshError, match=r"a\.off" if line is None else f"line {line}:"):
        load_mesh(tmp_path / "a.off", "m")


@pytest.mark.parametrize("index", [-1, 5])
def test_off_with_a_wrong_index_raises(tmp_path, index):
    (tmp_path / "a.off").write_text(f"OFF\n4 2 0\n0 0 0\n1 0 0\n2 1 0\n1 2 0\n3 0 1 2\n3 0 {index} 2\n")
    with pytest.raises(MeshError, match="line 8:"):
        load_mesh(tmp_path / "a.off", "m")


def test_off_polygons_become_fans(tmp_path):
    (tmp_path / "a.off").write_text("OFF\n5 2 0\n0 0 0\n1 0 0\n2 1 0\n1 2 0\n0 1 0\n5 0 1 2 3 4\n3 0 2 4\n")
    assert load_mesh(tmp_path / "a.off", "m").faces.tolist() == [[0, 2, 4], [0, 1, 2], [0, 2, 3], [0, 3, 4]]


def test_mesh_far_from_origin_raises(tmp_path):
    (tmp_path / "far.obj").write_text("v 0 0 20000\nv 1 0 20000\nv 0 1 20000\nf 1 2 3\n")
    with pytest.raises(MeshError, match="vertex 0"):
        load_mesh(tmp_path / "far.obj", "m")
    assert load_mesh(tmp_path / "far.obj", "mm").bounds_m[0, 2] == 20.0


@pytest.mark.parametrize("count", [0, 10])
def test_binary_stl_with_more_faces_than_declared_raises(tmp_path, count):
    content = ball("stl")
    (tmp_path / "ball.stl").write_bytes(content[:80] + count.to_bytes(4, "little") + content[84:])
    with pytest.raises(MeshError, match=f"{count} faces"):
        load_mesh(tmp_path / "ball.stl", "m")


@pytest.mark.parametrize(("rest", "damaged"), [(49, False), (50, True)])
def test_bytes_after_a_binary_stl_that_are_not_faces_are_ignored(tmp_path, rest, damaged):
    (tmp_path / "ball.stl").write_bytes(ball("stl") + b"\1" * rest)
    with pytest.raises(MeshError, match="follow") if damaged else nullcontext():
        load_mesh(tmp_path / "ball.stl", "m")


def test_missing_material_file_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "part.obj"
    path.write_text("mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl skin\nf 1 2 3\n")
    with pytest.warns(MeshWarning, match=r"gone\.mtl"):
        assert load_mesh(path, "m").group_names == ("skin",)
    path.with_name("gone.mtl").write_text("newmtl skin\nKd 1 0 0\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load_mesh(path, "m").colour_rgb is not None


def test_off_file_with_too_long_line_raises(tmp_path):
    (tmp_path / "a.off").write_bytes(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n1000000 " + b"0 " * 1_000_000 + b"\n")
    with pytest.raises(MeshError, match="longer"):
        load_mesh(tmp_path / "a.off", "m")
