"""`hapscene swatch`: list, show, search, add, remove, get; import, export, compare, publish."""

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import complain, name_made, note, say, size_words, tell
from hapscene.command.options import (
    add_command,
    add_group,
    add_out_file,
    add_out_folder,
    add_recording_options,
    base_name,
    check_out_folder,
    check_swatch,
    check_there,
    folder,
    force,
    new_file,
    number,
    rate,
    recording_options,
    seconds,
    seed,
)
from hapscene.errors import CaptureError, SwatchError
from hapscene.interrupt import heard

if TYPE_CHECKING:
    from hapscene.capture.report.compare import ComparedSurface, Comparison, Difference

RECORDING_SUFFIXES: Final = (
    ".csv",
    ".txt",
    ".wav",
    ".npz",
    ".mat",
    ".parquet",
    ".hsrec",
)  # as in capture.batch, heavy to import


def add_swatch(commands: Any) -> None:
    """Declare the group and its commands."""
    summary = "the library of swatches: list, show, search, add, remove, get, import, export, compare, publish"
    library = (_add_list, _add_show, _add_search, _add_add, _add_remove, _add_get)
    shown = (_add_compare, _add_publish)
    add_group(commands, "swatch", summary, *library, _add_import, _add_export, *shown)


# The library: `hapscene swatch list`, `show`, `search`, `add`, `remove`, `get`.


def _library(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--library",
        metavar="DIR",
        help="folder of the library (default: that of $HAPSCENE_LIBRARY, else one in your data folder)",
    )


def _add_list(commands: Any) -> None:
    command = add_command(commands, "list", _list)
    _library(command)
    command.add_argument("--json", action="store_true", help="print JSON")


def _list(options: argparse.Namespace) -> int:
    """List the swatches there are: shipped, and of the library.

    for example:
      hapscene swatch list
    """
    from hapscene.swatches.library import computed_entries, library_folder, own_entries, own_folders, shipped_entries

    own = [entry for home in own_folders(options.library) for entry in own_entries(home)]
    _print_entries({"shipped": shipped_entries(), "computed": computed_entries(), "library": own}, options.json)
    if not own and not options.json:
        print(f"the library in {library_folder(options.library)} is empty")
    return 0


def _print_entries(groups: Mapping[str, Sequence[Any]], as_json: bool) -> None:
    """One line a swatch, by where it is from, or JSON."""
    from hapscene.surface.swatch import touched_with

    rows = [(entry, source) for source, entries in groups.items() for entry in entries]
    if as_json:
        found = [
            {"name": e.name, "from": source, "words": e.words, "figures": e.figures, "licence": e.licence}
            | {"tags": list(e.tags), "tool": e.tool, "tip": e.tip}
            for e, source in rows
        ]
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    width = max((len(entry.name) for entry, _ in rows), default=0)
    for entry, source in rows:
        touched = touched_with(entry)
        said = f"{', '.join(entry.words)}{f' ({touched})' if touched else ''}"
        tell([f"{entry.name:<{width}}  {source:<8}  {said}"])


def _add_show(commands: Any) -> None:
    command = add_command(commands, "show", _show)
    command.add_argument("swatch", metavar="SWATCH", help="a name, or a .swatch file")
    _library(command)
    command.add_argument("--json", action="store_true", help="print JSON")


def _show(options: argparse.Namespace) -> int:
    """Tell how a swatch feels, in words and figures, and where it comes from.

    for example:
      hapscene swatch show wood
      hapscene swatch show oak.swatch --json
    """
    check_swatch(options.swatch)
    from hapscene.surface.swatch_summary import figures, lines, words
    from hapscene.swatches.library import find, load_swatch

    own = find(options.swatch, options.library) if options.library else None
    swatch = load_swatch(own or options.swatch)
    numbers = figures(swatch)
    if options.json:
        told = {"name": swatch.name, "words": words(numbers), "figures": numbers}
        told |= {key: getattr(swatch, key) for key in ("tool", "tip", "provenance", "licence")}
        print(json.dumps(told, indent=2, ensure_ascii=False))
        return 0
    tell(lines(swatch))
    return 0


