"""The shelf as a page to read, for `python -m hapscene.paint.gallery FILE`: every swatch in pictures, in words
with units, and to be heard. In Markdown."""

import html
import tempfile
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_BAND_HZ, ACCELERATION_RATE_HZ
from hapscene.errors import ViewError
from hapscene.files import whole_file, whole_folder
from hapscene.paint.shelf import START_S, Phrase, phrases, swatch_sound, wav_bytes
from hapscene.paint.swatch_picture import ball_png
from hapscene.scene.scene import Scene
from hapscene.surface.library import entry_of
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import FORCE_N, SPEED_M_S, TAP_M_S
from hapscene.view.chart import new_chart, turn_dark
from hapscene.view.palette import DARK, INK, LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# A swatch in one picture: a body painted with it, the spectra of its texture, its tap; on light and on dark ground.


GROUNDS: Final = {"light": LIGHT.page, "dark": DARK.page}
"""Ground of the picture by theme: that of pages that show Markdown."""

STROKES: Final = ((0.5, 0.05, (0, (1, 1.2))), (1.0, 0.1, "-"), (2.0, 0.2, (0, (6, 2))))
"""Strokes whose spectra are drawn: normal force [N], slip speed [m/s], dash. Light, plain, brisk. None has a colour:
those are the swatches'."""

STYLE: Final = {"axes.titlesize": 10, "legend.fontsize": 8.5, "lines.linewidth": 1.4}
"""How it differs from other charts."""

RANGE_DB: Final = 50.0
"""Range of the spectra below the highest of the gallery [dB]: what is lower is not felt beside it."""

TAP_MS: Final = 60.0
"""How long a tap is drawn [ms]."""

BODY_PX: Final = 400
"""Width of the painted body [pixels]."""

DRAWN_PX: Final = (800, 720)
"""Size that it is drawn at, for smooth edges [pixels]."""

Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Scale:
    """The axes that all swatches of a gallery share, so that they can be compared: highest level [dB], tap [m/s²]."""

    top_dB: float
    tap_m_s2: float


class _Line(NamedTuple):
    """A spectrum: what was stroked how, its looks, its level (k,)."""

    stroke: str
    dash: Any
    level_dB: NDArray[np.float64]


def scale_of(swatches: Sequence[Swatch]) -> Scale:
    """Axes that hold all of these swatches."""
    frequency = _frequencies()
    levels = [line.level_dB.max() for s in swatches for line in _spectra(s, frequency)]
    taps = [float(np.abs(s.taps.transient(TAP_M_S, ACCELERATION_RATE_HZ)).max()) for s in swatches if s.taps]
    top = 10.0 * np.ceil(max(levels, default=0.0) / 10.0)
    return Scale(float(top), 1.1 * max(taps, default=1.0))


def painted_body(swatch: Swatch) -> Pixels | None:
    """The shipped toad, painted with the swatch: RGBA pixels, clear around it; None where no GL can draw."""
    from PIL import Image
    from scipy.ndimage import binary_erosion

    from hapscene.view.picture import write_picture

    scene = Scene()
    with as_file(files("hapscene_assets") / "meshes" / "toad.ply") as mesh:
        scene.add(mesh, name="toad", unit="m", swatch=swatch)
    with tempfile.TemporaryDirectory(prefix="hapscene-") as folder:
        try:
            write_picture(scene, None, Path(folder) / "body.png", size=DRAWN_PX)
        except ViewError:
            return None
        with Image.open(Path(folder) / "body.png") as picture:
            pixels = np.asarray(picture.convert("RGB"))
    ground = (pixels == pixels[0, 0]).all(axis=2)
    height = len(pixels) if ground[:, 0].all() else int(np.argmin(ground[:, 0]))  # below it is the legend
    body = binary_erosion(~ground[:height])  # without the rim, which is mixed with the ground
    rows, columns = np.flatnonzero(body.any(axis=1)), np.flatnonzero(body.any(axis=0))
    cut = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    whole = np.dstack((pixels[:height], 255 * body.astype(np.uint8)))[cut]
    size = (BODY_PX, round(BODY_PX * whole.shape[0] / whole.shape[1]))
    return np.asarray(Image.fromarray(whole, "RGBA").resize(size, Image.Resampling.BOX))


