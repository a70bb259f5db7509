"""The library: a folder with an index, beside the shipped swatches."""

import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapscene import cli
from hapscene.errors import SwatchError
from hapscene.surface.library import (
    add,
    edit,
    find,
    library_folder,
    load_swatch,
    own_entries,
    own_folders,
    parse_index,
    remove,
    search,
    shipped_entries,
    shipped_swatches,
)
from hapscene.surface.life import Life
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import save_swatch
from hapscene.surface.swatch_summary import figures, lines, words
from hapscene.surface.taps import Taps

OAK = Swatch("oak", 700.0, 0.1, 0.5, 0.4, provenance="a board\x1b[31m", licence="MIT")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's library, in a temporary folder."""
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "home"))
    return tmp_path / "home"


def test_what_is_added_is_found_by_name(home: Path) -> None:
    assert own_entries() == [] and find("oak") is None
    entry = add(OAK)
    assert load_swatch("oak") == OAK
    data = (home / entry.file).read_bytes()
    assert (entry.sha256, entry.bytes) == (hashlib.sha256(data).hexdigest(), len(data))
    assert own_entries() == [entry] and entry.figures["friction_static"] == 0.5
    assert remove("oak") == home / "oak.swatch"
    assert [f.name for f in home.iterdir()] == ["index.json"] and own_entries() == []
    with pytest.raises(SwatchError, match=r"no swatch 'oak'; there are: .*wood"):
        load_swatch("oak")


def test_a_library_has_folders_and_tags(home: Path) -> None:
    add(OAK, inside="woods", tags=["desk", " desk ", ""])
    assert find("oak") == home / "woods" / "oak.swatch" and load_swatch("oak") == OAK
    assert own_folders() == [home, home / "woods"] and own_entries() == []
    (entry,) = own_entries(home / "woods")
    assert entry.tags == ("desk",) and search([entry], ["DESK"]) == [entry]
    with pytest.raises(SwatchError, match="'oak' is in the library already"):
        add(OAK)  # a name stands once in all folders
    harder = replace(OAK, stiffness_N_m=900.0)
    assert add(harder, replace=True).tags == ("desk",) and load_swatch("oak") == harder
    moved = edit("oak", new_name="old oak", inside="")
    assert own_entries() == [moved] and own_entries(home / "woods") == [] and moved.tags == ("desk",)
    assert load_swatch("old oak") == replace(harder, name="old oak")
    assert sorted(f.name for f in home.rglob("*.swatch")) == [moved.file]
    assert edit("old oak", tags=["a", "b"]).tags == ("a", "b")
    assert remove("old oak") == home / moved.file and not list(home.rglob("*.swatch"))


def test_what_cannot_be_edited(home: Path) -> None:
    add(OAK)
    add(replace(OAK, name="ash"))
    before = {f: f.read_bytes() for f in home.rglob("*") if f.is_file()}
    for name, changes, problem in (
        ("oak", {"new_name": "ash"}, "'ash' is in the library already"),
        ("oak", {"new_name": "wood"}, "'wood' is a shipped swatch"),
        ("oak", {"new_name": "slate"}, "'slate' is a shipped swatch"),
        ("oak", {"new_name": "a/b"}, "reads like a file"),
        ("oak", {"new_name": ""}, "1 to 200 printable"),
        ("oak", {"inside": "../up"}, "a plain name"),
        ("oak", {"inside": "NUL"}, "a plain name"),
        ("oak", {"tags": ["x" * 41]}, "each of 1 to 40"),
        ("oak", {"tags": [str(i) for i in range(21)]}, "20 tags at most"),
        ("elm", {"tags": []}, "no swatch 'elm'"),
        ("wood", {"tags": []}, "'wood' is a shipped swatch: it stays"),
    ):
        with pytest.raises(SwatchError, match=problem):
            edit(name, **changes)
    assert {f: f.read_bytes() for f in home.rglob("*") if f.is_file()} == before


