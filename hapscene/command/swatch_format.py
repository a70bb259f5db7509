"""`hapscene swatch import` and `hapscene swatch export`."""

import argparse
import sys
from typing import Any

from hapscene.command.word import add_command, force, name_made, number, rate, seconds, seed


def add_import(commands: Any) -> None:
    group = commands.add_parser(
        "import",
        help="make swatches of other programs' files: hatt",
        description="Make swatches of other programs' files.",
    )
    kinds = group.add_subparsers(required=True, metavar="FORMAT")
    command = add_command(
        kinds,
        "hatt",
        _import_hatt,
        "import files of the Penn Haptic Texture Toolkit: models, with the taps of the same name",
        'hapscene swatch import hatt "Models_ABS Plastic.xml" "Taps_ABS Plastic.xml" -o swatches',
        "hapscene swatch import hatt Models10000Hz/XML Taps/XML -o swatches",
    )
    command.add_argument("files", nargs="+", metavar="FILE", help="Models_X.xml, Taps_X.xml, or a folder of them")
    command.add_argument("-o", "--out", required=True, metavar="DIR", help="folder to write the swatches into")


def _import_hatt(options: argparse.Namespace) -> int:
    from hapscene.capture.hatt_batch import Outcome, import_many

    outcome = Outcome()
    try:
        import_many(options.files, options.out, lambda line: print(line, flush=True), outcome)
    except KeyboardInterrupt:
        print(f"hapscene: interrupted; the {len(outcome.made)} swatches named above are whole", file=sys.stderr)
        return 130
    print(f"{len(outcome.made)} made, {len(outcome.broken)} broken")
    for line in outcome.broken:
        print(f"hapscene: {' '.join(line.split())}", file=sys.stderr)
    return 2 if outcome.broken else 0


def add_export(commands: Any) -> None:
    group = commands.add_parser(
        "export",
        help="write a swatch for other programs: hatt, hjif",
        description="Write a swatch for other programs.",
    )
    kinds = group.add_subparsers(required=True, metavar="FORMAT")
    _add_hatt(kinds)
    _add_hjif(kinds)


def _add_hatt(kinds: Any) -> None:
    command = add_command(
        kinds,
        "hatt",
        _export_hatt,
        "write a swatch in the layout of the Penn Haptic Texture Toolkit",
        "hapscene swatch export hatt oak.swatch -o Models_oak.xml --taps Taps_oak.xml",
        "hapscene swatch export hatt wood --rate 10000 -o Models_wood.xml",
    )
    command.add_argument("swatch", metavar="SWATCH", help="a name, or a .swatch file")
    command.add_argument("-o", "--out", required=True, metavar="XML", help="file to write the models to")
    command.add_argument("--taps", metavar="XML", help="file to write the taps to")
    command.add_argument(
        "--rate", type=rate, metavar="HZ", help="resample to this rate; the toolkit plays 10000 and 1000"
    )


def _export_hatt(options: argparse.Namespace) -> int:
    from pathlib import Path

    from hapscene.capture.hatt import export_hatt
    from hapscene.surface.swatch_file import load_swatch

    export_hatt(load_swatch(options.swatch), options.out, options.taps, options.rate)
    name_made([Path(file) for file in (options.out, options.taps) if file is not None])
    return 0


def _add_hjif(kinds: Any) -> None:
    command = add_command(
        kinds,
        "hjif",
        _export_hjif,
        "write a swatch as an MPEG haptics file: its texture at one force and speed, then its taps",
        "hapscene swatch export hjif oak.swatch --force 1 --speed 0.1 --seconds 2 -o oak.hjif",
    )
    command.add_argument("swatch", metavar="SWATCH", help="a name, or a .swatch file")
    command.add_argument("-o", "--out", required=True, metavar="HJIF", help="file to write")
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
    from pathlib import Path

    from hapscene.capture.hjif import export_hjif
    from hapscene.surface.swatch_file import load_swatch

    swatch = load_swatch(options.swatch)
    export_hjif(swatch, options.out, options.force, options.speed, options.seconds, options.rate, options.seed)
    name_made([Path(options.out)])
    return 0
