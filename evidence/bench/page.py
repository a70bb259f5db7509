"""docs/benchmark.md, made from a sheet: no figure on it is copied by hand."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from hapscene.render.renderer import EFFECTS

from ..page import Page, shown
from .handle import FIRM, PLANTS, SIGNALS, SPREAD
from .machine import machine_words
from .order import ORDERS
from .sheet import QUANTILES, Sheet
from .side_by_side_page import add_peers

AIMS: Final = (  # description, case, figure, upper bound, unit
    ("contact, 1 k triangles, median", "sphere 1 k", "contact median", 0.65, "µs"),
    ("contact, 82 k triangles, median", "sphere 82 k", "contact median", 0.8, "µs"),
    ("contact, 1.31 M triangles, median", "sphere 1.31 M", "contact median", 0.9, "µs"),
    ("contact, 1.31 M triangles, p99", "sphere 1.31 M", "contact p99", 2.5, "µs"),
    ("whole tick, five effects, order 40, median", "tick, order 40", "tick median", 6.0, "µs"),
    ("harness of the effect calls", "harness", "four idle effects median", 0.3, "µs"),
    ("`run()` of a 10 s path, five effects, order 40", "tick, order 40", "run for 10 s of path", 0.15, "s"),
    ("`step()` from Python over the tick", "tick, order 40", "step over the tick median", 5.0, "µs"),
    ("`step()` with 1 body that moves", "moving 1", "step with bound bodies", 6.0, "µs"),
    ("`step()` with 100 bodies that move", "moving 100", "step with bound bodies", 20.0, "µs"),
    ("`step()` with 1,000 bodies that move", "moving 1000", "step with bound bodies", 120.0, "µs"),
    ("another shape of 20 k triangles, median", "shapes 20 k", "deform median", 1e3 / 60, "ms"),
    ("p99 of a tick, shapes at 60 Hz to none", "shapes 20 k", "tick p99, changing to at rest", 1.2, "times"),
    ("synthesis of 10 s at 10 kHz, order 40", "synthesis, order 40", "nine models for 10 s", 0.02, "s"),
    (
        "the same with a slow gain, over `lfilter`",
        "synthesis, order 40",
        "nine models, alive over lfilter",
        3.0,
        "times",
    ),
    ("fit of a swatch to 10 s at 10 kHz", "fit, 10 s", "time", 3.0, "s"),
    ("fit of a swatch to 600 s at 10 kHz", "fit, 600 s", "time", 30.0, "s"),
    ("its memory over the recording's", "fit, 600 s", "memory", 3.0, "times"),
    ("closed loop: hand, Omni, handle, five effects", "twin, Omni, handle", "tick", 20.0, "µs"),
    ("`import hapscene`", "start", "import hapscene", 0.5, "s"),
    ("load of 82 k triangles to the first tick, warm cache", "start", "sphere 82 k, load to first tick", 3.0, "s"),
    ("load of 1.31 M triangles to the first tick, warm cache", "start", "sphere 1.31 M, load to first tick", 2.5, "s"),
    ("the same from a binary STL", "start", "sphere 1.31 M, STL, load to first tick", 2.5, "s"),
    ("building 1.31 M triangles, from memory", "sphere 1.31 M", "build", 600.0, "ms"),
    ("memory of a triangle of them", "sphere 1.31 M", "memory a triangle", 200.0, "B"),
)


def page_of(sheet: Sheet, pictures: Path, peers: Sheet | None = None) -> Page:
    """The page; `pictures` is the folder of the charts, `peers` the sheet of other renderers side by side."""
    page = Page("Benchmark: speed and accuracy, one charted against the other")
    page.text("Made by `hapscene lab bench --docs docs`; hapscene's figures are from bench.csv beside the charts.")
    page.text(f"Machine: {'; '.join(machine_words(sheet))}.")
    page.text(
        f"""Method: icospheres of 50 mm radius; the tool approaches, presses 2 mm, slides at 0.1 m/s with wiggling depth
        and leaves, {shown(sheet.number("method", "path"))} s at 1 kHz. Times are read inside the tick
        (`Recording.contact_ns`, `tick_ns`); each tick's is the least of {shown(sheet.number("method", "hot runs"))} hot
        runs after one to warm up; only ticks in contact count. Two reads of the clock are
        {shown(sheet.number("clock", "between two reads median"))} ns apart, which is part of every time here. Four
        figures with slashes are median / p99 / p99.9 / max."""
    )
    for add in (_aims, _contact, _tick, _start, _accuracy, _synthesis, _twin, _handle, _crowd):
        add(page, sheet, pictures)
        if add is _contact:
            add_peers(page, peers)
    return page


def _quantiles(sheet: Sheet, case: str, name: str, quantiles: Iterable[str] = QUANTILES, scale: float = 1.0) -> str:
    """Median / p99 / p99.9 / max, or those named."""
    return " / ".join(shown(scale * sheet.number(case, f"{name} {quantile}")) for quantile in quantiles)


def _figures(sheet: Sheet, case: str, names: Sequence[str], scale: float = 1.0) -> list[str]:
    """Figures as shown; empty where the sheet has none."""
    return [shown(scale * sheet.number(case, name)) if (case, name) in sheet else "" for name in names]


def _aims(page: Page, sheet: Sheet, pictures: Path) -> None:
    rows = []
    for what, case, name, most, unit in AIMS:
        if (case, name) in sheet:
            value = sheet.number(case, name)
            rows.append((what, f"≤ {most:g} {unit}", f"{shown(value)} {unit}", "yes" if value <= most else "**no**"))
    page.heading("Aims")
    page.table(("", "aim", "measured", "held"), rows)


def _contact(page: Page, sheet: Sheet, pictures: Path) -> None:
    rows = []
    for case in (*sheet.cases("sphere "), *sheet.cases("zoo ")):
        if (case, "triangles") in sheet:
            count = f"{sheet.number(case, 'triangles'):,.0f}"
            rows.append((case, count, _quantiles(sheet, case, "contact"), shown(sheet.number(case, "build"))))
    page.heading("Contact")
    page.picture(pictures / "speed.png", "Contact time over mesh size, and tick time over order")
    page.table(("case", "triangles", "contact [µs]", "build [ms]"), rows)


def _tick(page: Page, sheet: Sheet, pictures: Path) -> None:
    rows = []
    for order in ORDERS:
        case = f"tick, order {order}"
        over = _figures(sheet, case, ("contact median", "step over the tick median"))
        run = _figures(sheet, case, ("run for 10 s of path",), 1e3)
        rows.append((str(order), _quantiles(sheet, case, "tick"), *over, *run))
    head = ("order", "tick [µs]", "its contact part, median [µs]", "`step` over the tick [µs]", "`run` of 10 s [ms]")
    harness = shown(1e3 * sheet.number("harness", "four idle effects median"))
    bare = shown(sheet.number("harness", "tick without effects median"))
    page.heading("The whole tick")
    page.text("""Wall, friction, texture and tap on 82 k triangles; 10 acceleration samples a tick. The textures are the
        shipped wood's, played for 10 s at 1 N and 0.1 m/s and fitted again at each order.""")
    page.table(head, rows)
    page.text(f"""A tick without effects takes {bare} µs; calling five effects that do nothing adds {harness} ns. Mean
        time that each effect by itself adds to a tick without effects:""")
    page.table(EFFECTS, [[f"{ns} ns" for ns in _figures(sheet, "profile", EFFECTS)]])


