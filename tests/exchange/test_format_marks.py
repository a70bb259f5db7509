"""Which files are opened as the painted scenes that they hold, by every command that opens a mesh."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.cli import main
from hapscene.errors import HapsceneError, SceneError
from hapscene.exchange import export_scene, import_scene, painted_scene
from hapscene.exchange.swatch_payload import ExchangeWarning
from hapscene.render.recording import Recording
from hapscene.scene.scene import Scene, load_scene
from hapscene.touch import open_scene


def worn(scene: Scene) -> dict[str, dict[str, int]]:
    """How many faces of each body wear each swatch."""
    names = [swatch.name for swatch in scene.swatches]
    return {b.name: {names[i]: int((b.face_swatch == i).sum()) for i in np.unique(b.face_swatch)} for b in scene.bodies}


@pytest.mark.filterwarnings("ignore:.*comes with its numbers alone")
@pytest.mark.parametrize("suffix", ["glb", "gltf", "ply", "GLB"])
def test_a_file_of_ours_is_opened_as_the_scene_it_holds(scene: Scene, tmp_path: Path, suffix: str) -> None:
    file = export_scene(scene, tmp_path / f"desk.{suffix}")[0]
    with pytest.warns(ExchangeWarning, match=f"desk.{suffix}"):
        opened = open_scene(file)
    assert worn(opened) == worn(scene)
    for was, now in zip(scene.bodies, opened.bodies, strict=True):
        np.testing.assert_allclose(now.X_WB, was.X_WB, rtol=0, atol=1e-12)
        np.testing.assert_allclose(now.mesh.bounds_m, was.mesh.bounds_m, rtol=0, atol=1e-7)  # in metres, as it was


@pytest.mark.parametrize("suffix", ["glb", "ply"])
def test_its_unit_is_known(scene: Scene, tmp_path: Path, suffix: str) -> None:
    file = export_scene(scene, tmp_path / f"desk.{suffix}")[0]
    with pytest.raises(SceneError, match="mm"):
        open_scene(file, "mm")
    with pytest.warns(ExchangeWarning):
        assert len(open_scene(file, "metres").bodies) == len(scene.bodies)


def test_a_swatch_for_all_of_it_wins_over_what_it_holds(scene: Scene, tmp_path: Path) -> None:
    file = export_scene(scene, tmp_path / "desk.glb")[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error", ExchangeWarning)
        opened = open_scene(file, swatch="leather")
    (body,) = opened.bodies
    assert {opened.swatches[i].name for i in body.face_swatch} == {"leather"}
    assert len(body.mesh.faces) == sum(len(b.mesh.faces) for b in scene.bodies)


def foreign(folder: Path) -> Path:
    """A box in millimetres of another program, whose material is called as a swatch."""
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(name="wood"))
    box.export(folder / "box.glb")
    for name, content in trimesh.Scene(box).export(file_type="gltf").items():
        (folder / ("box.gltf" if name == "model.gltf" else name)).write_bytes(content)
    return folder / "box.gltf"


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_a_foreign_file_stays_a_mesh(tmp_path: Path, suffix: str) -> None:
    file = foreign(tmp_path).with_suffix(f".{suffix}")
    assert painted_scene(file) is None
    with warnings.catch_warnings():
        warnings.simplefilter("error", ExchangeWarning)
        opened = open_scene(file)
    assert worn(opened) == {"box": {"plain": 12}}
    assert opened.bodies[0].mesh.diagonal_m == pytest.approx(np.linalg.norm((0.1, 0.2, 0.3)))
    assert worn(import_scene(file)) == {"box": {"wood": 12}}  # which import is asked to do


@pytest.mark.parametrize("name", ["none.glb", "empty.glb", "none.stl"])
def test_files_that_cannot_be_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty.glb").touch()
    with pytest.raises(HapsceneError, match=name):
        open_scene(tmp_path / name, "mm")


def test_commands_open_it_and_say_what_is_lost(
    make_scene: Callable[[int], Scene], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    from hapscene.paint.opening import open_session

    monkeypatch.chdir(tmp_path)
    scene = make_scene(0)
    export_scene(scene, "desk.glb")
    assert main(["touch", "desk.glb", "--out", "out", "--no-picture"]) == 0
    told = capsys.readouterr().err
    assert told.count("desk.glb") == 1
    felt = Recording.load(tmp_path / "out" / "touch.npz")
    assert set(felt.body_names) == {body.name for body in scene.bodies}
    assert {"wood", *felt.swatch_names} == {swatch.name for swatch in scene.swatches}
    with pytest.warns(ExchangeWarning):
        session = open_session("desk.glb")
    session.save()
    assert worn(load_scene(tmp_path / "desk.scene.json")) == worn(scene)
