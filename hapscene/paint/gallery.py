"""The shelf as a page to read: every swatch in pictures, in words with units, and to be heard. In Markdown."""

import html
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final
from urllib.parse import quote

from hapscene.output import whole_file, whole_folder
from hapscene.paint.gallery_plot import painted_body, scale_of, write_portraits
from hapscene.paint.heard import START_S, stroked, wav
from hapscene.paint.word import Phrase, phrases
from hapscene.surface.library import entry_of
from hapscene.surface.portrait import FORCE_N, SPEED_M_S, TAP_M_S
from hapscene.surface.swatch import Swatch

ASSUMED: Final = {
    "hardness": "stiffness_N_m",
    "texture": "texture",
    "friction": "friction_dynamic",
    "taps": "taps",
}
"""What a swatch calls the number behind a quality where it says why that was not measured."""


WIDTH: Final = 120
"""Longest line of the page [characters]."""


def write_gallery(
    swatches: Sequence[Swatch], page: str | Path, say: Callable[[str], None] = lambda text: None
) -> list[Path]:
    """Write a page of swatches, and beside it a folder of its name with their pictures and sounds.

    Args:
        swatches: in the order of the page.
        page: the Markdown file; its folder must be there.
        say: told what is being done.

    Returns:
        The files made.

    Raises:
        OSError: the folder is missing, or cannot be written.
    """
    page = Path(page)
    stems: list[str] = []
    for swatch in swatches:
        taken = {f"{stem}.swatch".casefold() for stem in stems}
        stems.append(entry_of(swatch, b"", taken).file.removesuffix(".swatch"))
    scale = scale_of(swatches)
    made: list[Path] = []
    with whole_folder(page.parent / page.stem) as folder:
        for swatch, stem in zip(swatches, stems, strict=True):
            say(f"{swatch.name}\n")
            body = painted_body(swatch)
            write_portraits(swatch, body, scale, folder, stem)
            (folder / f"{stem}.wav").write_bytes(wav(stroked(swatch)))
        made = [page.parent / page.stem / file.name for file in sorted(folder.iterdir())]
    with whole_file(page) as part:
        part.write_text(_page(swatches, stems, page.stem), encoding="utf-8", newline="\n")
    return [page, *made]


def _page(swatches: Sequence[Swatch], stems: Sequence[str], folder: str) -> str:
    """The page's text."""
    about = f"""Each sound is a tap at {1e3 * TAP_M_S:g} mm/s, and from {START_S:g} s on a stroke at {FORCE_N:g} N and
        {1e3 * SPEED_M_S:g} mm/s: the acceleration of the tool's handle. All have one scale, so that a smooth surface is
        heard to be quieter; all pictures have the same axes. **Assumed** is what the recording could not tell."""
    head = "# Gallery of swatches\n\nMade by `hapscene swatch gallery`; every figure is that of the swatch's own file."
    cards = [_card(swatch, f"{folder}/{stem}") for swatch, stem in zip(swatches, stems, strict=True)]
    return "\n\n".join([head, _wrapped(about), *cards]) + "\n"


def _card(swatch: Swatch, file: str) -> str:
    """One swatch."""
    file = quote(file)  # a page may be called anything
    name = _plain(swatch.name)
    told = f"{swatch.name}: a painted body, the spectra of its texture, and its tap over time"
    rows = "\n".join(_row(swatch, phrase) for phrase in phrases(swatch))
    return f"""## {name}

<picture>
  <source media="(prefers-color-scheme: dark)" srcset="{file}-dark.png">
  <img src="{file}-light.png" alt="{html.escape(told)}">
</picture>

[Hear it]({file}.wav)

| | | |
|---|---|---|
{rows}

{_wrapped(_plain(swatch.provenance)) or "Where it is from is not stated."}"""


def _row(swatch: Swatch, phrase: Phrase) -> str:
    reason = swatch.absent.get(ASSUMED[phrase.quality], "")
    missing = {"texture": swatch.texture, "taps": swatch.taps}.get(phrase.quality, swatch) is None
    because = f"; {'' if missing else '**assumed**: '}{_plain(reason)}" if reason else ""
    return f"| {phrase.quality} | {phrase.word} | {phrase.figure}{because} |"


def _wrapped(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), WIDTH, break_long_words=False, break_on_hyphens=False)


def _plain(text: str) -> str:
    """A text from a file, of which nothing is markup."""
    line = html.escape(" ".join(text.split()), quote=False)
    for mark in "\\`*_[]|#":
        line = line.replace(mark, f"\\{mark}")
    return line
