"""Static web site of a swatch library: a page of all swatches and a page for each, with pictures, sounds and files.

`hapscene swatch publish` writes it. Any web server can host it, and the pages can be opened as files. They load no
external resources. `hapscene swatch get` reads the index. All names and texts are untrusted and escaped.
"""

import base64
import hashlib
import os
import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from importlib.resources import as_file, files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple
from urllib.parse import quote

import numpy as np
from jinja2 import Environment, PackageLoader
from markupsafe import Markup
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_BAND_HZ, ACCELERATION_RATE_HZ
from hapscene.errors import SwatchError, printable
from hapscene.io.files import read_bytes, refusing, whole_folder
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import TOOL_FIELDS, Swatch, touched_with
from hapscene.surface.swatch_file import BYTES_MAX, SUFFIX, swatch_from_json
from hapscene.surface.swatch_summary import FORCE_N, SPEED_M_S, TAP_M_S, Phrase, lines, phrases
from hapscene.swatches.library import (
    INDEX,
    INDEX_BYTES_MAX,
    LibraryEntry,
    computed_entries,
    entry_of,
    own_entries,
    own_folders,
    parse_index,
    shipped_swatches,
    swatch_place,
    write_index,
)
from hapscene.swatches.picture import ball_png
from hapscene.swatches.sound import START_S, swatch_sound, wav_bytes
from hapscene.view.chart import inline_svg, new_chart
from hapscene.view.palette import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["NO_LICENCE", "Source", "first_page", "gather", "publish", "swatch_page", "touch_page"]

PAGE: Final = "index.html"

TITLE: Final = "Haptic swatches"

TITLE_MAX: Final = 70
"""Maximum length of a page title [characters], which is also what search engines show."""

MARK: Final = "<!-- made by hapscene swatch publish -->"
"""Mark of the first page, which identifies a folder that was published before: its files may be replaced."""

MADE: Final = (SUFFIX, ".html", ".wav", "-touch.html", "-ball.png")
"""Suffixes of the files of each swatch."""

NO_LICENCE: Final = "no licence stated: ask for permission before use"

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src 'self'; media-src 'self'; frame-src 'self'"
"""Content security policy: a second protection, in case a text is not escaped."""

ASSUMED: Final = {"hardness": "stiffness_N_m", "texture": "texture", "friction": "friction_dynamic", "taps": "taps"}
"""Key in `Swatch.absent` for each quality."""

SOUND_NOTE: Final = (
    f"Each sound is the acceleration of the handle during a tap at {1e3 * TAP_M_S:g} mm/s and, after {START_S:g} s, a "
    f"stroke with {FORCE_N:g} N at {1e3 * SPEED_M_S:g} mm/s. Taps have one scale; strokes are about equally loud, but "
    "those over coarse ribs and gratings are so low that a small loudspeaker hardly plays them."
)


class Source(NamedTuple):
    """A swatch to publish: the swatch, the content of its file, and its tags."""

    swatch: Swatch
    data: bytes
    tags: tuple[str, ...] = ()


def gather(
    names: Sequence[str] = (), library: str | os.PathLike[str] | None = None, shipped: bool = False
) -> list[Source]:
    """Read the swatches to publish, with their tags.

    Args:
        names: names or .swatch files. Default: the whole library including its folders, whose names become tags.
        library: folder of the library; None for the user's library.
        shipped: include the shipped swatches.

    Raises:
        SwatchError: an unknown name, a file that cannot be read, a name that occurs twice, or nothing to publish.
    """
    homes = own_folders(library)
    tags = {entry.name: entry.tags for entry in computed_entries()}
    own = {e.name: (*e.tags, *([home.name] if home != homes[0] else [])) for home in homes for e in own_entries(home)}
    wanted = list(names or own)
    if shipped:
        wanted += [*shipped_swatches(), *tags]
    tags |= own
    found = [_read(swatch_place(name, library), tags.get(name, ())) for name in wanted]
    if not found:
        raise SwatchError(f"the library in {homes[0]} is empty: name swatches to publish, or use --shipped")
    called = [source.swatch.name for source in found]
    if double := next((name for name in called if called.count(name) > 1), None):
        raise SwatchError(f"two swatches have the name {double!r}; names must be unique")
    return sorted(found, key=lambda source: source.swatch.name.casefold())


