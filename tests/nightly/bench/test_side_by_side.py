"""Other renderers beside hapscene: formats, turns and tables, with a program that speaks the format and no more."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene_evidence.bench.case import RADIUS_M, sphere_cases
from hapscene_evidence.bench.run import bench_peers
from hapscene_evidence.bench.sheet import Sheet
from hapscene_evidence.bench.side_by_side import OURS, Turn, beside, find_cases, find_drivers, measure
from hapscene_evidence.bench.side_by_side_page import add_peers
from hapscene_evidence.page import Page

PEER = f"""#!{sys.executable}
import struct, sys
mesh, path, out, *words = sys.argv[1:]
options = dict(zip(words[::2], words[1::2]))
data = open(mesh, "rb").read()
vertices, faces = struct.unpack_from("<qq", data)
assert len(data) == 16 + 24 * vertices + 12 * faces
assert max(struct.unpack_from("<%di" % (3 * faces), data, 16 + 24 * vertices)) == vertices - 1
first = int(options.get("--cold-first", -1))
assert options["--repeats"] == "5" if first < 0 else options["--flush-mb"] == "64"
with open(out, "wb") as file:
    for k, p in enumerate(struct.iter_unpack("<3d", open(path, "rb").read())):
        far = sum(x * x for x in p) ** 0.5
        on = far < {RADIUS_M}
        proxy = [x * {RADIUS_M} / far if on else x for x in p]
        time_ns = 1e6 if options.get("--mode") == "dynamic" or k < first else 0.0
        file.write(struct.pack("<8d", *proxy, 0.0, 0.0, 0.0, on, time_ns))
print("build_ms 3.5")
"""
"""A renderer of the round sphere, which takes 1 ms, or no time."""


def section(sheet: Sheet | None) -> str:
    page = Page("")
    add_peers(page, sheet)
    return page.markdown(Path())


def build(folder: Path, name: str = "chai_path", text: str = PEER) -> Path:
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)
    return folder


def test_cases_have_names() -> None:
    assert [case.name for case in find_cases(["20k", "1k"], None, 100)] == ["sphere 20 k", "sphere 1 k"]
    with pytest.raises(HapsceneError, match=r"no case '1.3M'; did you mean '1.31M'\?; there are: 1k, "):
        find_cases(["1.3M"], None, 100)
    with pytest.raises(HapsceneError, match="--zoo"):
        find_cases(["bunny"], None, 100)


def test_ratios_are_of_ticks_in_which_both_are_in_contact() -> None:
    ours, theirs = np.zeros((4, 9)), np.zeros((4, 8))
    ours[:, 6:], theirs[:, 6:] = (1, 1000, 2000), (1, 3000)
    ours[0, 6] = theirs[3, 6] = 0
    ours[0, 7], theirs[3, 7], theirs[2, 0] = 1e9, 1e9, 2e-6
    found = beside(Turn(theirs, 7.0), Turn(ours, 9.0))
    assert found["over contact median"] == found["over contact p99"] == 3.0 and found["over tick p99"] == 1.5
    assert found["build"] == 7.0 and found["ticks in contact"] == 3
    assert found["contact p99"] == 3.0 and found["proxy away p99"] == pytest.approx(2.0)
    theirs[:, 6] = 0
    assert np.isnan(beside(Turn(theirs, 7.0), Turn(ours, 9.0))["over contact p99"])


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Sheet:
    """Two renderers beside hapscene on a small sphere, two rounds hot and one cold."""
    drivers = find_drivers(build(tmp_path_factory.mktemp("build")))
    return measure(drivers, sphere_cases((3,), 600), 2, 1, False, lambda _: None)


def test_everybody_takes_turns(sheet: Sheet) -> None:
    for kind in ("hot", "cold"):
        ours, static, dynamic = sheet.cases(f"{kind}, ")
        assert ours == f"{kind}, sphere 1 k, {OURS}"
        assert (sheet.number(static, "contact p99"), sheet.number(dynamic, "contact median")) == (0.0, 1000.0)
        assert 0.0 < sheet.number(ours, "contact median") < sheet.number(ours, "tick median")
        ratio, least, most = (sheet.number(dynamic, f"over contact median{e}") for e in ("", ", least", ", greatest"))
        assert least <= ratio <= most and ratio > sheet.number(dynamic, "over tick median")
        assert sheet.number(static, "build") == 3.5
        assert sheet.number(static, "proxy away p99") < 1e3
        assert 100 < sheet.number(ours, "ticks in contact") <= (600 if kind == "hot" else 300)


def test_page_is_the_same_from_the_file(sheet: Sheet, tmp_path: Path) -> None:
    page = section(sheet)
    assert page.count("\n| sphere 1 k | ") == 8 and "HAPI over" not in page and "nan" not in page
    assert "| CHAI3D static over tick | ≥ 1 | 0.00 | sphere 1 k, median | **no** |" in page
    assert page.count("**0.00** (0.00–0.00)") == 8 and re.search(
        r"over contact \| ≥ 2 \| \d+\.\d\d \| sphere 1 k, p99 \| yes \|", page
    )
    sheet.write(tmp_path / "peers.csv")
    assert section(Sheet.read(tmp_path / "peers.csv")).count("|") == page.count("|")
    assert "No table has been made yet" in section(None)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("sys.exit('it cannot')", "it cannot"),
        ("os._exit(3)", "it ended with 3"),
        ("", "it wrote 0 bytes, expected 400 ticks of 8 numbers"),
        ("open(sys.argv[3], 'wb').write(bytes(400 * 64))", "it printed no line build_ms"),
    ],
)
def test_what_a_program_does_wrong_is_told(tmp_path: Path, text: str, told: str) -> None:
    drivers = find_drivers(build(tmp_path, "hapi_path", f"#!{sys.executable}\nimport os, sys\n{text}\n"))
    del drivers[OURS]
    with pytest.raises(HapsceneError, match=rf"HAPI on sphere 0 k .*: {told}"):
        measure(drivers, sphere_cases((1,), 400), 1, 0, False, lambda _: None)


def test_without_programs_it_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(HapsceneError, match=r"docs/benchmark\.md, "):
        bench_peers(tmp_path, tmp_path / "out", True, None, None, (), (1, 0), False)
    assert not (tmp_path / "out").exists()


def test_peers_write_table_and_page(tmp_path: Path) -> None:
    out = tmp_path / "out"
    bench_peers(build(tmp_path, "hapi_path"), out, True, None, None, ("1k",), (1, 0), False)
    assert sorted(file.name for file in out.iterdir()) == ["peers.csv", "peers.md"]
    assert Sheet.read(out / "peers.csv").number("hot, sphere 1 k, HAPI", "contact median") == 0.0
    assert "| HAPI over contact |" in (out / "peers.md").read_text(encoding="utf-8")
