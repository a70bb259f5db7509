"""`hapscene swatch`: list, show, search, add, remove, get; import, export, compare, gallery."""

import argparse
import json
from typing import Any

from hapscene.command.swatch_compare import add_swatch_compare
from hapscene.command.swatch_format import add_export, add_import
from hapscene.command.swatch_gallery import add_swatch_gallery
from hapscene.command.word import add_command


def add_swatch(commands: Any) -> None:
    group = commands.add_parser(
        "swatch",
        help="the library of swatches: list, show, search, add, remove, get, import, export, compare, gallery",
        description="The library of swatches, and files of other programs.",
        epilog="hapscene swatch COMMAND --help says more.",
    )
    words = group.add_subparsers(required=True, metavar="COMMAND")
    for add in (_add_list, _add_show, _add_search, _add_add, _add_remove, _add_get):
        add(words)
    add_import(words)
    add_export(words)
    add_swatch_compare(words)
    add_swatch_gallery(words)


def _library(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--library",
        metavar="DIR",
        help="folder of the library (default: that of $HAPSCENE_LIBRARY, else one in your data folder)",
    )


def _add_list(commands: Any) -> None:
    command = add_command(
        commands, "list", _list, "list the swatches there are: shipped, and of the library", "hapscene swatch list"
    )
    _library(command)
    command.add_argument("--json", action="store_true", help="print JSON")


def _list(options: argparse.Namespace) -> int:
    from hapscene.surface.library import library_folder, own_entries, shipped_entries

    own = own_entries(options.library)
    _print_entries(shipped_entries(), own, options.json)
    if not own and not options.json:
        print(f"the library in {library_folder(options.library)} is empty")
    return 0


def _print_entries(shipped: list[Any], own: list[Any], as_json: bool) -> None:
    """One line a swatch, or JSON."""
    rows = [(entry, "shipped") for entry in shipped] + [(entry, "library") for entry in own]
    if as_json:
        found = [
            {"name": e.name, "from": source, "words": e.words, "figures": e.figures, "licence": e.licence}
            for e, source in rows
        ]
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    width = max((len(entry.name) for entry, _ in rows), default=0)
    for entry, source in rows:
        print(f"{entry.name:<{width}}  {source:<8}  {', '.join(entry.words)}")


def _add_show(commands: Any) -> None:
    command = add_command(
        commands,
        "show",
        _show,
        "tell how a swatch feels, in words and figures, and where it comes from",
        "hapscene swatch show wood",
        "hapscene swatch show oak.swatch --json",
    )
    command.add_argument("swatch", metavar="SWATCH", help="a name, or a .swatch file")
    _library(command)
    command.add_argument("--json", action="store_true", help="print JSON")


def _show(options: argparse.Namespace) -> int:
    from hapscene.surface.library import find
    from hapscene.surface.portrait import figures, lines, words
    from hapscene.surface.swatch_file import load_swatch

    own = find(options.swatch, options.library) if options.library else None
    swatch = load_swatch(own or options.swatch)
    numbers = figures(swatch)
    if options.json:
        told = {"name": swatch.name, "words": words(numbers), "figures": numbers}
        told |= {"provenance": swatch.provenance, "licence": swatch.licence}
        print(json.dumps(told, indent=2, ensure_ascii=False))
        return 0
    print("\n".join(lines(swatch)))
    return 0


def _add_search(commands: Any) -> None:
    command = add_command(
        commands,
        "search",
        _search,
        "find swatches by words and by bounds on their figures",
        "hapscene swatch search grippy",
        'hapscene swatch search wood "friction<0.4" "roughness>=1"',
    )
    command.add_argument("terms", nargs="+", metavar="TERM", help="a word, or a bound: stiffness, roughness, friction")
    _library(command)
    command.add_argument("--json", action="store_true", help="print JSON")


def _search(options: argparse.Namespace) -> int:
    from hapscene.surface.library import own_entries, shipped_entries
    from hapscene.surface.library_search import search

    shipped, own = shipped_entries(), own_entries(options.library)
    found = search([*shipped, *own], options.terms)
    _print_entries([e for e in shipped if e in found], [e for e in own if e in found], options.json)
    if not found and not options.json:
        print("none")
    return 0 if found else 1


def _add_add(commands: Any) -> None:
    command = add_command(
        commands,
        "add",
        _add,
        "put swatch files into the library",
        "hapscene swatch add oak.swatch",
        "hapscene swatch add oak.swatch --name 'oak, oiled'",
    )
    command.add_argument("files", nargs="+", metavar="FILE", help="a .swatch file")
    command.add_argument("--name", help="name in the library, of a single file")
    command.add_argument("--replace", action="store_true", help="take the place of one of the same name")
    _library(command)


def _add(options: argparse.Namespace) -> int:
    from dataclasses import replace
    from pathlib import Path

    from hapscene.errors import SwatchError
    from hapscene.surface.library import add, library_folder
    from hapscene.surface.swatch_file import load_swatch

    if options.name is not None and len(options.files) > 1:
        raise SwatchError("--name is for a single file")
    swatches = [load_swatch(Path(file)) for file in options.files]  # all are read before any is added
    for swatch in swatches:
        entry = add(
            swatch if options.name is None else replace(swatch, name=options.name), options.library, options.replace
        )
        print(f"{entry.name} → {library_folder(options.library) / entry.file}")
    return 0


def _add_remove(commands: Any) -> None:
    command = add_command(
        commands, "remove", _remove, "take swatches out of the library, their files too", "hapscene swatch remove oak"
    )
    command.add_argument("names", nargs="+", metavar="NAME", help="a swatch of the library")
    _library(command)


def _remove(options: argparse.Namespace) -> int:
    from hapscene.surface.library import remove

    for name in options.names:
        print(f"removed {remove(name, options.library)}")
    return 0


def _add_get(commands: Any) -> None:
    command = add_command(
        commands,
        "get",
        _get,
        "fetch swatches from a library on the web, hashes checked; without a name, list what it has",
        "hapscene swatch get --from https://example.org/swatches/",
        "hapscene swatch get oak birch --from https://example.org/swatches/",
    )
    command.add_argument("names", nargs="*", metavar="NAME", help="a swatch that its index lists")
    command.add_argument("--from", dest="url", required=True, metavar="URL", help="the folder of its index.json")
    command.add_argument("--all", action="store_true", help="all that its index lists")
    command.add_argument("--replace", action="store_true", help="take the place of one of the same name")
    _library(command)


def _get(options: argparse.Namespace) -> int:
    import sys

    from hapscene.errors import SwatchError
    from hapscene.surface.fetch import get, read_index
    from hapscene.surface.library import library_folder

    address, entries = read_index(options.url)
    names = [entry.name for entry in entries] if options.all else options.names
    if not names:
        _print_entries([], entries, False)
        return 0
    broken: list[str] = []
    for i, name in enumerate(names, 1):
        try:
            entry = get(name, address, entries, options.library, options.replace)
        except SwatchError as error:
            broken.append(str(error))
            continue
        print(f"{i}/{len(names)}  {entry.name} → {library_folder(options.library) / entry.file}", flush=True)
    for line in broken:
        print(f"hapscene: {line}", file=sys.stderr)
    return 2 if broken else 0