def _start(page: Page, sheet: Sheet, pictures: Path) -> None:
    imported, ready = _figures(sheet, "start", ("import hapscene", "sphere 82 k, load to first tick"))
    page.heading("Start")
    page.text(f"""In a new process, from a warm cache: `import hapscene` {imported} s; from there to the first tick of a
        saved scene of 82 k triangles {ready} s.""")


_DISTANCES: Final = ("facets", "closest point", "round surface")


def _accuracy(page: Page, sheet: Sheet, pictures: Path) -> None:
    rows = []
    for case in sheet.cases("sphere "):
        if (case, "force direction error median") in sheet:
            direction = _quantiles(sheet, case, "force direction error", ("median", "p99"))
            away = [_quantiles(sheet, case, f"proxy to {what}", ("p99", "max"), 1e6) for what in _DISTANCES]
            rows.append((case, shown(sheet.number(case, "contact median")), direction, *away))
    head = (
        "case",
        "contact, median [µs]",
        "force to sphere's normal, median / p99 [°]",
        "proxy to facets, p99 / max [µm]",
        "to the closest point, p99 / max [µm]",
        "to the round sphere, p99 / max [µm]",
    )
    page.heading("Accuracy against time")
    page.picture(pictures / "accuracy.png", "Direction error and gap against contact time")
    page.table(head, rows)
    page.text("""The direction of the force is off the sphere's normal by as much as the facets are: a finer mesh buys
        accuracy, at the price of time. Off the facets the proxy is by rounding; where it crosses an edge, for a tick,
        by up to its skin (5e-6 of the mesh's diagonal) times the sine of the edge's angle.""")


