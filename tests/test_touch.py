"""The main job, from a scene and a path to the files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.io import wavfile

from hapscene.errors import SceneError, ViewError
from hapscene.flags import Flag
from hapscene.render.recording import Recording
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.touch import (
    MADE,
    MADE_BY_HAND,
    cautions,
    is_model,
    open_scene,
    summarise,
    touch,
    touch_by_hand,
    why_nothing,
)


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.1, 0.1, 0.02)), "m"), name="plate")
    scene.paint("plate", Swatch("card", stiffness_N_m=800.0, friction_static=0.4, friction_dynamic=0.3))
    return scene


@pytest.fixture(scope="module")
def p_WT() -> np.ndarray:
    """Down onto the plate's top at z = 0.01, 1 mm deep, along x, and up again."""
    t = np.linspace(0.0, 1.0, 400)
    z_m = 0.01 + np.interp(t, (0, 0.3, 0.7, 1), (0.005, -0.001, -0.001, 0.005))
    return np.column_stack((0.02 * t, 0.0 * t, z_m))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """No GL: what the job does then, and quick."""

    def write_picture(*arguments: object, **more: object) -> None:
        raise ViewError("no picture, since no GL: osmesa (none) needs libosmesa6")

    monkeypatch.setattr("hapscene.view.picture.write_picture", write_picture)


def test_job_makes_every_file_and_they_agree(tmp_path: Path, scene: Scene, p_WT: np.ndarray) -> None:
    said: list[str] = []
    t_s = 7.0 + np.arange(len(p_WT)) * 1e-3
    made = touch(scene, tmp_path / "out", p_WT, t_s=t_s, seed=3, title="plate", say=said.append)
    if "scene.png" not in (file.name for file in made):
        assert "without scene.png: no GL" in "".join(said)
    assert [file.name for file in made if file.name != "scene.png"] == [n for n in MADE if n != "scene.png"]
    assert {file.name for file in (tmp_path / "out").iterdir()} == {file.name for file in made}
    recording = Recording.load(tmp_path / "out" / "touch.npz")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert np.array_equal(recording.p_WT_m, p_WT) and np.array_equal(recording.t_s, t_s)
    assert summary["ticks"] == 400 and summary["seed"] == 3
    assert summary["ticks_in_contact"] == np.count_nonzero(recording.touching) > 150
    assert summary["ticks_on_swatches"] == {"plain": 0, "card": summary["ticks_in_contact"]}
    times_us = summary["time_per_tick_us"]
    assert 0 < times_us["contact"]["median"] <= times_us["whole"]["median"] <= times_us["whole"]["max"]
    assert set(summary["flags"].values()) == {0}
    assert (summary["depth_max_m"], summary["force_max_N"]) == pytest.approx((1e-3, np.hypot(0.8, 0.3 * 0.8)), rel=0.03)
    assert recording.normal_force_N.max() == pytest.approx(0.8, rel=1e-3)
    assert len((tmp_path / "out" / "touch.csv").read_text(encoding="utf-8").splitlines()) == 401
    assert len(wavfile.read(tmp_path / "out" / "feel.wav")[1]) == 4000