def test_tags_of_a_strangers_index() -> None:
    for tags, problem in (("desk", "must be a list"), ([1], "must be a list"), (["\x1b[31m"], "printable")):
        data = json.dumps({"format": "hapscene library", "version": 1, "swatches": [GOOD | {"tags": tags}]}).encode()
        with pytest.raises(SwatchError, match=problem):
            parse_index(data, "there")


def test_an_unknown_name_lists_both_kinds() -> None:
    add(OAK)
    with pytest.raises(SwatchError, match=r"no swatch 'oka'; there are: .*oak.*wood.*did you mean 'oak'\?"):
        load_swatch("oka")


def test_names_that_are_taken(home: Path) -> None:
    with pytest.raises(SwatchError, match="'wood' is a shipped swatch"):
        add(replace(OAK, name="wood"))
    with pytest.raises(SwatchError, match="'wood' is a shipped swatch: it stays"):
        remove("wood")
    with pytest.raises(SwatchError, match="no swatch 'elm'; there are none in"):
        remove("elm")
    add(OAK)
    with pytest.raises(SwatchError, match="'oak' is in the library already"):
        add(OAK)
    stiffer = replace(OAK, stiffness_N_m=900.0)
    add(stiffer, replace=True)
    assert load_swatch("oak") == stiffer and len(own_entries()) == 1


def test_file_names_are_plain_and_harm_nothing(home: Path) -> None:
    home.mkdir()
    (home / "oak.swatch").write_text("a file of the user's own")
    names = ["oak", "Oak", "..", "CON", "a:b", "Eiche №1", "…", ".hidden", "x" * 200]
    entries = [add(replace(OAK, name=name)) for name in names]
    assert len({entry.file.casefold() for entry in entries}) == len(names)
    assert (home / "oak.swatch").read_text() == "a file of the user's own"
    assert all(load_swatch(name).name == name for name in names)
    assert {f.name for f in home.iterdir()} == {e.file for e in entries} | {"oak.swatch", "index.json"}
    assert [e.name for e in own_entries()] == sorted(names)  # what is written is read
    for name in ("../../etc/passwd", "a\\b", "oak.swatch"):
        with pytest.raises(SwatchError, match="reads like a file"):
            add(replace(OAK, name=name))


def test_a_link_is_replaced_and_not_followed(home: Path, tmp_path: Path) -> None:
    entry = add(OAK)
    (home / entry.file).unlink()
    (tmp_path / "elsewhere").write_text("stays")
    (home / entry.file).symlink_to(tmp_path / "elsewhere")
    add(OAK, replace=True)
    assert (tmp_path / "elsewhere").read_text() == "stays" and not (home / entry.file).is_symlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_no_device_is_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.swatch")
    for path in (tmp_path / "pipe.swatch", Path("/dev/zero"), tmp_path):
        with pytest.raises(SwatchError, match="cannot be read"):
            load_swatch(path)


GOOD = {"name": "oak", "file": "oak.swatch", "sha256": "0" * 64, "bytes": 10}

BAD_INDEX: dict[str, tuple[object, str]] = {
    "list": ([], "not an index"),
    "format": ({"format": "x"}, "not an index"),
    "version": ({"format": "hapscene library", "version": 2}, "later than 1"),
    "no list": ({"format": "hapscene library", "version": 1, "swatches": {}}, '"swatches" must be a list'),
    "up": (GOOD | {"file": "../oak.swatch"}, "plain file name"),
    "absolute": (GOOD | {"file": "/etc/oak.swatch"}, "plain file name"),
    "drive": (GOOD | {"file": "C:\\oak.swatch"}, "plain file name"),
    "device": (GOOD | {"file": "con.swatch"}, "plain file name"),
    "hidden": (GOOD | {"file": ".oak.swatch"}, "plain file name"),
    "suffix": (GOOD | {"file": "oak.py"}, "plain file name"),
    "null": (GOOD | {"file": "oak\0.swatch"}, "plain file name"),
    "line": (GOOD | {"file": "oak.swatch\n"}, "plain file name"),
    "hash": (GOOD | {"sha256": "x" * 64}, "sha256 must be"),
    "size": (GOOD | {"bytes": 1 << 40}, "bytes must be"),
    "size truth": (GOOD | {"bytes": True}, "bytes must be"),
    "name": (GOOD | {"name": ""}, "name must be"),
    "name steers": (GOOD | {"name": "a\x1b[2J"}, "name must be"),
    "name a number": (GOOD | {"name": 3}, "name must be a text"),
    "figures": (GOOD | {"figures": {"a": "b"}}, "figures must be"),
    "missing": ({"name": "oak"}, "plain file name"),
}


