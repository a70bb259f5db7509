"""`hapscene lab stability`: writes the Z-width of a device, and the stability of swatches on it."""

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.device.model import Limits, device_named, limits_of
from hapscene.device.sim.hand import Grip
from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.io.files import whole_file, whole_folder
from hapscene.stability.z_width import DAMPINGS_NS_M, STIFFNESS_N_M, Point, StableRegion, describe, place, trace_all
from hapscene.surface.swatch import Swatch
from hapscene.view.chart import new_chart, save_both
from hapscene.view.palette import INK, OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["stability"]

FILES: Final = (
    "z_width.png",
    "z_width-dark.png",
    "z_width.csv",
    "swatches.csv",
)
"""Files that may be written."""

WIDTH_MAX_IN: Final = 10.0
"""Largest width of the chart [in]: at a page width of 830 pixels its text is 11 pixels high."""

TOP_N_M: Final = 1.15e5
"""Top of the chart [N/m]. Walls that were stable at the largest tested stiffness are drawn up to it."""

LABEL: Final[dict[str, Any]] = {
    **{"va": "center", "fontsize": 9, "zorder": 4, "bbox": {"facecolor": "white", "linewidth": 0.0, "pad": 0.5}},
    "arrowprops": {"arrowstyle": "-", "color": INK, "linewidth": 0.5, "shrinkA": 0, "shrinkB": 2},
}
"""Style of the label of a swatch."""

LABEL_RATIO: Final = 1.42
"""Least ratio of the heights of two labels on the logarithmic axis [1]; closer ones would overlap."""

LABELS_MAX: Final = 4
"""Most swatches at one position that have separate labels [count]."""

Placed = dict[tuple[float, int], list[Point]]
"""Swatches in the region, by rate and delay."""


def stability(
    out: Path,
    device: str,
    rates_Hz: Sequence[float],
    delays: Sequence[int],
    grip: Grip,
    swatches: Sequence[Swatch],
    say: Callable[[str], None] = lambda _: None,
    dampings_Ns_m: Sequence[float] = DAMPINGS_NS_M,
    jobs: int | None = None,
    scheduler: str | None = None,
) -> list[Path]:
    """Trace the Z-width of a device, and test swatches.

    Args:
        out: folder to write to.
        device: name of a device in `hapscene.device.model.DEVICES`.
        rates_Hz, delays: rates of the haptic tick, and delays in ticks; each pair is a panel of the chart.
        grip: grip of the hand that touches the walls.
        swatches: swatches to test.
        say: called with lines of progress.
        dampings_Ns_m: wall dampings at which the region is traced.
        jobs, scheduler: processes on this computer, or a Dask scheduler, that trace regions in parallel. An interrupted
            run keeps its results beside `out`, and the same call resumes it.

    Returns:
        the written files.

    Raises:
        HapsceneError: unknown device, or a device without mass.
        OSError: the folder cannot be written.
    """
    point = device_named(device).point
    if point is None:
        raise HapsceneError(f"device {device!r} has no mass; expected a simulated device with mass, such as omni")
    journal = Path(out).absolute().with_name(f".{Path(out).name}.sweep.jsonl")
    with whole_folder(out, FILES) as folder:
        workers = {"journal": journal, "jobs": jobs, "scheduler": scheduler}
        regions = trace_all(device, rates_Hz, delays, grip, say, dampings_Ns_m, **workers)
        keys = [(rate_Hz, delay) for delay in delays for rate_Hz in rates_Hz]
        body = Omni() if device == "omni" else point
        points = {key: place(device, body, *key, grip, swatches) for key in keys}
        _write_z_width(folder, device, regions, points)
        for line in verdicts(points):
            say(f"{line}\n")
        names = [file.name for file in sorted(folder.iterdir())]
    journal.unlink(missing_ok=True)
    return [Path(out) / name for name in names]


def _write_z_width(folder: Path, device: str, regions: list[StableRegion], points: Placed) -> None:
    """Write the chart, and the tables of regions and swatches."""
    caps = {(rate_Hz, delay): limits_of(device, 1.0 / rate_Hz, delay) for rate_Hz, delay in points}
    write_z_width_chart(folder / "z_width.png", regions, points, caps)
    rows = [
        (r.device, r.rate_Hz, r.delay_ticks, *row)
        for r in regions
        for row in zip(r.damping_Ns_m, r.limit_N_m, r.closed_N_m, strict=True)
    ]
    write_table(folder / "z_width.csv", [f.name for f in fields(StableRegion)], rows)
    names = ("rate_Hz", "delay_ticks", *(f.name for f in fields(Point)))
    write_table(folder / "swatches.csv", names, [(*key, *astuple(p)) for key, here in points.items() for p in here])


def verdicts(points: Placed) -> list[str]:
    """One sentence for each unstable swatch, rate and delay, then the swatches that are always stable."""
    lines = [describe(p, *key) for key, here in points.items() for p in here if not (p.stable and p.capped_stable)]
    unstable = {p.swatch for here in points.values() for p in here if not (p.stable and p.capped_stable)}
    stable = sorted({p.swatch for here in points.values() for p in here} - unstable)
    if stable:
        lines.append(f"stable at every rate and delay: {', '.join(stable)}")
    return lines


