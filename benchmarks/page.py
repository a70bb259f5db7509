"""docs/benchmark.md, made from a sheet: no figure on it is copied by hand."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from hapscene.files import whole_file
from hapscene.handle.sensor import ACCELEROMETER_HZ
from hapscene.renderer import EFFECTS
from hapscene.view.chart import picture

from .handle import DRAGS, FIRM, PLANTS, SIGNALS, SPREAD, TAPS, TELEOPERATED
from .machine import machine_words
from .markdown import paragraph, shown, table
from .order import ORDERS, RECORDINGS
from .peer import CITED, PEERS, TRIANGLES
from .projection import ANGLES_DEG, STEPS
from .sheet import QUANTILES, Sheet
from .side_by_side_page import section
from .tick_time import PARTS

AIMS: Final = (  # what it is, case and figure, most it may be, unit
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


INSTANCES: Final = """Tried on 2026-11-22 (two shared cores of 2.5 GHz, dynamic scene, low build quality, the rays of
the same slide): among 1,000 bodies a ray took 0.171 µs through the instances, 0.093 µs in a body's own scene, where a
whole contact took 0.462 µs at rest; and whenever bodies had moved, a tenth of them, the scene had to be committed anew:
1,568 µs, with locks and allocations."""
"""What Embree's instances cost, stated: nothing here measures it any more."""


def write_page(sheet: Sheet, path: Path, charts: Sequence[str], peers: Sheet | None = None) -> None:
    """Write the page; `charts` are paths of the pictures as seen from it, `peers` other renderers side by side."""
    known = {Path(chart).stem: chart for chart in charts}
    parts = [_head(sheet), _aims(sheet), _contact(sheet, known), section(peers)]
    parts += [_tick(sheet), _cold(sheet), _rays(sheet), _accuracy(sheet, known), _groove(sheet, known)]
    if "texture" in known:
        parts.append(_texture(sheet, known))
    if sheet.cases("synthesis, "):
        parts.append(_synthesis(sheet))
    if sheet.cases("twin, "):
        parts.append(_twin(sheet))
    if "handle" in known:
        parts.append(_handle(sheet, known))
    if sheet.cases("sensor, "):
        parts.append(_sensor(sheet))
    parts.append(_crowd(sheet, known))
    with whole_file(path) as part:
        part.write_text("\n".join(parts), encoding="utf-8")


def _quantiles(sheet: Sheet, case: str, name: str, quantiles: Iterable[str] = QUANTILES, scale: float = 1.0) -> str:
    """Median / p99 / p99.9 / max, or those named."""
    return " / ".join(shown(scale * sheet.number(case, f"{name} {quantile}")) for quantile in quantiles)


def _head(sheet: Sheet) -> str:
    clock = shown(sheet.number("clock", "between two reads median"))
    length_s, runs = shown(sheet.number("method", "path")), shown(sheet.number("method", "hot runs"))
    method = f"""How it was measured: icospheres of 50 mm radius; the tool approaches, presses 2 mm, slides at 0.1 m/s
        with wiggling depth and leaves, {length_s} s at 1 kHz. Times are read inside the tick (`Recording.contact_ns`,
        `tick_ns`); each tick's is the least of {runs} hot runs after one to warm up; only ticks in contact count. Two
        reads of the clock lie {clock} ns apart, which no time here has taken off. Four figures with slashes are
        median / p99 / p99.9 / max."""
    return f"""# Benchmark: speed and accuracy, one charted against the other

Made by `hapscene lab bench --docs docs`; every figure of hapscene's below is from [bench.csv](bench/bench.csv), none is
copied by hand.

{paragraph(f"Machine: {'; '.join(machine_words(sheet))}.")}

{paragraph(method)}
"""


def _aims(sheet: Sheet) -> str:
    rows = []
    for what, case, name, most, unit in AIMS:
        if (case, name) in sheet:
            value = sheet.number(case, name)
            held = "yes" if value <= most else "**no**"
            rows.append((what, f"≤ {most:g} {unit}", f"{shown(value)} {unit}", held))
    return "## Aims\n" + table(("", "aim", "measured", "held"), rows)