def _read(place: Traversable, tags: tuple[str, ...]) -> Source:
    """Read a swatch and the bytes of its file."""
    with as_file(place) as path, refusing(SwatchError):
        data = read_bytes(path, BYTES_MAX, "swatch")
    with refusing(SwatchError, place):
        return Source(swatch_from_json(data), data, tags)


def publish(
    sources: Sequence[Source],
    folder: str | os.PathLike[str],
    say: Callable[[str], None] = lambda text: None,
) -> list[LibraryEntry]:
    """Write the web site of a library, completely or not at all.

    Other files in an existing folder are kept; files of an earlier publication are replaced or removed.

    Args:
        sources: swatches from `gather`.
        folder: target folder; created if missing.
        say: receives progress messages.

    Returns:
        The entries of the index.

    Raises:
        SwatchError: the folder contains other files with the same names, or cannot be written.
    """
    folder = Path(folder)
    before = _published_files(folder)
    entries: list[LibraryEntry] = []
    taken = {f"index{SUFFIX}"}
    for source in sources:
        entries.append(entry_of(source.swatch, source.data, taken, source.tags))
        taken.add(entries[-1].file.casefold())
    made = _files_of(entries)
    if foreign := sorted(name for name in made - before if os.path.lexists(folder / name)):
        raise SwatchError(
            f"{folder / foreign[0]}: exists, but is not part of an earlier publication: choose another folder"
        )
    swatches = [source.swatch for source in sources]
    scale = scale_of(swatches)
    try:
        with whole_folder(folder, before) as part:
            for i, (source, entry) in enumerate(zip(sources, entries, strict=True), 1):
                say(f"{i}/{len(sources)}  {entry.name}\n")
                _write_swatch(source, entry, scale, part)
            write_index(part, entries)
            (part / PAGE).write_text(first_page(swatches, entries), encoding="utf-8", newline="\n")
    except OSError as error:
        why = str(error.strerror or error).removeprefix("cannot be written: ")
        raise SwatchError(f"{folder}: cannot be written: {why}") from None
    return entries


def _files_of(entries: Iterable[LibraryEntry]) -> set[str]:
    """Return the names of all files of a site."""
    return {PAGE, INDEX, *(entry.file.removesuffix(SUFFIX) + end for entry in entries for end in MADE)}


def _published_files(folder: Path) -> set[str]:
    """Return the names of the files of an earlier publication."""
    if not (folder / PAGE).is_file() or not (folder / INDEX).is_file():
        return set()
    with refusing(SwatchError):
        if MARK.encode() not in read_bytes(folder / PAGE, 8 * INDEX_BYTES_MAX, "page"):
            return set()
        data = read_bytes(folder / INDEX, INDEX_BYTES_MAX, "index")
    return _files_of(parse_index(data, str(folder / INDEX)))


def _write_swatch(source: Source, entry: LibraryEntry, scale: "Scale", part: Path) -> None:
    """Write all files of one swatch."""
    stem = entry.file.removesuffix(SUFFIX)
    (part / entry.file).write_bytes(source.data)
    (part / f"{stem}.wav").write_bytes(wav_bytes(swatch_sound(source.swatch)))
    (part / f"{stem}-ball.png").write_bytes(ball_png(source.swatch))
    (part / f"{stem}-touch.html").write_text(touch_page(source.swatch), encoding="utf-8", newline="\n")
    page = swatch_page(source.swatch, entry, _plots(source.swatch, scale))
    (part / f"{stem}.html").write_text(page, encoding="utf-8", newline="\n")


def touch_page(swatch: Swatch) -> str:
    """Return a page on which the shipped toad with the swatch can be touched: see `hapscene.exchange.html_page`."""
    from hapscene.exchange.html_page import html_page

    scene = Scene()
    with as_file(files("hapscene_assets") / "meshes" / "toad.ply") as mesh:
        scene.add(mesh, name="toad", unit="m", swatch=swatch)
    return html_page(scene, swatch.name, shown_max=TOUCHED_MAX)