@pytest.mark.parametrize("case", BAD_INDEX)
def test_bad_indices_are_refused(case: str) -> None:
    row, message = BAD_INDEX[case]
    content = row
    if isinstance(row, dict) and "format" not in row:
        content = {"format": "hapscene library", "version": 1, "swatches": [row]}
    with pytest.raises(SwatchError, match=message) as caught:
        parse_index(json.dumps(content).encode(), "there")
    assert str(caught.value).startswith("there: ") and len(str(caught.value)) < 300


@pytest.mark.parametrize("data", [b"", b"\xff", b"[" * 100_000, b'{"a": NaN}', b'{"a":1,"a":2}', b"{" * 60_000])
def test_no_index_at_all(data: bytes) -> None:
    with pytest.raises(SwatchError, match="there: not an index"):
        parse_index(data, "there")


def test_two_of_a_name_or_file() -> None:
    for other, what in ((GOOD | {"file": "b.swatch"}, "name"), (GOOD | {"name": "b", "file": "OAK.swatch"}, "file")):
        data = json.dumps({"format": "hapscene library", "version": 1, "swatches": [GOOD, other]}).encode()
        with pytest.raises(SwatchError, match=f"two swatches have one {what}"):
            parse_index(data, "there")


def test_search_by_words_and_bounds() -> None:
    entries = shipped_entries()
    assert {e.name for e in search(entries, [])} == set(shipped_swatches())
    assert [e.name for e in search(entries, ["WOOD", "friction<5"])] == ["wood"]
    grippy = {e.name for e in search(entries, ["friction>=0.35"])}
    assert grippy == {e.name for e in entries if e.figures["friction_dynamic"] >= 0.35}
    assert not search(entries, ["tap_Hz>1e9"])
    with pytest.raises(SwatchError, match=r"no figure 'colour' to search by; there are: .*friction"):
        search(entries, ["colour<3"])
    with pytest.raises(SwatchError, match="expected a number after <"):
        search(entries, ["friction<low"])
    for term in ("friction<", "<0.4", "friction <> 2 3"):
        with pytest.raises(SwatchError, match="a malformed bound"):
            search(entries, [term])


def test_words_follow_the_figures() -> None:
    assert words(figures(Swatch("ice", 5000.0, 0, 0.06, 0.05))) == ["rigid", "slippery"]
    assert words(figures(Swatch("rubber", 100.0, 0, 1.5, 1.2))) == ["very soft", "very grippy"]
    assert figures(Swatch("x", taps=Taps([0.2], [4.0], [90.0], [50.0])))["tap_m_s2"] == pytest.approx(2.0)


