"""The tab of the file: what would lose somebody's work is asked, and done as it was asked."""

from pathlib import Path

import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

import hapscene
from hapscene.paint.model.document import autosave_folder, find_recovery
from hapscene.paint.model.session import Session
from hapscene.paint.web.page import Page

from ..conftest import make_scene
from ..tab import Tab


def said(tab: Tab, text: str) -> None:
    """Wait until the page said so."""
    tab.wait(lambda: any(text in line for line in tab.said))


def asked(tab: Tab, answer: str) -> bool:
    """Return whether a question with this answer is displayed."""
    return any(c["props"].get("label") == answer for c in list(tab.controls.values()))


def displayed(tab: Tab, text: str) -> bool:
    return any(text in c["props"].get("content", "") for c in list(tab.controls.values()))


def save_as(tab: Tab, name: str) -> None:
    tab.set("Scene file", name)
    tab.settle()
    tab.send("save")


def test_file_is_overwritten_after_confirmation(page: Page, tab: Tab) -> None:
    Path("asked.scene.json").write_text("theirs")
    Path("precious.scene.json").write_text("precious")
    save_as(tab, "asked.scene.json")
    tab.control("Overwrite")
    tab.set("Scene file", "precious.scene.json")
    tab.settle()
    tab.set("Overwrite", True)
    said(tab, "Saved: asked.scene.json")
    assert Path("precious.scene.json").read_text() == "precious"
    hapscene.load_scene("asked.scene.json")
    tab.wait(lambda: not asked(tab, "Overwrite"))


def test_export_over_an_existing_file_needs_confirmation(page: Page, tab: Tab) -> None:
    Path("ball.ply").write_text("theirs")
    tab.set("Format", "ply")
    tab.settle()
    tab.wait(lambda: tab.control("File")["value"] == "ball.ply")
    tab.set("Export", True)
    tab.control("Overwrite")
    assert Path("ball.ply").read_text() == "theirs"
    tab.set("Overwrite", True)
    said(tab, "Exported: ball.ply")
    assert Path("ball.ply").read_bytes().startswith(b"ply")


def test_panel_lists_what_the_chosen_format_cannot_store(page: Page, tab: Tab) -> None:
    tab.set("Format", "ply")
    tab.wait(lambda: displayed(tab, "Not included: bodies and their names"))


def test_escape_closes_a_question_without_an_answer(page: Page, tab: Tab) -> None:
    Path("asked.scene.json").write_text("theirs")
    tab.send("dismiss")  # without a question
    save_as(tab, "asked.scene.json")
    tab.control("Overwrite")
    tab.send("dismiss")
    tab.wait(lambda: not asked(tab, "Overwrite"))
    assert Path("asked.scene.json").read_text() == "theirs" and not page.context.questions


def test_export_never_overwrites_a_mesh_of_the_scene(page: Page, tab: Tab) -> None:
    before = Path("ball.obj").read_bytes()
    tab.set("Format", "obj")
    tab.settle()
    tab.wait(lambda: tab.control("File")["value"] == "ball_painted.obj")
    tab.set("File", "ball.obj")
    tab.settle()
    tab.set("Export", True)
    said(tab, "is a mesh of a scene")
    assert Path("ball.obj").read_bytes() == before and not asked(tab, "Overwrite")


def test_after_another_name_exports_go_there(page: Page, tab: Tab) -> None:
    Path("sub").mkdir()
    save_as(tab, "sub/cup.scene.json")
    said(tab, "Saved")
    tab.wait(lambda: tab.control("File")["value"] == str(Path("sub/cup.glb")))
    assert page.context.session.path == Path("sub/cup.scene.json")
    assert not autosave_folder(Path("ball.scene.json")).exists()


def test_failed_answer_keeps_the_dialog_open(page: Page, tab: Tab) -> None:
    other = Session.open(Path("ball.scene.json"))
    other.save(Path("cup.scene.json"))
    save_as(tab, "cup.scene.json")
    tab.control("Overwrite")
    other.document.start_autosave(60.0)
    tab.set("Overwrite", True)
    said(tab, "open in another painter")
    assert asked(tab, "Overwrite")
    other.document.close()
    tab.set("Overwrite", True)
    said(tab, "Saved: cup.scene.json")
    tab.wait(lambda: not asked(tab, "Overwrite"))


@pytest.fixture
def killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene file, whose painter was killed while it painted another mesh."""
    monkeypatch.chdir(tmp_path)
    path = Path("cup.scene.json")
    make_scene(tmp_path).save(path)
    other = hapscene.Scene()
    other.add("ball.obj", name="other", unit="mm")
    session = Session(other, path)
    session.document.start_autosave(60.0)
    session.fill_body(0, session.add_swatch("wood"))
    session.document.close(keep=True)
    return path


def test_while_it_is_asked_all_is_kept(killed: Path) -> None:
    with Page(Session.open(killed), port=0, with_hand=False) as page:
        tab = Tab(page)
        tab.control("Recover")
        assert page.context.session.document.autosave
        page.context.session.fill_body("plate", 0)
        tab.wait(lambda: displayed(tab, "backed up every second"))
        tab.set("Recover", True)
        said(tab, "bodies differ")
        tab.settle()
        assert asked(tab, "Recover")
        tab.set("Ask again next time", True)
        tab.wait(lambda: not asked(tab, "Recover"))
        tab.close()
    assert page.kept
    assert [b.name for b in find_recovery(killed).load().bodies] == ["ball", "plate"]  # the last one first
    with Page(Session.open(killed), port=0, with_hand=False) as page:
        tab = Tab(page)
        tab.set("Recover", True)
        tab.wait(lambda: (page.context.session.scene.body("plate").face_swatch == 0).all())
        tab.wait(lambda: len(page.context.session.document.autosave.recoveries) == 1)  # and the other is asked for
        tab.settle()
        tab.set("Discard", True)
        tab.wait(lambda: not asked(tab, "Discard"))
        tab.send("save")
        said(tab, "Saved")
        tab.close()
    assert not page.kept and not autosave_folder(killed).exists()
