"""The static site of a library: content, replacement of files, escaping."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from hapscene.cli import main
from hapscene.errors import SwatchError, printable
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import save_swatch
from hapscene.surface.swatch_summary import TAP_M_S, Phrase
from hapscene.swatches import site as static_site
from hapscene.swatches.library import add, computed_entries, entry_of, load_swatch, own_entries, shipped_swatches
from hapscene.swatches.site import (
    FREQUENCIES_HZ,
    NO_LICENCE,
    STROKES,
    Scale,
    _spectra,
    draw_spectra,
    draw_tap,
    first_page,
    gather,
    publish,
    scale_of,
    swatch_page,
)

HOSTILE = "</h1><b onload='x'>\"&amp;<!-- "


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> list[static_site.Source]:
    """A library with a folder, tags, a swatch without licence and texture, and one with a malicious name."""
    home = tmp_path_factory.mktemp("library")
    wood = load_swatch("wood")
    add(replace(wood, name="oak, planed"), home, inside="woods", tags=["hard wood", "planed"])
    texts = {"provenance": HOSTILE * 3, "tool": HOSTILE, "tip": "3 mm ball", "absent": {"taps": HOSTILE}}
    add(replace(wood, name=HOSTILE.replace("/", "").strip(), **texts), home, tags=["<i>"])
    add(Swatch("index", stiffness_N_m=300.0), home)
    return gather(library=home)


@pytest.fixture(scope="module")
def site(sources: list[static_site.Source], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("published") / "site"
    publish(sources, folder)
    return folder


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sites without pages to touch and plots."""
    monkeypatch.setattr(static_site, "touch_page", lambda swatch: "")
    monkeypatch.setattr(static_site, "_plots", lambda swatch, scale: [])


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """What `python -m http.server` does with the folder."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *arguments: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site)))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    thread.join()
    server.server_close()


def test_get_from_a_web_server(
    address: str, sources: list[static_site.Source], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    home = str(tmp_path / "mine")
    assert main(["swatch", "get", "--from", address]) == 0
    assert "oak, planed" in capsys.readouterr().out
    assert main(["swatch", "get", "--all", "--from", address, "--library", home]) == 0
    got = {entry.name: entry for entry in own_entries(home)}
    assert set(got) == {source.swatch.name for source in sources} and len(got) == 3
    for source in sources:
        assert (Path(home) / got[source.swatch.name].file).read_bytes() == source.data
        assert got[source.swatch.name].tags == source.tags
    assert got["oak, planed"].tags == ("hard wood", "planed", "woods")
    assert main(["swatch", "get", "index", "--name", "soft", "--from", address, "--library", home]) == 0
    assert "soft" in {entry.name for entry in own_entries(home)}
    assert main(["swatch", "get", "--all", "--name", "soft", "--from", address, "--library", home]) == 2


def test_files_of_a_swatch(site: Path) -> None:
    assert not (site / "index.swatch").exists() and (site / "index_2.html").is_file()
    for page in sorted(site.glob("*.html")):
        stem = page.stem
        if stem == "index" or stem.endswith("-touch"):
            continue
        text = page.read_text(encoding="utf-8")
        assert text.count("<svg") == 2 and f'src="{stem}.wav"' in text and f'href="{stem}.swatch"' in text
        assert f'src="{stem}-touch.html"' in text and (site / f"{stem}-touch.html").stat().st_size > 100_000
        assert sum(file.stat().st_size for file in site.glob(f"{stem}*")) < 450_000
    assert NO_LICENCE in (site / "index_2.html").read_text(encoding="utf-8")
    assert (site / "index.html").read_text(encoding="utf-8").count(NO_LICENCE) == 1


# Replacement of files.


@pytest.mark.usefixtures("quick")
def test_publish_again(tmp_path: Path) -> None:
    site = tmp_path / "site"
    publish(gather(["wood", "paper"]), site)
    (site / "CNAME").write_text("swatches.example.org")
    (site / "notes.html").write_text("other")
    publish(gather(["wood"]), site)
    names = {file.name for file in site.iterdir()}
    wood = {f"wood{end}" for end in (".swatch", ".html", ".wav", "-touch.html", "-ball.png")}
    assert names == {"CNAME", "notes.html", "index.html", "index.json"} | wood


@pytest.mark.usefixtures("quick")
def test_files_have_names_that_differ_in_more_than_case(tmp_path: Path) -> None:
    files = [tmp_path / f"{i}.swatch" for i in range(3)]
    for file, name in zip(files, ("oak", "OAK", "ash"), strict=True):
        save_swatch(Swatch(name), file)
    found = publish(gather([str(file) for file in files]), tmp_path / "site")
    assert [entry.name for entry in found] == ["ash", "oak", "OAK"]
    assert len({entry.file.casefold() for entry in found}) == 3


def test_shipped_swatches_are_published_with_their_tags(tmp_path: Path) -> None:
    add(Swatch("mine"), tmp_path / "home", tags=["own"])
    found = {source.swatch.name: source.tags for source in gather(library=tmp_path / "home", shipped=True)}
    computed = {entry.name: entry.tags for entry in computed_entries()}
    assert found == dict.fromkeys(shipped_swatches(), ()) | computed | {"mine": ("own",)}
    with pytest.raises(SwatchError, match="wood"):
        gather(["wood"], shipped=True)
    with pytest.raises(SwatchError, match="empty"):
        gather(library=tmp_path / "none")


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("name", ["index.html", "index.json", "wood.html", "wood.swatch"])
def test_other_files_are_not_replaced(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(SwatchError, match=f"{name}: exists, but"):
        publish(gather(["wood"]), tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [name]


# Untrusted names and texts.


class Skeleton(HTMLParser):
    """Elements with their attributes, and the texts of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, tuple[str, ...]]] = []
        self.texts: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, tuple(name for name, _ in attrs)))
        self.texts += [value or "" for name, value in attrs if name in ("alt", "aria-label")]

    def handle_endtag(self, tag: str) -> None:
        self.tags.append((f"/{tag}", ()))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def pages(name: str, provenance: str, licence: str, tag: str, title: str) -> list[str]:
    swatch = Swatch(name, provenance=provenance, licence=licence, absent={"stiffness_N_m": provenance}, tool=tag)
    entry = entry_of(swatch, b"", tags=(tag,))
    return [first_page([swatch], [entry], title), swatch_page(swatch, entry, [], title)]


