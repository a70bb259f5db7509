"""Autosave: after a kill, work up to the last write is offered for recovery once, with its undo steps."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import hapscene
from hapscene.errors import SceneError
from hapscene.paint.model.document import autosave_folder, find_recovery
from hapscene.paint.model.session import Session
from hapscene.surface.swatch import Swatch

from .conftest import hit_at


@pytest.fixture
def path(scene, tmp_path):
    scene.save(tmp_path / "cup.scene.json")
    return tmp_path / "cup.scene.json"


@pytest.fixture
def killed(path):
    """A session whose autosave was written, then left behind as by a killed process."""
    session = Session.open(path)
    session.document.start_autosave(interval_s=60.0)
    session.fill_at(hit_at(session, 0, 700), "material", session.add_swatch(Swatch("slate")))
    assert session.document.autosave is not None
    session.document.autosave.write()
    session.document.autosave._lock.release()  # what the system does
    return session


def test_recovery_has_the_undo_steps(killed, path) -> None:
    def paint() -> list[np.ndarray]:
        return [body.face_swatch.copy() for body in session.scene.bodies]

    session = killed
    states = [paint()]
    for _ in range(2):
        session.fill_body("plate", len(states) - 1)
        states.append(paint())
    session.painting.begin_step("unfinished", 0)
    session.painting.paint_faces(0, np.arange(700, 800))
    last = paint()
    killed.document.autosave.write()
    names = [step.what for step in killed.history.done if step.faces]

    session = Session.open(path)
    start = paint()
    session.document.recover(session.document.recovery())
    np.testing.assert_equal(paint(), last)
    assert session.document.changed and session.scene.swatch_source[-1] is None
    assert [step.what for step in session.history.done] == ["recovered painting", *names, "recovered painting"]
    session.undo()
    for state in reversed(states):
        np.testing.assert_equal([paint()[1], paint()[0][800:]], [state[1], state[0][800:]])
        session.undo()
    session.undo()
    np.testing.assert_equal(paint(), start)
    assert len(session.scene.swatches) == 2


@pytest.mark.parametrize("steps", [b"", b"{}", b'{"scene": "0", "steps": []}', b"[", b"\xff"])
def test_recovery_without_readable_steps_is_one_step(killed, path, steps) -> None:
    session = Session.open(path)
    recovery = session.document.recovery()
    recovery.file.with_name("steps.json").write_bytes(steps)
    session.document.recover(recovery)
    np.testing.assert_array_equal(session.scene.bodies[0].face_swatch, killed.scene.bodies[0].face_swatch)
    assert [step.what for step in session.history.done] == ["recovered painting"]
    session.undo()
    assert len(session.scene.swatches) == 2


def test_recovery_file_stays_until_the_user_decides(killed, path) -> None:
    session = Session.open(path)
    session.document.start_autosave(interval_s=60.0)
    left = session.document.recovery()
    session.fill_body("plate", 0)  # while it is asked
    assert session.document.autosave.write() and session.document.autosave.file.exists() and left.file.exists()
    session.document.autosave._lock.release()  # it is killed as well
    again = Session.open(path)
    again.document.start_autosave(interval_s=60.0)
    last = again.document.recovery()
    assert last != left and (last.load().body("plate").face_swatch == 0).all()
    again.document.recover(last)
    assert not last.file.exists() and again.document.recovery() == left  # the next one
    again.document.discard_recovery(left)
    assert again.document.recovery() is None
    again.save()
    again.document.close()
    assert not autosave_folder(path).exists()


def test_recovery_of_another_scene_is_refused_and_kept(killed, path) -> None:
    other = hapscene.Scene()
    other.add(path.parent / "ball.obj", name="cup", unit="mm")
    session = Session(other, path)
    session.document.start_autosave(interval_s=60.0)
    left = session.document.recovery()
    with pytest.raises(SceneError, match=re.escape(str(left.file))):
        session.document.recover(left)
    assert [body.name for body in Session.open(left.file).scene.bodies] == ["ball", "plate"]
    session.document.close(keep=True)
    assert find_recovery(path) == left


def test_two_painters_of_one_scene(path) -> None:
    first, second = Session.open(path), Session.open(path)
    first.document.start_autosave(interval_s=60.0)
    first.fill_body("ball", 1)
    first.document.autosave.write()  # type: ignore[union-attr]
    with pytest.raises(SceneError):
        second.document.start_autosave()
    assert second.document.recovery() is None  # it is not a killed one's
    first.document.close()
    second.document.start_autosave()
    second.document.close()


def test_saved_or_undone_changes_leave_no_recovery_file(path) -> None:
    session = Session.open(path)
    session.document.start_autosave(interval_s=60.0)
    autosave = session.document.autosave
    assert autosave is not None
    file = autosave.file
    autosave.write()
    assert not file.exists()
    session.fill_body("ball", 1)
    autosave.write()
    assert file.exists()
    written = file.stat().st_mtime_ns
    autosave.write()
    assert file.stat().st_mtime_ns == written  # nothing new
    session.undo()
    autosave.write()
    assert not file.exists()
    session.redo()
    autosave.write()
    session.save()
    assert not file.exists() and session.document.problem is None
    session.document.close()


def test_unwritable_folder_is_reported(path) -> None:
    autosave_folder(path).write_text("a file is in the way")
    with pytest.raises(SceneError):
        Session.open(path).document.start_autosave()
    Session.open(path).document.close()
    session = Session(Session.open(path).scene)
    session.document.start_autosave()  # without a path there is no place: nothing is done
    assert session.document.recovery() is None and session.document.problem is None


def test_removed_folder_is_reported(path) -> None:
    session = Session.open(path)
    session.document.start_autosave(interval_s=60.0)
    session.fill_body("ball", 1)
    assert session.document.autosave.write() and session.document.problem is None
    shutil.rmtree(path.parent)
    assert not session.document.autosave.write() and "autosave failed" in session.document.problem
    assert not session.document.close(keep=True) and "autosave failed" in session.document.problem


def test_painter_that_holds_the_lock_can_save_and_close(path) -> None:
    session = Session.open(path)
    session.document.start_autosave(interval_s=0.001)  # the other thread looks all the time
    with session.lock:
        for ink in (1, 0, 1):
            session.fill_body("ball", ink)
            session.save()
        session.document.close()
    assert not autosave_folder(path).exists()
    assert (hapscene.load_scene(path).body("ball").face_swatch == 1).all()


def test_a_scene_in_a_folder_that_cannot_be_written_is_painted_and_saved_elsewhere(path, tmp_path, monkeypatch) -> None:
    allowed = os.access
    monkeypatch.setattr("os.access", lambda where, kind: Path(where) != path.parent and allowed(where, kind))
    session = Session.open(path)
    session.document.start_autosave(interval_s=60.0)
    session.fill_body("ball", 1)
    assert not session.document.autosave and re.match("autosave is off", session.document.problem)
    assert not autosave_folder(path).exists()
    with pytest.raises(SceneError, match=r"cup\.scene\.json: cannot be written"):
        session.save()
    (tmp_path / "mine").mkdir()
    session.save(tmp_path / "mine" / "cup.scene.json")
    assert session.document.autosave and session.document.problem is None
    session.document.close()
