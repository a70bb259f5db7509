"""The charts of a benchmark, drawn from its sheet."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hapscene.swatches.library import load_swatch
from hapscene.view.chart import new_chart, save_both
from hapscene.view.palette import EDGE, INK, OKABE_ITO, albedo_colours

from .case import short
from .handle import draw_handle
from .order import ORDERS, RECORDINGS
from .peer import PEERS, TRIANGLES
from .projection import ANGLES_DEG, STEPS
from .sheet import Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OURS: Final = OKABE_ITO["blue"]
PEER_STYLES: Final = ((OKABE_ITO["orange"], "s"), (OKABE_ITO["vermilion"], "D"), (OKABE_ITO["green"], "^"))
"""Colour and marker of each of `PEERS`: told apart without colour as well."""

PEER_COUNT: Final = 20480
"""Triangles at which the peers' accuracy is known [count]."""

ROUNDING_M: Final = 1e-18
"""Where an error of zero is drawn [m]: float64's rounding at the scale of a millimetre."""


def write_charts(sheet: Sheet, folder: Path) -> list[Path]:
    """Write those charts as PNG, on light and on dark ground, whose figures the sheet has; return their paths."""
    charts: dict[str, tuple[bool, int, Callable[..., None]]] = {
        "speed": (bool(sheet.cases("sphere ")), 2, _draw_speed),
        "accuracy": (bool(sheet.cases("sphere ")), 2, _draw_accuracy),
        "groove": (bool(sheet.cases("groove ")), 1, _draw_groove),
        "crowd": (bool(sheet.cases("1 body")), 1, _draw_crowd),
        "handle": (bool(sheet.cases("handle, ")), 2, draw_handle),
        "texture": (bool(sheet.cases("recording ")), 1, _draw_texture),
    }
    made = []
    for name, (known, panels, draw) in charts.items():
        if known:
            made += _write(folder / f"{name}.png", panels, sheet, draw)
    return made


def _write(path: Path, panels: int, sheet: Sheet, draw: Callable[..., None]) -> list[Path]:
    with new_chart(min(6.8 * panels, 10.0), 4.8, style={"axes.titlesize": 11.5}) as figure:
        draw(sheet, *figure.subplots(1, panels, squeeze=False)[0])
        return save_both(figure, path)


def _spheres(sheet: Sheet) -> tuple[list[str], list[float]]:
    """Names of the sphere cases, and their triangles."""
    names = [name for name in sheet.cases("sphere ") if (name, "triangles") in sheet]
    return names, [sheet.number(name, "triangles") for name in names]


def _draw_speed(sheet: Sheet, left: "Axes", right: "Axes") -> None:
    """Contact time over mesh size, ours and others; the whole tick over the texture's order."""
    for peer, (colour, marker) in zip(PEERS, PEER_STYLES, strict=True):
        left.plot(TRIANGLES, peer.median_us, color=colour, marker=marker, markersize=4.5, label=peer.name)
        left.plot(TRIANGLES, peer.p99_us, color=colour, marker=marker, markersize=3, linestyle=":", linewidth=1)
    names, triangles = _spheres(sheet)
    for quantile, style, width in (("median", "-", 2.6), ("p99", ":", 1.6)):
        times = [sheet.number(name, f"contact {quantile}") for name in names]
        label = "hapscene" if quantile == "median" else None
        left.plot(triangles, times, color=OURS, marker="o", linestyle=style, linewidth=width, label=label)
    left.plot([], [], color="#777777", linestyle=":", label="dotted: p99")
    left.set(xscale="log", yscale="log", xlabel="triangles", ylabel="time per tick [µs]")
    left.set_title("Contact part of a tick, median, hot")
    _plain_ticks(left, y=(0.2, 0.5, 1, 2, 5, 10))
    left.set_xticks(TRIANGLES, [short(count) for count in TRIANGLES])
    left.minorticks_off()
    left.legend(loc="upper left", ncols=2)
    orders = [order for order in ORDERS if (f"tick, order {order}", "tick median") in sheet]
    for quantile, style in (("median", "-"), ("p99", ":")):
        times = [sheet.number(f"tick, order {order}", f"tick {quantile}") for order in orders]
        right.plot(orders, times, color=OURS, marker="o", linestyle=style, label=f"whole tick, {quantile}")
    contact = [sheet.number(f"tick, order {order}", "contact median") for order in orders]
    right.plot(orders, contact, color=OKABE_ITO["purple"], marker="v", label="its contact part, median", linewidth=1.2)
    right.set(xlabel="order of the texture's AR model", ylabel="time per tick [µs]", xticks=orders)
    right.set_ylim(bottom=0)
    right.set_title("Tick with wall, friction, texture and tap; 82 k triangles")
    right.legend(loc="upper left")


