"""What `hapscene lab stability` writes: a device's Z-width, swatches placed in it, and which of them would buzz."""

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any, Final

from hapscene.device.model import device_named, limits_of
from hapscene.device.sim.hand import Grip
from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.io.files import whole_file, whole_folder
from hapscene.stability.wall_chart import write_z_width_chart
from hapscene.stability.z_width import DAMPINGS_NS_M, Point, StableRegion, place, say_of, trace_all
from hapscene.surface.swatch import Swatch

__all__ = ["stability"]

FILES: Final = (
    "z_width.png",
    "z_width-dark.png",
    "z_width.csv",
    "swatches.csv",
    "words.txt",
)
"""What may be made."""

Placed = dict[tuple[float, int], list[Point]]
"""Swatches placed in the region, by rate and delay."""


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
    """Trace a device's Z-width and place swatches in it.

    Args:
        out: folder to write into.
        device: its name, of `hapscene.device.model.DEVICES`.
        rates_Hz, delays: of the force channel, and of the loop in ticks: a panel for each pair.
        grip: of the hand that tries the walls.
        swatches: to place.
        say: called with lines of progress.
        dampings_Ns_m: of walls, at which the region is traced.
        jobs, scheduler: processes here, or a Dask cluster, that trace regions side by side. What a run that was
            stopped has traced is kept beside `out`, and the same run goes on there.

    Returns:
        list of Path: the files made.

    Raises:
        HapsceneError: no such device, or one without a body.
        OSError: the folder cannot be written.
    """
    point = device_named(device).point
    if point is None:
        raise HapsceneError(f"device {device!r} has no mass, so no limit of stability: name another")
    journal = Path(out).absolute().with_name(f".{Path(out).name}.sweep.jsonl")
    with whole_folder(out, FILES) as folder:
        workers = {"journal": journal, "jobs": jobs, "scheduler": scheduler}
        regions = trace_all(device, rates_Hz, delays, grip, say, dampings_Ns_m, **workers)
        keys = [(rate_Hz, delay) for delay in delays for rate_Hz in rates_Hz]
        body = Omni() if device == "omni" else point
        points = {key: place(device, body, *key, grip, swatches) for key in keys}
        _write_z_width(folder, device, regions, points)
        for line in words(points):
            say(f"{line}\n")
        names = [file.name for file in sorted(folder.iterdir())]
    journal.unlink(missing_ok=True)
    return [Path(out) / name for name in names]


def _write_z_width(folder: Path, device: str, regions: list[StableRegion], points: Placed) -> None:
    """The chart, its regions and swatches as tables, and what is said of the swatches."""
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
    said = "".join(f"{line}\n" for line in words(points))
    (folder / "words.txt").write_text(said, encoding="utf-8", newline="\n")


def words(points: Placed) -> list[str]:
    """Which swatches would buzz, by rate and delay, a sentence each; then those that never do."""
    lines = [say_of(p, *key) for key, here in points.items() for p in here if not (p.stable and p.capped_stable)]
    buzzing = {p.swatch for here in points.values() for p in here if not (p.stable and p.capped_stable)}
    still = sorted({p.swatch for here in points.values() for p in here} - buzzing)
    if still:
        lines.append(f"at rest at every rate and delay: {', '.join(still)}")
    return lines


def write_table(path: Path, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """A CSV; numbers with nine figures."""
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(head)
        for row in rows:
            table.writerow([f"{value:.9g}" if isinstance(value, float) else value for value in row])
