"""`hapscene lab stability`: writes the Z-width of a device, and the stability of swatches on it."""

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Final

from hapscene.device.model import device_named, limits_of
from hapscene.device.sim.hand import Grip
from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.io.files import whole_file, whole_folder
from hapscene.stability.wall_chart import write_z_width_chart
from hapscene.stability.z_width import DAMPINGS_NS_M, Point, StableRegion, describe, place, trace_all
from hapscene.surface.swatch import Swatch

__all__ = ["stability"]

FILES: Final = (
    "z_width.png",
    "z_width-dark.png",
    "z_width.csv",
    "swatches.csv",
    "verdicts.txt",
)
"""Files that may be written."""

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
    """Write the chart, the tables of regions and swatches, and the verdicts."""
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
    said = "".join(f"{line}\n" for line in verdicts(points))
    (folder / "verdicts.txt").write_text(said, encoding="utf-8", newline="\n")


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