def _contact(sheet: Sheet, charts: dict[str, str]) -> str:
    """Contact over mesh size, beside other renderers."""
    rows = []
    for case in (*sheet.cases("sphere "), *sheet.cases("zoo ")):
        if (case, "triangles") not in sheet:
            continue
        count = round(sheet.number(case, "triangles"))
        others = ["" for _ in PEERS]
        if case.startswith("sphere "):
            at = TRIANGLES.index(count)
            others = [f"{shown(peer.median_us[at])} / {shown(peer.p99_us[at])}" for peer in PEERS]
        ours = _quantiles(sheet, case, "contact")
        rows.append((case, f"{count:,}", ours, *others, shown(sheet.number(case, "build"))))
    names = [f"{peer.name}, median / p99" for peer in PEERS]
    built = "; ".join(f"{p.name.split()[0]} {p.build_ms[0]:g} to {p.build_ms[1]:g}" for p in PEERS[1:])
    return f"""## Contact

{picture(charts["speed"], "Contact time over mesh size, and tick time over order")}

{table(("case", "triangles", "contact [µs]", *names, "build [ms]"), rows)}
CHAI3D 3.3.0 and HAPI 1.3.1: {CITED}.
Their trees took, in ms from 1 k to 1.31 M triangles: {built}.
"""


def _tick(sheet: Sheet) -> str:
    rows = []
    for order in ORDERS:
        case = f"tick, order {order}"
        contact, over = (shown(sheet.number(case, f"{name} median")) for name in ("contact", "step over the tick"))
        run_ms = shown(1e3 * sheet.number(case, "run for 10 s of path"))
        rows.append((str(order), _quantiles(sheet, case, "tick"), contact, over, run_ms))
    harness = shown(1e3 * sheet.number("harness", "four idle effects median"))
    bare = shown(sheet.number("harness", "tick without effects median"))
    head = ("order", "tick [µs]", "of it contact, median [µs]", "`step` over the tick [µs]", "`run` of 10 s [ms]")
    return f"""## The whole tick
Wall, friction, texture and tap on 82 k triangles; 10 acceleration samples a tick. The textures are the shipped wood's,
played for 10 s at 1 N and 0.1 m/s and fitted again at each order.

{table(head, rows)}
A tick without effects takes {bare} µs; calling five effects that do nothing adds {harness} ns.
{_profile(sheet)}"""


def _profile(sheet: Sheet) -> str:
    """What the parts of a tick take; empty where an older table has no such figures."""
    if ("profile", "clock") not in sheet:
        return ""
    parts = [(name, shown(sheet.number("profile", name))) for name in (*PARTS, "clock", *EFFECTS)]
    return f"""
The parts of a tick in contact, on the mean: of one with the wall alone, read by a clock between them; the clock, of
which a tick reads two in the time it tells; and what each effect by itself adds to a tick without.

{table([name for name, _ in parts], [[f"{ns} ns" for _, ns in parts]])}"""


def _cold(sheet: Sheet) -> str:
    case = "sphere 82 k, 1 kHz loop"
    imported, ready = (sheet.number("start", n) for n in ("import hapscene", "sphere 82 k, load to first tick"))
    rows = [
        ("contact", _quantiles(sheet, case, "contact")),
        ("tick, five effects", _quantiles(sheet, case, "tick")),
        ("wakes late", _quantiles(sheet, case, "late")),
        ("wakes late, empty loop", _quantiles(sheet, "empty 1 kHz loop", "late")),
    ]
    return f"""## Cold, and from the start
A Python loop that sleeps until each millisecond, then calls `step`: caches are cold. How late it wakes is the system's
doing, and is the same without the tick. CHAI3D took 5–7 µs (static) and 6–11 µs (dynamic), HAPI 6–7 µs for the contact
in such a loop, at the median.

{table(("82 k triangles", "[µs]"), rows)}
In a fresh process, from a warm cache: `import hapscene` {shown(imported)} s; from there to the first tick of a saved
scene of 82 k triangles {shown(ready)} s.
"""


def _rays(sheet: Sheet) -> str:
    rows = []
    clock = sheet.number("clock", "between two reads median")
    for case in sheet.cases("sphere "):
        if (case, "rays a tick mean") in sheet:
            contact, rays = 1e3 * sheet.number(case, "contact mean"), sheet.number(case, "rays of a tick mean")
            count, one = sheet.number(case, "rays a tick mean"), sheet.number(case, "ray mean")
            times = map(shown, (one, rays, clock, contact - rays - clock))
            rows.append((case, shown(contact), f"{count:.2f}", *times))
    head = ("case", "contact, mean [ns]", "rays a tick", "a ray [ns]", "rays [ns]", "clock [ns]", "the rest [ns]")
    return f"""## Where the contact's time goes
The rays of the path, noted from the interpreted tick, are cast again in a loop of their own, each after the one before
has ended. The rest is planes, and reading the corners of faces from memory: on a fine mesh nearly every tick enters a
face that no cache holds.

{table(head, rows)}"""


