"""The part of docs/benchmark.md that has other renderers beside hapscene, made from the sheet of `side_by_side`."""

from typing import Final

from ..page import Page, shown
from .machine import machine_words
from .sheet import Sheet
from .side_by_side import COLD_TICKS, FLUSH_MB, OURS

AIMS: Final = (("CHAI3D static", 1.3, 1.0), ("CHAI3D dynamic", 2.0, 2.0), ("HAPI", 2.0, 1.0))
"""Least that a renderer's time may be over hapscene's contact and over its whole tick, hot, in every case [times]."""

METHOD: Final = f"""The same meshes and paths, one machine, one run. In each round every renderer runs every case in a
process of its own, in an order that turns by one from round to round. Hot: each tick's least time of five runs after
one to warm up. Cold: {COLD_TICKS} ticks from the middle of the path on, once, with {FLUSH_MB} MiB rewritten before
each. Ticks count in which a renderer and hapscene both are in contact. Numbers are medians of the rounds; ratios are of
each round's own numbers, the other renderer's time over hapscene's, with the least–greatest of the rounds, in bold
where hapscene is the slower."""

UNFAIR: Final = """### What is unfair
- CHAI3D: timed is `cAlgorithmFingerProxy::computeForces`, proxy and force; not what an application does besides (global
  positions, tool, potential fields). HAPI: `GodObjectRenderer::renderHapticsOneStep`, proxy, force of a smooth surface,
  list of contacts, its locks. hapscene's contact is the proxy without its force; its whole tick adds the description of
  the touch, the wall, mixing, limits, a noted row and ten samples of acceleration. A fair figure lies between the two.
  Two reads of the clock are part of every time.
- The answers differ. "CHAI3D static", its default, solves one constraint a tick and gets 5 of 37 cases with known
  answers right; "CHAI3D dynamic", its mode for moving objects, 32; HAPI 28; hapscene 37. HAPI loses contact on half of
  the bunny's path.
- CHAI3D runs at 20 units a metre, as in its examples: in metres it is blind to triangles under 0.16 mm².
- hapscene's larger arrays lie in huge pages where the system gives them; `--huge` has glibc ask for them for all.
- hapscene's time to build is a whole `Renderer`'s in a new process, compiled code read from the cache; the others' is
  their tree's alone.
"""

FORMATS: Final = """### A driver for another renderer
None comes with hapscene. `BUILD` holds `chai_path`, `hapi_path`, or both: programs without a device around CHAI3D 3.3.0
(github.com/chai3d/chai3d) and HAPI 1.3.1 (github.com/ChristianFrisson/HAPI and its H3DUtil), compiled with `-O3
-march=native`; on Debian with git, cmake, g++, libgl1-mesa-dev and libglu1-mesa-dev. Each is called as

    PROGRAM MESH PATH OUT [--mode static|dynamic --scale UNITS_PER_M] [--repeats N] [--cold-first TICK --flush-mb MIB]

| little-endian | holds |
| --- | --- |
| MESH | two int64, how many vertices and how many faces; float64 (vertices, 3) [m]; int32 (faces, 3) |
| PATH | float64 (ticks, 3) [m]: the tool's position, a row a tick |
| OUT | float64 (ticks, 8): proxy 3 [m], force 3, 1 in contact or 0, time [ns] |

It prints a line `build_ms NUMBER`, the time from a mesh in memory to a tree that can be searched, and ends with 0; else
the last line of its standard error says why. It runs the path once to warm up and then N times, each time by a new
proxy at the path's first position; between two reads of a monotonic clock stands the call alone, and each tick's least
time counts. With `--cold-first` it runs once, hot up to that tick; from there on a word of each line of 64 bytes of a
buffer is rewritten before each tick. CHAI3D: a `cMultiMesh` in a `cWorld` with `createAABBCollisionDetector`, a
`cAlgorithmFingerProxy` of radius 0, in the mode `dynamic` with `m_useDynamicProxy`. HAPI: a `HapticTriangleTree` over
an `AABBTree`, front sides, a smooth `FrictionSurface`, a `GodObjectRenderer`.
"""


