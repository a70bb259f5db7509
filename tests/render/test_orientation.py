"""The orientation of the tool, from the device through tick, effects, logs and recordings to the picture."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device import choose
from hapscene.errors import PathError, SceneError
from hapscene.loop import session_log
from hapscene.loop.result import LOOP_ROW
from hapscene.loop.session_log import NUMBERS_FILE, SessionLog
from hapscene.render.recording import Recording, RecordingError
from hapscene.view.figure_parts import TOOL, make_figure_parts
from hapscene.view.palette import LIGHT
from tests.virtual_servo import VirtualServo


def push_along(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Pull the hand along the handle with 1 N in contact."""
    if touch.touching:
        for i in range(3):
            out.f_W_N[i] += touch.R_WT[i, 2]


ALONG = hapscene.Effect("along", "A force along the handle.", push_along)


def turned(count: int) -> np.ndarray:
    """Rotations (count, 3, 3) from the identity on, each by a further 0.01 rad about a tilted axis."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(0.01 * np.arange(count)[:, None] * [0.6, 0.0, 0.8]).as_matrix()


@pytest.fixture
def scene() -> hapscene.Scene:
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((0.1, 0.1, 0.02)), name="plate", unit="m", swatch=hapscene.Swatch("stone"))
    return scene


def poses(count: int = 60) -> np.ndarray:
    X_WT = np.tile(np.eye(4), (count, 1, 1))
    X_WT[:, :3, :3], X_WT[:, 2, 3] = turned(count), np.linspace(0.011, 0.009, count)
    return X_WT


def test_effects_read_it(scene: hapscene.Scene) -> None:
    """A step with a pose and a path of poses give the same bits; an effect without orientation gives those of a path
    of positions."""
    X_WT = poses()
    recording = hapscene.Renderer(scene, [ALONG]).run(X_WT)
    touching = recording.touching
    assert 20 < np.count_nonzero(touching) < 40
    np.testing.assert_array_equal(recording.f_W_N[touching], X_WT[touching, :3, 2])
    renderer = hapscene.Renderer(scene, [ALONG])
    np.testing.assert_array_equal([renderer.step(X).f_W_N for X in X_WT], recording.f_W_N)
    by_pose = hapscene.Renderer(scene).run(X_WT)
    by_position = hapscene.Renderer(scene).run(X_WT[:, :3, 3])
    for name in ("f_W_N", "p_WP_m", "a_m_s2"):
        np.testing.assert_array_equal(getattr(by_pose, name), getattr(by_position, name))
    assert by_position.R_WT is None


def test_it_lasts_and_is_the_identity_without_a_device_that_measures_it(scene: hapscene.Scene) -> None:
    renderer = hapscene.Renderer(scene, [ALONG])
    renderer.reset((0.0, 0.0, 0.011))
    assert renderer.step((0.0, 0.0, 0.009)).f_W_N.tolist() == [0.0, 0.0, 1.0]
    X_WT = poses()[50]
    renderer.step(X_WT)
    assert renderer.step((0.0, 0.0, 0.0091)).f_W_N.tolist() == X_WT[:3, 2].tolist()
    renderer.repaint(scene)
    assert renderer.step((0.0, 0.0, 0.009)).f_W_N.tolist() == X_WT[:3, 2].tolist()


def test_invalid_poses_of_the_tool(scene: hapscene.Scene) -> None:
    renderer = hapscene.Renderer(scene, [ALONG])
    X_WT = poses()
    renderer.step(X_WT[0])
    force_N = renderer.step(X_WT[50]).f_W_N
    X_WT[51, 0, 0] = np.nan
    lost = renderer.step(X_WT[51])
    assert lost.flags & hapscene.Flag.TOOL_NOT_FINITE and lost.f_W_N.tolist() == force_N.tolist()
    with pytest.raises(SceneError, match="tool"):
        renderer.step(2.0 * X_WT[50])
    with pytest.raises(PathError, match=r"\(4, 4\)"):
        renderer.step(X_WT[50, :3])
    with pytest.raises(SceneError, match="tool"):
        renderer.run(X_WT)


def test_a_bridge_passes_it_on(scene: hapscene.Scene) -> None:
    class Nothing:
        names, step_s = (), 0.003

        def read(self, X_WB: np.ndarray) -> None: ...

        def mobility(self, body: int) -> np.ndarray:
            return np.zeros((6, 6))

        def advance(self, wrench_W: np.ndarray) -> None: ...

    renderer, X_WT, seen = hapscene.Renderer(scene, [ALONG]), poses(), list[hapscene.Command]()
    given = iter(X_WT)
    bridge = hapscene.bridge.Bridge(Nothing())
    for _ in range(20):
        bridge.step(renderer, lambda: next(given), seen.append)
    touching = [command.contact is not None for command in seen]
    np.testing.assert_array_equal([c.f_W_N for c in seen if c.contact], X_WT[touching, :3, 2])
    two = [hapscene.Renderer(scene, [ALONG]), hapscene.Renderer(scene, [ALONG])]
    bridge.step(two, lambda: X_WT[[0, 0]])
    last = bridge.step(two, lambda: X_WT[[50, 59]])
    np.testing.assert_array_equal([c.f_W_N for c in last], X_WT[[50, 59], :3, 2])
    with pytest.raises(PathError):
        bridge.step(two, lambda: X_WT[:3])


def test_a_recording_stores_it(scene: hapscene.Scene, tmp_path: Path) -> None:
    X_WT = poses()
    recording = hapscene.Renderer(scene).run(X_WT)
    recording.save(tmp_path / "touch.npz")
    loaded = Recording.load(tmp_path / "touch.npz")
    assert loaded.R_WT is not None
    np.testing.assert_array_equal(loaded.R_WT, X_WT[:, :3, :3])
    recording.save_csv(tmp_path / "touch.csv")
    table = np.genfromtxt(tmp_path / "touch.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    np.testing.assert_allclose(table["R_WT_xz"], X_WT[:, 0, 2], atol=1e-8)
    plain = hapscene.Renderer(scene).run(X_WT[:, :3, 3])
    plain.save(tmp_path / "plain.npz")
    assert Recording.load(tmp_path / "plain.npz").R_WT is None
    with np.load(tmp_path / "touch.npz") as stored:
        np.savez(tmp_path / "short.npz", **{**stored, "R_WT": stored["R_WT"][:5]})
    with pytest.raises(RecordingError, match="R_WT"):
        Recording.load(tmp_path / "short.npz")


def test_the_tool_is_drawn_along_it(scene: hapscene.Scene) -> None:
    X_WT = poses()
    figure = make_figure_parts(scene, hapscene.Renderer(scene).run(X_WT), LIGHT, np.array([59]))
    for tick in (5, 55):
        np.testing.assert_allclose(dict(figure.shown(tick))[TOOL], X_WT[tick], atol=1e-12)
    ends = figure.points_m(tool=True)
    along = X_WT[55, :3, 3] + 0.22 * figure.size_m * X_WT[55, :3, 2]
    assert np.linalg.norm(ends - along, axis=1).min() < 1e-12


def test_a_servo_passes_it_on_and_logs_it(
    scene: hapscene.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The device is turned by a quarter about z. A replay is the same to the bit, also for an effect that reads it."""
    X_WD, R_DT = np.eye(4), turned(300)
    X_WD[:3, :3], X_WD[2, 3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], 0.012
    with VirtualServo(scene, choose("simulated"), effects=["wall", ALONG], X_WD=X_WD) as servo:
        servo.start((0.0, 0.0, 0.012))
        device = servo.handler.connections[0]
        device._arm.hand[0].target_m = 0.0, 0.0, -0.05
        for k in range(300):
            device.state.R_DT = R_DT[k]
            servo.advance(1)
        rows = servo.read().rows
        log = servo.session_log()
    R_WT = X_WD[:3, :3] @ R_DT
    np.testing.assert_allclose(log.loop_rows["R_WT"][0][-300:], R_WT, atol=1e-15)
    touching = rows["touching"] == 1
    assert np.count_nonzero(touching) > 100
    assert np.ptp(rows["f_W_N"][touching][:, :2], axis=0).max() > 0.5  # a wall alone would push along z
    log.save(tmp_path / "log")

    def renderer_of(scene: hapscene.Scene, made: Any, tool: int) -> hapscene.Renderer:
        limits = hapscene.device.Limits(**made["limits"][tool])
        return hapscene.Renderer(
            scene, ["wall", ALONG], tick_s=made["tick_s"], a_rate_Hz=made["a_rate_Hz"], limits=limits
        )

    monkeypatch.setattr(session_log, "_renderer", renderer_of)
    loaded = SessionLog.load(tmp_path / "log")
    assert loaded.replay().count > 250 and len(loaded.replay().unlike) == 0
    with np.load(tmp_path / "log" / NUMBERS_FILE) as stored:  # as of an earlier version
        np.savez(tmp_path / "log" / NUMBERS_FILE, **{name: stored[name] for name in stored if name != "felt_R_WT"})
    older = SessionLog.load(tmp_path / "log")
    assert not older.loop_rows["R_WT"].any() and LOOP_ROW.names and len(older.replay().unlike) > 100
