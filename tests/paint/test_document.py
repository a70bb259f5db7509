"""Saving: over one's own file without a question, over another's never."""

import os

import pytest

import hapscene
from hapscene.errors import SaveConflict, SceneError
from hapscene.paint.model.document import find_recovery
from hapscene.paint.model.session import Session

from .conftest import hit_at


@pytest.fixture
def session(scene, tmp_path) -> Session:
    scene.save(tmp_path / "cup.scene.json")
    session = Session.open(tmp_path / "cup.scene.json")
    session.fill_at(hit_at(session, 0, 0), "material", session.add_swatch("wood"))
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


def test_undone_after_saving_the_numbers_that_are_shown_are_saved(session) -> None:
    paper = session.painting.swatch_named("paper")

    def saved() -> tuple[float, float]:
        session.save()
        found = hapscene.load_scene(session.path).swatches[paper].stiffness_N_m
        return session.scene.swatches[paper].stiffness_N_m, found

    session.tune(paper, stiffness_N_m=300.0)
    session.save()
    session = Session.open(session.path)  # the next evening
    session.tune(paper, stiffness_N_m=100.0)
    assert saved() == (100.0, 100.0)
    session.undo()
    assert saved() == (300.0, 300.0)
    session.redo()
    assert saved() == (100.0, 100.0)
    assert len(list(session.path.parent.glob("cup.paper.*.swatch"))) == 1


def test_changed_file_is_not_overwritten(session) -> None:
    other = hapscene.load_scene(session.path)
    other.paint("plate", "leather")
    other.save(session.path)
    theirs = session.path.read_bytes()
    with pytest.raises(SaveConflict):
        session.save()
    assert session.path.read_bytes() == theirs and session.dirty
    session.save(force=True)
    assert (hapscene.load_scene(session.path).body("ball").face_swatch[:700] != 0).all()
    session.undo()
    session.save()  # from now on it is ours again
    session.path.unlink()
    with pytest.raises(SaveConflict, match="removed"):
        session.save()
    session.save(force=True)


def test_file_with_a_new_time_but_equal_content_is_overwritten(session) -> None:
    os.utime(session.path, ns=(1, 1))
    session.save()


def test_another_name(session, tmp_path) -> None:
    (tmp_path / "taken.scene.json").write_text("someone's")
    with pytest.raises(SaveConflict, match="exists"):
        session.save(tmp_path / "taken.scene.json")
    with pytest.raises(SaveConflict, match="exists"):  # new when it was opened, created by another program
        new = Session(session.scene, tmp_path / "made.scene.json")
        (tmp_path / "made.scene.json").write_text("{}")
        new.save()
    old = session.path.read_bytes()
    assert session.save(tmp_path / "new.scene.json") == session.path == tmp_path / "new.scene.json"
    assert (tmp_path / "cup.scene.json").read_bytes() == old
    session.fill_body("ball", 0)
    session.save()


@pytest.mark.parametrize("force", [False, True])
def test_another_name_that_is_open_in_another_painter(session, scene, tmp_path, force) -> None:
    taken = tmp_path / "taken.scene.json"
    scene.save(taken)
    before = taken.read_bytes()
    other = Session.open(taken)
    other.document.start_autosave(60.0)
    session.document.start_autosave(60.0)
    with pytest.raises(SceneError):
        session.save(taken, force)
    assert taken.read_bytes() == before and session.dirty and session.document.autosave
    assert session.path == tmp_path / "cup.scene.json"
    session.save()
    other.document.close()
    session.save(taken, force=True)
    assert taken.read_bytes() != before
    session.document.close()


@pytest.mark.parametrize("with_autosave", [False, True])
def test_another_name_whose_painter_was_killed_is_asked_for(session, scene, tmp_path, with_autosave) -> None:
    taken = tmp_path / "taken.scene.json"
    other = Session(scene, taken)
    other.document.start_autosave(60.0)
    other.fill_body("ball", other.add_swatch("leather"))
    other.document.close(keep=True)  # as when it is ended
    left = find_recovery(taken)
    assert left is not None
    if with_autosave:
        session.document.start_autosave(60.0)
    with pytest.raises(SaveConflict):
        session.save(taken)
    assert not taken.exists() and session.path != taken
    session.save(taken, force=True)
    session.document.close()
    assert find_recovery(taken) == left and "leather" in [s.name for s in left.load().swatches]


@pytest.mark.parametrize("target", ["real.scene.json", "1"])
def test_a_scene_is_painted_and_saved_through_a_link(scene, tmp_path, target) -> None:
    """Its files beside it, or beside the link, as a store of large files has them."""
    (tmp_path / "store").mkdir()
    link, real = tmp_path / "linked.scene.json", tmp_path / "store" / target
    scene.save(link)
    link.rename(real)
    link.symlink_to(real)
    session = Session.open(link)
    session.fill_body("ball", session.add_swatch("wood"))
    session.save()
    assert link.is_symlink() and not session.dirty
    again = Session.open(link)
    assert (again.scene.body("ball").face_swatch == again.painting.swatch_named("wood")).all()
