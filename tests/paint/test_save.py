"""Saving: over one's own file without a question, over another's never."""

import os
from pathlib import Path

import pytest

import hapscene
from hapscene.errors import SwatchError
from hapscene.paint.save import SaveConflict, check_unchanged, stamp_of, write_swatch
from hapscene.paint.session import Session
from hapscene.surface.swatch import Swatch


@pytest.fixture
def session(scene, tmp_path) -> Session:
    scene.save(tmp_path / "cup.scene.json")
    session = Session.open(tmp_path / "cup.scene.json")
    session.fill_group("ball", "north", session.add_swatch("wood"))
    return session


def test_saving_is_safe_and_ends_what_is_to_be_saved(session) -> None:
    assert session.dirty
    session.save()
    assert not session.dirty
    session.undo()
    assert session.dirty
    session.redo()
    assert not session.dirty  # the scene is again as it was saved
    session.fill_body("plate", 0)
    session.save()
    assert (hapscene.load_scene(session.path).body("plate").face_swatch == 0).all()


def test_a_file_that_changed_meanwhile_is_not_written_over(session) -> None:
    other = hapscene.load_scene(session.path)
    other.paint("plate", "leather")
    other.save(session.path)
    theirs = session.path.read_bytes()
    with pytest.raises(SaveConflict, match="was changed by someone else since it was opened"):
        session.save()
    assert session.path.read_bytes() == theirs and session.dirty
    session.save(force=True)
    assert (hapscene.load_scene(session.path).body("ball").face_swatch[:700] != 0).all()
    session.undo()
    session.save()  # from now on it is ours again


def test_a_file_that_was_only_touched_is_ours(session) -> None:
    os.utime(session.path, ns=(1, 1))
    session.save()


def test_a_file_that_is_gone_is_asked_for(session) -> None:
    session.path.unlink()
    with pytest.raises(SaveConflict, match="was removed or renamed meanwhile"):
        session.save()
    session.save(force=True)


def test_another_name(session, tmp_path) -> None:
    (tmp_path / "taken.scene.json").write_text("someone's")
    with pytest.raises(SaveConflict, match="is there already"):
        session.save(tmp_path / "taken.scene.json")
    old = session.path.read_bytes()
    assert session.save(tmp_path / "new.scene.json") == session.path == tmp_path / "new.scene.json"
    assert (tmp_path / "cup.scene.json").read_bytes() == old
    session.fill_body("ball", 0)
    session.save()


def test_a_new_file_that_someone_makes_first(scene, tmp_path) -> None:
    session = Session(scene, tmp_path / "new.scene.json")
    (tmp_path / "new.scene.json").write_text("{}")
    with pytest.raises(SaveConflict, match="was made by someone else meanwhile"):
        session.save()


def test_stamps(tmp_path: Path) -> None:
    file = tmp_path / "a"
    assert stamp_of(file).sha256 == ""
    check_unchanged(file, None)
    file.write_text("a")
    check_unchanged(file, stamp_of(file))
    with pytest.raises(hapscene.HapsceneError, match="cannot be read"):
        stamp_of(tmp_path)


def test_a_swatch_is_not_written_over_another(tmp_path) -> None:
    source, file = write_swatch(Swatch("foam"), tmp_path / "foam.swatch", False)
    assert source == file.resolve()
    with pytest.raises(SwatchError, match="is there already"):
        write_swatch(Swatch("foam", stiffness_N_m=1.0), tmp_path / "foam.swatch", False)
    assert hapscene.load_swatch(file).stiffness_N_m == 500.0
    write_swatch(Swatch("foam", stiffness_N_m=1.0), tmp_path / "foam.swatch", True)
    assert hapscene.load_swatch(file).stiffness_N_m == 1.0
