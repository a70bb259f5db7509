"""All figures in turn, the page and the table of numbers: what `hapscene lab reproduce` does."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from hapscene.handle.plant import Plant
from hapscene.io.files import whole_folder

from . import handle_figure, prediction_figure, remote_figure, tap_study
from .finding import Finding, Say
from .material import Material, load_materials
from .paper_page import page_of, table_of_numbers

MADE: Final = ("haptography.html", "numbers.csv")
"""What is written."""

Make = Callable[[dict[str, Material]], Finding]

FIGURES: Final[Mapping[str, tuple[str, Make]]] = {
    "fig2": ("two materials", prediction_figure.two_materials),
    "fig4": ("linear prediction", lambda m: prediction_figure.linear_prediction(m["wood"])),
    "fig5": ("real against synthetic", lambda m: prediction_figure.real_against_synthetic(m["wood"])),
    "fig7": ("the handle", lambda _: handle_figure.handle_in_hands(Plant(), handle_figure.PAPER_BAND_HZ)),
    "fig8": ("two taps and five drags", lambda _: remote_figure.felt_through_a_leader()),
    "taps": ("ratings of taps, simulated", lambda _: tap_study.rated_taps()),
    "handle": ("the handle to 1000 Hz", lambda _: handle_figure.handle_in_hands(Plant(), handle_figure.FULL_BAND_HZ)),
}
"""What is reproduced: a key, what is said meanwhile, and what makes it."""


def reproduce(out: str | Path, recordings: Path | None = None, say: Say = lambda text: None) -> list[Path]:
    """Write `MADE` into a folder: all of it or nothing.

    Args:
        out: the folder.
        recordings: folder of the recordings that the shipped swatches were fitted to, or None: what would show a
            surface is then synthesised from the swatches.
        say: told how far it is.

    Raises:
        CaptureError: no recording in that folder, or one that is none.
        OSError: the folder cannot be written.
    """
    materials, findings = load_materials(recordings), {}
    with whole_folder(out, ours=MADE) as folder:
        for number, (key, (words, make)) in enumerate(FIGURES.items(), 1):
            say(f"{number} of {len(FIGURES)}: {words}\n")
            findings[key] = make(materials)
        for name, text in zip(MADE, (page_of(findings, materials).html(), table_of_numbers(findings)), strict=True):
            (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return [Path(out) / name for name in MADE]