def write_portraits(swatch: Swatch, body: Pixels | None, scale: Scale, folder: Path, stem: str) -> None:
    """Draw a swatch as PNG on each of `GROUNDS`: STEM-light.png, STEM-dark.png."""
    with new_chart(9.6, 2.9, style=STYLE) as figure:
        figure.set_layout_engine("constrained", w_pad=0.1, h_pad=0.08)
        first, second, third = figure.subplots(1, 3, width_ratios=(1.0, 1.5, 1.0))
        first.axis("off")
        if body is None:
            first.text(0.5, 0.5, "no picture:\nno GL here", ha="center", va="center", transform=first.transAxes)
        else:
            first.imshow(body, interpolation="antialiased")
        draw_spectra(second, swatch, scale)
        draw_tap(third, swatch, scale)
        for ground in GROUNDS:
            if ground == "dark":
                turn_dark(figure)
            _save_small(figure, folder / f"{stem}-{ground}.png")


def _save_small(figure: "Figure", path: Path) -> None:
    """Save in 256 colours: a third of the size, and no eye sees it."""
    from PIL import Image

    with tempfile.TemporaryDirectory(prefix="hapscene-") as folder:
        full = Path(folder) / "full.png"
        figure.savefig(full, dpi=130)
        with Image.open(full) as picture, whole_file(path) as part:
            picture.convert("RGB").quantize(256).save(part, format="PNG", optimize=True)


def draw_spectra(axes: "Axes", swatch: Swatch, scale: Scale) -> None:
    """Spectra of the texture, at the strokes that differ within what it was made for."""
    frequency = _frequencies()
    for line in _spectra(swatch, frequency):
        axes.semilogx(frequency, line.level_dB, color=INK, linestyle=line.dash, label=line.stroke)
    axes.set(xlim=ACCELERATION_BAND_HZ, ylim=(scale.top_dB - RANGE_DB, scale.top_dB))
    axes.set(xlabel="frequency [Hz]", ylabel="[dB re 1 (m/s²)²/Hz]")
    axes.set_title("stroked", loc="left")
    axes.set_xticks([20, 50, 100, 200, 500, 1000], ["20", "50", "100", "200", "500", "1000"])
    axes.set_xticks([], minor=True)
    if swatch.texture is None:
        axes.text(0.5, 0.5, "no texture", ha="center", va="center", transform=axes.transAxes)
    else:
        axes.legend(loc="best", handlelength=2.4, borderaxespad=0.3, labelspacing=0.25)


def draw_tap(axes: "Axes", swatch: Swatch, scale: Scale) -> None:
    """The tap at the speed that taps are told at."""
    count = round(1e-3 * TAP_MS * ACCELERATION_RATE_HZ)
    wave = np.zeros(count)
    if swatch.taps is not None:
        transient = swatch.taps.transient(TAP_M_S, ACCELERATION_RATE_HZ)[:count]
        wave[: len(transient)] = transient
    axes.plot(1e3 * np.arange(count) / ACCELERATION_RATE_HZ, wave, color=INK)
    axes.set(xlim=(0.0, TAP_MS), ylim=(-scale.tap_m_s2, scale.tap_m_s2), xlabel="time [ms]", ylabel="[m/s²]")
    axes.set_title(f"tapped at {1e3 * TAP_M_S:g} mm/s" if swatch.taps is not None else "no tap", loc="left")


def _spectra(swatch: Swatch, frequency_Hz: NDArray[np.float64]) -> list[_Line]:
    """The spectrum of each stroke; those that a texture clamps to one are one."""
    texture = swatch.texture
    found: dict[str, _Line] = {}
    if texture is None:
        return []
    gain = swatch.parameter("lpc_texture", "texture_gain", 1.0)
    for force_N, speed_m_s, dash in STROKES:
        at = min(force_N, texture.force_max_N), min(speed_m_s, texture.speed_max_m_s)
        shown = f"{at[0]:.2g} N, {1e3 * at[1]:.0f} mm/s"
        if shown in found:
            continue
        power = gain**2 * texture.density([at[0]], [at[1]], frequency_Hz=frequency_Hz)[0]
        found[shown] = _Line(shown, dash, 10.0 * np.log10(np.maximum(power, 1e-12)))
    return list(found.values())


