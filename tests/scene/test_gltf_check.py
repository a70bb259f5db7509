"""Size checks of glTF files."""

import json
import tracemalloc
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.errors import FormatError, MeshError
from hapscene.scene import gltf_check, mesh, mesh_file
from hapscene.scene.gltf_check import check_gltf, parse_gltf
from hapscene.scene.mesh_file import load_mesh

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()


def gltf(*accessors: dict[str, Any], blob: bytes = POINTS, **more: Any) -> dict[str, Any]:
    """A file with one triangle, and more accessors."""
    first = {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "bufferViews": [{"buffer": 0, "byteLength": len(blob)}],
        "buffers": [{"byteLength": len(blob), "uri": "data.bin"}],
        "accessors": [first, *accessors],
        **more,
    }


def write(folder: Path, tree: dict[str, Any], suffix: str = "gltf", blob: bytes = POINTS) -> Path:
    """The file of a tree, as .gltf with a data file, or as .glb."""
    path = folder / f"small.{suffix}"
    if suffix == "gltf":
        (folder / "data.bin").write_bytes(blob)
        path.write_text(json.dumps(tree))
        return path
    tree = tree | {"buffers": [{"byteLength": len(blob)}]}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = len(text).to_bytes(4, "little") + b"JSON" + text + len(blob).to_bytes(4, "little") + b"BIN\0" + blob
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks)
    return path


ZEROS = {"componentType": 5126, "type": "VEC3", "count": 30_000_000}
SPARSE = {
    "count": 1,
    "indices": {"bufferView": 0, "componentType": 5121},
    "values": {"bufferView": 0, "byteOffset": 4},
}
VIEW = {"buffer": 0, "byteLength": len(POINTS)}

MUCH: dict[str, tuple[dict[str, Any], str]] = {
    "zeros": (gltf(ZEROS), "accessors[1]"),
    "sparse": (gltf(ZEROS | {"sparse": SPARSE}), "accessors[1]"),
    "overlapping views": (gltf(ZEROS | {"count": 5000}, bufferViews=[VIEW] * 1000), "accessors[1]"),
    "count is not an integer": (gltf(ZEROS | {"count": 3e7}), "accessors[1].count"),
    "missing view": (gltf(ZEROS | {"bufferView": 1}), "bufferViews[1]"),
    "view without length": (gltf(bufferViews=[{"buffer": 0}]), "bufferViews[0].byteLength"),
    "invalid type": (gltf(ZEROS | {"type": ["VEC3"]}), "accessors[1]"),
}


@pytest.mark.parametrize("name", MUCH)
def test_small_file_with_large_counts_raises_without_allocation(tmp_path: Path, name: str) -> None:
    tree, field = MUCH[name]
    path = write(tmp_path, tree, "glb" if name == "zeros" else "gltf")
    tracemalloc.start()
    try:
        with pytest.raises(MeshError) as caught:
            load_mesh(path)
        assert field in str(caught.value) and tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("stride_B", "offset_B", "fits"), [(0, 0, 3), (0, 12, 2), (0, 13, 1), (16, 0, 2), (24, 0, 2)])
def test_elements_of_an_accessor_lie_in_its_view(stride_B: int, offset_B: int, fits: int) -> None:
    for count, refused in ((0, False), (fits, False), (fits + 1, True)):
        more = {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count, "byteOffset": offset_B}
        tree = gltf(bufferViews=[VIEW | {"byteStride": stride_B}]) | {"accessors": [more]}
        with pytest.raises(MeshError, match=f"{count} elements") if refused else nullcontext():
            check_gltf(json.dumps(tree).encode(), False, "a.gltf", 10**9)


def test_accessor_without_data_is_read(tmp_path: Path) -> None:
    tree = gltf({"componentType": 5126, "type": "VEC2", "count": 3})  # as texture coordinates of one pixel
    tree["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 1
    assert len(load_mesh(write(tmp_path, tree)).faces) == 1


@pytest.mark.parametrize("kind", ["views", "accessors", "primitives"])
def test_repeated_references_are_counted(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_file, "check_gltf", lambda *given: check_gltf(*given[:3], 20_000))
    tree = gltf()
    times = {
        "views": ("bufferViews", tree),
        "accessors": ("accessors", tree),
        "primitives": ("primitives", tree["meshes"][0]),
    }
    key, parent = times[kind]
    parent[key] = parent[key] * 600
    with pytest.raises(MeshError, match="21,600"):
        load_mesh(write(tmp_path, tree))
    parent[key] = parent[key][:100]
    assert len(load_mesh(write(tmp_path, tree)).faces) == (100 if kind == "primitives" else 1)


def test_repeated_instances_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh, "FACE_MAX", 1000)
    tree = gltf(nodes=[{"mesh": 0}] * 400, scenes=[{"nodes": list(range(400))}])
    with pytest.raises(MeshError, match="1,000"):
        load_mesh(write(tmp_path, tree))
    tree["scenes"] = [{"nodes": list(range(300))}]
    assert len(load_mesh(write(tmp_path, tree)).faces) == 300


@pytest.mark.parametrize(
    ("children", "node"), [({0: [1], 1: [0]}, 0), ({1: [1]}, 1), ({0: [1, 1]}, 1), ({0: [2], 1: [2]}, 2)]
)
def test_nodes_must_be_a_tree(tmp_path: Path, children: dict[int, list[int]], node: int) -> None:
    nodes: list[dict[str, Any]] = [{"mesh": 0}, {}, {}]
    for index, own in children.items():
        nodes[index] |= {"children": own}
    with pytest.raises(MeshError, match=rf"nodes\[{node}\]"):
        load_mesh(write(tmp_path, gltf(nodes=nodes)))


@pytest.mark.parametrize(
    ("suffix", "strict", "fits"), [("glb", True, False), ("glb", False, True), ("gltf", False, False)]
)
def test_invalid_text_is_read_from_a_binary_file_of_another_program_alone(
    tmp_path: Path, suffix: str, strict: bool, fits: bool
) -> None:
    content = write(tmp_path, gltf(extras="name"), suffix).read_bytes().replace(b"name", b"na\xffe")
    with nullcontext() if fits else pytest.raises(FormatError, match="not a valid"):
        assert parse_gltf(content, suffix == "glb", "a", strict)[0]["extras"] == "na\N{REPLACEMENT CHARACTER}e"


def test_files_of_other_programs_may_have_as_many_lists_as_fit_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    content = json.dumps(gltf()).encode()
    for limits, strictly, else_too in (
        ((8, 100), False, True),
        ((10**6, 10**12), True, True),
        ((8, 10**12), False, False),
    ):
        for name, limit in zip(("CONTAINER_MAX", "CONTAINER_B"), limits, strict=True):
            monkeypatch.setattr(gltf_check, name, limit)
        for strict, fits in ((True, strictly), (False, else_too)):
            with nullcontext() if fits else pytest.raises(FormatError, match="at most"):
                assert parse_gltf(content, False, "a", strict)[0] == gltf()


def test_too_many_lists_raise(tmp_path: Path) -> None:
    path = tmp_path / "lists.gltf"
    path.write_bytes(b'{"asset": {"version": "2.0"}, "extras": [' + b"[]," * 2_600_000 + b"0]}")
    with pytest.raises(MeshError, match="2,600,003"):
        load_mesh(path)