@pytest.mark.parametrize(
    ("figure", "reason", "shown"),
    [
        ("650 N/m", "", "650 N/m"),
        ("", "no tap was found", "no tap was found"),
        ("650 N/m", "no depth", "650 N/m (assumed: no depth)"),
    ],
)
def test_figure_of_a_quality_has_the_reason_why_it_is_assumed(figure: str, reason: str, shown: str) -> None:
    phrase = Phrase("hardness", "firm", figure)
    for key in ("stiffness_N_m", "stiffness_N_m.level"):
        row = static_site._row(Swatch("a", absent={key: reason} if reason else {}), phrase)
        assert row == ("hardness", "firm", shown)


def test_scale_contains_all_spectra_and_taps() -> None:
    wood = load_swatch("wood")
    assert wood.texture is not None and wood.taps is not None
    louder = replace(wood, effects={"lpc_texture": {"texture_gain": 10.0}})
    soft = replace(
        wood, texture=None, taps=replace(wood.taps, wave_m_s2=None, amplitude_m_s2=0.0 * wood.taps.amplitude_m_s2)
    )
    top_dB, tap_m_s2 = scale_of([wood, Swatch("plain"), soft])
    levels = [level for level, _ in _spectra(wood).values()]
    assert top_dB % 10.0 == 0.0 and top_dB - 10.0 < max(level.max() for level in levels) <= top_dB
    assert tap_m_s2 == pytest.approx(1.1 * np.abs(wood.taps.transient(TAP_M_S, 1e4)).max(), rel=1e-6)
    assert scale_of([wood, louder]).top_dB == top_dB + 20.0 and scale_of([]) == (0.0, 1.1)
    share = {"force_N": 0.4 / wood.texture.force_max_N, "speed_m_s": 0.04 / wood.texture.speed_max_m_s}
    small = replace(wood.texture, **{name: part * getattr(wood.texture, name) for name, part in share.items()})
    assert list(_spectra(replace(wood, texture=small))) == ["0.4 N, 40 mm/s"]