def _frequencies() -> NDArray[np.float64]:
    return np.geomspace(*ACCELERATION_BAND_HZ, 400)


ASSUMED: Final = {"hardness": "stiffness_N_m", "texture": "texture", "friction": "friction_dynamic", "taps": "taps"}
"""What a swatch calls the number behind a quality where it says why that was not measured."""


WIDTH: Final = 120
"""Longest line of the page [characters]."""


def write_gallery(
    swatches: Sequence[Swatch],
    page: str | Path,
    say: Callable[[str], None] = lambda text: None,
    computed: Sequence[Swatch] = (),
) -> list[Path]:
    """Write a page of swatches, and beside it a folder of its name with their pictures and sounds.

    Args:
        swatches: in the order of the page.
        page: the Markdown file; its folder must be there.
        say: told what is being done.
        computed: those that were computed, not measured: in one table after the others, each with a ball.

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
            (folder / f"{stem}.wav").write_bytes(wav_bytes(swatch_sound(swatch)))
        for swatch in computed:
            (folder / f"{swatch.name}-ball.png").write_bytes(ball_png(swatch))
        made = [page.parent / page.stem / file.name for file in sorted(folder.iterdir())]
    with whole_file(page) as part:
        part.write_text(_page(swatches, stems, page.stem, computed), encoding="utf-8", newline="\n")
    return [page, *made]


def _page(swatches: Sequence[Swatch], stems: Sequence[str], folder: str, computed: Sequence[Swatch] = ()) -> str:
    """The page's text."""
    about = f"""Each sound is a tap at {1e3 * TAP_M_S:g} mm/s, and from {START_S:g} s on a stroke at {FORCE_N:g} N and
        {1e3 * SPEED_M_S:g} mm/s: the acceleration of the tool's handle. All have one scale, so that a smooth surface is
        heard to be quieter; all pictures have the same axes. **Assumed** is what the recording could not tell."""
    made_by = "Made by `python -m hapscene.paint.gallery`; every figure is that of the swatch's own file."
    head = f"# Gallery of swatches\n\n{made_by}"
    cards = [_card(swatch, f"{folder}/{stem}") for swatch, stem in zip(swatches, stems, strict=True)]
    if computed:
        cards += ["## Computed, not measured", _wrapped(COMPUTED), _computed_table(computed, folder)]
    return "\n\n".join([head, _wrapped(about), *cards]) + "\n"


COMPUTED: Final = """Surfaces that nobody recorded: their acceleration follows from a profile and a material by a model.
`hapscene swatch show NAME` says which numbers were looked up, and where, and which are assumed; the model is in
`swatches/compute.py`. A line of a grating lies at speed/period, a sandpaper's corner at speed/grain. What they feel
like is as good as that model: trust a measured one more. `hapscene swatch search grating` finds them by kind, and the
painter's shelf shows them by *Show: computed*."""


def _computed_table(swatches: Sequence[Swatch], folder: str) -> str:
    """A line for each computed swatch."""
    rows = ["| | swatch | what it is | feels |", "|---|---|---|---|"]
    for swatch in swatches:
        what = swatch.provenance.removeprefix("Computed, not measured: ").partition(", under a steel ball")[0]
        feels = ", ".join(phrase.word for phrase in phrases(swatch))
        ball = f"![{_plain(swatch.name)}]({quote(f'{folder}/{swatch.name}-ball.png')})"
        rows.append(f"| {ball} | {_plain(swatch.name)} | {_plain(what)} | {feels} |")
    return "\n".join(rows)


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


if __name__ == "__main__":  # python -m hapscene.paint.gallery FILE
    import sys

    from hapscene.surface.library import computed_entries, load_swatch, shipped_swatches

    computed = [load_swatch(entry.name) for entry in computed_entries()]
    write_gallery([load_swatch(name) for name in shipped_swatches()], Path(sys.argv[1]), print, computed)
