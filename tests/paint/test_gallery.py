"""The gallery: what the page says and links to, its pictures and sounds; and that of the documents is of today."""

import re
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image
from scipy.io import wavfile

import hapscene
from hapscene.paint import gallery
from hapscene.paint.gallery import GROUNDS, painted_body
from hapscene.paint.shelf import FULL_SCALE_M_S2
from hapscene.surface.library import computed_entries, shipped_swatches

pytestmark = pytest.mark.nightly

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture
def no_body(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures without the body, which takes seconds to draw."""
    monkeypatch.setattr(gallery, "painted_body", lambda swatch: None)


def links_of(text: str) -> list[tuple[str, str]]:
    return re.findall(r'(?:srcset|src)="([^"]+)"|\]\(([^)#]+)\)', text)


@pytest.mark.usefixtures("no_body")
def test_page_has_every_swatch_with_pictures_and_sound(tmp_path: Path) -> None:
    oak = replace(hapscene.load_swatch("wood"), name="<b>oak|*", texture=None, absent={"texture": "it was too short"})
    made = gallery.write_gallery([oak, hapscene.load_swatch("leather")], tmp_path / "page.md")
    assert all(file.is_file() for file in made) and len(made) == 1 + 2 * 3
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert all((tmp_path / "".join(link)).is_file() for link in links_of(text)) and len(links_of(text)) == 6
    assert "&lt;b&gt;oak\\|\\*" in text and "<b>" not in text
    assert "no texture; it was too short" in text
    assert "350 N/m; **assumed**: the recording holds no depth" in text


@pytest.mark.usefixtures("no_body")
@pytest.mark.parametrize("stem", ["my page", "a (b), c", "ü%20#?"])
def test_links_are_links_whatever_the_page_is_called(stem: str, tmp_path: Path) -> None:
    gallery.write_gallery([hapscene.load_swatch("wood")], tmp_path / f"{stem}.md")
    links = ["".join(link) for link in links_of((tmp_path / f"{stem}.md").read_text(encoding="utf-8"))]
    assert len(links) == 3 and not any(sign in link for link in links for sign in " ,()#?")
    assert all((tmp_path / unquote(link)).is_file() for link in links)


@pytest.mark.usefixtures("no_body")
def test_pictures_are_on_their_ground_and_small(tmp_path: Path) -> None:
    gallery.write_gallery([hapscene.load_swatch("wood")], tmp_path / "page.md")
    for ground, colour in GROUNDS.items():
        with Image.open(tmp_path / "page" / f"wood-{ground}.png") as picture:
            corner = np.array(picture.convert("RGB").getpixel((0, 0)))
        assert np.abs(corner - [int(colour[i : i + 2], 16) for i in (1, 3, 5)]).max() <= 2
    assert all(file.stat().st_size < 60_000 for file in (tmp_path / "page").iterdir())


@pytest.mark.usefixtures("no_body")
def test_computed_swatches_stand_apart_in_one_table(tmp_path: Path) -> None:
    glass = hapscene.load_swatch("glass")
    made = gallery.write_gallery([hapscene.load_swatch("wood")], tmp_path / "page.md", computed=[glass])
    assert [file.name for file in made[1:]] == ["glass-ball.png", "wood-dark.png", "wood-light.png", "wood.wav"]
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    measured, _, computed = text.partition("## Computed, not measured")
    assert "glass" not in measured and "| float glass, on glass | firm, smooth" in computed
    assert all((tmp_path / "".join(link)).is_file() for link in links_of(text))


def test_body_wears_the_swatch_on_clear_ground() -> None:
    swatch = replace(hapscene.load_swatch("wood"), albedo_rgb=(0.1, 0.2, 0.8))
    pixels = painted_body(swatch)
    if pixels is None:
        pytest.skip("no GL here")
    assert pixels[0, 0, 3] == 0 and pixels[-1, -1, 3] == 0
    solid = pixels[..., 3] == 255
    assert 0.3 < solid.mean() < 0.9
    red, green, blue = pixels[solid][:, :3].mean(axis=0)
    assert blue > 2.0 * green > 2.0 * red * 0.9


def test_gallery_of_the_documents_is_of_the_shipped_swatches() -> None:
    names = shipped_swatches()
    swatches = [hapscene.load_swatch(name) for name in names]
    computed = [hapscene.load_swatch(entry.name) for entry in computed_entries()]
    made = "make docs/gallery.md anew: hapscene swatch gallery --out docs/gallery.md"
    page = gallery._page(swatches, names, "gallery", computed)
    assert (DOCS / "gallery.md").read_text(encoding="utf-8") == page, made
    assert all((DOCS / "gallery" / f"{swatch.name}-ball.png").is_file() for swatch in computed), made
    for name, swatch in zip(names, swatches, strict=True):
        rate_Hz, wave = wavfile.read(DOCS / "gallery" / f"{name}.wav")
        want = gallery.swatch_sound(swatch)
        scale = 32767.0 / max(FULL_SCALE_M_S2, np.abs(want.a_m_s2).max())
        body = slice(0, len(wave) - 100)  # the end fades
        assert rate_Hz == want.rate_Hz
        np.testing.assert_allclose(wave[body], scale * want.a_m_s2[body], atol=2.0, err_msg=made)
    assert sum(file.stat().st_size for file in (DOCS / "gallery").iterdir()) < 1_500_000
