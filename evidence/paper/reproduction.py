"""The figures in turn, the page and the table of numbers: `hapscene lab reproduce`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from hapscene.errors import HapsceneError
from hapscene.handle.plant import Plant
from hapscene.io.files import whole_folder

from ..page import write_page
from . import handle_figure, interpolation_table, prediction_figure, remote_figure, tap_study
from .material import Material, load_materials
from .paper_page import page_of, summary, table_of_numbers
from .result import FigureResult, Progress

FILES: Final = ("haptography.html", "numbers.csv")
"""Names of the files that are written."""

START, END = "<!-- reproduce -->\n", "<!-- end of reproduce -->\n"
"""Lines of paper.md between which the summary is written."""

Reproduce = Callable[[dict[str, Material]], FigureResult]

FIGURES: Final[Mapping[str, tuple[str, Reproduce]]] = {
    "fig2": ("two materials", prediction_figure.two_materials),
    "fig4": ("linear prediction", lambda m: prediction_figure.linear_prediction(m["wood"])),
    "fig5": ("real and synthetic acceleration", lambda m: prediction_figure.real_against_synthetic(m["wood"])),
    "interpolation": ("interpolation between conditions", lambda _: interpolation_table.interpolation()),
    "fig7": ("handle, five users", lambda _: handle_figure.handle_in_hands(Plant(), handle_figure.PAPER_BAND_HZ)),
    "fig8": ("teleoperation, two taps and five drags", lambda _: remote_figure.teleoperated_wood()),
    "taps": ("ratings of taps, computed", lambda _: tap_study.rated_taps()),
    "handle": ("handle to 1000 Hz", lambda _: handle_figure.handle_in_hands(Plant(), handle_figure.FULL_BAND_HZ)),
}
"""The figures: key on the page, progress message, and the function that reproduces it."""


def reproduce(
    out: str | Path, recordings: Path | None = None, say: Progress = lambda text: None, docs: Path | None = None
) -> list[Path]:
    """Reproduce all figures and write `FILES` into a folder; an interrupted run writes nothing.

    Without recordings, the surfaces are synthesised from the shipped swatches. `docs` is the folder docs/results, in
    whose paper.md the summary is written as well.

    Raises:
        CaptureError: no recording in that folder, or an invalid one.
        HapsceneError: `docs` has no paper.md with the lines `START` and `END`.
    """
    materials, results = load_materials(recordings), {}
    page = None if docs is None else _parts(docs / "paper.md")
    with whole_folder(out, ours=FILES) as folder:
        for number, (key, (words, make)) in enumerate(FIGURES.items(), 1):
            say(f"{number} of {len(FIGURES)}: {words}\n")
            results[key] = make(materials)
        for name, text in zip(FILES, (page_of(results, materials).html(), table_of_numbers(results)), strict=True):
            (folder / name).write_text(text, encoding="utf-8", newline="\n")
    made = [Path(out) / name for name in FILES]
    if docs is not None and page is not None:
        made.append(docs / "paper.md")
        write_page(made[-1], f"{page[0]}{START}{summary(results, materials).markdown(docs)}{END}{page[1]}")
    return made


def _parts(file: Path) -> tuple[str, str]:
    """Return the text of paper.md before and after the generated summary."""
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    before, start, rest = text.partition(START)
    _, end, after = rest.partition(END)
    if not start or not end:
        raise HapsceneError(
            f"{file}: expected the lines {START.strip()} and {END.strip()}; name the folder docs/results"
        )
    return before, after