def test_the_commands(home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_swatch(OAK, tmp_path / "oak.swatch")
    assert cli.main(["swatch", "list"]) == 0
    assert "is empty" in capsys.readouterr().out
    assert cli.main(["swatch", "add", str(tmp_path / "oak.swatch"), "--name", "oak, oiled"]) == 0
    assert cli.main(["swatch", "list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out.partition("\n")[2])
    assert {row["name"]: row["from"] for row in listed}["oak, oiled"] == "library"
    assert cli.main(["swatch", "show", "oak, oiled"]) == 0
    said = capsys.readouterr().out
    assert "oak, oiled: firm, grippy" in said and "700 N/m" in said and "0.5 static" in said and "0.4 dynamic" in said
    assert "\x1b" not in said and "a board" in said and "MIT" in said
    assert cli.main(["swatch", "search", "oak", "stiffness>600"]) == 0
    assert capsys.readouterr().out.split()[0:2] == ["oak,", "oiled"]
    assert cli.main(["swatch", "search", "marble"]) == 1
    assert cli.main(["swatch", "remove", "oak, oiled"]) == 0
    capsys.readouterr()
    for arguments, message in {
        ("remove", "oak"): "no swatch 'oak'",
        ("add", str(tmp_path / "none.swatch")): "none.swatch: no such file",
        ("add", __file__, __file__, "--name", "x"): "--name is for a single file",
        ("show", "oka"): "no swatch 'oka'",
        ("search", "friction<"): "malformed bound",
    }.items():
        assert cli.main(["swatch", *arguments]) == 2
        assert message in capsys.readouterr().err


def test_a_library_of_its_own_folder(tmp_path: Path, home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_swatch(OAK, tmp_path / "oak.swatch")
    other = str(tmp_path / "other")
    assert cli.main(["swatch", "add", str(tmp_path / "oak.swatch"), "--library", other]) == 0
    assert cli.main(["swatch", "show", "oak", "--library", other]) == 0
    assert not home.exists() and find("oak") is None and find("oak", other) == tmp_path / "other" / "oak.swatch"
    assert library_folder() == home


@pytest.mark.parametrize("name", ["-rf", "-soft", "+10 % stiffer", "日本-soft", "(-)x", "+-"])
def test_a_swatch_of_any_name_leaves_the_library_readable(monkeypatch, tmp_path, name) -> None:
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "library"))
    add(Swatch(name))
    assert [entry.name for entry in own_entries()] == [name]


def test_what_lives_in_a_texture_is_told() -> None:
    wood = load_swatch("wood")
    assert wood.texture is not None
    steady = replace(wood, texture=replace(wood.texture, life=None))
    assert "alive" not in "\n".join(lines(steady))
    life = Life(np.array([0.3, 0.4]), np.array([20.0, 0.0]), np.array([0.0, 300.0]))
    texture = replace(wood.texture, warp=0.5, life=life, exponents=np.array([0.5, 2.0]))
    told = "\n".join(lines(replace(wood, texture=texture)))
    for words_of_it in (
        "warped by 0.5",
        "alive: gain of 4.3 dB spread, forgets 20/s + 0/m, 0/s + 300/m",
        "power as force^0.5 and speed^2, by 10 dB at most (not recorded)",
    ):
        assert words_of_it in told


def test_a_library_knows_tools(home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    probed = replace(OAK, name="probed", tool="steel probe", tip="3.2 mm ball")
    for swatch in (OAK, probed, replace(OAK, name="bare", tool="finger")):
        add(swatch)
    entries = own_entries()
    assert [e.name for e in search(entries, ["tool:Probe"])] == ["probed"]
    assert [e.name for e in search(entries, ["tip:ball", "friction<1"])] == ["probed"]
    assert [e.name for e in search(entries, ["finger"])] == ["bare"] and not search(entries, ["tip:finger"])
    index = json.loads((home / "index.json").read_text(encoding="utf-8"))["swatches"]
    assert ["tool" in row for row in index] == [True, False, True]  # as ever, where nothing is known
    assert cli.main(["swatch", "search", "tool:probe"]) == 0
    assert "(steel probe, 3.2 mm ball)" in capsys.readouterr().out
    assert cli.main(["swatch", "list", "--json"]) == 0
    assert {"steel probe", "finger", ""} == {row["tool"] for row in json.loads(capsys.readouterr().out)}
    assert cli.main(["swatch", "show", "probed"]) == 0
    said = capsys.readouterr().out
    assert "  tool        steel probe\n" in said and "  tip         3.2 mm ball\n" in said
    assert cli.main(["swatch", "compare", "probed", "bare"]) == 0
    assert "touched with different tools (steel probe, 3.2 mm ball; finger)" in capsys.readouterr().out
    assert cli.main(["swatch", "compare", "probed", "oak"]) == 0
    assert "different tools" not in capsys.readouterr().out  # of the other it is not known
    row = index[0] | {"tip": "a\x1b"}
    with pytest.raises(SwatchError, match=r"swatches\[0\]\.tip must be at most 200 printable"):
        parse_index(json.dumps({"format": "hapscene library", "version": 1, "swatches": [row]}).encode(), "x")