# --- pages ---


def first_page(swatches: Sequence[Swatch], entries: Sequence[LibraryEntry], title: str = TITLE) -> str:
    """Return the HTML of the first page."""
    script = files("hapscene.swatches").joinpath("templates", "site.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return _page(
        "first",
        title,
        head=printable(title, TITLE_MAX),
        policy=f"{POLICY}; script-src 'sha256-{digest}'",
        mark=Markup(MARK),
        script=Markup(script),
        tiles=[_shown(swatch, entry) for swatch, entry in zip(swatches, entries, strict=True)],
    )


def swatch_page(swatch: Swatch, entry: LibraryEntry, plots: Sequence[str], title: str = TITLE) -> str:
    """Return the HTML of the page of a swatch."""
    shown = _shown(swatch, entry)
    head, rows = printable(f"{swatch.name}: {title}", TITLE_MAX), [_row(swatch, phrase) for phrase in phrases(swatch)]
    known = {"touched": touched_with(swatch), "numbers": _numbers(swatch), "rows": rows, "plots": plots}
    return _page("swatch", title, head=head, policy=POLICY, page=PAGE, shown=shown, **known, **shown)


def _page(name: str, title: str, **known: object) -> str:
    return _environment().get_template(f"{name}.html.jinja").render(
        title=title, note=SOUND_NOTE, no_licence=Markup(f'<span class="warn">{NO_LICENCE}</span>'), **known
    )  # fmt: skip


@cache
def _environment() -> Environment:
    loader = PackageLoader("hapscene.swatches.site")
    made = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    made.filters["text"] = _text
    return made


def _shown(swatch: Swatch, entry: LibraryEntry) -> dict[str, object]:
    """Return what both pages show of a swatch."""
    words = ", ".join(phrase.word for phrase in phrases(swatch))
    stem = quote(entry.file.removesuffix(SUFFIX))
    return {"swatch": swatch, "entry": entry, "stem": stem, "words": words, "levels": swatch_sound(swatch).levels}


def _row(swatch: Swatch, phrase: Phrase) -> tuple[str, str, str]:
    key = ASSUMED[phrase.quality]
    reason = swatch.absent.get(key) or swatch.absent.get(f"{key}.level", "")
    figure = f"{phrase.figure} (assumed: {reason})" if phrase.figure and reason else phrase.figure or reason
    return phrase.quality, phrase.word, figure


def _numbers(swatch: Swatch) -> list[tuple[str, list[str]]]:
    """Return the parameters of a swatch that the page does not show elsewhere: keys, and lines of text."""
    shown = ("provenance", "licence", *TOOL_FIELDS)
    found = re.findall(r"^  (\S+) +(.*(?:\n {3,}.*)*)", "\n".join(map(printable, lines(swatch)[2:])), re.MULTILINE)
    return [(key, text.splitlines()) for key, text in found if key not in shown]


def _text(text: str) -> Markup | str:
    """Escape a text from a file and isolate its writing direction."""
    line = printable(" ".join(text.split()))
    return Markup("<bdi>{}</bdi>").format(line) if line else ""


# --- pictures ---


STROKES: Final = ((0.5, 0.05, (0, (1, 1.2))), (1.0, 0.1, "-"), (2.0, 0.2, (0, (6, 2))))
"""Strokes of the plotted spectra: normal force [N], slip speed [m/s], line style."""

STYLE: Final = {"axes.titlesize": 10, "legend.fontsize": 8.5, "lines.linewidth": 1.4}
"""Differences from the common chart style."""

FREQUENCIES_HZ: Final = np.geomspace(*ACCELERATION_BAND_HZ, 400)

RANGE_DB: Final = 70.0
"""Dynamic range of the plotted spectra [dB]."""

TAP_MS: Final = 60.0
"""Plotted length of a tap [ms]."""

TOUCHED_MAX: Final = 12_000
"""Largest number of triangles of the body to touch [count]: its page has about 250 kB."""


class Scale(NamedTuple):
    """Common axis limits of all swatches of a site: maximum level [dB] and acceleration of taps [m/s²]."""

    top_dB: float
    tap_m_s2: float