def write_table(path: Path, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV with nine significant digits."""
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(head)
        for row in rows:
            table.writerow([f"{value:.9g}" if isinstance(value, float) else value for value in row])


def write_z_width_chart(
    path: Path,
    regions: Sequence[StableRegion],
    points: Placed,
    caps: dict[tuple[float, int], Limits],
) -> None:
    """Draw the stable regions: one panel for each rate (across) and delay (down); `points` and `caps` are by rate
    and delay."""
    rates = sorted({region.rate_Hz for region in regions})
    delays = sorted({region.delay_ticks for region in regions})

    with new_chart(min(5.2 * len(rates), WIDTH_MAX_IN), 4.4 * len(delays)) as figure:
        axes = figure.subplots(len(delays), len(rates), squeeze=False)
        for row, delay in enumerate(delays):
            for column, rate_Hz in enumerate(rates):
                ax, key = axes[row, column], (rate_Hz, delay)
                here = [region for region in regions if (region.rate_Hz, region.delay_ticks) == key]
                _draw_regions(ax, here)
                _draw_caps(ax, caps[key])
                _draw_points(ax, points[key])
                delay_text = "no delay" if delay == 0 else f"delay {delay} tick{'s' if delay > 1 else ''}"
                ax.set_title(f"{rate_Hz / 1e3:g} kHz, {delay_text}")
                ax.set_xlabel("wall damping [N·s/m]" if row == len(delays) - 1 else "")
                ax.set_ylabel("wall stiffness [N/m]" if column == 0 else "")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(3, len(rates)))
        save_both(figure, path, dpi=160)


def _draw_regions(ax: "Axes", regions: Sequence[StableRegion]) -> None:
    """Draw the region of the first device filled, of the others as lines, and the closed form."""
    bottom = STIFFNESS_N_M[0]
    for n, region in enumerate(regions):
        B = np.array(region.damping_Ns_m)
        K = np.clip(np.array(region.limit_N_m), bottom, TOP_N_M)
        colour, line = OKABE_ITO[("blue", "orange", "green")[n % 3]], ("o-", "s-", "D-")[n % 3]
        if n == 0:
            ax.fill_between(B, bottom, K, color=colour, alpha=0.16, linewidth=0, label=f"{region.device}: stable")
        ax.plot(B, K, line, color=colour, markersize=3.5, label=f"{region.device}: simulated limit")
    theory = np.array(regions[0].closed_N_m)
    kept = theory > 0.0
    x, y = np.array(regions[0].damping_Ns_m)[kept], np.clip(theory[kept], bottom, TOP_N_M)
    ax.plot(x, y, "--", color=INK, linewidth=1.2, label="closed form, without friction")
    ax.set_xscale("symlog", linthresh=0.5, linscale=0.6)
    ax.set(yscale="log", xlim=(-0.75, None), ylim=(bottom, TOP_N_M))
    ticks = (0, 0.5, 2, 8, 32, 128)
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.xaxis.minorticks_off()
    heights = (50, 200, 1000, 5000, 20_000, 100_000)
    ax.set_yticks(heights, [f"{height:,}" for height in heights])
    ax.yaxis.minorticks_off()


def _draw_caps(ax: "Axes", caps: Limits) -> None:
    """Draw the range to which the device's own limits restrict each wall."""
    if np.isfinite(caps.stiffness_N_m) and np.isfinite(caps.damping_Ns_m):
        K, B = caps.stiffness_N_m, caps.damping_Ns_m
        label = "limits of the device"
        ax.plot((0.0, B, B), (K, K, STIFFNESS_N_M[0]), ":", color=OKABE_ITO["purple"], linewidth=2.2, label=label)


def _label(point: Point, points: Sequence[Point]) -> str:
    """The label of a swatch; several at one position share one label with their number."""
    here = [other.swatch for other in points if _place(other) == _place(point)]
    if len(here) <= LABELS_MAX:
        return point.swatch if point.stable else f"{point.swatch}: unstable"
    label = f"{len(here)} swatches" + ": unstable" * (not point.stable)
    return label if point.swatch == here[0] else ""


def _place(point: Point) -> tuple[str, str, bool]:
    return f"{point.stiffness_N_m:.2g}", f"{point.damping_Ns_m:.2g}", point.stable


def _draw_points(ax: "Axes", points: Sequence[Point]) -> None:
    """Draw the swatches with their labels."""
    height = 0.0
    for point in sorted(points, key=lambda p: p.stiffness_N_m):
        K, B = point.stiffness_N_m, point.damping_Ns_m
        marker, colour = ("o", OKABE_ITO["green"]) if point.stable else ("X", OKABE_ITO["vermilion"])
        ax.plot(B, K, marker, color=colour, markersize=7, markeredgecolor="white", zorder=5, clip_on=False)
        name = _label(point, points)
        if not name:
            continue
        height = max(K, LABEL_RATIO * height)
        x, align = (1.35 * B, "left") if B > 0.1 else (B - 0.12, "right")
        ax.annotate(name, (B, K), (x, height), ha=align, **LABEL)
    for label, marker, colour in (("stable swatch", "o", "green"), ("unstable swatch", "X", "vermilion")):
        ax.plot([], [], marker, color=OKABE_ITO[colour], markersize=7, linestyle="", label=label)
