"""`hapscene swatch gallery`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.word import add_command, name_made


def add_swatch_gallery(commands: Any) -> None:
    command = add_command(
        commands,
        "gallery",
        _gallery,
        "make a page of swatches: picture, spectra, sound, and their numbers in words",
        "hapscene swatch gallery --out gallery.md",
        "hapscene swatch gallery oak.swatch wood --out oak.md",
    )
    command.add_argument("swatches", nargs="*", metavar="SWATCH", help="a name, or a .swatch file (default: shipped)")
    command.add_argument(
        "--out", required=True, metavar="FILE", help="the page, .md; pictures and sounds go into a folder of its name"
    )


def _gallery(options: argparse.Namespace) -> int:
    from hapscene.errors import SwatchError
    from hapscene.paint.gallery import write_gallery
    from hapscene.surface.swatch_file import load_swatch, shipped_swatches
    from hapscene.touch import speak

    page = Path(options.out)
    if page.suffix.lower() != ".md":
        raise SwatchError(f"{page}: a gallery is a Markdown page; name it {page.stem or 'gallery'}.md")
    if not page.parent.is_dir():
        raise SwatchError(f"{page}: there is no folder {page.parent}; make it first")
    swatches = [load_swatch(name) for name in options.swatches or shipped_swatches()]
    name_made(write_gallery(swatches, page, speak))
    return 0
