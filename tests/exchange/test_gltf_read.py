"""glTF read back, as another program may have left it, and from strangers."""

import base64
import copy
import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.errors import HapsceneError, SceneError
from hapscene.exchange import export_scene, import_scene
from hapscene.exchange.carried import ExchangeWarning
from hapscene.scene.scene import Scene
from hapscene.surface.swatch_file import swatch_to_json

pytestmark = pytest.mark.filterwarnings("ignore::hapscene.exchange.carried.ExchangeWarning")


@pytest.fixture
def tree(make_scene: Callable[[int], Scene], tmp_path: Path) -> dict[str, Any]:
    return json.loads(export_scene(make_scene(0), tmp_path / "small.gltf")[0].read_bytes())


@pytest.fixture
def read(tmp_path: Path) -> Callable[[Any], Scene]:
    def read(tree: Any) -> Scene:
        file = tmp_path / "changed.gltf"
        file.write_text(json.dumps(tree), encoding="utf-8")
        return import_scene(file)

    return read


def test_poses_are_the_scenes_own_wherever_the_file_is_put(tree: dict, read: Callable, scene: Scene) -> None:
    tree["nodes"].append({"children": [0], "translation": [5, 6, 7], "scale": [2, 2, 2]})
    tree["scenes"][0]["nodes"] = [len(tree["nodes"]) - 1]
    for was, now in zip(scene.bodies, read(tree).bodies, strict=True):
        assert np.array_equal(was.X_WB, now.X_WB)


def test_a_pose_may_be_split_into_its_parts(tree: dict, read: Callable, scene: Scene) -> None:
    from scipy.spatial.transform import Rotation

    for body in scene.bodies:
        node = next(n for n in tree["nodes"] if n.get("extras", {}).get("hapscene_body") == body.name)
        del node["matrix"]
        node["rotation"] = (Rotation.from_matrix(body.X_WB[:3, :3]).as_quat() * 3).tolist()  # of any length
        node["translation"] = body.X_WB[:3, 3].tolist()
    for was, now in zip(scene.bodies, read(tree).bodies, strict=True):
        np.testing.assert_allclose(now.X_WB, was.X_WB, rtol=0, atol=1e-15)


