"""The search for the level of detail of a scene."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.cli import main
from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.errors import HapsceneError
from hapscene.fidelity import trial, tune
from hapscene.fidelity.coarser_mesh import coarser_mesh
from hapscene.fidelity.tune import Simplification, simplified
from hapscene.perception import BAND_DB, band_edges_Hz
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture

from .conftest import scene_of


def painted(kind="sphere"):
    scene = scene_of(kind)
    scene.paint("body", "leather", scene.bodies[0].mesh.triangles_m.mean(axis=1)[:, 0] > 0.01)
    return scene


def names(scene):
    return [swatch.name for swatch in scene.swatches]


def test_a_coarser_mesh_keeps_borders_and_is_closed():
    scene = painted()
    body = scene.bodies[0]
    mesh = coarser_mesh(body, 640, names(scene))
    assert len(mesh.faces) < 1000

    def border(faces, swatch, vertices):
        edges = [
            {
                tuple(sorted((tuple(a), tuple(b))))
                for tri in vertices[faces[swatch == s]]
                for a, b in zip(tri, np.roll(tri, 1, 0), strict=True)
            }
            for s in (1, 2)
        ]
        return edges[0] & edges[1]

    own = border(body.mesh.faces, body.face_swatch, body.mesh.vertices_m)
    assert own and own == border(mesh.faces, mesh.group, mesh.vertices_m)
    assert trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False).is_watertight
    at = simplified(scene, Simplification({"body": mesh}))
    assert np.array_equal(at.bodies[0].face_swatch, mesh.group)


def test_coplanar_faces_are_removed_without_a_difference():
    box = hapscene.Scene()
    made = trimesh.creation.box((0.08, 0.08, 0.04))
    for _ in range(5):
        made = made.subdivide()
    made.units = "m"
    box.add(made, name="body", swatch="wood")
    mesh = coarser_mesh(box.bodies[0], 200, names(box))
    assert len(mesh.faces) < 400
    paths = trial.scene_paths(box, 5, "omni")[:6]
    felt = [
        trial.render_paths(trial.new_renderer(scene, "omni", ("wall", "friction")), paths)
        for scene in (box, simplified(box, Simplification({"body": mesh})))
    ]
    assert np.percentile(trial.force_error(*felt), 99) < 1e-3


def test_band_power_of_a_sine():
    t_s = np.arange(8000) / 10_000.0
    power = trial.band_power(3.0 * np.sin(2 * np.pi * 250.0 * t_s), 10_000.0)
    band = np.searchsorted(band_edges_Hz(), 250.0) - 1
    assert power.shape == (7, 12)
    np.testing.assert_allclose(power[:, band], 4.5, rtol=0.01)
    assert np.delete(power, band, axis=1).max() < 0.02


@pytest.mark.parametrize(("width_m", "hover_m"), [(0.01, 0.2 * 0.0096), (0.4, 0.012)])
def test_paths_over_a_narrow_body_are_low_and_shallow(width_m, hover_m):
    """96 % of a body is explored, by a tap and a stroke; each is as deep as its force demands, but at most 5 % of the
    narrow side."""
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((0.5, width_m, 0.02)), name="body", unit="m", swatch=Swatch("soft", 200.0))
    paths = trial.random_paths(scene, 0, np.random.default_rng(0), trial.device_limits("omni"), 5)
    assert len(paths) == 5
    depths_m = []
    for path in paths:
        assert path[:, 2].max() - 0.01 == pytest.approx(hover_m)
        assert (np.abs(path[:, :2]) <= (0.25, width_m / 2)).all()
        under = np.flatnonzero(path[:, 2] < 0.01)
        tap, stroke = (path[part] for part in np.split(under, np.flatnonzero(np.diff(under) > 1) + 1))
        assert np.ptp(tap[:, :2], axis=0).max() < 1e-9 < np.ptp(stroke[:, :2], axis=0).max()
        depths_m += [0.01 - tap[:, 2].min(), 0.01 - stroke[:, 2].min()]
    if width_m < 0.1:
        np.testing.assert_allclose(depths_m, 0.05 * 0.0096)
    else:
        assert 0.2 <= 200.0 * min(depths_m) < 0.5 < 200.0 * max(depths_m) <= 0.5 * 3.3


def test_errors_in_jnd():
    scene = scene_of("sphere")
    renderer = trial.new_renderer(scene, "omni")
    paths = trial.scene_paths(scene, 3, "omni")[:2]
    felt = trial.render(renderer, paths, 0, 2)
    true = trial.Rendered(felt.recordings, [1e6 * p + 1.0 for p in felt.power])  # all over its threshold
    louder = trial.Rendered(
        [replace(r, f_W_N=1.14 * r.f_W_N) for r in true.recordings], [p * 10 ** (0.3 * BAND_DB) for p in true.power]
    )
    found = trial.error_of(true, louder)
    strong = np.concatenate([np.linalg.norm(r.f_W_N, axis=1)[r.touching] for r in true.recordings]) > 0.5
    np.testing.assert_allclose(found.force_jnd[strong], 2.0, rtol=1e-6)
    assert found.vibration_jnd == pytest.approx(3.0)
    assert trial.error_of(true, true).total_jnd.max() == 0.0


def test_the_lowest_order_within_the_limit():
    a = ar_from_reflection(0.6 * 0.93 ** np.arange(30) * np.cos(2.1 * np.arange(30)))
    rough = Texture.from_models(1e4, [1.0], [0.1], a=a[None], variance_m2_s4=[100.0 / power_gain(a)])
    swatch = Swatch("rough", texture=rough)
    found = {most: tune.evaluate_swatch(swatch, "omni", most) for most in (0.3, 0.8)}
    orders = {most: judged.least(most) for most, judged in found.items()}
    assert orders[0.8] < orders[0.3] < 30
    assert dict(found[0.8].tried)[orders[0.8] - 1] > 0.8
    assert tune.evaluate_swatch(Swatch("plain"), "omni", 1.0).least(1.0) is None


def test_a_choice_that_fails_is_repeated_with_a_smaller_margin(monkeypatch):
    """Twice on the paths of the verification, and once because the test paths differ, which then join it."""
    limits, drawn, failed = [], [], iter([["a"], ["a"], [], []])
    monkeypatch.setattr(tune, "_planned", lambda scene, judged, most_jnd: limits.append(dict(most_jnd)) or len(limits))
    monkeypatch.setattr(tune, "_failed", lambda *arguments: next(failed))
    comparison = SimpleNamespace(
        scene=None,
        drawn=lambda k: drawn.append(k) or k,
        error=lambda sets, plan: SimpleNamespace(total_jnd=np.array([3.0 if sets == [2] else 2.0])),
    )
    plan, unseen, _ = tune._choose(comparison, {"a": None, "b": None}, 2.0, lambda text: None)
    assert (plan, unseen, drawn) == (4, 3, [1, 2, 3])
    margins = [*tune.MARGINS[:3], tune.MARGINS[2]]
    assert limits == [{"a": 2.0 * margin, "b": 2.0 * tune.MARGINS[0]} for margin in margins]


def few_paths(patch):
    patch.setattr(trial, "SCENE_PATHS", 6)
    patch.setattr(trial, "SEED_COUNT", 4)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """A scene that was tuned on a few short paths, and the exit code."""
    with pytest.MonkeyPatch.context() as patch:
        few_paths(patch)
        folder = tmp_path_factory.mktemp("tuned")
        scene = hapscene.Scene()
        ball = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
        ball.units = "m"
        scene.add(ball, name="body", swatch="wood")
        scene.save(folder / "x.scene.json")
        code = main(["tune", str(folder / "x.scene.json"), "-o", str(folder / "y.scene.json")])
    return scene, hapscene.load_scene(folder / "y.scene.json"), code


def test_a_tuned_scene_is_within_the_limit_on_other_paths(tuned):
    scene, simple, code = tuned
    assert code == 0
    assert len(simple.bodies[0].mesh.faces) < 0.5 * len(scene.bodies[0].mesh.faces)
    paths = trial.scene_paths(scene, 99, "omni")
    felt = [trial.render_paths(trial.new_renderer(s, "omni", ("wall", "friction")), paths) for s in (scene, simple)]
    assert np.percentile(trial.force_error(*felt), 95) <= 1.0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--device", "omny"], "no device 'omny'; there are: ideal, omni"),
        (["-o", "x.json"], "must end in .scene.json"),
        (["-o", "x.scene.json"], "is the scene itself"),
        (["--jnd", "0"], "--jnd"),
    ],
)
def test_invalid_options(tmp_path, monkeypatch, capsys, words, expected):
    monkeypatch.chdir(tmp_path)
    scene_of("sphere").save("x.scene.json")
    assert main(["tune", "x.scene.json", *words]) == 2
    assert expected in capsys.readouterr().err


def test_a_scene_without_contact():
    scene = hapscene.Scene()
    mesh = scene_of("sphere").bodies[0].mesh
    with pytest.warns(hapscene.scene.mesh.MeshWarning):
        scene.add(replace(mesh, faces=mesh.faces[:, ::-1]), name="inside out", swatch="wood")
    with pytest.raises(HapsceneError, match="cannot touch"):
        tune.tune(scene)
