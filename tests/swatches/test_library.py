"""The swatch library."""

import hashlib
import json
import os
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from filelock import FileLock

from hapscene import cli
from hapscene.errors import SwatchError
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import save_swatch
from hapscene.swatches import library
from hapscene.swatches.library import (
    add,
    edit,
    find,
    load_swatch,
    own_entries,
    own_folders,
    parse_index,
    remove,
    search,
    shipped_entries,
    shipped_swatches,
)

OAK = Swatch("oak", 700.0, 0.1, 0.5, 0.4, provenance="a board\x1b[31m", licence="MIT")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's library, in a temporary folder."""
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "home"))
    return tmp_path / "home"


def files_in(home: Path) -> dict[str, bytes]:
    """The files of the library by name, without that which writers lock."""
    files = {f.relative_to(home).as_posix(): f.read_bytes() for f in home.rglob("*") if f.is_file()}
    return {name: content for name, content in files.items() if name != library.LOCK}


def test_add_find_and_remove(home: Path) -> None:
    assert own_entries() == [] and find("oak") is None
    entry = add(OAK)
    assert load_swatch("oak") == OAK
    assert sys.platform == "win32" or (home / library.LOCK).is_file()  # locked from the first file on
    data = (home / entry.file).read_bytes()
    assert (entry.sha256, entry.bytes) == (hashlib.sha256(data).hexdigest(), len(data))
    assert own_entries() == [entry] and entry.figures["friction_static"] == 0.5
    assert remove("oak") == home / "oak.swatch"
    assert set(files_in(home)) == {"index.json"} and own_entries() == []
    with pytest.raises(SwatchError, match="oak"):
        load_swatch("oak")


def test_folders_and_tags(home: Path) -> None:
    add(OAK, inside="woods", tags=["desk", " desk ", ""])
    assert find("oak") == home / "woods" / "oak.swatch" and load_swatch("oak") == OAK
    for other, file in (("empty", "oak.swatch"), (".hidden", "index.json")):
        (home / other).mkdir()
        (home / other / file).write_bytes((home / "woods" / file).read_bytes())
    assert own_folders() == [home, home / "woods"] and own_entries() == []
    shutil.rmtree(home / "empty")
    (entry,) = own_entries(home / "woods")
    assert entry.tags == ("desk",) and search([entry], ["DESK"]) == [entry]
    with pytest.raises(SwatchError, match="oak"):
        add(OAK)  # names are unique across folders
    harder = replace(OAK, stiffness_N_m=900.0)
    assert add(harder, replace=True).tags == ("desk",) and load_swatch("oak") == harder
    moved = edit("oak", new_name="old oak", inside="")
    assert own_entries() == [moved] and own_entries(home / "woods") == [] and moved.tags == ("desk",)
    assert load_swatch("old oak") == replace(harder, name="old oak")
    assert sorted(f.name for f in home.rglob("*.swatch")) == [moved.file]
    assert edit("old oak", tags=["a", "b"]).tags == ("a", "b")
    renamed = edit("old oak", new_name="ash")
    assert sorted(f.name for f in home.rglob("*.swatch")) == [renamed.file] != [moved.file]
    assert remove("ash") == home / renamed.file and not list(home.rglob("*.swatch"))


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("oak", {"new_name": "ash"}),
        ("oak", {"new_name": "wood"}),
        ("oak", {"new_name": "a/b"}),
        ("oak", {"new_name": ""}),
        ("oak", {"inside": "../up"}),
        ("oak", {"tags": ["x" * 41]}),
        ("oak", {"tags": [str(i) for i in range(21)]}),
        ("elm", {"tags": []}),
    ],
)
def test_invalid_edit_raises_and_changes_nothing(home: Path, name: str, changes: dict[str, object]) -> None:
    add(OAK)
    add(replace(OAK, name="ash"))
    before = files_in(home)
    with pytest.raises(SwatchError):
        edit(name, **changes)
    assert files_in(home) == before


