"""Scene files: roundtrips, changed meshes, untrusted files, sidecar files."""

import base64
import json
import re
import shutil
import zlib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.creation import icosphere

import hapscene
from hapscene.errors import HapsceneError, SceneError
from hapscene.io.files import write_whole
from hapscene.scene.mesh import MeshWarning
from hapscene.scene.scene_file import RUN_MAX, decode_paint, encode_paint, is_own
from hapscene.surface.swatch import Swatch

BALL = trimesh.creation.icosphere(subdivisions=2, radius=30)
OAK = Swatch("oak tree/2", stiffness_N_m=400)


def build(folder) -> hapscene.Scene:
    """Two instances of a mesh file, a mesh without a file, a swatch file, and a swatch without a file."""
    (folder / "meshes").mkdir()
    BALL.export(folder / "meshes" / "ball.stl")
    hapscene.save_swatch(Swatch("slate"), folder / "slate.swatch")
    scene = hapscene.Scene()
    scene.add(folder / "meshes" / "ball.stl", unit="mm", swatch=folder / "slate.swatch")
    pose = trimesh.transformations.rotation_matrix(0.1, (1, 2, 3), (4, 5, 6))
    scene.add(folder / "meshes" / "ball.stl", name="zweite Kugel", unit="mm", pose=pose, two_sided=True)
    scene.add(trimesh.creation.box((0.1, 0.2, 0.3)), name='a [ 1 ] "box"', unit="ft")
    rng = np.random.default_rng(0)
    scene.paint("ball", OAK, rng.random(320) < 0.4)
    scene.paint("zweite Kugel", "plain", [1, 2])
    return scene


def same(a: hapscene.Scene, b: hapscene.Scene) -> None:
    assert [s.name for s in a.swatches] == [s.name for s in b.swatches]
    assert len(a.bodies) == len(b.bodies)
    for x, y in zip(a.bodies, b.bodies, strict=True):
        assert (x.name, x.two_sided, x.mesh.digest) == (y.name, y.two_sided, y.mesh.digest)
        assert x.mesh.group_names == y.mesh.group_names
        np.testing.assert_array_equal(x.X_WB, y.X_WB)
        np.testing.assert_array_equal(x.face_swatch, y.face_swatch)


def test_roundtrip_is_exact(tmp_path):
    scene = build(tmp_path)
    scene.save(tmp_path / "my.scene.json")
    back = hapscene.load_scene(tmp_path / "my.scene.json")
    same(scene, back)
    assert back.bodies[0].mesh is back.bodies[1].mesh
    back.save(str(tmp_path / "again.scene.json"))
    same(scene, hapscene.load_scene(tmp_path / "again.scene.json"))
    first, again = ((tmp_path / f"{n}.scene.json").read_text() for n in ("my", "again"))
    assert first == again


def test_file_is_readable_and_has_relative_paths(tmp_path):
    (tmp_path / "old").mkdir()
    build(tmp_path / "old").save(tmp_path / "old" / "my.scene.json")
    text = (tmp_path / "old" / "my.scene.json").read_text()
    content = json.loads(text)
    assert str(tmp_path) not in text and content["meshes"][0]["path"] == "meshes/ball.stl"
    assert content["swatches"][:2] == ["plain", "slate.swatch"]
    assert re.fullmatch(r"my\.oak_tree_2\.[0-9a-f]{8}\.swatch", content["swatches"][2])
    assert "[1.0, 0.0, 0.0, 0.0]" in text and sum(run[1] for run in content["bodies"][0]["paint"]) == 320
    (tmp_path / "old").rename(tmp_path / "new")
    assert len(hapscene.load_scene(tmp_path / "new" / "my.scene.json").bodies) == 3


def test_sidecar_meshes_have_unique_names(tmp_path):
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((1, 1, 1)), name="a b", unit="m")
    scene.add(trimesh.creation.box((2, 2, 2)), name="a_b", unit="m")
    scene.save(tmp_path / "s.scene.json")
    back = hapscene.load_scene(tmp_path / "s.scene.json")
    assert [round(body.mesh.bounds_m[1, 0], 3) for body in back.bodies] == [0.5, 1.0]
    back.add(trimesh.creation.box((3, 3, 3)), name="a?b", unit="m")
    back.save(tmp_path / "s.scene.json")
    same(back, hapscene.load_scene(tmp_path / "s.scene.json"))