def test_indices_of_16_bits_and_interleaved_positions(tree: dict, read: Callable) -> None:
    before = read(tree)
    blob = base64.b64decode(tree["buffers"][0]["uri"].partition(",")[2])
    for i, accessor in enumerate(tree["accessors"]):
        view = tree["bufferViews"][accessor["bufferView"]]
        data = blob[view["byteOffset"] :][: view["byteLength"]]
        if accessor["type"] == "VEC3":
            rows = np.zeros((accessor["count"], 5), "<f4")
            rows[:, 1:4] = np.frombuffer(data, "<f4").reshape(-1, 3)
            new, accessor["byteOffset"], stride = rows.tobytes(), 4, {"byteStride": 20}
        else:
            new, accessor["componentType"], stride = np.frombuffer(data, "<u4").astype("<u2").tobytes(), 5123, {}
        accessor["bufferView"] = len(tree["bufferViews"])
        tree["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(new), **stride})
        blob += new + bytes(-len(new) % 4)
        assert i < 12
    tree["buffers"][0] = {"byteLength": len(blob), "uri": "data:;base64," + base64.b64encode(blob).decode()}
    for was, now in zip(before.bodies, read(tree).bodies, strict=True):
        assert was.mesh.digest == now.mesh.digest and np.array_equal(was.face_swatch, now.face_swatch)


def test_a_material_made_elsewhere_is_a_swatch_by_its_name(tree: dict, read: Callable) -> None:
    wood = next(m for m in tree["materials"] if m["name"] == "wood")
    del wood["extras"]
    assert "wood" in read(copy.deepcopy(tree)).swatch_source
    for material in tree["materials"]:
        if material["name"] == "wood":
            material |= {"name": "Material.001", "extras": {}}
    with pytest.warns(ExchangeWarning, match=r"'Material\.001' is no swatch"):
        assert "wood" not in [s.name for s in read(tree).swatches]


def test_a_long_swatch_comes_from_the_library(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.exchange.carried.EMBEDDED_MAX", 10)
    file = export_scene(scene, tmp_path / "desk.glb")[0]
    with pytest.warns(ExchangeWarning, match="numbers alone"):
        back = import_scene(file)
    by_name = {s.name: s for s in back.swatches}
    assert swatch_to_json(by_name["wood"]) == swatch_to_json(scene.swatches[1])
    mine = scene.swatches[2]
    bare = replace(mine, texture=None, taps=None, effects={}, provenance="", licence="", intervals={}, absent={})
    assert swatch_to_json(by_name[mine.name]) == swatch_to_json(bare)


def _set(tree: dict, path: str, value: Any) -> None:
    *way, last = path.split(".")
    for step in way:
        tree = tree[int(step)] if step.isdigit() else tree[step]  # type: ignore[index, assignment]
    tree[int(last) if last.isdigit() else last] = value  # type: ignore[index]


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("nodes.0.children", [0], "within itself"),
        ("nodes.0.children", [99], r"no nodes\[99\]"),
        ("nodes.0.extras", {"hapscene_version": 2}, "update hapscene"),
        ("nodes.0.extras", {"hapscene_version": "1"}, "whole number"),
        ("nodes.1.translation", [1, 2, 3], "moved within its body"),
        ("nodes.4.matrix", [1] * 15, "16 finite numbers"),
        ("nodes.4.matrix", [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1], "scales or shears"),
        ("nodes.4.extras.hapscene_body", 5, "needs its name"),
        ("nodes.4.extras.two_sided", "yes", "two_sided"),
        ("nodes.4.children", [], "has no mesh"),
        ("meshes.0.primitives.0.mode", 1, "only triangles"),
        ("meshes.0.primitives.0.extensions", {"KHR_draco_mesh_compression": {}}, "without compression"),
        ("meshes.0.primitives.0.material", "wood", "by its index"),
        ("accessors.0.count", 10**12, "past the file's buffer"),
        ("accessors.0.count", 10**30, "whole number"),
        ("accessors.0.count", -1, "whole number"),
        ("accessors.0.count", 0, "whole number"),
        ("accessors.0.componentType", 5130, "float32"),
        ("accessors.0.componentType", [], "float32"),
        ("accessors.0.bufferView", None, r"no bufferViews\[None\]"),
        ("accessors.1.count", 4, "do not make triangles"),
        ("bufferViews.0.byteStride", 4, "whole number"),
        ("bufferViews.0.byteOffset", 1 << 39, "past the file's buffer"),
        ("bufferViews.0.buffer", 1, "past the file's buffer"),
        ("buffers.0.uri", "data:;base64,????", "not base64"),
        ("buffers.0.uri", "small.bin", "past the file's buffer"),
        ("materials.0.extras.swatch_file", "{}", "swatch"),
        ("materials.1.extras.sha256", "0", None),
        ("accessors", {}, "accessors"),
        ("asset", 2, "not a glTF file"),
        ("scenes.0.nodes", [[0]], r"no nodes\[\[0\]\]"),
        ("scene", 7, r"no scenes\[7\]"),
    ],
)
def test_what_is_refused_and_why(path: str, value: Any, message: str | None, tree: dict, read: Callable) -> None:
    if path.endswith("swatch_file"):
        tree["materials"][0]["extras"]["sha256"] = "0" * 64  # not the library's
    _set(tree, path, value)
    if message is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(tree)
        return
    with pytest.raises(HapsceneError, match=message):
        read(tree)


def test_a_small_file_cannot_ask_for_much(tree: dict, read: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.exchange.gltf_read.FACE_MAX", 10_000)
    tree["meshes"][0]["primitives"] *= 2_000
    with pytest.raises(SceneError, match="more than 20,000 faces"):
        read(tree)


def test_a_foreign_file_cannot_ask_for_much(read: Callable) -> None:
    accessor = {"componentType": 5126, "count": 30_000_000, "type": "VEC3"}  # no data: all zero
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    tree = {"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "meshes": [mesh], "accessors": [accessor]}
    with pytest.raises(SceneError, match="cannot hold"):
        read(tree | {"scenes": [{"nodes": [0]}], "scene": 0})


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_damaged_files_are_refused_in_words(suffix: str, make_scene: Callable[[int], Scene], tmp_path: Path) -> None:
    file = export_scene(make_scene(0), tmp_path / f"small.{suffix}")[0]
    good = file.read_bytes()
    rng = np.random.default_rng(7)
    refused = 0
    for _ in range(60):
        bad = np.frombuffer(good, np.uint8).copy()
        bad[rng.integers(0, len(bad), rng.integers(1, 30))] = rng.integers(0, 256)
        file.write_bytes(bad.tobytes()[: int(rng.integers(1, len(bad))) if rng.random() < 0.3 else None])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                import_scene(file)
            except HapsceneError:
                refused += 1
    assert refused > 20