def scale_of(swatches: Sequence[Swatch]) -> Scale:
    """Return axis limits for these swatches."""
    levels = [level_dB.max() for swatch in swatches for level_dB, _ in _spectra(swatch).values()]
    taps = [float(np.abs(s.taps.transient(TAP_M_S, ACCELERATION_RATE_HZ)).max()) for s in swatches if s.taps]
    top = 10.0 * np.ceil(max(levels, default=0.0) / 10.0)
    return Scale(float(top), 1.1 * max(taps, default=1.0))


def _plots(swatch: Swatch, scale: Scale) -> list[str]:
    """Return the figures of spectra and tap as HTML with inline SVG."""
    spectra = "Spectra of the texture for a light, a medium and a fast stroke."
    tap = f"Acceleration of the handle during a tap at {1e3 * TAP_M_S:g} mm/s."
    return [_figure("Spectra", spectra, draw_spectra, swatch, scale), _figure("Tap", tap, draw_tap, swatch, scale)]


def _figure(
    title: str, caption: str, draw: "Callable[[Axes, Swatch, Scale], None]", swatch: Swatch, scale: Scale
) -> str:
    with new_chart(4.8, 2.9, style=STYLE) as chart:
        draw(chart.subplots(), swatch, scale)
        svg = inline_svg(chart, title)
    drawing = svg.replace("<svg", f'<svg role="img" aria-label="{title} of this surface. {caption}"', 1)
    return f"<figure><h3>{title}</h3>{drawing}<figcaption>{caption}</figcaption></figure>\n"


def draw_spectra(axes: "Axes", swatch: Swatch, scale: Scale) -> None:
    """Draw the spectra of the texture at `STROKES`."""
    for label, (level_dB, dash) in _spectra(swatch).items():
        axes.semilogx(FREQUENCIES_HZ, level_dB, color=INK, linestyle=dash, label=label)
    axes.set(xlim=ACCELERATION_BAND_HZ, ylim=(scale.top_dB - RANGE_DB, scale.top_dB))
    axes.set(xlabel="frequency [Hz]", ylabel="[dB re 1 (m/s²)²/Hz]")
    axes.set_xticks([20, 50, 100, 200, 500, 1000], ["20", "50", "100", "200", "500", "1000"])
    axes.set_xticks([], minor=True)
    if swatch.texture is None:
        axes.text(0.5, 0.5, "no texture", ha="center", va="center", transform=axes.transAxes)
    else:
        axes.legend(loc="best", handlelength=2.4, borderaxespad=0.3, labelspacing=0.25)


def draw_tap(axes: "Axes", swatch: Swatch, scale: Scale) -> None:
    """Draw the acceleration of a tap over time."""
    count = round(1e-3 * TAP_MS * ACCELERATION_RATE_HZ)
    wave = np.zeros(count)
    if swatch.taps is not None:
        transient = swatch.taps.transient(TAP_M_S, ACCELERATION_RATE_HZ)[:count]
        wave[: len(transient)] = transient
    axes.plot(1e3 * np.arange(count) / ACCELERATION_RATE_HZ, wave, color=INK)
    axes.set(xlim=(0.0, TAP_MS), ylim=(-scale.tap_m_s2, scale.tap_m_s2), xlabel="time [ms]", ylabel="[m/s²]")


def _spectra(swatch: Swatch) -> dict[str, tuple[NDArray[np.float64], object]]:
    """Return level [dB] and line style of each stroke by label; strokes beyond the range of the texture are merged."""
    texture, found = swatch.texture, dict[str, tuple[NDArray[np.float64], object]]()
    if texture is None:
        return found
    gain = swatch.parameter("lpc_texture", "texture_gain", 1.0)
    for force_N, speed_m_s, dash in STROKES:
        at = min(force_N, texture.force_max_N), min(speed_m_s, texture.speed_max_m_s)
        power = gain**2 * texture.density([at[0]], [at[1]], frequency_Hz=FREQUENCIES_HZ)[0]
        found.setdefault(f"{at[0]:.2g} N, {1e3 * at[1]:.0f} mm/s", (10.0 * np.log10(np.maximum(power, 1e-12)), dash))
    return found