def _accuracy(sheet: Sheet, charts: dict[str, str]) -> str:
    rows = []
    for case in sheet.cases("sphere "):
        if (case, "force direction error median") in sheet:
            figures = [_quantiles(sheet, case, "force direction error", ("median", "p99"))]
            figures += [_quantiles(sheet, case, name, ("p99", "max"), 1e6) for name in _DISTANCES]
            rows.append((case, shown(sheet.number(case, "contact median")), *figures))
    head = (
        "case",
        "contact, median [µs]",
        "force to sphere's normal, median / p99 [°]",
        "proxy to facets, p99 / max [µm]",
        "to the closest point, p99 / max [µm]",
        "to the round sphere, p99 / max [µm]",
    )
    others = "; ".join(
        f"{p.name} {p.median_us[1]:g} µs, {p.direction_deg[0]:g} / {p.direction_deg[1]:g}°, gap {1e6 * p.gap_m:g} µm"
        for p in PEERS
    )
    said = f"""The direction of the force is off the sphere's normal by as much as the facets are: a finer mesh buys
        accuracy, at the price of time. Off the facets the proxy is by rounding; where it crosses an edge, for a tick,
        by up to its skin (5e-6 of the mesh's diagonal) times the sine of the edge's angle. Others at 20 k triangles
        ({CITED}): {others}."""
    return f"""## Accuracy against time

{picture(charts["accuracy"], "Direction error and gap against contact time")}

{table(head, rows)}
{paragraph(said)}
"""


_DISTANCES: Final = ("proxy to facets", "proxy to closest point", "proxy to round surface")


def _groove(sheet: Sheet, charts: dict[str, str]) -> str:
    rows = []
    for angle_deg in ANGLES_DEG:
        case = f"groove {angle_deg:g}°"
        enough = [steps for steps in STEPS if sheet.number(case, f"{steps} projections error") <= 1e-6]
        times = ("never", "")
        if enough:
            times = (shown(sheet.number(case, f"{enough[0]} projections time")), str(enough[0]))
        exact = shown(sheet.number(case, "active set time")), shown(1e6 * sheet.number(case, "active set error"))
        rows.append((f"{angle_deg:g}°", *times, *exact))
    head = ("groove", "alternating, to 1 µm [ns]", "projections", "active set [ns]", "its error [µm]")
    return f"""## The proxy's solution: exact, and why

{picture(charts["groove"], "Error against time in a groove")}

{table(head, rows)}
Alternating projection leaves cos α of the error at each step, so the sharper the groove the longer it takes. The active
set of at most three planes is solved at once.
"""


def _texture(sheet: Sheet, charts: dict[str, str]) -> str:
    rows = []
    for name in RECORDINGS:
        case = f"recording {name}"
        distances = [f"{sheet.number(case, f'order {order} distance'):.2f}" for order in ORDERS]
        rows.append((name, *distances, f"{sheet.number(case, 'floor'):.2f}", f"{sheet.number(case, 'chosen order'):g}"))
    head = ("recording", *(f"order {order}" for order in ORDERS), "its two halves", "chosen order")
    return f"""## Texture: order against time

{picture(charts["texture"], "Log-spectral distance against time per tick")}

Log-spectral distance [dB], 20 to 1000 Hz, of a model of one half of a recording to the other half, both ways round:

{table(head, rows)}
"Its two halves" is the distance between the recording's own halves: below it no model is better.
"""


def _synthesis(sheet: Sheet) -> str:
    """How many times faster than real time a texture is made, beside SciPy."""
    rows = []
    for case in sheet.cases("synthesis, "):
        name = case.removeprefix("synthesis, ")
        swatch = (case, "order") in sheet
        order = f"{sheet.number(case, 'order'):g}" if swatch else name.removeprefix("order ")
        for what in ("swatch",) if swatch else ("one model", "nine models", "nine models, alive"):
            if not swatch and (case, f"{what} for 10 s") not in sheet:
                continue  # a table made before it was timed
            times = [sheet.number(case, f"{method} for 10 s") for method in (what, "lfilter")]
            ratio = shown(times[0] / times[1])
            rows.append((name if swatch else what, order, *(f"{10.0 / t:,.0f}" for t in times), ratio))
    head = ("swatch", "order", "`synthesize`, times real time", "`lfilter`, times real time", "time over `lfilter`'s")
    said = """10 s at 10 kHz along a stroke through the swatch's forces and speeds, best of seven runs. `synthesize`
        makes the noise, looks up and blends the models and filters; `scipy.signal.lfilter` only filters noise that is
        there, with one fixed filter at a fixed level."""
    return f"""## Synthesis
{paragraph(said)}

{table(head, rows)}"""


