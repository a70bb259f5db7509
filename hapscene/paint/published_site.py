"""A library as a site that any web server, or none, can show: `hapscene swatch publish`, whose command is thin.

A page with all swatches, one for each, their sounds and files, and the index that `hapscene swatch get` reads: plain
HTML, nothing fetched from elsewhere. Names and texts are strangers': nothing of them is markup.
"""

import base64
import hashlib
import os
from collections.abc import Callable, Sequence
from functools import partial
from html import escape
from importlib.resources import as_file, files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import quote

from hapscene.capture.report.page import POLICY, document, figure
from hapscene.capture.report.plots import Plot
from hapscene.errors import SwatchError, printable
from hapscene.files import read_bytes, refusing, whole_folder
from hapscene.paint.gallery import ASSUMED, STYLE, Scale, draw_spectra, draw_tap, painted_body, scale_of
from hapscene.paint.shelf import START_S, Phrase, phrases, swatch_sound, wav_bytes
from hapscene.paint.swatch_picture import ball_png
from hapscene.surface.library import (
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
from hapscene.surface.swatch import TOOL_FIELDS, Swatch, touched_with
from hapscene.surface.swatch_file import BYTES_MAX, SUFFIX, swatch_from_json
from hapscene.surface.swatch_summary import FORCE_N, SPEED_M_S, TAP_M_S, lines
from hapscene.view.chart import inline_svg, new_chart

PAGE: Final = "index.html"

TITLE: Final = "Haptic swatches"

TITLE_MAX: Final = 70
"""Longest title of a page in a browser's tab [characters]: more is not shown in search either."""

MARK: Final = "<!-- made by hapscene swatch publish -->"
"""In the first page, by which a folder that was published before is known: its files may be replaced."""

MADE: Final = (SUFFIX, ".html", ".wav", "-body.png", "-ball.png")
"""What is made of each swatch, as its files end."""

RANGE_DB: Final = 70.0
"""Range of the spectra below the highest of the site [dB]: a library holds smoother surfaces than a gallery."""

NO_LICENCE: Final = "no licence stated: ask before you use it"

BALL_LARGE_PX: Final = 300
"""Width of the ball that stands for the painted body where no GL can draw [pixels]."""

PAGE_BYTES_MAX: Final = 64 * 1024 * 1024
"""Largest page of an earlier publishing that is looked at [bytes]."""


class Source(NamedTuple):
    """A swatch to be published, the content of its file, words to find it by."""

    swatch: Swatch
    data: bytes
    tags: tuple[str, ...] = ()


def gather(
    names: Sequence[str] = (), library: str | os.PathLike[str] | None = None, shipped: bool = False
) -> list[Source]:
    """The swatches to publish, with their tags.

    Args:
        names: names or .swatch files; none for all of the library, with its folders, whose names become tags.
        library: the library's folder, None for the user's own.
        shipped: those that come with hapscene as well.

    Raises:
        SwatchError: an unknown name, a file that cannot be read, two of one name, or nothing to publish.
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
        raise SwatchError(f"the library in {homes[0]} is empty: name swatches to publish, or --shipped")
    called = [source.swatch.name for source in found]
    if double := next((name for name in called if called.count(name) > 1), None):
        raise SwatchError(f"two swatches are called {double!r}: a library has each name once")
    return sorted(found, key=lambda source: source.swatch.name.casefold())


def _read(place: Traversable, tags: tuple[str, ...]) -> Source:
    """A swatch with the very bytes of its file."""
    with as_file(place) as path, refusing(SwatchError):
        data = read_bytes(path, BYTES_MAX, "swatch")
    with refusing(SwatchError, place):
        return Source(swatch_from_json(data), data, tags)


def publish(
    sources: Sequence[Source],
    folder: str | os.PathLike[str],
    title: str = TITLE,
    say: Callable[[str], None] = lambda text: None,
) -> list[LibraryEntry]:
    """Write the site of a library: all of it or nothing.

    A folder that is there keeps what this did not make; what an earlier call made of other swatches is gone.

    Args:
        sources: what to publish, as `gather` gives it.
        folder: made where there is none.
        title: of the first page.
        say: told what is being done.

    Returns:
        The entries of the index.

    Raises:
        SwatchError: the folder has files of somebody else's under these names; it cannot be written.
    """
    folder = Path(folder)
    before = _made_before(folder)
    entries: list[LibraryEntry] = []
    taken = {f"index{SUFFIX}"}
    for source in sources:
        entries.append(entry_of(source.swatch, source.data, taken, source.tags))
        taken.add(entries[-1].file.casefold())
    made = {PAGE, INDEX, *(name for entry in entries for name in _files_of(entry))}
    if foreign := sorted(name for name in made - before if os.path.lexists(folder / name)):
        raise SwatchError(f"{folder / foreign[0]}: is there and was not published: give a folder without it")
    scale = scale_of([source.swatch for source in sources])
    try:
        with whole_folder(folder, before) as part:
            for i, (source, entry) in enumerate(zip(sources, entries, strict=True), 1):
                say(f"{i}/{len(sources)}  {entry.name}\n")
                _write_swatch(source, entry, scale, part, title)
            write_index(part, entries)
            swatches = [source.swatch for source in sources]
            (part / PAGE).write_text(first_page(swatches, entries, title), encoding="utf-8", newline="\n")
    except OSError as error:
        why = str(error.strerror or error).removeprefix("cannot be written: ")
        raise SwatchError(f"{folder}: cannot be written: {why}") from None
    return entries


def _files_of(entry: LibraryEntry) -> list[str]:
    return [entry.file.removesuffix(SUFFIX) + end for end in MADE]


def _made_before(folder: Path) -> set[str]:
    """Names of the files that an earlier call made there."""
    if not (folder / PAGE).is_file() or not (folder / INDEX).is_file():
        return set()
    with refusing(SwatchError):
        page = read_bytes(folder / PAGE, PAGE_BYTES_MAX, "page")
        if MARK.encode() not in page:
            return set()
        entries = parse_index(read_bytes(folder / INDEX, INDEX_BYTES_MAX, "index"), str(folder / INDEX))
    return {PAGE, INDEX, *(name for entry in entries for name in _files_of(entry))}


def _write_swatch(source: Source, entry: LibraryEntry, scale: Scale, part: Path, title: str) -> None:
    """All files of one swatch."""
    from PIL import Image

    stem = entry.file.removesuffix(SUFFIX)
    (part / entry.file).write_bytes(source.data)
    (part / f"{stem}.wav").write_bytes(wav_bytes(swatch_sound(source.swatch)))
    (part / f"{stem}-ball.png").write_bytes(ball_png(source.swatch))
    body = painted_body(source.swatch)
    if body is None:
        (part / f"{stem}-body.png").write_bytes(ball_png(source.swatch, px=BALL_LARGE_PX))
        size = BALL_LARGE_PX, BALL_LARGE_PX
    else:
        size = body.shape[1], body.shape[0]
        Image.fromarray(body, "RGBA").quantize(256).save(part / f"{stem}-body.png", "PNG", optimize=True)
    page = swatch_page(source.swatch, entry, _plots(source.swatch, scale), size, title)
    (part / f"{stem}.html").write_text(page, encoding="utf-8", newline="\n")


# The pages. Every text is escaped here; what is ours is taken as it is.


def first_page(swatches: Sequence[Swatch], entries: Sequence[LibraryEntry], title: str = TITLE) -> str:
    """The page of all swatches."""
    script = _resource("js")
    tiles = "\n".join(_tile(swatch, entry) for swatch, entry in zip(swatches, entries, strict=True))
    body = [
        MARK,
        f"<main><h1>{_text(title)}</h1>",
        f'<p class="lead">{len(entries)} surface{"s" * (len(entries) != 1)} to be felt. {HEARD}</p>',
        f'<p>{FETCH} <code>hapscene swatch get NAME --from <span class="here">ADDRESS-OF-THIS-PAGE</span></code></p>',
        '<search class="find" hidden><label for="words">Find</label><input id="words" type="search" '
        'placeholder="rough wood CC0"><output for="words"></output></search>',
        f'<ul class="tiles">\n{tiles}\n</ul></main>',
        f"<script>{script}</script>",
    ]
    return document(printable(title, TITLE_MAX), body, _resource("css"), _policy(script))


def swatch_page(
    swatch: Swatch, entry: LibraryEntry, plots: Sequence[Plot], size: tuple[int, int], title: str = TITLE
) -> str:
    """The page of one swatch; `size` is that of its picture [pixels]."""
    stem = quote(entry.file.removesuffix(SUFFIX))
    name = _text(swatch.name)
    told = escape(printable(f"A body painted with {swatch.name}"))
    rows = "".join(map(partial(_row, swatch), phrases(swatch)))
    where = [
        ("provenance", _text(swatch.provenance) or "not stated"),
        ("licence", _licence(swatch)),
        ("touched with", _text(touched_with(swatch)) or "not stated"),
        ("words", _tags(entry) or "none"),
        ("file", f'<a href="{stem}{SUFFIX}" download>{escape(entry.file)}</a>, {entry.bytes:,} bytes'),
        ("sha256", f"<code>{entry.sha256}</code>"),
    ]
    body = [
        f'<nav><a href="{PAGE}">{_text(title)}</a></nav>',
        f'<main><h1>{name}</h1><p class="lead">{", ".join(p.word for p in phrases(swatch))}</p>',
        f'<h2>To be seen</h2><div class="plots"><figure class="body"><img src="{stem}-body.png" alt="{told}" '
        f'width="{size[0]}" height="{size[1]}"></figure>{"".join(map(figure, plots))}</div>',
        f"<h2>To be heard</h2><p>{HEARD}</p>{_audio(stem, swatch)}",
        f'<h2>In words</h2><div class="table"><table><tbody>{rows}</tbody></table></div>',
        f"<h2>Where it comes from</h2><dl>{''.join(f'<dt>{a}</dt><dd>{b}</dd>' for a, b in where)}</dl>",
        f"<h2>All numbers</h2><pre>{_numbers(swatch)}</pre></main>",
    ]
    return document(printable(f"{swatch.name}: {title}", TITLE_MAX), body, _resource("css"), _policy())


HEARD: Final = (
    f"Each sound is a tap at {1e3 * TAP_M_S:g} mm/s, and from {START_S:g} s on a stroke at {FORCE_N:g} N and "
    f"{1e3 * SPEED_M_S:g} mm/s: the acceleration of the tool’s handle. All have one scale."
)

FETCH: Final = "Into a library of one’s own:"


def _tile(swatch: Swatch, entry: LibraryEntry) -> str:
    stem = quote(entry.file.removesuffix(SUFFIX))
    words = ", ".join(phrase.word for phrase in phrases(swatch))
    return (
        f'<li class="tile"><img src="{stem}-ball.png" alt="" width="72" height="72" loading="lazy">'
        f'<h2><a href="{stem}.html">{_text(swatch.name)}</a></h2><p>{words}</p>{_audio(stem, swatch)}'
        f'{_tags(entry)}<p class="detail">Licence: {_licence(swatch)}</p></li>'
    )


def _audio(stem: str, swatch: Swatch) -> str:
    label = escape(printable(f"{swatch.name}: a tap, then a stroke"))
    return f'<audio controls preload="none" src="{stem}.wav" aria-label="{label}"></audio>'


def _licence(swatch: Swatch) -> str:
    return _text(swatch.licence) or f'<span class="warn">{NO_LICENCE}</span>'


def _tags(entry: LibraryEntry) -> str:
    tags = "".join(f"<li>{_text(tag)}</li>" for tag in entry.tags)
    return f'<ul class="tags">{tags}</ul>' if tags else ""


def _row(swatch: Swatch, phrase: Phrase) -> str:
    reason = swatch.absent.get(ASSUMED[phrase.quality], "")
    told = _text(phrase.figure + (f" (assumed, not measured: {reason})" if reason else ""))
    head = f'<tr><th scope="row">{phrase.quality}</th><td class="value">{phrase.word}</td>'
    return f'{head}<td class="figure">{told}</td></tr>'


def _numbers(swatch: Swatch) -> str:
    """What is told of it in lines, without what stands above them already."""
    above = tuple(f"  {what} " for what in ("provenance", "licence", *TOOL_FIELDS))
    kept = (line for line in lines(swatch)[2:] if not line.startswith(above))
    return escape("\n".join(printable(line).rstrip() for line in kept))


def _text(text: str) -> str:
    """A text from a file, of which nothing is markup and nothing turns what stands around it."""
    line = printable(" ".join(text.split()))
    return f"<bdi>{escape(line)}</bdi>" if line else ""


def _plots(swatch: Swatch, scale: Scale) -> list[Plot]:
    """Spectra and tap, drawn into the page: on the axes that all swatches of the site share."""
    found = []
    for title, draw, caption in (
        ("Spectra", draw_spectra, "Of its texture, stroked lightly, plainly and briskly."),
        ("Tap", draw_tap, f"The handle’s acceleration as it is tapped at {1e3 * TAP_M_S:g} mm/s."),
    ):
        with new_chart(4.8, 2.9, style=STYLE) as chart:
            axes = chart.subplots()
            draw(axes, swatch, scale)
            axes.set_title("")
            if draw is draw_spectra:
                axes.set_ylim(scale.top_dB - RANGE_DB, scale.top_dB)
            found.append(Plot(title, caption, inline_svg(chart, title), f"{title} of this surface. {caption}"))
    return found


def _policy(script: str = "") -> str:
    """Reports' policy, and what the site has of its own: pictures, sounds, this script."""
    policy = POLICY.replace("img-src data:", "img-src 'self'; media-src 'self'")
    if script:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        policy += f"; script-src 'sha256-{digest}'"
    return policy


def _resource(kind: str) -> str:
    return files("hapscene.paint").joinpath(f"published_site.{kind}").read_text(encoding="utf-8")