def add_peers(page: Page, sheet: Sheet | None) -> None:
    """Add the part of the page; without a sheet its text, and the command that makes the tables."""
    page.heading("Side by side with other renderers")
    page.text(f"Made by `python -m hapscene_evidence.bench.run BUILD docs`. {METHOD}")
    if sheet is None:
        page.text("No table has been made yet.")
    else:
        hot, cold = (sheet.number("method", f"{kind} rounds") for kind in ("hot", "cold"))
        how = f"Rounds: {hot:g} hot, {cold:g} cold; huge pages: {sheet.text('method', 'huge pages')}."
        page.text(f"Machine: {'; '.join(machine_words(sheet))}. {how} All figures are in peers.csv beside the charts.")
        _add_aims(page, sheet)
        for kind in ("hot", "cold"):
            if sheet.cases(f"{kind}, "):
                _add_tables(page, sheet, kind)
    page.markdown_only(UNFAIR)
    page.markdown_only(FORMATS)


def _add_aims(page: Page, sheet: Sheet) -> None:
    """The least ratio of all cases, median and p99, beside what is aimed at."""
    rows = []
    for peer, *aims in AIMS:
        for what, aim in zip(("contact", "tick"), aims, strict=True):
            cases = [case for case in sheet.cases("hot, ") if case.endswith(f", {peer}")]
            found = [(sheet.number(c, f"over {what} {q}"), c, q) for c in cases for q in ("median", "p99")]
            if found:
                ratio, case, quantile = min(found)
                held = "yes" if ratio >= aim else "**no**"
                where = f"{case.split(', ')[1]}, {quantile}"
                rows.append((f"{peer} over {what}", f"≥ {aim:g}", f"{ratio:.2f}", where, held))
    if rows:
        page.table(("hot, every case, median and p99", "aim", "least", "at", "held"), rows)


def _add_tables(page: Page, sheet: Sheet, kind: str) -> None:
    """Times, ratios, and whether they are of the same work."""
    keys = [case.split(", ")[1:] for case in sheet.cases(f"{kind}, ")]
    cases, names = (list(dict.fromkeys(found)) for found in zip(*keys, strict=True))
    peers = names[1:]

    def pair(case: str, name: str, what: str) -> str:
        return " / ".join(shown(sheet.number(f"{kind}, {case}, {name}", f"{what} {q}")) for q in ("median", "p99"))

    def ratio(case: str, peer: str, what: str) -> str:
        ends = ("", ", least", ", greatest")
        middle, least, most = (sheet.number(f"{kind}, {case}, {peer}", what + end) for end in ends)
        return (f"**{middle:.2f}**" if middle < 1.0 else f"{middle:.2f}") + f" ({least:.2f}–{most:.2f})"

    def work(case: str, name: str) -> str:
        ticks, build_ms = (sheet.number(f"{kind}, {case}, {name}", what) for what in ("ticks in contact", "build"))
        away = "" if name == OURS else f"{pair(case, name, 'proxy away')}; "
        return f"{ticks:,.0f}; {away}{build_ms:,.0f}"

    page.text(f"{kind.capitalize()}, median / p99 [µs]:")
    columns = [(OURS, "contact"), (OURS, "tick"), *((peer, "contact") for peer in peers)]
    head = ("", "hapscene, contact", "hapscene, whole tick", *peers)
    page.table(head, [(case, *(pair(case, *column) for column in columns)) for case in cases])
    head = ("", *(f"{peer}, {q}" for peer in peers for q in ("median", "p99")))
    for what in ("contact", "tick"):
        page.text(f"{kind.capitalize()}, over hapscene's {'whole ' * (what == 'tick')}{what} [times]:")
        columns = [(peer, f"over {what} {q}") for peer in peers for q in ("median", "p99")]
        page.table(head, [(case, *(ratio(case, *column) for column in columns)) for case in cases])
    page.text(f"{kind.capitalize()}, ticks in contact; proxy from hapscene's, median / p99 [µm]; build [ms]:")
    page.table(("", *names), [(case, *(work(case, name) for name in names)) for case in cases])
