"""The session log: written, read from untrusted sources, and replayed."""

import json
import os
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hapscene
from hapscene.compiled.native import INTERPRETED
from hapscene.errors import HapsceneError
from hapscene.loop import SessionLog
from hapscene.loop.checkpoint import restore_checkpoint
from hapscene.loop.session_log import NUMBERS_FILE, STORY_FILE, note_order, replay_log, write_log
from tests.loop.test_servo import MASS, make_scene
from tests.virtual_servo import VirtualServo

pytestmark = pytest.mark.skipif(INTERPRETED, reason="an interpreted tick takes longer than a period")


@pytest.fixture(scope="module")
def log_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the log of a stroke with a tuned parameter, longer than the ring buffer."""
    folder = tmp_path_factory.mktemp("logs") / "stroke"
    with VirtualServo(make_scene(), MASS, ring_s=1.5) as servo:
        servo.start((-0.03, 0.0, 0.002))
        for k, x_m in enumerate(np.linspace(-0.03, 0.03, 40)):
            servo.aim((x_m, 0.0, -0.004), "medium")
            servo.advance(20)
            if k == 20:
                servo.tune("wood", stiffness_N_m=400.0)
        servo.advance(900)
        servo.session_log().save(folder)
    return folder


def test_replay_is_identical(log_folder: Path) -> None:
    log = SessionLog.load(log_folder)
    replay = log.replay()
    assert replay.count > 500 and len(replay.unlike) == 0 and "the same to the bit" in str(replay)
    assert log.first + log.rows.shape[1] == 1700 and log.rows.shape[1] == 1499  # the oldest may be overwritten
    assert 400 < log.memory_tick < 1500  # after the parameter was tuned
    assert log.rows["f_W_N"].any() and log.a_m_s2.any()


def test_log_without_contact_points_is_read(log_folder: Path, tmp_path: Path) -> None:
    """Logs from before tools had a radius: the contact point of a point is its proxy."""
    folder = tmp_path / "older"
    shutil.copytree(log_folder, folder)
    with np.load(folder / NUMBERS_FILE) as stored:
        np.savez(folder / NUMBERS_FILE, **{name: stored[name] for name in stored.files if name != "row_p_WC_m"})
    log = SessionLog.load(folder)
    assert np.array_equal(log.rows["p_WC_m"], log.rows["p_WP_m"]) and log.rows["p_WC_m"].any()


@pytest.mark.nightly
def test_untrusted_log_is_replayed_in_a_separate_process(log_folder: Path, tmp_path: Path) -> None:
    again = replay_log(log_folder)
    assert len(again.unlike) == 0 and again.reason == SessionLog.load(log_folder).reason != ""
    folder = tmp_path / "forged"
    shutil.copytree(log_folder, folder)
    story = json.loads((folder / STORY_FILE).read_text())
    (folder / STORY_FILE).write_text(json.dumps(story | {"made": {"tick_s": "x"}}))
    with pytest.raises(HapsceneError, match=STORY_FILE):
        replay_log(folder)


def test_changed_force_is_detected_at_its_tick(log_folder: Path) -> None:
    log = SessionLog.load(log_folder)
    at = log.rows.shape[1] - 50
    log.rows["f_W_N"][0, at, 2] = np.nextafter(log.rows["f_W_N"][0, at, 2], 9.0)
    assert log.replay().unlike.tolist() == [log.first + at]


@pytest.mark.parametrize("limits", ["x", [], ["x"], [{"reach_m": 1.0}]])
def test_limits_of_a_log_are_checked(log_folder: Path, limits: Any) -> None:
    log = SessionLog.load(log_folder)
    with pytest.raises(HapsceneError, match="limits"):
        replace(log, made={**log.made, "limits": limits}).replay()


def test_checkpoint_of_another_scene_is_refused(log_folder: Path) -> None:
    renderer, memory = hapscene.Renderer(make_scene(), ["wall"]), SessionLog.load(log_folder).memory
    with pytest.raises(HapsceneError, match="the checkpoint has"):
        restore_checkpoint(renderer.world, renderer.surface, memory)


def test_log_with_a_deformation_cannot_be_replayed(log_folder: Path, tmp_path: Path) -> None:
    scene = make_scene()
    with VirtualServo(scene, MASS) as servo:
        servo.start((0.0, 0.0, 0.01))
        servo.deform("plate", 1.1 * scene.bodies[0].mesh.vertices_m)
        servo.advance(20)
        servo.session_log().save(tmp_path / "deformed")
    with pytest.raises(HapsceneError, match="replayed"):
        SessionLog.load(tmp_path / "deformed").replay()


def test_log_with_an_added_body_cannot_be_replayed(tmp_path: Path) -> None:
    scene = make_scene()
    with VirtualServo(scene, MASS) as servo:
        servo.start((0.0, 0.0, 0.01))
        servo.add(scene.bodies[0].mesh, name="other")
        servo.advance(20)
        log = servo.session_log()
    with pytest.raises(HapsceneError, match="replayed"):
        log.replay()


def test_replay_of_two_tools_with_numpy_settings(tmp_path: Path) -> None:
    made = {"effects": ["wall", "weight"], "settings": {"weight": {"mass_kg": np.float32(0.02)}}}
    with VirtualServo(make_scene(), ["omni", "premium-1.5"], ring_s=0.2, **made) as servo:
        servo.start([(0.0, 0.0, 0.002)] * 2)
        for tool in range(2):
            servo.aim((0.0, 0.0, -0.006), "firm", tool=tool)
        servo.advance(300)
        servo.session_log().save(tmp_path / "two")
    log = SessionLog.load(tmp_path / "two")
    assert log.rows["touching"].any(axis=1).all() and len(log.replay().unlike) == 0
    assert log.memory_tick == 150  # the oldest of four in the ring buffer


def test_repeated_orders_are_merged() -> None:
    tuned: list[tuple[str, str, dict[str, float]]] = [("mute", "wall", {"muted": True})]
    for k in range(1000):
        note_order(tuned, "tune", "wood", {"stiffness_N_m": float(k)})
    assert tuned[1:] == [("tune", "wood", {"stiffness_N_m": 999.0})]


@pytest.mark.parametrize(
    "damage", ["elsewhere", "tuned", "made", "first", "gone", "no numbers", "later", "cut", "pickle"]
)
def test_invalid_log_is_rejected_in_one_line(log_folder: Path, damage: str, tmp_path: Path) -> None:
    folder = tmp_path / "bad"
    folder.mkdir()
    for file in log_folder.iterdir():
        if file.is_file():
            (folder / file.name).write_bytes(file.read_bytes())
    story = json.loads((folder / STORY_FILE).read_text())
    match damage:
        case "gone":
            (folder / STORY_FILE).unlink()
        case "no numbers":
            (folder / NUMBERS_FILE).unlink()
        case "later":
            (folder / STORY_FILE).write_text(json.dumps(story | {"version": 99}))
        case "tuned" | "made" | "first":
            (folder / STORY_FILE).write_text(json.dumps(story | {damage: "x"}))
        case "elsewhere":
            (folder / STORY_FILE).write_text(json.dumps(story | {"memory_tick": -7}))
        case "cut":
            content = (folder / NUMBERS_FILE).read_bytes()
            (folder / NUMBERS_FILE).write_bytes(content[: len(content) // 2])
        case "pickle":
            np.savez(folder / NUMBERS_FILE, a_m_s2=np.array([[[object()]]], dtype=object))
    with pytest.raises(HapsceneError) as error:
        SessionLog.load(folder)
    assert str(folder) in str(error.value) and "\n" not in str(error.value)


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root mounts a full disk")
def test_full_disk_is_reported(log_folder: Path, tmp_path: Path) -> None:
    full = tmp_path / "full"
    full.mkdir()
    if os.system(f"mount -t tmpfs -o size=64k tmpfs {full}") != 0:
        pytest.skip("no permission to mount a disk")
    try:
        assert "could not be written" in write_log(SessionLog.load(log_folder), full)
        assert list(full.iterdir()) == []
    finally:
        os.system(f"umount {full}")


def test_two_logs_in_one_second(log_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "strftime", lambda form: "now")
    log = SessionLog.load(log_folder)
    write_log(log, tmp_path)
    write_log(log, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
