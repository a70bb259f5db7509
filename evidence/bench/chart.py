"""Charts of a benchmark, drawn from its sheet."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

from hapscene.view.chart import new_chart, save_both
from hapscene.view.palette import OKABE_ITO

from .case import short
from .sheet import Sheet
from .tick_time import ORDERS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OURS: Final = OKABE_ITO["blue"]
ROUNDING_M: Final = 1e-18
"""Value at which an error of zero is drawn [m]: rounding of float64 at the scale of a millimetre."""


def write_charts(sheet: Sheet, folder: Path) -> list[Path]:
    """Write the charts whose figures are in the sheet as PNG, for light and dark pages; return their paths."""
    made: list[Path] = []
    if not sheet.cases("sphere "):
        return made
    for name, draw in (("speed", _draw_speed), ("accuracy", _draw_accuracy)):
        with new_chart(10.0, 4.8, style={"axes.titlesize": 11.5}) as figure:
            draw(sheet, *figure.subplots(1, 2))
            made += save_both(figure, folder / f"{name}.png")
    return made


def _spheres(sheet: Sheet) -> tuple[list[str], list[float]]:
    """Return the names of the sphere cases, and their numbers of triangles."""
    names = [name for name in sheet.cases("sphere ") if (name, "triangles") in sheet]
    return names, [sheet.number(name, "triangles") for name in names]


def _draw_speed(sheet: Sheet, left: "Axes", right: "Axes") -> None:
    """Draw contact time over mesh size, and tick time over the order of the texture."""
    names, triangles = _spheres(sheet)
    for quantile, style, width in (("median", "-", 2.6), ("p99", ":", 1.6)):
        times = [sheet.number(name, f"contact {quantile}") for name in names]
        label = "hapscene" if quantile == "median" else None
        left.plot(triangles, times, color=OURS, marker="o", linestyle=style, linewidth=width, label=label)
    left.plot([], [], color="#777777", linestyle=":", label="dotted: p99")
    left.set(xscale="log", yscale="log", xlabel="triangles", ylabel="time per tick [µs]")
    left.set_title("Contact part of a tick, median, hot")
    _plain_ticks(left, y=(0.2, 0.5, 1, 2, 5, 10))
    left.set_xticks(triangles, [short(int(count)) for count in triangles])
    left.minorticks_off()
    left.legend(loc="upper left", ncols=2)
    orders = [order for order in ORDERS if (f"tick, order {order}", "tick median") in sheet]
    for quantile, style in (("median", "-"), ("p99", ":")):
        times = [sheet.number(f"tick, order {order}", f"tick {quantile}") for order in orders]
        right.plot(orders, times, color=OURS, marker="o", linestyle=style, label=f"tick, {quantile}")
    contact = [sheet.number(f"tick, order {order}", "contact median") for order in orders]
    right.plot(orders, contact, color=OKABE_ITO["purple"], marker="v", label="its contact part, median", linewidth=1.2)
    right.set(xlabel="order of the texture's AR model", ylabel="time per tick [µs]", xticks=orders)
    right.set_ylim(bottom=0)
    right.set_title("Tick with five effects; 82 k triangles")
    right.legend(loc="upper left")


def _draw_accuracy(sheet: Sheet, left: "Axes", right: "Axes") -> None:
    """Draw the direction error of the force, and the distance to the mesh, against contact time."""
    names, triangles = _spheres(sheet)
    times = [sheet.number(name, "contact median") for name in names]
    for quantile, style, fill in (("median", "-", OURS), ("p99", ":", "white")):
        errors = [sheet.number(name, f"force direction error {quantile}") for name in names]
        label = f"hapscene, {quantile}"
        left.plot(times, errors, color=OURS, marker="o", linestyle=style, markerfacecolor=fill, label=label)
    gaps = [max(sheet.number(name, "proxy to facets max"), ROUNDING_M) * 1e6 for name in names]
    right.plot(times, gaps, color=OURS, marker="o", label="hapscene, maximum")
    for x, error, gap, count in zip(times, errors, gaps, triangles, strict=True):
        for ax, y in ((left, error), (right, gap)):
            ax.annotate(short(int(count)), (x, y), (7, 3), textcoords="offset points", fontsize=8.5)
    for ax in (left, right):
        ax.set(xscale="log", yscale="log", xlabel="contact time per tick, median [µs]")
        ax.set_xlim(0.15, 4)
        _plain_ticks(ax, x=(0.2, 0.5, 1, 2, 4))
    left.set_ylabel("angle to the sphere's normal [°]")
    left.set_title("Direction of the force; hollow: p99")
    _plain_ticks(left, y=(0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10))
    left.legend(loc="upper right", fontsize=8.5)
    right.set_ylabel("distance from the proxy to the mesh [µm]")
    right.set_title("Proxy to the facets")
    _plain_ticks(right, y=(0.001, 0.01, 0.1, 1, 10))
    right.legend(loc="best", fontsize=8.5)


def _plain_ticks(ax: "Axes", x: tuple[float, ...] = (), y: tuple[float, ...] = ()) -> None:
    """Label a logarithmic axis with plain decimal numbers."""
    if x:
        ax.set_xticks(x, [f"{value:g}" for value in x])
        ax.xaxis.minorticks_off()
    if y:
        ax.set_yticks(y, [f"{value:,g}" for value in y])
        ax.yaxis.minorticks_off()