def test_spectra_and_tap_are_drawn() -> None:
    wood = load_swatch("wood")
    assert wood.texture is not None and wood.taps is not None
    one, two, three = (figure.subplots() for figure in (Figure(), Figure(), Figure()))
    draw_spectra(one, wood, Scale(20.0, 5.0))
    known = [wood.texture.density([f], [v], frequency_Hz=FREQUENCIES_HZ)[0] for f, v, _ in STROKES]
    for line, power in zip(one.lines, known, strict=True):
        np.testing.assert_allclose(line.get_xydata().T, [FREQUENCIES_HZ, 10.0 * np.log10(power)])
    assert one.get_xlim() == (20.0, 1000.0) and one.get_ylim() == (-50.0, 20.0) and one.get_xscale() == "log"
    assert one.get_xticks().tolist() == [20, 50, 100, 200, 500, 1000] and not len(one.get_xticks(minor=True))
    assert [text.get_text() for text in one.get_legend().texts] == ["0.5 N, 50 mm/s", "1 N, 100 mm/s", "2 N, 200 mm/s"]
    assert one.get_xlabel() and one.get_ylabel()
    draw_tap(two, wood, Scale(20.0, 5.0))
    ((t_ms, wave),) = (line.get_xydata().T for line in two.lines)
    transient = wood.taps.transient(TAP_M_S, 1e4)[:600]
    np.testing.assert_allclose(t_ms, np.arange(600) / 10.0)
    np.testing.assert_allclose(wave, np.pad(transient, (0, 600 - len(transient))))
    assert two.get_xlim() == (0.0, 60.0) and two.get_ylim() == (-5.0, 5.0) and two.get_xlabel() and two.get_ylabel()
    draw_spectra(three, Swatch("plain"), Scale(20.0, 5.0))
    assert [text.get_text() for text in three.texts] == ["no texture"] and not three.lines and not three.get_legend()
    weak = replace(wood, texture=replace(wood.texture, force_N=0.4 * wood.texture.force_N / wood.texture.force_max_N))
    assert list(_spectra(weak)) == ["0.4 N, 50 mm/s", "0.4 N, 100 mm/s", "0.4 N, 200 mm/s"]


WORDS = st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=60).filter(lambda text: text.strip())
MARKUP = st.sampled_from(["<b>", "</li>", "<script>", "&lt;", "&#0;", '"', "'", "-->", "]]>", "\u202e", "\0", " "])
TEXT = st.one_of(WORDS, st.lists(st.one_of(MARKUP, WORDS), min_size=1, max_size=5).map("".join)).filter(str.strip)
NAME = TEXT.map(lambda text: "".join(filter(str.isprintable, text))[:80]).filter(str.strip)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(NAME, TEXT, TEXT, NAME, TEXT)
def test_texts_are_escaped(name: str, provenance: str, licence: str, tag: str, title: str) -> None:
    plain = [Skeleton(page).tags for page in pages("a", "b", "c", "d", "e")]
    for page, tags in zip(pages(name, provenance, licence, tag, title), plain, strict=True):
        found = Skeleton(page)
        assert found.tags == tags
        for text in (name, licence, tag, title):
            assert printable(" ".join(text.split())) in found.texts
        page.encode()
        assert not any("\x7f" <= sign <= "\x9f" or (sign < " " and sign != "\n") for sign in page)
    assert printable(" ".join(provenance.split())) in Skeleton(page).texts