def _twin(sheet: Sheet) -> str:
    """How fast the closed loop is."""
    rows = []
    for case in sheet.cases("twin, "):
        times = f"{sheet.number(case, 'times real time'):,.0f}"
        figures = (shown(sheet.number(case, name)) for name in ("tick", "rendering median"))
        rows.append((case.removeprefix("twin, "), times, *figures))
    said = """A hand that scrubs wood, five effects, 1 kHz force and 10 kHz acceleration, the device and the handle
        (`adaptive`) advanced ten times a tick; the fastest of seven runs, making of the arrays included."""
    return f"""## The twin in closed loop
{paragraph(said)}

{table(("device", "times real time", "tick [µs]", "of it rendering [µs]"), rows)}"""


def _handle(sheet: Sheet, charts: dict[str, str]) -> str:
    """How well the compensators play, and what each costs."""
    rows = []
    for case in sheet.cases("handle, "):
        errors = [
            " / ".join(f"{sheet.number(case, f'{signal} {what}'):.1f}" for what in ("nominal", "median", "p95", "firm"))
            for signal in SIGNALS
        ]
        rows.append((case.removeprefix("handle, "), *errors, f"{sheet.number(case, 'sample least'):.2f}"))
    said = f"""Spectrogram error [%] of the handle's acceleration against the desired, no output being 100: the nominal
        handle / median and p95 of {PLANTS} handles with all six parameters off by up to {100 * SPREAD:.0f} % / a grip
        {FIRM:g} times as firm. Simulated at 10 kHz with amplifier, accelerometer and its noise, travel and force
        limits. Time is that of one sample, plant and all."""
    head = ("compensator", *SIGNALS, "sample [µs]")
    return f"""## The handle: error against time

{picture(charts["handle"], "Error against time of the compensators")}

{paragraph(said)}

{table(head, rows)}"""


def _sensor(sheet: Sheet) -> str:
    """How the learning compensator does with sensors as they are, and in teleoperation."""
    rows = [
        (case.removeprefix("sensor, "), *(_beside_flat(sheet, case, signal) for signal in SIGNALS))
        for case in sheet.cases("sensor, ")
    ]
    operated = [
        (case.removeprefix("teleoperation, "), *(f"{sheet.number(case, name):.0f}" for name in TELEOPERATED))
        for case in sheet.cases("teleoperation, ")
    ]
    said = f"""Errors as above, of `adaptive` · `flat`: the nominal handle / median and p95 of {PLANTS} handles with all
        six parameters off by up to {100 * SPREAD:.0f} %. `adaptive` hears an accelerometer that is late, slow or noisy;
        `flat` hears nothing. The accelerometer has a pole at {ACCELEROMETER_HZ:g} Hz and 150 µg/√Hz unless said; the
        force is measured, or known from the command alone. Signals are those above, times what is said."""
    line = f"""The haptography paper's teleoperation in simulation, {TAPS} taps and {DRAGS} drags on wood, by two Omnis
        on the position–position controller without delay: spectrogram error [%] of the leader's tip against the
        follower's accelerometer, 20 to 1000 Hz, over the whole of it, by grip. The paper's handle had 48 %."""
    return f"""## The handle: late, slow and noisy sensors

{paragraph(said)}

{table(("sensor", *SIGNALS), rows)}

{paragraph(line)}

{table(("grip", *TELEOPERATED), operated)}"""


def _beside_flat(sheet: Sheet, case: str, signal: str) -> str:
    """Errors of `adaptive` and of `flat`, where the signal was played."""
    if (case, f"{signal} flat nominal") not in sheet:
        return ""
    errors = [
        " / ".join(f"{sheet.number(case, f'{signal} {kind} {what}'):.1f}" for what in ("nominal", "median", "p95"))
        for kind in ("adaptive", "flat")
    ]
    return " · ".join(errors)


def _crowd(sheet: Sheet, charts: dict[str, str]) -> str:
    """Many bodies, and the way that was not taken."""
    rows = []
    moving = ("contact, a tenth moving median", "placing the moving bodies")
    for case in (*sheet.cases("1 body"), *sheet.cases("10")):
        times = [shown(sheet.number(case, name)) if (case, name) in sheet else "" for name in moving]
        rows.append((case, _quantiles(sheet, case, "contact", ("median", "p99")), *times))
    head = ("", "contact, median / p99 [µs]", "contact, a tenth moving [µs]", "placing them [µs]")
    said = f"""The other way would be one top-level scene over Embree's instances. {INSTANCES} The tick takes no
        lock and allocates nothing; so each body is asked by itself, in its own frame."""
    return f"""## Many bodies: one query per body, not Embree's instances

{picture(charts["crowd"], "Contact time over the number of bodies")}

Spheres of 1,280 triangles on a grid, 0.2 m apart; the tool slides over one. hapscene lists the bodies whose balls are
near, and asks each.

{table(head, rows)}
{paragraph(said)}
"""