def _draw_accuracy(sheet: Sheet, left: "Axes", right: "Axes") -> None:
    """Error of the force's direction, and gap to the mesh, against contact time."""
    names, triangles = _spheres(sheet)
    times = [sheet.number(name, "contact median") for name in names]
    for quantile, style, fill in (("median", "-", OURS), ("p99", ":", "white")):
        errors = [sheet.number(name, f"force direction error {quantile}") for name in names]
        label = f"hapscene, {quantile}"
        left.plot(times, errors, color=OURS, marker="o", linestyle=style, markerfacecolor=fill, label=label)
    gaps = [max(sheet.number(name, "proxy to facets max"), ROUNDING_M) * 1e6 for name in names]
    right.plot(times, gaps, color=OURS, marker="o", label="hapscene, largest")
    for x, error, gap, count in zip(times, errors, gaps, triangles, strict=True):
        for ax, y in ((left, error), (right, gap)):
            ax.annotate(short(int(count)), (x, y), (7, 3), textcoords="offset points", fontsize=8.5)
    at = TRIANGLES.index(PEER_COUNT)
    for peer, (colour, marker) in zip(PEERS, PEER_STYLES, strict=True):
        x = peer.median_us[at]
        label = f"{peer.name}, {short(PEER_COUNT)}"
        left.plot([x, x], peer.direction_deg, color=colour, linewidth=0.8, linestyle=":")
        left.plot(x, peer.direction_deg[0], color=colour, marker=marker, linestyle="", label=label)
        left.plot(x, peer.direction_deg[1], color=colour, marker=marker, linestyle="", markerfacecolor="white")
        right.plot(x, peer.gap_m * 1e6, color=colour, marker=marker, linestyle="", label=label)
    for ax in (left, right):
        ax.set(xscale="log", yscale="log", xlabel="contact time per tick, median [µs]")
        ax.set_xlim(0.15, 4)
        _plain_ticks(ax, x=(0.2, 0.5, 1, 2, 4))
    left.set_ylabel("angle to the sphere's normal [°]")
    left.set_title("Direction of the force: the facets' own error (hollow: p99)")
    _plain_ticks(left, y=(0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10))
    left.legend(loc="upper right", fontsize=8.5)
    right.set_ylabel("distance from the proxy to the mesh [µm]")
    right.set_title("Proxy to the facets")
    _plain_ticks(right, y=(0.001, 0.01, 0.1, 1, 10))
    right.legend(loc="best", fontsize=8.5)