def _synthesis(page: Page, sheet: Sheet, pictures: Path) -> None:
    rows = []
    for case in sheet.cases("synthesis, order "):
        for what in ("one model", "nine models", "nine models, alive"):
            if (case, f"{what} for 10 s") in sheet:
                taken_s, filter_s = (sheet.number(case, f"{method} for 10 s") for method in (what, "lfilter"))
                times = (f"{10.0 / taken_s:,.0f}", f"{10.0 / filter_s:,.0f}", shown(taken_s / filter_s))
                rows.append((what, case.removeprefix("synthesis, order "), *times))
    head = ("texture", "order", "`synthesize`, times real time", "`lfilter`, times real time", "time over `lfilter`'s")
    page.heading("Synthesis")
    page.text("""10 s at 10 kHz along a stroke through the swatch's forces and speeds, best of seven runs. `synthesize`
        makes the noise, looks up and blends the models and filters; `scipy.signal.lfilter` only filters noise that is
        there, with one fixed filter at a fixed level.""")
    page.table(head, rows)


def _twin(page: Page, sheet: Sheet, pictures: Path) -> None:
    rows = [
        (
            case.removeprefix("twin, "),
            f"{sheet.number(case, 'times real time'):,.0f}",
            *_figures(sheet, case, ("tick", "rendering median")),
        )
        for case in sheet.cases("twin, ")
    ]
    page.heading("The twin in closed loop")
    page.text("""A hand that scrubs wood, five effects, 1 kHz force and 10 kHz acceleration, the device and the handle
        (`adaptive`) advanced ten times a tick; the fastest of seven runs, making of the arrays included.""")
    page.table(("device", "times real time", "tick [µs]", "its rendering [µs]"), rows)


def _handle(page: Page, sheet: Sheet, pictures: Path) -> None:
    rows = []
    for case in sheet.cases("handle, "):
        errors = [
            " / ".join(f"{sheet.number(case, f'{signal} {what}'):.1f}" for what in ("nominal", "median", "p95", "firm"))
            for signal in SIGNALS
        ]
        rows.append((case.removeprefix("handle, "), *errors, f"{sheet.number(case, 'sample least'):.2f}"))
    page.heading("The handle: error against time")
    page.text(f"""Spectrogram error [%] of the handle's acceleration against the desired, no output being 100: the
        nominal handle / median and p95 of {PLANTS} handles with all six parameters off by up to {100 * SPREAD:.0f} % /
        a grip {FIRM:g} times as firm. Simulated at 10 kHz with amplifier, accelerometer and its noise, travel and force
        limits. Time is that of one sample, plant and all. `hapscene lab chart --only compensator` varies the
        sensor.""")
    page.table(("compensator", *SIGNALS, "sample [µs]"), rows)


def _crowd(page: Page, sheet: Sheet, pictures: Path) -> None:
    rows = [
        (case, _quantiles(sheet, case, "contact", ("median", "p99")))
        for case in (*sheet.cases("1 body"), *sheet.cases("10"))
    ]
    page.heading("Many bodies")
    page.picture(pictures / "crowd.png", "Contact time over the number of bodies")
    page.text("""Spheres of 1,280 triangles on a grid, 0.2 m apart; the tool slides over one. hapscene lists the bodies
        whose balls are near, and asks each in its own frame: no lock, no allocation.""")
    page.table(("", "contact, median / p99 [µs]"), rows)
