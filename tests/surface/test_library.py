"""The library: a folder with an index, beside the shipped swatches."""

import gzip
import hashlib
import json
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene import cli
from hapscene.dsp.ar_filter import ar_from_reflection
from hapscene.errors import SwatchError
from hapscene.surface import library
from hapscene.surface.library import (
    add,
    find,
    get,
    library_folder,
    load_swatch,
    own_entries,
    parse_index,
    read_index,
    remove,
    search,
    shipped_entries,
    shipped_swatches,
)
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import save_swatch, swatch_to_json
from hapscene.surface.swatch_summary import figures, words
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture

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
    "version": ({"format": "hapscene library", "version": 2}, "version must be 1"),
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
    assert cli.main(["swatch", "show", "wood", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["figures"]["rate_Hz"] == 10000
    assert cli.main(["swatch", "search", "oak", "stiffness>600"]) == 0
    assert capsys.readouterr().out.split()[0:2] == ["oak,", "oiled"]
    assert cli.main(["swatch", "search", "marble"]) == 1
    assert cli.main(["swatch", "remove", "oak, oiled"]) == 0
    capsys.readouterr()
    for arguments, message in {
        ("remove", "oak"): "no swatch 'oak'",
        ("add", str(tmp_path / "none.swatch")): "none.swatch: cannot be read",
        ("add", "a.swatch", "b.swatch", "--name", "x"): "--name is for a single file",
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


# Swatches fetched from a real server on this machine that cuts off, lies and bombs.


def oak() -> Swatch:
    rng = np.random.default_rng(0)
    a = ar_from_reflection(rng.uniform(-0.5, 0.5, (30, 60)))
    texture = Texture.from_models(1e4, rng.uniform(1, 2, 30), rng.uniform(0.1, 0.2, 30), a, rng.uniform(0, 1, 30))
    return Swatch("oak", texture=texture, licence="MIT")


class Server:
    """A web server whose answers a test can bend; `files` by name, `bend` by name, `asked` what came in."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.bend: dict[str, Callable[[Any, bytes], None]] = {}
        self.asked: list[tuple[str, str | None]] = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                name = self.path.lstrip("/")
                outer.asked.append((name, self.headers.get("Range")))
                data = outer.files.get(name)
                if data is None:
                    self.send_error(404)
                elif name in outer.bend:
                    outer.bend[name](self, data)
                else:
                    send(self, data)

            def log_message(self, *arguments: object) -> None:
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.http.server_address[1]}/"

    def publish(self, name: str, data: bytes, **changes: object) -> None:
        """Puts a file up and an index that names it."""
        file = f"{name}.swatch"
        self.files[file] = data
        row = {"name": name, "file": file, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)} | changes
        content = {"format": "hapscene library", "version": 1, "swatches": [row]}
        self.files["index.json"] = json.dumps(content).encode()


def send(handler: Any, data: bytes, code: int = 200, length: int | None = None, **headers: str) -> None:
    handler.send_response(code)
    handler.send_header("Content-Length", str(len(data) if length is None else length))
    for key, value in headers.items():
        handler.send_header(key.replace("_", "-"), value)
    handler.end_headers()
    handler.wfile.write(data)


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    thread = threading.Thread(target=server.http.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server
    server.http.shutdown()
    thread.join()
    server.http.server_close()


@pytest.fixture(autouse=True)
def home_fetch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "home_fetch"))
    return tmp_path / "home_fetch"


def fetched(server: Server, name: str = "oak") -> Swatch:
    address, entries = read_index(server.url)
    get(name, address, entries)
    return load_swatch(name)


DATA = swatch_to_json(oak()).encode()


def test_what_is_published_comes_whole(server: Server, home_fetch: Path) -> None:
    server.publish("oak", DATA)
    assert fetched(server) == oak()
    assert sorted(f.name for f in home_fetch.iterdir()) == ["index.json", "oak.swatch"]
    assert (home_fetch / "oak.swatch").read_bytes() == DATA


def test_a_library_folder_is_a_server(server: Server, home_fetch: Path, tmp_path: Path) -> None:
    entry = add(oak(), tmp_path / "published")
    for name in ("index.json", entry.file):
        server.files[name] = (tmp_path / "published" / name).read_bytes()
    assert fetched(server) == oak()


def cut(after: int, resumable: bool, times: int) -> Callable[[Any, bytes], None]:
    """A transfer that breaks off after so many bytes, so many times."""
    left = [times]

    def bend(handler: Any, data: bytes) -> None:
        wanted = handler.headers.get("Range")
        start = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted and resumable else 0
        rest = data[start:]
        code, headers = (206, {"Content_Range": f"bytes {start}-{len(data) - 1}/{len(data)}"}) if start else (200, {})
        left[0] -= 1
        send(handler, rest[:after] if left[0] >= 0 else rest, code, len(rest), **headers)

    return bend


def test_a_transfer_that_breaks_off_is_taken_up(server: Server) -> None:
    server.publish("oak", DATA)
    server.bend["oak.swatch"] = cut(7000, resumable=True, times=3)
    assert fetched(server) == oak()
    assert [r for name, r in server.asked if name == "oak.swatch"] == [
        None,
        "bytes=7000-",
        "bytes=14000-",
        "bytes=21000-",
    ]


def test_or_begun_again_where_the_server_cannot(server: Server) -> None:
    server.publish("oak", DATA)
    server.bend["oak.swatch"] = cut(7000, resumable=False, times=3)
    assert fetched(server) == oak()


def test_what_broke_off_for_good_is_taken_up_by_a_later_call(server: Server, home_fetch: Path) -> None:
    server.publish("oak", DATA)
    server.bend["oak.swatch"] = cut(1000, resumable=True, times=library.TRIES)
    with pytest.raises(SwatchError, match="cannot be fetched"):
        fetched(server)
    assert own_entries() == [] and not (home_fetch / "oak.swatch").exists()
    assert fetched(server) == oak()
    assert server.asked[-1] == ("oak.swatch", f"bytes={1000 * library.TRIES}-")
    assert sorted(f.name for f in home_fetch.iterdir()) == ["index.json", "oak.swatch"]


def refused(server: Server, home_fetch: Path, message: str, name: str = "oak") -> None:
    """It is refused, and the library is as it was."""
    with pytest.raises(SwatchError, match=message):
        fetched(server, name)
    assert own_entries() == []
    assert not home_fetch.exists() or not [f for f in home_fetch.iterdir() if f.suffix != ".part"]


def test_truncated_files_are_refused(server: Server, home_fetch: Path) -> None:
    server.publish("oak", DATA)
    server.files["oak.swatch"] = DATA[:-100]
    refused(server, home_fetch, "shorter than")


def test_other_content_is_refused(server: Server, home_fetch: Path) -> None:
    server.publish("oak", DATA)
    server.files["oak.swatch"] = DATA.replace(b"MIT", b"BSD")
    refused(server, home_fetch, r"not what the index says \(sha256\)")
    server.files["oak.swatch"] = DATA  # and what was refused does not stay in the way
    assert fetched(server) == oak()


def test_a_file_that_is_changed_between_the_halves_is_refused(server: Server, home_fetch: Path) -> None:
    server.publish("oak", DATA)
    first = cut(7000, resumable=True, times=1)

    def bend(handler: Any, data: bytes) -> None:
        first(handler, data if handler.headers.get("Range") is None else data.upper())

    server.bend["oak.swatch"] = bend
    refused(server, home_fetch, "sha256")


def test_more_than_the_index_says_is_not_taken(server: Server, home_fetch: Path) -> None:
    server.publish("oak", DATA)

    def endless(handler: Any, data: bytes) -> None:
        handler.send_response(200)
        handler.end_headers()
        try:
            for _ in range(1000):
                handler.wfile.write(b" " * 100_000)
        except OSError:
            server.asked.append(("hung up", None))

    server.bend["oak.swatch"] = endless
    refused(server, home_fetch, f"longer than {len(DATA)} bytes")


def test_a_bomb_of_zeros_is_not_unpacked(server: Server, home_fetch: Path) -> None:
    bomb = gzip.compress(b" " * (64 << 20))
    server.publish("oak", DATA)
    server.bend["oak.swatch"] = lambda handler, data: send(handler, bomb, Content_Encoding="gzip")
    refused(server, home_fetch, "compressed")
    server.publish("oak", bomb)  # as a file of its own it is no swatch
    del server.bend["oak.swatch"]
    refused(server, home_fetch, "not a swatch")
    server.bend["index.json"] = lambda handler, data: send(handler, bomb, Content_Encoding="gzip")
    refused(server, home_fetch, "compressed")


HEAD = b'{"format": "hapscene swatch", "version": 1, "name": "oak"'
MALICIOUS = {
    "huge array": (HEAD + b', "albedo_rgb": [' + b"1," * 3_000_000 + b"1]}", "more than the 2500000"),
    "nan": (DATA.replace(b'"rate_Hz": 10000.0', b'"rate_Hz": NaN'), "NaN is no number"),
    "infinity": (DATA.replace(b'"rate_Hz": 10000.0', b'"rate_Hz": 1e999'), "finite number"),
    "deep": (HEAD + b', "texture": ' + b"[" * 49_000, "not a swatch"),
    "deeper": (b"[" * 1_000_000, "not a swatch"),
    "huge integer": (HEAD + b', "stiffness_N_m": ' + b"9" * 4000 + b"}", "finite number"),
    "pickle": (
        b"\x80\x04\x95\x10\x00\x00\x00\x00\x00\x00\x00\x8c\x02os\x94\x8c\x06system\x94\x93\x94.",
        "not a swatch",
    ),
    "another name": (DATA.replace(b'"name": "oak"', b'"name": "elm"'), "calls itself 'elm'"),
    "surrogate": (HEAD + b', "licence": "\\ud800"}', "licence must be a text"),
    "empty text": (b" ", "not a swatch"),
}


@pytest.mark.parametrize("case", MALICIOUS)
def test_malicious_files_with_the_right_hash_are_refused(server: Server, home_fetch: Path, case: str) -> None:
    data, message = MALICIOUS[case]
    server.publish("oak", data)
    refused(server, home_fetch, message)


@pytest.mark.parametrize(
    "file", ["../oak.swatch", "/tmp/oak.swatch", "a/../../oak.swatch", "..\\oak.swatch", "oak.exe"]
)
def test_no_name_leads_out_of_the_folder(server: Server, home_fetch: Path, tmp_path: Path, file: str) -> None:
    server.publish("oak", DATA, file=file)
    refused(server, home_fetch, "plain file name")
    assert not list(tmp_path.rglob("*.swatch"))


def test_a_planted_link_is_not_followed(server: Server, home_fetch: Path, tmp_path: Path) -> None:
    server.publish("oak", DATA)
    digest = hashlib.sha256(DATA).hexdigest()
    (tmp_path / "elsewhere").write_text("stays")
    home_fetch.mkdir()
    for name in (f".{digest}.part", f".{digest}.whole", "oak.swatch"):
        (home_fetch / name).symlink_to(tmp_path / "elsewhere")
    assert fetched(server) == oak()
    assert (tmp_path / "elsewhere").read_text() == "stays"


def test_answers_that_are_none(server: Server, home_fetch: Path) -> None:
    with pytest.raises(SwatchError, match="the server says 404"):
        read_index(server.url)
    server.files["index.json"] = b"<html>"
    with pytest.raises(SwatchError, match=r"index\.json: not an index of swatches"):
        read_index(server.url + "index.json")
    server.publish("oak", DATA)
    refused(server, home_fetch, "no swatch 'elm'; there are: oak at http", "elm")
    del server.files["oak.swatch"]
    refused(server, home_fetch, "the server says 404")
    for url in ("file:///etc/passwd", "ftp://x/y", "oak", "http://"):
        with pytest.raises(SwatchError, match="is no address"):
            read_index(url)
    server.http.shutdown()
    server.http.server_close()
    with pytest.raises(SwatchError, match="cannot be fetched"):
        read_index(server.url)


def test_the_command(server: Server, home_fetch: Path, capsys: pytest.CaptureFixture[str]) -> None:
    server.publish("oak", DATA)
    assert cli.main(["swatch", "get", "--from", server.url]) == 0
    assert "oak" in capsys.readouterr().out and not home_fetch.exists()
    assert cli.main(["swatch", "get", "oak", "elm", "--from", server.url]) == 2
    said = capsys.readouterr()
    assert "oak.swatch" in said.out and "no swatch 'elm'" in said.err and load_swatch("oak") == oak()
    assert cli.main(["swatch", "get", "--all", "--from", server.url]) == 2
    assert "in the library already" in capsys.readouterr().err
    assert cli.main(["swatch", "get", "--all", "--replace", "--from", server.url]) == 0