def test_changed_mesh_raises_unless_accepted(tmp_path):
    build(tmp_path).save(tmp_path / "my.scene.json")
    moved = BALL.copy()
    moved.vertices[0] += 0.5
    moved.export(tmp_path / "meshes" / "ball.stl")
    with pytest.raises(SceneError, match="accept_changed"):
        hapscene.load_scene(tmp_path / "my.scene.json")
    with pytest.warns(MeshWarning):
        scene = hapscene.load_scene(tmp_path / "my.scene.json", accept_changed=True)
    scene.save(tmp_path / "my.scene.json")
    hapscene.load_scene(tmp_path / "my.scene.json")
    trimesh.creation.icosphere(subdivisions=1).export(tmp_path / "meshes" / "ball.stl")
    for accept in (False, True):
        with pytest.raises(SceneError):
            hapscene.load_scene(tmp_path / "my.scene.json", accept_changed=accept)


@pytest.mark.parametrize("name", ["my.json", "gone/my.scene.json"])
def test_invalid_path_raises(tmp_path, name):
    with pytest.raises(SceneError, match="my"):
        hapscene.Scene().save(tmp_path / name)


def edit(*keys_and_value):
    *keys, value = keys_and_value

    def change(content):
        for key in keys[:-1]:
            content = content[key]
        if value is KeyError:
            del content[keys[-1]]
        else:
            content[keys[-1]] = value

    return change


HOSTILE = [
    (edit("format", "other"), "format"),
    (edit("version", 4), "version"),
    (edit("swatches", 0, 7), "swatches[0]"),
    (edit("meshes", 0, []), "meshes[0]"),
    (edit("meshes", 0, "path", "gone.stl"), "gone.stl"),
    (edit("meshes", 0, "sha256", "00"), "ball.stl"),
    (edit("bodies", 0, "mesh", 2), "bodies[0]: 'mesh'"),
    (edit("bodies", 1, "name", "ball"), "'ball'"),
    (edit("bodies", 0, "parent", "ball"), "'ball'"),
    (edit("bodies", 0, "two_sided", 1), "bodies[0].two_sided"),
    (edit("bodies", 0, "pose", [[10**400, 0, 0, 0]] * 4), "pose"),
    (edit("bodies", 0, "paint", [[9, 320]]), "swatch index 9"),
    (edit("bodies", 0, "paint", "all"), "'paint'"),
    (edit("bodies", 0, "made_of", 9), "'made_of'"),
    (edit("bodies", [{}] * 10_001), "bodies"),
]


@pytest.mark.parametrize(("change", "field"), HOSTILE)
def test_invalid_field_is_named(tmp_path, change, field):
    build(tmp_path).save(tmp_path / "my.scene.json")
    content = json.loads((tmp_path / "my.scene.json").read_text())
    change(content)
    (tmp_path / "my.scene.json").write_text(json.dumps(content))
    with pytest.raises(HapsceneError) as error:
        hapscene.load_scene(tmp_path / "my.scene.json")
    assert field in str(error.value) and "\n" not in str(error.value) and len(str(error.value)) < 600


@pytest.mark.parametrize("content", [None, b"", b"[" * 100_000, b"\xff\xfe\x00", b"[]", b"7" * 5000])
def test_file_that_is_not_a_scene_raises(tmp_path, content):
    if content is not None:
        (tmp_path / "bad.scene.json").write_bytes(content)
    with pytest.raises(SceneError, match="bad"):
        hapscene.load_scene(tmp_path / "bad.scene.json")


# Sidecar files.


def make(stiffness_N_m: float = 300.0, edge_m: float = 0.1) -> hapscene.Scene:
    """A box and a swatch without files."""
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((edge_m, 0.1, 0.1)), name="box", unit="m", swatch=Swatch("slate", stiffness_N_m))
    return scene


def sidecars(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir() if file.suffix in (".ply", ".swatch")}


def stiffness(file: Path) -> float:
    return hapscene.load_scene(file).swatches[1].stiffness_N_m


def test_sidecar_files_are_reused_and_replaced(tmp_path: Path) -> None:
    file = tmp_path / "cup.scene.json"
    make().save(file)
    first = sidecars(tmp_path)
    assert len(first) == 2 and all(is_own(tmp_path / name) for name in first)
    made = {name: (tmp_path / name).stat().st_mtime_ns for name in first}
    make().save(file)
    assert {name: (tmp_path / name).stat().st_mtime_ns for name in sidecars(tmp_path)} == made
    make(100.0, 0.2).save(file)
    assert len(sidecars(tmp_path)) == 2 and not sidecars(tmp_path) & first  # unused files are removed
    assert stiffness(file) == 100.0