CHANGES: dict[str, Callable[[], object]] = {
    "add": lambda: add(replace(OAK, name="elm"), inside="other"),
    "replace": lambda: add(replace(OAK, stiffness_N_m=900.0), replace=True),
    "rename": lambda: edit("oak", new_name="elm"),
    "move": lambda: edit("oak", new_name="elm", inside="other"),
    "remove": lambda: remove("oak"),
}


@pytest.mark.parametrize("step", range(4))
@pytest.mark.parametrize("change", CHANGES)
def test_failed_write_changes_nothing(change: str, step: int, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The write after `step` others fails, and all later ones but those that restore a file."""
    add(OAK, inside="woods")
    add(replace(OAK, name="ash"))
    before, write, left = files_in(home), library.write_whole, [step]

    def fail(path: Path, content: bytes, error: type[Exception]) -> None:
        if before.get(path.relative_to(home).as_posix()) != content:
            left[0] -= 1
            if left[0] < 0:
                raise error(f"{path}: no space left on the device")
        write(path, content, error)

    monkeypatch.setattr(library, "write_whole", fail)
    try:
        CHANGES[change]()
    except SwatchError:
        assert files_in(home) == before
    else:
        assert step > 0 and left[0] >= 0


def test_failed_removal_changes_nothing(home: Path) -> None:
    file = home / add(OAK).file
    file.unlink()
    file.mkdir()  # cannot be unlinked
    before = files_in(home)
    with pytest.raises(SwatchError, match="oak"):
        remove("oak")
    assert files_in(home) == before


def test_library_locked_by_another_program_raises(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add(OAK)
    monkeypatch.setattr(library, "LOCK_WAIT_S", 0.0)
    with FileLock(home / library.LOCK), pytest.raises(SwatchError, match="home"):
        remove("oak")
    assert remove("oak")


def test_existing_names(home: Path) -> None:
    with pytest.raises(SwatchError, match="wood"):
        add(replace(OAK, name="wood"))
    for name in ("wood", "elm"):
        with pytest.raises(SwatchError, match=name):
            remove(name)
    add(OAK)
    with pytest.raises(SwatchError, match="oak"):
        add(OAK)
    stiffer = replace(OAK, stiffness_N_m=900.0)
    add(stiffer, replace=True)
    assert load_swatch("oak") == stiffer and len(own_entries()) == 1


def test_file_names_are_safe(home: Path) -> None:
    home.mkdir()
    (home / "oak.swatch").write_text("a file of the user's own")
    names = ["oak", "Oak", "..", "CON", "a:b", "Eiche №1", "…", ".hidden", "x" * 200, "-rf", "+10 % stiffer"]
    entries = [add(replace(OAK, name=name)) for name in names]
    assert len({entry.file.casefold() for entry in entries}) == len(names)
    assert (home / "oak.swatch").read_text() == "a file of the user's own"
    assert all(load_swatch(name).name == name for name in names)
    assert set(files_in(home)) == {e.file for e in entries} | {"oak.swatch", "index.json"}
    assert [e.name for e in own_entries()] == sorted(names)  # roundtrip
    for name in ("../../etc/passwd", "a\\b", "oak.swatch"):
        with pytest.raises(SwatchError):
            add(replace(OAK, name=name))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_devices_are_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.swatch")
    for path in (tmp_path / "pipe.swatch", Path("/dev/zero"), tmp_path):
        with pytest.raises(SwatchError):
            load_swatch(path)


GOOD = {"name": "oak", "file": "oak.swatch", "sha256": "0" * 64, "bytes": 10}


def index_of(*rows: object) -> bytes:
    return json.dumps({"format": "hapscene library", "version": 1, "swatches": list(rows)}).encode()


BAD_ROWS = [
    ("file", "../oak.swatch"),
    ("file", "nul.swatch"),
    ("licence", "\ud800"),
    ("sha256", "x" * 64),
    ("bytes", 1 << 40),
    ("name", "a\x1b[2J"),
    ("figures", {"a": "b"}),
    ("tags", ["\x1b[31m"]),
]


@pytest.mark.parametrize(("field", "value"), BAD_ROWS)
def test_invalid_row_raises(field: str, value: object) -> None:
    with pytest.raises(SwatchError, match=field) as caught:
        parse_index(index_of(GOOD | {field: value}), "there")
    assert str(caught.value).startswith("there: ") and len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "data",
    [
        b"\xff",
        b"[" * 100_000,
        b"[]",
        b'{"format": "hapscene library", "version": 2}',
        b'{"format": "hapscene library", "version": 1, "swatches": {}}',
        index_of({"name": "oak"}),
        index_of(GOOD, GOOD | {"file": "b.swatch"}),
        index_of(GOOD, GOOD | {"name": "b", "file": "OAK.swatch"}),
    ],
)
def test_invalid_index_raises(data: bytes) -> None:
    with pytest.raises(SwatchError, match="there"):
        parse_index(data, "there")


def test_search_by_words_and_bounds() -> None:
    entries = shipped_entries()
    assert {e.name for e in search(entries, [])} == set(shipped_swatches())
    assert [e.name for e in search(entries, ["WOOD", "friction<5"])] == ["wood"]
    grippy = {e.name for e in search(entries, ["friction>=0.35"])}
    assert grippy == {e.name for e in entries if e.figures["friction_dynamic"] >= 0.35}
    assert not search(entries, ["tap_Hz>1e9"])
    for term in ("colour<3", "friction<low", "friction<", "<0.4", "friction <> 2 3"):
        with pytest.raises(SwatchError):
            search(entries, [term])


def test_commands(home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_swatch(OAK, tmp_path / "oak.swatch")
    assert cli.main(["swatch", "list"]) == 0
    assert "is empty" in capsys.readouterr().out
    assert cli.main(["swatch", "add", str(tmp_path / "oak.swatch"), "--name", "oak, oiled"]) == 0
    assert cli.main(["swatch", "list"]) == 0
    assert re.search(r"^oak, oiled +library ", capsys.readouterr().out, re.MULTILINE)
    assert cli.main(["swatch", "show", "oak, oiled"]) == 0
    printed = capsys.readouterr().out
    assert (
        "oak, oiled: firm, grippy" in printed
        and "700 N/m" in printed
        and "0.5 static" in printed
        and "0.4 dynamic" in printed
    )
    assert "\x1b" not in printed and "a board" in printed and "MIT" in printed
    assert cli.main(["swatch", "search", "oak", "stiffness>600"]) == 0
    assert capsys.readouterr().out.split()[0:2] == ["oak,", "oiled"]
    assert cli.main(["swatch", "search", "marble"]) == 1
    assert cli.main(["swatch", "remove", "oak, oiled"]) == 0
    capsys.readouterr()
    for arguments in (("remove", "oak"), ("add", "none.swatch"), ("add", "a.swatch", "b.swatch", "--name", "x")):
        assert cli.main(["swatch", *arguments]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_search_by_tool(home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    probed = replace(OAK, name="probed", tool="steel probe", tip="3.2 mm ball")
    for swatch in (OAK, probed, replace(OAK, name="bare", tool="finger")):
        add(swatch)
    entries = own_entries()
    assert [e.name for e in search(entries, ["ball", "friction<1"])] == ["probed"]
    assert [e.name for e in search(entries, ["finger"])] == ["bare"]
    index = json.loads((home / "index.json").read_text(encoding="utf-8"))["swatches"]
    assert ["tool" in row for row in index] == [True, False, True]  # omitted if unknown
    assert cli.main(["swatch", "search", "probe"]) == 0
    assert "(steel probe, 3.2 mm ball)" in capsys.readouterr().out
    assert cli.main(["swatch", "show", "probed"]) == 0
    printed = capsys.readouterr().out
    assert "  tool        steel probe\n" in printed and "  tip         3.2 mm ball\n" in printed
    assert cli.main(["swatch", "compare", "probed", "bare"]) == 0
    assert "different tools (steel probe, 3.2 mm ball; finger)" in capsys.readouterr().out
    assert cli.main(["swatch", "compare", "probed", "oak"]) == 0
    assert "different tools" not in capsys.readouterr().out  # the other tool is unknown
