"""All figures in turn, the page and the table of numbers: what `hapscene reproduce` does."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from hapscene.files import whole_folder
from hapscene.handle.plant import Plant

from . import further, handle_figure, prediction_figure, remote_figure, tap_study
from .finding import Finding, Say
from .material import Material, load_materials
from .paper_page import page, table_of_numbers

MADE: Final = ("haptography.html", "numbers.csv")
"""What is written."""

Materials = dict[str, Material]

FIGURES: Final[Mapping[str, tuple[str, Callable[[Materials], Finding]]]] = {
    "fig2": ("two materials", prediction_figure.two_materials),
    "fig4": ("linear prediction", lambda known: prediction_figure.linear_prediction(known["wood"])),
    "fig5": ("real against synthetic", lambda known: prediction_figure.real_against_synthetic(known["wood"])),
    "fig7": ("the handle in five hands", lambda known: handle_figure.handle_in_hands(Plant())),
    "fig8": ("two taps and five drags", lambda known: remote_figure.felt_through_a_leader()),
    "taps": ("ratings of taps, simulated", lambda known: tap_study.rated_taps()),
    "beyond-handle": ("the handle to 1000 Hz", lambda known: further.handle_to_1000_Hz(Plant())),
    "beyond-compensators": ("every compensator", lambda known: further.compensators()),
    "beyond-orders": ("order by perception", further.orders_by_perception),
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
    materials = load_materials(recordings)
    findings = {}
    with whole_folder(out, ours=MADE) as folder:
        for number, (key, (words, make)) in enumerate(FIGURES.items(), 1):
            say(f"{number} of {len(FIGURES)}: {words}\n")
            findings[key] = make(materials)
        html, table = (folder / name for name in MADE)
        html.write_text(page(findings, materials), encoding="utf-8")
        table.write_text(table_of_numbers(findings), encoding="utf-8", newline="\n")
    return [Path(out) / name for name in MADE]