def test_failed_save_preserves_the_old_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "cup.scene.json"
    make().save(file)
    before = sidecars(tmp_path)

    def full(path: Path, content: bytes, error: type[Exception]) -> None:
        raise error(f"{path}: cannot be written: No space left on device")

    monkeypatch.setattr("hapscene.scene.scene_file.write_whole", full)  # the scene file is written last
    with pytest.raises(HapsceneError):
        make(7.0, 0.2).save(file)
    monkeypatch.setattr("hapscene.scene.scene_file.write_whole", write_whole)
    assert stiffness(file) == 300.0 and sidecars(tmp_path) == before


def test_other_files_are_not_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "cup.scene.json"
    foreign = {"cup.box.ply": b"a", "cup.slate.swatch": b"b", "cup.slate.0123abcd.swatch": b"c"}
    for name, content in foreign.items():
        (tmp_path / name).write_bytes(content)
    make().save(file)
    mine = sidecars(tmp_path) - set(foreign)
    for name in mine:
        (tmp_path / name).write_bytes(b"changed by hand")
    make().save(file)
    assert len(sidecars(tmp_path)) == len(foreign) + 4 and stiffness(file) == 300.0  # under longer names
    make(100.0, 0.2).save(file)
    kept = {name: (tmp_path / name).read_bytes() for name in (*foreign, *mine)}
    assert kept == foreign | dict.fromkeys(mine, b"changed by hand")


def test_copied_scene_file_keeps_its_sidecar_files(tmp_path: Path) -> None:
    file, copy = tmp_path / "cup.scene.json", tmp_path / "cup_before.scene.json"
    make().save(file)
    shutil.copyfile(file, copy)
    make(100.0).save(file)
    assert (stiffness(file), stiffness(copy)) == (100.0, 300.0)
    make(50.0).save(copy)
    assert (stiffness(file), stiffness(copy)) == (100.0, 50.0)


def test_only_sidecar_files_are_removed(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    names = ("cup.scan.ply", "cup.20240115.ply", "cup.abcdef01.ply", "mug.abcdef01.ply", "scans/cup.abcdef01.ply")
    for name in names:
        trimesh.creation.icosphere(1).export(tmp_path / name)
    content = {"swatches": ["plain"], "meshes": [{"path": name} for name in (*names, "../cup.abcdef01.ply")]}
    (tmp_path / "cup.scene.json").write_text(json.dumps(content))  # untrusted
    make().save(tmp_path / "cup.scene.json")
    assert all((tmp_path / name).is_file() for name in names)


# Encoding of paint.


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 300), st.integers(1, 40)), min_size=1, max_size=60), st.booleans())
def test_paint_roundtrip(runs: list[tuple[int, int]], packed: bool) -> None:
    paint = np.repeat([r[0] for r in runs], [r[1] for r in runs]).astype(np.int16)
    if packed:  # many short runs over the same swatches
        paint = np.resize(np.concatenate([paint, paint[::-1]]), 3 * RUN_MAX)
        paint[::2] = (paint[::2] + 1) % 301
    value = json.loads(json.dumps(encode_paint(paint)))
    np.testing.assert_array_equal(decode_paint(value, len(paint), 301), paint)


def packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content)).decode()


@pytest.mark.parametrize(
    "value",
    [
        packed(bytes(6)),
        packed(bytes(100_000_000)),  # 100 kB that unpack to 100 MB
        base64.b64encode(zlib.compress(bytes(8))[:-2]).decode(),
        packed(np.array([0, 1, -1, 2], "<i2").tobytes()),
        packed(np.array([0, 1, 3, 2], "<i2").tobytes()),
    ],
)
def test_invalid_paint_raises(value: object) -> None:
    with pytest.raises(ValueError):
        decode_paint(value, 4, 3)


def test_scene_with_packed_paint(tmp_path) -> None:
    scene = hapscene.Scene()
    icosphere(subdivisions=4).export(tmp_path / "ball.ply")
    scene.add(tmp_path / "ball.ply", unit="mm")
    for name in ("wood", "paper"):
        scene.paint("ball", name, np.random.default_rng(len(name)).random(5120) < 0.4)
    scene.save(tmp_path / "my.scene.json")
    content = json.loads((tmp_path / "my.scene.json").read_text())
    assert content["version"] == 2
    assert isinstance(content["bodies"][0]["paint"], str)
    back = hapscene.load_scene(tmp_path / "my.scene.json")
    np.testing.assert_array_equal(back.bodies[0].face_swatch, scene.bodies[0].face_swatch)
    scene.paint("ball", "plain")
    scene.save(tmp_path / "my.scene.json")
    assert json.loads((tmp_path / "my.scene.json").read_text())["version"] == 1  # older readers can read that