def _add_search(commands: Any) -> None:
    command = add_command(commands, "search", _search)
    command.add_argument(
        "terms",
        nargs="+",
        metavar="TERM",
        help="a word, tool:WORD, tip:WORD, or a bound: stiffness, roughness, friction",
    )
    _library(command)
    command.add_argument("--json", action="store_true", help="print JSON")


def _search(options: argparse.Namespace) -> int:
    """Find swatches by words and by bounds on their figures.

    for example:
      hapscene swatch search grippy
      hapscene swatch search wood "friction<0.4" "roughness>=1"
      hapscene swatch search tool:probe tip:ball
    """
    from hapscene.swatches.library import computed_entries, own_entries, own_folders, search, shipped_entries

    own = [entry for home in own_folders(options.library) for entry in own_entries(home)]
    groups = {"shipped": shipped_entries(), "computed": computed_entries(), "library": own}
    found = search([entry for group in groups.values() for entry in group], options.terms)
    _print_entries({source: [e for e in group if e in found] for source, group in groups.items()}, options.json)
    if not found and not options.json:
        print("none")
    return 0 if found else 1


def _add_add(commands: Any) -> None:
    command = add_command(commands, "add", _add)
    command.add_argument("files", nargs="+", metavar="FILE", help="a .swatch file")
    command.add_argument("--name", help="name in the library, of a single file")
    command.add_argument("--replace", action="store_true", help="take the place of one of the same name")
    _library(command)


def _add(options: argparse.Namespace) -> int:
    """Put swatch files into the library.

    for example:
      hapscene swatch add oak.swatch
      hapscene swatch add oak.swatch --name 'oak, oiled'
    """
    from dataclasses import replace

    from hapscene.swatches.library import add, library_folder, load_swatch

    if options.name is not None and len(options.files) > 1:
        raise SwatchError("--name is for a single file")
    for file in options.files:
        check_there(file, SwatchError)
    swatches = [load_swatch(Path(file)) for file in options.files]  # all are read before any is added
    for swatch in swatches:
        named = swatch if options.name is None else replace(swatch, name=options.name)
        entry = add(named, options.library, options.replace)
        tell([f"{entry.name} → {library_folder(options.library) / entry.file}"])
    return 0


def _add_remove(commands: Any) -> None:
    command = add_command(commands, "remove", _remove)
    command.add_argument("names", nargs="+", metavar="NAME", help="a swatch of the library")
    _library(command)


def _remove(options: argparse.Namespace) -> int:
    """Take swatches out of the library, their files too.

    for example:
      hapscene swatch remove oak
    """
    from hapscene.swatches.library import remove

    for name in options.names:
        tell([f"removed {remove(name, options.library)}"])
    return 0


def _add_get(commands: Any) -> None:
    command = add_command(commands, "get", _get)
    command.add_argument("names", nargs="*", metavar="NAME", help="a swatch that its index lists")
    command.add_argument("--from", dest="url", required=True, metavar="URL", help="the folder of its index.json")
    command.add_argument("--all", action="store_true", help="all that its index lists")
    command.add_argument("--name", help="what to call it in the library; for one swatch")
    command.add_argument("--replace", action="store_true", help="take the place of one of the same name")
    _library(command)


def _get(options: argparse.Namespace) -> int:
    """Fetch swatches from a library on the web, hashes checked; without a name, list what it has.

    for example:
      hapscene swatch get --from https://example.org/swatches/
      hapscene swatch get oak birch --from https://example.org/swatches/
    """
    if options.name is not None and (options.all or len(options.names) != 1):
        raise SwatchError("--name is for one swatch")
    from hapscene.swatches.library import get, library_folder, read_index

    address, entries = read_index(options.url)
    names = [entry.name for entry in entries] if options.all else options.names
    if not names:
        _print_entries({"library": entries}, False)
        return 0
    code = 0
    for i, name in enumerate(names, 1):
        try:
            entry = get(name, address, entries, folder=options.library, replace=options.replace, new_name=options.name)
        except SwatchError as error:
            complain(str(error))
            code = 2
            continue
        tell([f"{i}/{len(names)}  {entry.name} → {library_folder(options.library) / entry.file}"])
    return code