def test_job_goes_on_without_gl(tmp_path: Path, scene: Scene, p_WT: np.ndarray, undrawn: None) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "scene.png").write_text("of an earlier run")
    (tmp_path / "out" / "notes.txt").write_text("not ours")
    said: list[str] = []
    made = touch(scene, tmp_path / "out", p_WT, say=said.append)
    assert [file.name for file in made] == [name for name in MADE if name != "scene.png"]
    lines = [line for line in "".join(said).splitlines() if "without" in line]
    assert said[0] == "preparing 1 body of 12 faces … " and said[2] == "rendering 0.4 s of path … "
    assert [text[-1] for text in said].count("\n") == 7 == sum(text.endswith("… ") for text in said) + 2
    assert len(lines) == 1 and "libosmesa6" in lines[0]
    assert {file.name for file in (tmp_path / "out").iterdir()} == {*MADE, "notes.txt"} - {"scene.png"}
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert "libosmesa6" in summary["missing"]["scene.png"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("writer", ["hapscene.render.recording.Recording.save_csv", "hapscene.view.plot.draw_plot"])
def test_job_that_fails_midway_leaves_what_was_there(
    tmp_path: Path,
    scene: Scene,
    p_WT: np.ndarray,
    undrawn: None,
    monkeypatch: pytest.MonkeyPatch,
    writer: str,
    error: BaseException,
) -> None:
    def fail(*arguments: object, **more: object) -> None:
        raise error

    monkeypatch.setattr(writer, fail)
    old = tmp_path / "old"
    old.mkdir()
    (old / "touch.npz").write_text("of an earlier run")
    for out in (tmp_path / "new", old):
        with pytest.raises(type(error)):
            touch(scene, out, p_WT)
    assert [file.name for file in tmp_path.iterdir()] == ["old"]
    assert [(file.name, file.read_text()) for file in old.iterdir()] == [("touch.npz", "of an earlier run")]


def test_summary_counts_flags_by_name(scene: Scene, p_WT: np.ndarray) -> None:
    recording = Renderer(scene).run(p_WT)
    flags = np.zeros(len(p_WT), np.uint32)
    flags[:5] = Flag.FORCE_LIMITED | Flag.UNSETTLED
    flags[5] = Flag.UNSETTLED
    a_m_s2 = np.zeros_like(recording.a_m_s2)
    a_m_s2[3, :2] = -2.0, 1.0
    summary = summarise(replace(recording, flags=flags, a_m_s2=a_m_s2), "")
    counted = summary["flags"]
    assert summary["acceleration_max_m_s2"] == 2.0
    assert counted["FORCE_LIMITED"] == 5 and counted["UNSETTLED"] == 6 and counted["EFFECT_MUTED"] == 0


def test_scene_file_and_mesh_open_alike(tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene.save(tmp_path / "plate.scene.json")
    assert [body.name for body in open_scene(tmp_path / "plate.scene.json").bodies] == ["plate"]
    with pytest.raises(SceneError, match="--unit"):
        open_scene(tmp_path / "plate.scene.json", unit="mm")
    trimesh.creation.box((20, 20, 20)).export(tmp_path / "cube.stl")
    opened = open_scene(tmp_path / "cube.stl", unit="mm", two_sided=True)
    assert opened.bodies[0].mesh.diagonal_m == pytest.approx(0.02 * np.sqrt(3))
    assert opened.bodies[0].two_sided
    monkeypatch.setattr("hapscene.exchange.painted_scene", lambda *given, **how: pytest.fail("the paint of the file"))
    assert "wood" in [swatch.name for swatch in open_scene(tmp_path / "cube.stl", "mm", "wood").swatches]


def bowl(two_sided: bool = False) -> Scene:
    """A ball wound inward, but for one face, which is not there."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.01)
    scene = Scene()
    scene.add(Mesh(np.array(ball.vertices), np.array(ball.faces)[1:, ::-1]), name="bowl", two_sided=two_sided)
    return scene


def line(start_m: tuple[float, float, float], end_m: tuple[float, float, float]) -> np.ndarray:
    return np.linspace(start_m, end_m, 300)


def test_path_without_contact_reports_the_reason(tmp_path: Path, scene: Scene) -> None:
    said: list[str] = []
    touch(scene, tmp_path / "out", line((0.0, 0.0, 0.06), (0.0, 0.0, 0.03)), with_picture=False, say=said.append)
    lines = [text for text in said if text.startswith("nothing was touched")]
    assert len(lines) == 1 and "20 mm" in lines[0] and "'plate'" in lines[0] and "142.8 mm" in lines[0]


def test_path_through_back_faces_reports_it() -> None:
    into = line((0.001, 0.002, 0.02), (0.001, 0.002, 0.001))
    assert "crosses 'bowl' from behind its faces" in why_nothing(bowl(), into)
    both_sides = why_nothing(bowl(two_sided=True), line((0.0, 0.0, 0.001), (0.0, 0.0, 0.002)))
    assert "misses all faces of the nearest body 'bowl'" in both_sides


def test_distance_of_a_path_is_to_the_box_of_the_nearest_body_at_its_pose() -> None:
    bar = Mesh.from_trimesh(trimesh.creation.box((0.1, 0.02, 0.04)), "m")
    turned = np.array([[0.0, 0, 1, 0.3], [1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 0, 1]])
    scene = Scene()
    for name, aside_m in (("far", -0.5), ("bar", 0.0), ("farther", -0.7)):
        X_WB = turned.copy()
        X_WB[0, 3] += aside_m
        scene.add(bar, name=name, pose=X_WB)
    for side in ((1, 1, 1), (-1, -1, -1)):
        at = turned[:3, 3] + np.array(side) * (0.05, 0.09, 0.13)  # 3, 4 and 12 cm off the bar, which lies along y
        reason = why_nothing(scene, np.linspace(at, at + np.array(side) * (0.1, 0.0, 0.0), 50))
        assert "stays 130 mm away" in reason and "'bar' of size 109.5 mm" in reason


def test_closed_loop_without_contact_reports_the_reason(tmp_path: Path) -> None:
    from hapscene.device.sim.point import PointMass
    from hapscene.loop import ReferenceTrajectory, Twin

    said: list[str] = []
    into = line((0.001, 0.002, 0.02), (0.001, 0.002, 0.001))
    made_of = bowl()

    def ready() -> Twin:
        return Twin(made_of, PointMass(0.045, 0.1, 0.26, 5.5e-5))

    made = touch_by_hand(
        made_of, tmp_path / "out", ReferenceTrajectory.along(into, "light"), ready, with_picture=False, say=said.append
    )
    assert "nothing was touched: the path crosses 'bowl'" in "".join(said)
    assert [file.name for file in made] == [name for name in MADE_BY_HAND if name != "scene.png"]


def test_silent_recording_suggests_a_textured_swatch(scene: Scene, p_WT: np.ndarray) -> None:
    recording = Renderer(scene).run(p_WT)
    (text,) = cautions(scene, recording)
    assert "silent" in text and "card" in text and "--swatch" in text
    textured = Scene()
    textured.add(Mesh.from_trimesh(trimesh.creation.box((0.1, 0.1, 0.02)), "m"), name="plate", swatch="wood")
    assert cautions(textured, Renderer(textured).run(p_WT)) == []
    (text,) = cautions(textured, Renderer(textured, ["wall"]).run(p_WT))
    assert "silent" in text and "lpc_texture" in text


@pytest.mark.parametrize(("share", "count"), [(0.04, 0), (0.06, 1)])
def test_long_force_limitation_is_reported(scene: Scene, p_WT: np.ndarray, share: float, count: int) -> None:
    recording = Renderer(scene).run(p_WT)
    recording = replace(recording, a_m_s2=np.ones_like(recording.a_m_s2))
    touching = np.flatnonzero(recording.touching)
    recording.flags[touching[: round(share * len(touching))]] |= np.uint32(Flag.FORCE_LIMITED)
    recording.flags[~recording.touching] |= np.uint32(Flag.FORCE_LIMITED)  # flags in the air do not count
    reported = cautions(scene, recording)
    assert len(reported) == count
    assert all(f"of {len(touching)} ticks in contact" in text for text in reported)


def test_caution_is_one_line_on_standard_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from hapscene.cli import main

    trimesh.creation.box((20, 20, 20)).export(tmp_path / "cube.stl")
    monkeypatch.chdir(tmp_path)
    assert main(["touch", "cube.stl", "--unit", "mm", "--no-picture"]) == 0
    reported = capsys.readouterr()
    assert reported.err.startswith("hapscene: warning: feel.wav is silent") and reported.err.count("\n") == 1
    assert "silent" not in reported.out


def test_models_of_mujoco_are_known_by_their_suffix() -> None:
    assert is_model("arm.XML") and is_model(Path("arm.urdf")) and not is_model("xml.stl")
