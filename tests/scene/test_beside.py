"""What lies beside a scene file: never written over, removed when no scene names it."""

import json
import shutil
from pathlib import Path

import pytest
import trimesh

import hapscene
from hapscene.errors import HapsceneError
from hapscene.output import write_whole
from hapscene.scene.beside import is_own
from hapscene.surface.swatch import Swatch


def make(stiffness_N_m: float = 300.0, edge_m: float = 0.1) -> hapscene.Scene:
    """A box and a swatch, both in memory alone."""
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((edge_m, 0.1, 0.1)), name="box", unit="m", swatch=Swatch("slate", stiffness_N_m))
    return scene


def own(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir() if file.suffix in (".ply", ".swatch")}


def stiffness(file: Path) -> float:
    return hapscene.load_scene(file).swatches[1].stiffness_N_m


def test_the_same_content_is_the_same_file_and_other_content_another(tmp_path: Path) -> None:
    file = tmp_path / "cup.scene.json"
    make().save(file)
    first = own(tmp_path)
    assert len(first) == 2 and all(is_own(tmp_path / name) for name in first)
    made = {name: (tmp_path / name).stat().st_mtime_ns for name in first}
    make().save(file)
    assert {name: (tmp_path / name).stat().st_mtime_ns for name in own(tmp_path)} == made
    make(100.0, 0.2).save(file)
    assert len(own(tmp_path)) == 2 and not own(tmp_path) & first  # what nobody names any more is gone
    assert stiffness(file) == 100.0


def test_a_failed_save_leaves_the_old_scene_with_its_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "cup.scene.json"
    make().save(file)
    before = own(tmp_path)

    def full(path: Path, content: bytes, error: type[Exception]) -> None:
        raise error(f"{path}: cannot be written: No space left on device")

    monkeypatch.setattr("hapscene.scene.file.write_whole", full)  # of the scene file, the last
    with pytest.raises(HapsceneError, match="No space left"):
        make(7.0, 0.2).save(file)
    monkeypatch.setattr("hapscene.scene.file.write_whole", write_whole)
    assert stiffness(file) == 300.0 and own(tmp_path) == before


def test_files_of_others_stay(tmp_path: Path) -> None:
    file = tmp_path / "cup.scene.json"
    theirs = {"cup.box.ply": b"a", "cup.slate.swatch": b"b", "cup.slate.0123abcd.swatch": b"c"}
    for name, content in theirs.items():
        (tmp_path / name).write_bytes(content)
    make().save(file)
    mine = own(tmp_path) - set(theirs)
    for name in mine:
        (tmp_path / name).write_bytes(b"changed by hand")
    make().save(file)
    assert len(own(tmp_path)) == len(theirs) + 4 and stiffness(file) == 300.0  # beside it, under longer names
    make(100.0, 0.2).save(file)
    kept = {name: (tmp_path / name).read_bytes() for name in (*theirs, *mine)}
    assert kept == theirs | dict.fromkeys(mine, b"changed by hand")


def test_a_copy_of_the_scene_file_keeps_what_it_names(tmp_path: Path) -> None:
    file, copy = tmp_path / "cup.scene.json", tmp_path / "cup_before.scene.json"
    make().save(file)
    shutil.copyfile(file, copy)
    make(100.0).save(file)
    assert (stiffness(file), stiffness(copy)) == (100.0, 300.0)
    make(50.0).save(copy)
    assert (stiffness(file), stiffness(copy)) == (100.0, 50.0)


def test_saved_into_another_folder_it_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    make().save(tmp_path / "a" / "cup.scene.json")
    hapscene.load_scene(tmp_path / "a" / "cup.scene.json").save(tmp_path / "b" / "mug.scene.json")
    shutil.rmtree(tmp_path / "a")
    assert stiffness(tmp_path / "b" / "mug.scene.json") == 300.0


def test_what_was_removed_meanwhile_is_written_anew(tmp_path: Path) -> None:
    file = tmp_path / "cup.scene.json"
    make().save(file)
    opened = hapscene.load_scene(file)
    make(100.0, 0.2).save(file)  # by another program
    opened.save(file)
    assert stiffness(file) == 300.0 and len(own(tmp_path)) == 2


def test_nothing_but_its_own_files_is_ever_removed(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    names = ("cup.scan.ply", "cup.20240115.ply", "cup.abcdef01.ply", "mug.abcdef01.ply", "scans/cup.abcdef01.ply")
    for name in names:
        trimesh.creation.icosphere(1).export(tmp_path / name)
    content = {"swatches": ["plain"], "meshes": [{"path": name} for name in (*names, "../cup.abcdef01.ply")]}
    (tmp_path / "cup.scene.json").write_text(json.dumps(content))  # from a stranger
    make().save(tmp_path / "cup.scene.json")
    assert all((tmp_path / name).is_file() for name in names)


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("cup.box.0123abcd.ply", True),
        ("cup.box.0123abcde.swatch", True),
        ("scan.20240115.ply", False),  # a date
        ("cup.box.ply", False),
        ("cup.0123abc.ply", False),
        ("cup.box.0123abcd.stl", False),
        ("0123abcd.ply", False),
    ],
)
def test_own_files_are_known_by_name(name: str, answer: bool) -> None:
    assert is_own(Path("somewhere") / name) is answer


def test_long_names_of_swatches_are_cut(tmp_path: Path) -> None:
    scene = make()
    scene.paint("box", Swatch("日" * 200))
    scene.save(tmp_path / "cup.scene.json")
    assert hapscene.load_scene(tmp_path / "cup.scene.json").swatches[2].name == "日" * 200