# `hapscene swatch import` and `hapscene swatch export`.


def _add_import(commands: Any) -> None:
    add_group(commands, "import", "make swatches of other programs' files: hatt", _add_import_hatt, metavar="FORMAT")


def _add_import_hatt(formats: Any) -> None:
    command = add_command(formats, "hatt", _import_hatt)
    command.add_argument("files", nargs="+", metavar="FILE", help="Models_X.xml, Taps_X.xml, or a folder of them")
    add_out_folder(command, "out/hatt")


def _import_hatt(options: argparse.Namespace) -> int:
    """Import files of the Penn Haptic Texture Toolkit: models, with the taps of the same name.

    for example:
      hapscene swatch import hatt "Models_ABS Plastic.xml" "Taps_ABS Plastic.xml" -o swatches
      hapscene swatch import hatt Models10000Hz/XML Taps/XML -o swatches
    """
    for file in options.files:
        check_there(file, SwatchError, "file or folder")
    from hapscene.capture.io.hatt import ImportOutcome, import_many

    outcome = ImportOutcome()
    try:
        import_many(options.files, options.out, lambda line: say(f"{line}\n"), outcome)
    except KeyboardInterrupt:
        heard()
        complain(f"interrupted; the {len(outcome.made)} swatches named above are whole")
        return 130
    print(f"{len(outcome.made)} made, {len(outcome.broken)} broken")
    for line in outcome.broken:
        complain(line)
    return 2 if outcome.broken else 0


def _add_export(commands: Any) -> None:
    summary = "write a swatch for other programs: hjif"
    add_group(commands, "export", summary, _add_export_hjif, metavar="FORMAT")


def _add_export_hjif(formats: Any) -> None:
    command = add_command(formats, "hjif", _export_hjif)
    command.add_argument("swatch", metavar="SWATCH", help="a name, or a .swatch file")
    add_out_file(command, "HJIF", "file to write (default NAME.hjif, as oak.hjif)")
    command.add_argument("--force", type=force, default=1.0, metavar="N", help="normal force [N] (default 1)")
    command.add_argument(
        "--speed",
        type=number("a speed is a number of m/s"),
        default=0.1,
        metavar="M_S",
        help="slip speed [m/s] (default 0.1)",
    )
    command.add_argument("--seconds", type=seconds, default=2.0, metavar="S", help="length of the texture (default 2)")
    command.add_argument("--rate", type=rate, metavar="HZ", help="samples a second (default: the texture's own)")
    command.add_argument("--seed", type=seed, default=0, help="of the texture's noise (default 0)")


def _export_hjif(options: argparse.Namespace) -> int:
    """Write a swatch as an MPEG haptics file: its texture at one force and speed, then its taps.

    for example:
      hapscene swatch export hjif wood
      hapscene swatch export hjif oak.swatch --force 1 --speed 0.1 --seconds 2 -o oak.hjif
    """
    check_swatch(options.swatch)
    options.out = options.out or new_file(f"{base_name(options.swatch)}.hjif", "-o")
    from hapscene.capture.io.hjif import export_hjif
    from hapscene.swatches.library import load_swatch

    stroke = {"force_N": options.force, "speed_m_s": options.speed, "seconds": options.seconds}
    export_hjif(load_swatch(options.swatch), options.out, **stroke, rate_Hz=options.rate, seed=options.seed)
    name_made([Path(options.out)])
    return 0


# `hapscene swatch compare`.


def _add_compare(commands: Any) -> None:
    command = add_command(commands, "compare", _compare)
    command.add_argument(
        "surface", metavar="SURFACE", nargs="+",
        help="a .swatch file, the name of a shipped swatch, or a recording, to which a swatch is fitted",
    )  # fmt: skip
    command.add_argument("--library", metavar="DIR", help="rank the swatches of this folder by how near they are")
    command.add_argument("--json", action="store_true", help="print JSON")
    add_recording_options(command)


