"""Detection of exported scenes by commands that open meshes."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.cli import main
from hapscene.errors import SceneError
from hapscene.exchange import export_scene, import_scene, painted_scene
from hapscene.exchange.swatch_payload import ExchangeWarning
from hapscene.render.recording import Recording
from hapscene.scene.scene import Scene, load_scene
from hapscene.touch import open_scene


def face_counts(scene: Scene) -> dict[str, dict[str, int]]:
    """Number of faces for each body and swatch."""
    names = [swatch.name for swatch in scene.swatches]
    return {b.name: {names[i]: int((b.face_swatch == i).sum()) for i in np.unique(b.face_swatch)} for b in scene.bodies}


@pytest.mark.parametrize("suffix", ["glb", "GLB"])
def test_exported_file_is_opened_as_a_scene(scene: Scene, tmp_path: Path, suffix: str) -> None:
    file = export_scene(scene, tmp_path / f"desk.{suffix}")[0]
    opened = open_scene(file)
    assert face_counts(opened) == face_counts(scene)
    for was, now in zip(scene.bodies, opened.bodies, strict=True):
        np.testing.assert_allclose(now.X_WB, was.X_WB, rtol=0, atol=1e-12)
        np.testing.assert_allclose(now.mesh.bounds_m, was.mesh.bounds_m, rtol=0, atol=1e-7)  # in metres, as it was


def test_other_unit_raises(scene: Scene, tmp_path: Path) -> None:
    file = export_scene(scene, tmp_path / "desk.glb")[0]
    for read in (open_scene, import_scene):
        with pytest.raises(SceneError, match="mm"):
            read(file, "mm")
        assert len(read(file, "metres").bodies) == len(scene.bodies)
        for other in ({"up": "z"}, {"scale": 2.0}):
            with pytest.raises(SceneError, match="omit --up and --scale"):
                read(file, **other)


def foreign(folder: Path) -> Path:
    """A box of another program, with a material that has the name of a swatch."""
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(name="wood"))
    box.export(folder / "box.glb")
    for name, content in trimesh.Scene(box).export(file_type="gltf").items():
        (folder / ("box.gltf" if name == "model.gltf" else name)).write_bytes(content)
    return folder / "box.gltf"


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_file_of_another_program_is_a_mesh(tmp_path: Path, suffix: str) -> None:
    file = foreign(tmp_path).with_suffix(f".{suffix}")
    assert painted_scene(file) is None
    with warnings.catch_warnings():
        warnings.simplefilter("error", ExchangeWarning)
        opened = open_scene(file)
    assert face_counts(opened) == {"box": {"plain": 12}}
    assert opened.bodies[0].mesh.diagonal_m == pytest.approx(np.linalg.norm((0.1, 0.2, 0.3)))
    assert face_counts(import_scene(file)) == {"box": {"wood": 12}}  # importing uses material names


def test_commands_open_scenes(
    make_scene: Callable[[int], Scene], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hapscene.paint.opening import open_session

    monkeypatch.chdir(tmp_path)
    scene = make_scene(0)
    export_scene(scene, "desk.glb")
    assert main(["touch", "desk.glb", "--out", "out", "--no-picture"]) == 0
    recording = Recording.load(tmp_path / "out" / "touch.npz")
    assert set(recording.body_names) == {body.name for body in scene.bodies}
    assert {"wood", *recording.swatch_names} == {swatch.name for swatch in scene.swatches}
    session = open_session("desk.glb")
    session.save()
    assert face_counts(load_scene(tmp_path / "desk.scene.json")) == face_counts(scene)
