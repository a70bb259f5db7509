"""`hapscene swatch`: the swatch library, comparison of surfaces, publishing."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace as changed
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from hapscene.cli.console import format_size, print_error, print_lines, print_note, print_progress, table
from hapscene.cli.inputs import check_swatch
from hapscene.cli.options import Help, InFiles, InPaths, OutFolder
from hapscene.errors import SwatchError
from hapscene.interrupt import clear_interrupt

if TYPE_CHECKING:
    from hapscene.capture.report.compare import Comparison, Difference
    from hapscene.swatches.library import LibraryEntry

__all__ = ["app"]

app = App(name="swatch", help="Swatches: haptic properties of surfaces, stored in a library.")

Library = Annotated[
    str | None,
    Parameter(help="Folder of the library (default: $HAPSCENE_LIBRARY, else a folder in your data folder)."),
]
NewName = Annotated[str | None, Parameter(help="Name in the library, if a single swatch is given.")]
Replace = Annotated[bool, Parameter(help="Replace a swatch of the same name.")]


@app.command(name="list", alias="search")
def list_swatches(
    *terms: Annotated[str, Help("Word, or comparison such as stiffness>500")],
    library: Library = None,
) -> int:
    """List swatches, or search them: shipped ones, computed ones, and those of the library.

    Each term must match: a word of the name, description, tags, tool, tip, source
    or licence, or a comparison of a property. Exit codes: 0 success; 1 no match.

    examples:
      hapscene swatch list
      hapscene swatch search wood "friction<0.4" "roughness>=1"
      hapscene swatch search probe ball
    """
    from hapscene.swatches import library as known

    own = [entry for home in known.own_folders(library) for entry in known.own_entries(home)]
    groups = {"shipped": known.shipped_entries(), "computed": known.computed_entries(), "library": own}
    if terms:
        found = known.search([entry for group in groups.values() for entry in group], terms)
        groups = {source: [entry for entry in group if entry in found] for source, group in groups.items()}
    _print_entries(groups)
    if not (terms or own):
        print(f"the library in {known.library_folder(library)} is empty")
    if terms and not any(groups.values()):
        print_note("no swatch matches")
        return 1
    return 0


def _print_entries(groups: Mapping[str, Sequence["LibraryEntry"]]) -> None:
    """Print one line for each swatch with its source."""
    from hapscene.surface.swatch import touched_with

    for entry, source in ((entry, source) for source, group in groups.items() for entry in group):
        touched = touched_with(entry)
        print_lines([f"{entry.name:<20}  {source:<8}  {', '.join(entry.words)}{f' ({touched})' if touched else ''}"])


@app.command
def show(swatch: Annotated[str, Help("Name of a swatch, or .swatch file")], /, *, library: Library = None) -> None:
    """Print the properties of a swatch, its origin and licence.

    examples:
      hapscene swatch show wood
      hapscene swatch show oak.swatch
    """
    from hapscene.surface.swatch_summary import lines
    from hapscene.swatches.library import find, load_swatch

    own = find(swatch, library) if library else None
    print_lines(lines(load_swatch(own or swatch)))


@app.command
def add(
    files: Annotated[InFiles, Help("Swatch files")],
    /,
    *,
    name: NewName = None,
    replace: Replace = False,
    library: Library = None,
) -> None:
    """Add swatch files to the library.

    examples:
      hapscene swatch add oak.swatch
      hapscene swatch add oak.swatch --name 'oak, oiled'
    """
    from hapscene.swatches import library as known

    if name is not None and len(files) > 1:
        raise SwatchError(f"--name {name!r} applies to a single file; got {len(files)} files")
    swatches = [known.load_swatch(Path(file)) for file in files]  # read all files before adding any
    for swatch in swatches:
        entry = known.add(swatch if name is None else changed(swatch, name=name), library, replace)
        print_lines([f"{entry.name} → {known.library_folder(library) / entry.file}"])


@app.command
def remove(names: Annotated[list[str], Help("Names of swatches")], /, *, library: Library = None) -> None:
    """Remove swatches from the library, and delete their files.

    examples:
      hapscene swatch remove oak
    """
    from hapscene.swatches import library as known

    for name in names:
        print_lines([f"removed {known.remove(name, library)}"])


@app.command
def get(
    *names: Annotated[str, Help("Names of swatches (default: list the available ones)")],
    url: Annotated[str, Parameter(name="--from", metavar="URL"), Help("Address of the folder with index.json")],
    every: Annotated[bool, Parameter(name="--all"), Help("Download all swatches of the index")] = False,
    name: NewName = None,
    replace: Replace = False,
    library: Library = None,
) -> int:
    """Download swatches from a published library, and check their hashes.

    Without names, the available swatches are listed.

    examples:
      hapscene swatch get --from https://example.org/swatches/
      hapscene swatch get oak birch --from https://example.org/swatches/
    """
    if name is not None and (every or len(names) != 1):
        raise SwatchError(f"--name {name!r} applies to a single swatch; name exactly one")
    from hapscene.swatches import library as known

    address, entries = known.read_index(url)
    wanted = [entry.name for entry in entries] if every else names
    if not wanted:
        _print_entries({"library": entries})
    code = 0
    for i, each in enumerate(wanted, 1):
        try:
            entry = known.get(each, address, entries, folder=library, replace=replace, new_name=name)
        except SwatchError as error:
            print_error(str(error))
            code = 2
            continue
        print_lines([f"{i}/{len(wanted)}  {entry.name} → {known.library_folder(library) / entry.file}"])
    return code


@app.command(name="import")
def import_files(
    files: Annotated[InPaths, Help("Files Models_X.xml and Taps_X.xml, or folders of them")],
    /,
    *,
    out: OutFolder = Path("out/hatt"),
) -> int:
    """Import textures of the Penn Haptic Texture Toolkit (HaTT) as swatches.

    Models_X.xml and Taps_X.xml of the same X become one swatch.

    examples:
      hapscene swatch import Models_oak.xml Taps_oak.xml -o swatches
      hapscene swatch import Models10000Hz/XML Taps/XML -o swatches
    """
    from hapscene.capture.io.hatt import import_many

    try:
        broken = import_many(files, str(out), lambda line: print_progress(f"{line}\n"))
    except KeyboardInterrupt:
        clear_interrupt()
        print_error("interrupted; the swatches in the list above are complete")
        return 130
    for line in broken:
        print_error(line)
    return 2 if broken else 0


# Comparison.


@app.command
def compare(surfaces: Annotated[list[str], Help("Swatch names or .swatch files")], /) -> None:
    """Compare surfaces perceptually: two side by side, or the first with each of several.

    A single surface is compared with all shipped swatches and your library.
    Differences are in just-noticeable differences (JND).

    examples:
      hapscene swatch compare wood paper
      hapscene swatch compare mine.swatch
      hapscene swatch compare mine.swatch swatches/*.swatch
    """
    for name in surfaces:
        check_swatch(name)
    from hapscene.capture.report import compare as comparing
    from hapscene.swatches import library as known

    first, *others = (known.load_swatch(name) for name in surfaces)
    if len(others) == 1:
        print_lines(_pair_text(comparing.compare(first, *others)))
        return
    if not others:
        places: list[str | Path] = [*known.shipped_swatches()]
        places += [home / entry.file for home in known.own_folders() for entry in known.own_entries(home)]
        for place in places:
            try:
                others.append(known.load_swatch(place))
            except SwatchError as error:
                print_note(str(error))
    print_lines(_rank_text(comparing.rank(first, [other for other in others if other != first])))


def _pair_text(comparison: "Comparison") -> list[str]:
    rows = [("", comparison.first, comparison.second, "difference", "1 JND is", "")]
    rows += [_row(d) for d in comparison.differences]
    lines = [*table(rows), "", _sentence(comparison)]
    if comparison.tools is not None:
        one, two = comparison.tools
        lines.append(f"recorded with different tools ({one}; {two}): the tools alone can cause such a difference")
    lines += _assumed([comparison])
    return lines + [f"not compared: {name} ({reason})" for name, reason in comparison.skipped.items()]


def _assumed(comparisons: Sequence["Comparison"]) -> list[str]:
    levels = dict(pair for comparison in comparisons for pair in comparison.assumed.items())
    return [f"vibration level of {name} is assumed: {reason}" for name, reason in levels.items()]


def _row(d: "Difference") -> tuple[str, str, str, str, str, str]:
    q = d.quantity
    first, second = (
        f"{v:.3g} {q.value_unit}".removesuffix(" 1") if math.isfinite(v) else "" for v in (d.first, d.second)
    )
    change = f"{d.change:.1f}" if math.isnan(d.first) else f"{d.change:+.1f}"
    return q.name, first, second, f"{change} {q.unit}".replace("-", "−"), f"{q.jnd:g} {q.unit}", d.verdict


def _sentence(comparison: "Comparison") -> str:
    largest = comparison.largest
    if largest is None:
        return f"{comparison.first} and {comparison.second} cannot be compared: no property is measured for both"
    most = f"largest difference: {largest.quantity.name}, {comparison.distance_jnd:.1f} JND"
    return f"{comparison.second} {comparison.verdict} from {comparison.first}; {most}"


def _rank_text(ranked: Sequence["Comparison"]) -> list[str]:
    if not ranked:
        return ["no other surface to compare with in the library"]
    rows = [("", "surface", "distance", "largest in", f"from {ranked[0].first}")]
    for place, c in enumerate(ranked, 1):
        distance = f"{c.distance_jnd:.1f} JND" if c.largest else ""
        rows.append((str(place), c.second, distance, c.largest.quantity.name if c.largest else "", c.verdict))
    return [*table(rows), "1 JND is the just-noticeable difference", *_assumed(ranked), ""]


@app.command
def publish(
    folder: Annotated[Path, Help("Folder of the web site")],
    /,
    *swatches: Annotated[str, Help("Swatch names or .swatch files (default: all of the library)")],
    library: Library = None,
    shipped: Annotated[bool, Help("Publish the shipped swatches as well")] = False,
) -> None:
    """Publish a swatch library as a static web site with a page for each swatch.

    A page has a picture, spectra, audio and the licence. Any web server can host
    the site, and the pages also open as local files. `swatch get` downloads from
    it. Other files in the folder are not changed.

    examples:
      hapscene swatch publish site
      hapscene swatch publish site oak.swatch wood
      python -m http.server --directory site
    """
    from hapscene.swatches.site import gather
    from hapscene.swatches.site import publish as write_site

    entries = write_site(gather(swatches, library, shipped), str(folder), say=print_progress)
    counted = f"{len(entries)} swatch{'es' * (len(entries) != 1)}"
    sizes = [file.stat().st_size for file in folder.iterdir() if file.is_file()]
    print_lines([f"made: {folder / 'index.html'}  ({counted}, {format_size(sum(sizes))})"])
    if bare := [entry.name for entry in entries if not entry.licence.strip()]:
        print_note(f"without a licence, others may not use: {', '.join(bare[:5])}{' …' if len(bare) > 5 else ''}")
