"""Comparison with other renderers: file formats, order of runs and tables, with a fake renderer."""

import re
import sys
from pathlib import Path

import pytest

from hapscene_evidence.bench.case import RADIUS_M, sphere_cases
from hapscene_evidence.bench.sheet import Sheet
from hapscene_evidence.bench.side_by_side import OURS, add_peers, find_drivers, measure
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
"""A fake renderer of the round sphere that reports 1 ms or 0."""


def section(sheet: Sheet | None) -> str:
    page = Page("")
    add_peers(page, sheet, ())
    return page.markdown(Path())


def build(folder: Path, name: str = "chai_path", text: str = PEER) -> Path:
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)
    return folder


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> Sheet:
    """Two fake renderers and hapscene on a small sphere, two rounds hot and one cold."""
    drivers = find_drivers(build(tmp_path_factory.mktemp("build")))
    return measure(drivers, sphere_cases((3,), 600), 2, 1, lambda _: None)


def test_all_renderers_run_all_cases(sheet: Sheet) -> None:
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
    assert page.count("\n| sphere 1 k | ") == 2 and "HAPI /" not in page and "nan" not in page
    assert "| CHAI3D static / hapscene's tick | ≥ 1 | 0.00 | sphere 1 k, median | **no** |" in page
    assert re.search(r"'s contact \| ≥ 2 \| \d+\.\d\d \| sphere 1 k, p99 \| yes \|", page)
    sheet.write(tmp_path / "peers.csv")
    assert section(Sheet.read(tmp_path / "peers.csv")).count("|") == page.count("|")
    assert "Not measured." in section(None)