def _draw_groove(sheet: Sheet, ax: "Axes") -> None:
    """Error of a proxy in a groove against time."""
    colours = (OKABE_ITO["green"], OKABE_ITO["orange"], OKABE_ITO["vermilion"])
    for angle_deg, colour, marker in zip(ANGLES_DEG, colours, "^sD", strict=True):
        name = f"groove {angle_deg:g}°"
        times = [sheet.number(name, f"{steps} projections time") for steps in STEPS]
        errors = [max(sheet.number(name, f"{steps} projections error"), 1e-30) * 1e6 for steps in STEPS]
        label = f"alternating projection, {angle_deg:g}°"
        ax.plot(times, errors, color=colour, marker=marker, markersize=4, label=label)
        error = max(sheet.number(name, "active set error"), ROUNDING_M) * 1e6
        ax.plot(sheet.number(name, "active set time"), error, color=OURS, marker=marker, markersize=9, linestyle="")
    ax.plot([], [], color=OURS, marker="^", markersize=8, linestyle="", label="active set (hapscene), same marks")
    ax.axhline(1.0, color=INK, linewidth=0.8, linestyle="--")
    ax.annotate("1 µm", (1.0, 1.0), (-2, 3), xycoords=("axes fraction", "data"), textcoords="offset points", ha="right")
    ax.set(xscale="log", yscale="log", xlabel="time [ns]", ylabel="distance from the right point [µm]")
    ax.set_ylim(ROUNDING_M * 1e6 / 20, 1e5)
    ax.set_title("Proxy at the bottom of a groove, tool 2 mm below: error against time")
    ax.legend(loc="center left", fontsize=9)


def _draw_crowd(sheet: Sheet, ax: "Axes") -> None:
    """Contact among many bodies."""
    names = [name for name in (*sheet.cases("1 body"), *sheet.cases("10")) if (name, "bodies") in sheet]
    moving = [name for name in names if (name, "contact, a tenth moving median") in sheet]
    lines = (
        ("contact, all at rest", names, "contact median", OURS, "o"),
        ("contact, a tenth of the bodies moving", moving, "contact, a tenth moving median", OKABE_ITO["sky"], "v"),
        ("placing that tenth", moving, "placing the moving bodies", OKABE_ITO["orange"], "s"),
    )
    for label, cases, figure, colour, marker in lines:
        bodies = [sheet.number(name, "bodies") for name in cases]
        ax.plot(bodies, [sheet.number(name, figure) for name in cases], color=colour, marker=marker, label=label)
    ax.set(xscale="log", yscale="log", xlabel="bodies", ylabel="time per tick, median [µs]")
    counts = [int(sheet.number(name, "bodies")) for name in names]
    ax.set_xticks(counts, [f"{count:,}" for count in counts])
    _plain_ticks(ax, y=(0.03, 0.1, 0.3, 1, 3, 10))
    ax.minorticks_off()
    ax.set_title("Many bodies, the tool slides over one")
    ax.legend(loc="upper left", fontsize=9)


def _draw_texture(sheet: Sheet, ax: "Axes") -> None:
    """Distance to held-out recordings against time per tick, by order."""
    colours = albedo_colours([load_swatch(name) for name in RECORDINGS])
    orders = [order for order in ORDERS if (f"tick, order {order}", "tick median") in sheet]
    times = [sheet.number(f"tick, order {order}", "tick median") for order in orders]
    for name, colour, marker in zip(RECORDINGS, colours, "os^D", strict=True):
        case = f"recording {name}"
        distances = [sheet.number(case, f"order {order} distance") for order in orders]
        ax.plot(times, distances, color=EDGE, linewidth=4.0)
        ax.plot(times, distances, color=colour, marker=marker, markeredgecolor=EDGE, linewidth=2.4, label=name)
    top = ax.get_ylim()[1]
    for time, order in zip(times, orders, strict=True):
        ax.annotate(f"{order}", (time, top), (0, 4), textcoords="offset points", ha="center", fontsize=9)
        ax.axvline(time, color="#D0D0D0", linewidth=0.8, zorder=0)
    ax.set(xlabel="whole tick with five effects, median [µs]", ylabel="log-spectral distance, held out [dB]")
    ax.set_ylim(bottom=0, top=top)
    ax.set_title("Texture: nearness to a recording against time, by order of the model (above)\n")
    ax.legend(loc="lower left", ncols=2)


def _plain_ticks(ax: "Axes", x: tuple[float, ...] = (), y: tuple[float, ...] = ()) -> None:
    """Numbers as they are spoken on a logarithmic axis."""
    if x:
        ax.set_xticks(x, [f"{value:g}" for value in x])
        ax.xaxis.minorticks_off()
    if y:
        ax.set_yticks(y, [f"{value:,g}" for value in y])
        ax.yaxis.minorticks_off()