def _compare(options: argparse.Namespace) -> int:
    """How different surfaces feel: side by side, or against a library.

    for example:
      hapscene swatch compare wood paper
      hapscene swatch compare mine.swatch                     (against the shipped swatches)
      hapscene swatch compare mine.swatch --library swatches/
      hapscene swatch compare a.csv b.csv --rate 10000 --units acceleration=g
    """
    for name in options.surface:
        check_swatch(name)
        if Path(name).suffix.lower() in RECORDING_SUFFIXES:
            check_there(name, CaptureError)
    check_there(options.library, SwatchError, "folder")
    from hapscene.capture.report.compare import compare, load_library, load_surface, rank

    surfaces = [load_surface(name, **recording_options(options)) for name in options.surface]
    swatches = [surface.swatch for surface in surfaces]
    if options.library is None and len(swatches) == 2:
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
            note(reason)
    return 0


def _print(as_json: bool, content: dict[str, Any], lines: Sequence[str]) -> None:
    if as_json:
        print(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False))
    else:
        tell(lines)


def _repeats(surfaces: Sequence["ComparedSurface"]) -> dict[str, Any]:
    """How far the halves of each recording are apart, for JSON."""
    return {"repeat_jnd": [surface.repeat_jnd for surface in surfaces]}


def _pair_text(comparison: "Comparison", surfaces: Sequence["ComparedSurface"]) -> list[str]:
    rows: list[Sequence[str]] = [("", comparison.first, comparison.second, "difference", "felt from", "")]
    rows += [_row(d) for d in comparison.differences]
    lines = [*_table(rows), "", _sentence(comparison)]
    if comparison.tools is not None:
        one, two = comparison.tools
        lines.append(f"touched with different tools ({one}; {two}): that alone may differ as much as surfaces do")
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


def _repeat_text(surfaces: Sequence["ComparedSurface"]) -> list[str]:
    return [
        f"two halves of {s.swatch.name}'s own recording are {s.repeat_jnd:.1f} JND apart: less may be chance"
        for s in surfaces
        if s.repeat_jnd is not None
    ]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns of even width."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


# `hapscene swatch publish`.


def _add_publish(commands: Any) -> None:
    command = add_command(commands, "publish", _publish)
    command.add_argument("folder", type=folder, metavar="FOLDER", help="folder of the site")
    told = "a name, or a .swatch file (default: all of the library)"
    command.add_argument("swatches", nargs="*", metavar="SWATCH", help=told)
    _library(command)
    command.add_argument("--shipped", action="store_true", help="those that come with hapscene as well")
    command.add_argument("--title", default="Haptic swatches", help="of the first page (default: Haptic swatches)")


def _publish(options: argparse.Namespace) -> int:
    """Make a library a site that others can host: pages with picture, spectra, sound and licence, and its index.

    Any web server can hold it, and the pages can be opened as files. `swatch get` fetches from it. What the folder has
    of other things stays; published again, what was made before is replaced.

    for example:
      hapscene swatch publish site
      hapscene swatch publish site oak.swatch wood --title "Woods of our workshop"
      python -m http.server --directory site
    """
    for name in options.swatches:
        check_swatch(name)
    check_out_folder(options.folder)
    from hapscene.swatches.site import gather, publish

    sources = gather(options.swatches, options.library, options.shipped)
    entries = publish(sources, options.folder, options.title, say)
    counted = f"{len(entries)} swatch{'es' * (len(entries) != 1)}"
    sizes = [file.stat().st_size for file in Path(options.folder).iterdir() if file.is_file()]
    tell([f"made: {Path(options.folder) / 'index.html'}  ({counted}, {size_words(sum(sizes))})"])
    if bare := [entry.name for entry in entries if not entry.licence.strip()]:
        note(f"no licence is stated for {', '.join(bare[:5])}{' …' if len(bare) > 5 else ''}: others may not use them")
    return 0
