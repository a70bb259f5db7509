"""`hapscene swatch compare`."""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hapscene.command.recording_option import add_recording_options, recording_options
from hapscene.command.word import add_command

if TYPE_CHECKING:
    from hapscene.capture.compare import Comparison, Difference
    from hapscene.capture.compare_series import Series
    from hapscene.capture.compare_surface import Surface


def add_swatch_compare(commands: Any) -> None:
    command = add_command(
        commands,
        "compare",
        _compare,
        "how different surfaces feel: side by side, against a library, or over time",
        "hapscene swatch compare wood paper",
        "hapscene swatch compare mine.swatch                     (against the shipped swatches)",
        "hapscene swatch compare mine.swatch --library swatches/",
        "hapscene swatch compare a.csv b.csv --rate 10000 --units acceleration=g",
        "hapscene swatch compare --series monday.swatch tuesday.swatch wednesday.swatch",
    )
    command.add_argument(
        "surface", metavar="SURFACE", nargs="+",
        help="a .swatch file, the name of a shipped swatch, or a recording, to which a swatch is fitted",
    )  # fmt: skip
    command.add_argument("--library", metavar="DIR", help="rank the swatches of this folder by how near they are")
    command.add_argument("--series", action="store_true", help="the surfaces are one over time, in this order")
    command.add_argument("--json", action="store_true", help="print JSON")
    add_recording_options(command)


def _compare(options: argparse.Namespace) -> int:
    from hapscene.capture.compare import compare, rank
    from hapscene.capture.compare_series import follow
    from hapscene.capture.compare_surface import load_library, load_surface
    from hapscene.errors import CaptureError

    if options.series and options.library is not None:
        raise CaptureError("--series follows one surface over time, --library ranks others: give one of the two")
    surfaces = [load_surface(name, **recording_options(options)) for name in options.surface]
    swatches = [surface.swatch for surface in surfaces]
    if options.series:
        series = follow(swatches)
        _print(options.json, series.as_dict() | _repeats(surfaces), _series_text(series, surfaces))
    elif options.library is None and len(swatches) == 2:
        comparison = compare(*swatches)
        _print(options.json, comparison.as_dict() | _repeats(surfaces), _pair_text(comparison, surfaces))
    else:
        broken: dict[str, str] = {}
        if options.library is None and len(swatches) > 1:
            ranks = [rank(swatches[0], swatches[1:])]
        else:
            library, broken = load_library(options.library)
            ranks = [rank(swatch, [other for other in library if other != swatch]) for swatch in swatches]
        content = {"ranked": [[c.as_dict() for c in ranked] for ranked in ranks], "unreadable": broken}
        _print(options.json, content | _repeats(surfaces), [line for r in ranks for line in _rank_text(r)])
        for reason in broken.values():
            print(f"hapscene: note: {reason}", file=sys.stderr)
    return 0


def _print(as_json: bool, content: dict[str, Any], lines: Sequence[str]) -> None:
    print(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) if as_json else "\n".join(lines))


def _repeats(surfaces: Sequence["Surface"]) -> dict[str, Any]:
    """How far the halves of each recording are apart, for JSON."""
    return {"repeat_jnd": [surface.repeat_jnd for surface in surfaces]}


def _pair_text(comparison: "Comparison", surfaces: Sequence["Surface"]) -> list[str]:
    rows: list[Sequence[str]] = [("", comparison.first, comparison.second, "difference", "felt from", "")]
    rows += [_row(d) for d in comparison.differences]
    lines = [*_table(rows), "", _sentence(comparison)]
    lines += [f"not compared: {name} ({reason})" for name, reason in comparison.skipped.items()]
    return lines + _repeat_text(surfaces)


def _row(d: "Difference") -> tuple[str, ...]:
    q = d.quantity
    values = [f"{v:.3g} {q.value_unit}".removesuffix(" 1") if math.isfinite(v) else "" for v in (d.first, d.second)]
    change = f"{d.change:.1f}" if math.isnan(d.first) else f"{d.change:+.1f}"
    return (q.name, *values, f"{change} {q.unit}".replace("-", "−"), f"{q.jnd:g} {q.unit}", d.verdict)


def _sentence(comparison: "Comparison") -> str:
    telling = comparison.telling
    if telling is None:
        return f"{comparison.first} and {comparison.second} cannot be compared: they have nothing in common"
    times = f"{comparison.distance_jnd:.1f} times what a person feels"
    return f"{comparison.second} {comparison.verdict} from {comparison.first}: most by {telling.quantity.name}, {times}"


def _rank_text(ranked: Sequence["Comparison"]) -> list[str]:
    if not ranked:
        return ["nothing to compare with: the library holds only this surface"]
    rows = [("", "surface", "distance", "most by", f"from {ranked[0].first}")]
    for place, c in enumerate(ranked, 1):
        distance = f"{c.distance_jnd:.1f} JND" if c.telling else ""
        rows.append((str(place), c.second, distance, c.telling.quantity.name if c.telling else "", c.verdict))
    return [*_table(rows), "1 JND is the least difference that a person feels", ""]


def _series_text(series: "Series", surfaces: Sequence["Surface"]) -> list[str]:
    rows = [("", "surface", *(f"{t.quantity.name} [{t.quantity.unit}]" for t in series.trends), "from the first")]
    for i, name in enumerate(series.names):
        change = [t.change[i] for t in series.trends]
        cells = ["" if math.isnan(c) else f"{c:+.1f}".replace("-", "−") for c in change]
        rows.append((str(i + 1), name, *cells, series.comparisons[i].verdict if i else ""))
    lines = ["change against the first surface", *_table(rows), ""]
    for t in series.trends:
        chance = "" if math.isnan(t.p_value) else f", p = {t.p_value:.2g}"
        slope = f"{t.slope:+.2f}".replace("-", "−")
        lines.append(f"{t.quantity.name}: {t.word} ({slope} {t.quantity.unit} from one to the next{chance})")
    return lines + _repeat_text(surfaces)


def _repeat_text(surfaces: Sequence["Surface"]) -> list[str]:
    return [
        f"two halves of {s.swatch.name}'s own recording are {s.repeat_jnd:.1f} JND apart: less may be chance"
        for s in surfaces
        if s.repeat_jnd is not None
    ]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns of even width."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
