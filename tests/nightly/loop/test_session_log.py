"""The last minute: kept, written, read from strangers, and flown again."""

import json
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from hapscene.compiled.native import INTERPRETED
from hapscene.errors import HapsceneError
from hapscene.loop import SessionLog
from hapscene.loop.session_log import NUMBERS_FILE, STORY_FILE, note_order, replay_log, write_log
from tests.loop.test_servo import MASS, make_scene
from tests.virtual_servo import VirtualServo

pytestmark = pytest.mark.skipif(INTERPRETED, reason="an interpreted tick takes longer than a period")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stroke, tuned on its way, in a ring that is smaller than it."""
    folder = tmp_path_factory.mktemp("flights") / "stroke"
    with VirtualServo(make_scene(), MASS, ring_s=1.5) as servo:
        servo.start((-0.03, 0.0, 0.002))
        for k, x_m in enumerate(np.linspace(-0.03, 0.03, 40)):
            servo.aim((x_m, 0.0, -0.004), "medium")
            servo.advance(20)
            if k == 20:
                servo.tune("wood", stiffness_N_m=400.0)
        servo.advance(900)
        servo.save_log(folder)
    return folder


def test_it_is_flown_again_to_the_bit(flown: Path) -> None:
    log = SessionLog.load(flown)
    replay = log.replay()
    assert replay.count > 500 and len(replay.unlike) == 0 and "the same to the bit" in str(replay)
    assert log.first > 0  # the ring is shorter than the stroke
    assert 400 < log.memory_tick < 1500  # from after the tuning on
    assert log.rows["f_W_N"].any() and log.a_m_s2.any()


def test_a_stranger_s_is_flown_in_a_process_of_its_own(flown: Path, tmp_path: Path) -> None:
    again = replay_log(flown)
    assert len(again.unlike) == 0 and again.reason == SessionLog.load(flown).reason != ""
    folder = tmp_path / "forged"
    shutil.copytree(flown, folder)
    story = json.loads((folder / STORY_FILE).read_text())
    (folder / STORY_FILE).write_text(json.dumps(story | {"made": {"tick_s": "x"}}))
    with pytest.raises(HapsceneError, match="flight.json"):
        replay_log(folder)


def test_another_force_is_found_at_its_tick(flown: Path) -> None:
    log = SessionLog.load(flown)
    at = log.rows.shape[1] - 50
    log.rows["f_W_N"][0, at, 2] = np.nextafter(log.rows["f_W_N"][0, at, 2], 9.0)
    assert log.replay().unlike.tolist() == [log.first + at]


def test_after_shapes_have_changed_it_says_that_it_cannot(flown: Path, tmp_path: Path) -> None:
    scene = make_scene()
    with VirtualServo(scene, MASS) as servo:
        servo.start((0.0, 0.0, 0.01))
        servo.deform("plate", 1.1 * scene.bodies[0].mesh.vertices_m)
        servo.advance(20)
        servo.save_log(tmp_path / "deformed")
    with pytest.raises(HapsceneError, match="replayed"):
        SessionLog.load(tmp_path / "deformed").replay()


def test_after_a_body_came_it_says_that_it_cannot(tmp_path: Path) -> None:
    scene = make_scene()
    with VirtualServo(scene, MASS) as servo:
        servo.start((0.0, 0.0, 0.01))
        servo.add(scene.bodies[0].mesh, name="other")
        servo.advance(20)
        log = servo.session_log()
    with pytest.raises(HapsceneError, match="replayed"):
        log.replay()


def test_each_tool_is_flown_again_within_its_own_limits_and_settings_are_numbers_of_any_kind(tmp_path: Path) -> None:
    pull = {"weight": {"mass_kg": np.float32(0.02)}}
    with VirtualServo(make_scene(), ["omni", "premium-1.5"], effects=["wall", "weight"], settings=pull) as servo:
        servo.start([(0.0, 0.0, 0.002)] * 2)
        for tool in range(2):
            servo.aim((0.0, 0.0, -0.006), "firm", tool=tool)
        servo.advance(300)
        servo.save_log(tmp_path / "two")
    log = SessionLog.load(tmp_path / "two")
    assert log.rows["touching"].any(axis=1).all() and len(log.replay().unlike) == 0


def test_a_slider_that_moves_for_hours_is_one_line() -> None:
    tuned: list[tuple[str, str, dict[str, float]]] = [("mute", "wall", {"muted": True})]
    for k in range(1000):
        note_order(tuned, "tune", "wood", {"stiffness_N_m": float(k)})
    assert tuned[1:] == [("tune", "wood", {"stiffness_N_m": 999.0})]


@pytest.mark.parametrize("damage", ["elsewhere", "gone", "no numbers", "later", "cut", "pickle"])
def test_what_is_none_is_refused_in_one_line(flown: Path, damage: str, tmp_path: Path) -> None:
    folder = tmp_path / "bad"
    folder.mkdir()
    for file in flown.iterdir():
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


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root mounts a full disk")
def test_a_full_disk_is_told_and_nothing_else_happens(flown: Path, tmp_path: Path) -> None:
    full = tmp_path / "full"
    full.mkdir()
    if os.system(f"mount -t tmpfs -o size=64k tmpfs {full}") != 0:
        pytest.skip("no disk may be mounted here")
    try:
        assert "could not be written" in write_log(SessionLog.load(flown), full)
        assert list(full.iterdir()) == []
    finally:
        os.system(f"umount {full}")


def test_two_in_one_second_are_two(flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "strftime", lambda form: "now")
    log = SessionLog.load(flown)
    write_log(log, tmp_path)
    write_log(log, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
