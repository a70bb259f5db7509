"""Import of glTF files that other programs changed, and of invalid files."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.errors import HapsceneError, SceneError
from hapscene.exchange import export_scene, import_scene
from hapscene.exchange.gltf import Z_UP, glb_of
from hapscene.exchange.swatch_payload import ExchangeWarning
from hapscene.scene.body import Body
from hapscene.scene.gltf_check import parse_gltf
from hapscene.scene.scene import Scene

pytestmark = pytest.mark.filterwarnings("ignore::hapscene.exchange.swatch_payload.ExchangeWarning")


@pytest.fixture
def parsed(make_scene: Callable[[int], Scene], tmp_path: Path) -> tuple[dict[str, Any], bytes]:
    file = export_scene(make_scene(0), tmp_path / "small.glb", show="look")[0]
    return parse_gltf(file.read_bytes(), True, "small.glb")


@pytest.fixture
def tree(parsed: tuple[dict[str, Any], bytes]) -> dict[str, Any]:
    return parsed[0]


@pytest.fixture
def read(parsed: tuple[dict[str, Any], bytes], tmp_path: Path) -> Callable[[Any], Scene]:
    def read(tree: Any) -> Scene:
        file = tmp_path / "changed.glb"
        file.write_bytes(glb_of(tree, parsed[1], file))
        return import_scene(file)

    return read


def test_poses_are_relative_to_the_scene(tree: dict, read: Callable, scene: Scene) -> None:
    tree["nodes"].append({"children": [0], "translation": [5, 6, 7], "scale": [2, 2, 2]})
    tree["scenes"][0]["nodes"] = [len(tree["nodes"]) - 1]
    for was, now in zip(scene.bodies, read(tree).bodies, strict=True):
        assert np.array_equal(was.X_WB, now.X_WB)


def test_pose_as_translation_and_rotation(tree: dict, read: Callable, scene: Scene) -> None:
    from scipy.spatial.transform import Rotation

    for body in scene.bodies:
        node = next(n for n in tree["nodes"] if n.get("extras", {}).get("hapscene_body") == body.name)
        del node["matrix"]
        node["rotation"] = (Rotation.from_matrix(body.X_WB[:3, :3]).as_quat() * 3).tolist()  # of any length
        node["translation"] = body.X_WB[:3, 3].tolist()
    for was, now in zip(scene.bodies, read(tree).bodies, strict=True):
        np.testing.assert_allclose(now.X_WB, was.X_WB, rtol=0, atol=1e-15)


def _node(tree: dict, body: str) -> dict:
    return next(n for n in tree["nodes"] if n.get("extras", {}).get("hapscene_body") == body)


def _corners(body: Body) -> np.ndarray:
    """Corners of the faces in W (m, 3, 3) [m]."""
    return body.mesh.triangles_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3]


def test_nested_bodies(tree: dict, read: Callable, scene: Scene) -> None:
    nut, stone = _node(tree, "nut"), _node(tree, 'Stein "1" <&>')
    index = tree["nodes"].index(nut)
    tree["nodes"][0]["children"].remove(index)
    stone["children"].append(index)
    back = {body.name: body for body in read(tree).bodies}
    assert len(back) == 3 and len(back["nut"].mesh.faces) == 20
    X_WB = scene.bodies[0].X_WB @ scene.bodies[1].X_WB
    np.testing.assert_allclose(back["nut"].X_WB, X_WB, rtol=0, atol=1e-15)


@pytest.mark.parametrize("parent", ["W", "nothing"])
@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 2, -3)])
def test_added_object_becomes_a_body(
    scale: tuple[int, int, int], parent: str, tree: dict, read: Callable, scene: Scene
) -> None:
    mesh = tree["nodes"][_node(tree, "nut")["children"][1]]["mesh"]
    assert tree["materials"][tree["meshes"][mesh]["primitives"][0]["material"]]["name"] == "wood"
    X = scene.bodies[0].X_WB @ np.diag([*scale, 1])
    below = tree["nodes"][0]["children"] if parent == "W" else tree["scenes"][0]["nodes"]
    X_node = X if parent == "W" else np.reshape(Z_UP, (4, 4)).T @ X
    for _ in range(2):
        below.append(len(tree["nodes"]))
        tree["nodes"].append({"name": "added\n", "mesh": mesh, "matrix": X_node.T.ravel().tolist()})
    back = read(tree)
    assert [body.name for body in back.bodies][-2:] == ["added", "added_2"] and len(back.bodies) == 5
    nut = next(body for body in back.bodies if body.name == "nut")
    wood = nut.mesh.triangles_m[nut.face_swatch == back.swatch_source.index("wood")]
    for added in back.bodies[-2:]:
        seen = _corners(added)
        seen = seen[:, ::-1] if scale[2] < 0 else seen  # reflected faces are reversed
        np.testing.assert_allclose(seen, wood @ X[:3, :3].T + X[:3, 3], rtol=0, atol=1e-15)
        assert {back.swatches[i].name for i in added.face_swatch} == {"wood"}


def test_material_without_extras_is_found_by_name(tree: dict, read: Callable) -> None:
    wood = next(m for m in tree["materials"] if m["name"].endswith("wood"))
    del wood["extras"]["sha256"]
    assert "wood" in read(copy.deepcopy(tree)).swatch_source
    del wood["extras"]
    back = read(copy.deepcopy(tree))
    assert "wood" in back.swatch_source
    for material in tree["materials"]:
        if material["name"] == "wood":
            material |= {"name": "Material.001", "extras": {}}
    with pytest.warns(ExchangeWarning, match="Material"):
        assert "wood" not in [s.name for s in read(tree).swatches]


def _set(tree: dict, path: str, value: Any) -> None:
    *way, last = path.split(".")
    for step in way:
        tree = tree[int(step)] if step.isdigit() else tree[step]  # type: ignore[index, assignment]
    tree[int(last) if last.isdigit() else last] = value  # type: ignore[index]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("nodes.0.children", [0]),
        ("nodes.0.extras", {"hapscene_version": 2}),
        ("nodes.1.translation", [1, 2, 3]),
        ("nodes.4.extras.hapscene_body", 5),
        ("nodes.4.extras.two_sided", 3),
        ("nodes.4.children", []),
        *(("nodes.4.matrix", bad) for bad in (5, [1] * 15, ["1"] * 16, [1e100] * 16, [-1e100] * 16)),
        *(("nodes.0.children", [bad]) for bad in ("1", True, 99, -1)),
        ("nodes.1", 5),
        ("nodes", {"0": {}}),
        ("bufferViews.0.extensions", {"EXT_meshopt_compression": {}}),
        ("meshes.0.primitives.0.extensions", {"KHR_draco_mesh_compression": {}}),
        ("meshes.0.primitives.0.material", -5),
        ("meshes.0.primitives.0.material", True),
        ("meshes.0.primitives.0.mode", 1),
        ("meshes.0.primitives.0", 5),
        ("accessors.0.sparse", {}),
        ("accessors.0.count", 10**12),
        ("accessors.0.count", 3),
        ("accessors.0.componentType", 5125),
        ("bufferViews.0.byteOffset", 1 << 39),
        ("materials.0.extras.swatch_file", "{}"),
    ],
)
def test_invalid_tree_raises(path: str, value: Any, tree: dict, read: Callable) -> None:
    if path.endswith("swatch_file"):
        tree["materials"][0]["extras"]["sha256"] = "0" * 64  # not the library's
    _set(tree, path, value)
    with pytest.raises(HapsceneError, match="changed"):
        read(tree)


def test_number_of_faces_is_limited(tree: dict, read: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.exchange.gltf_read.FACE_MAX", 30)  # a body has 20
    with pytest.raises(SceneError, match="30 faces"):
        read(tree)


@pytest.mark.parametrize("matrix", [[0.0] * 15 + [1.0], [1e99] * 15 + [1.0]])
def test_singular_world_raises(matrix: list[float], tree: dict, read: Callable) -> None:
    tree["nodes"][0]["matrix"] = matrix
    tree["scenes"][0]["nodes"].append(len(tree["nodes"]))
    tree["nodes"].append({"mesh": 0})
    with pytest.raises(SceneError):
        read(tree)


def test_faces_without_a_material_are_plain(tree: dict, read: Callable) -> None:
    primitive = tree["meshes"][tree["nodes"][_node(tree, "nut")["children"][1]]["mesh"]]["primitives"][0]
    assert tree["materials"][primitive.pop("material")]["name"] == "wood"
    primitive["extensions"] = {"OTHER_compression": {}}
    nut = next(body for body in read(tree).bodies if body.name == "nut")
    assert {*nut.face_swatch.tolist()} == {0, 2} and len(nut.mesh.faces) == 20
