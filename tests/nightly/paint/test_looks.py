"""That the page can be read, light and dark; nothing cut in a small window."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
pytest.importorskip("playwright", reason="playwright is not installed: pip install 'hapscene[dev]'")

from trimesh.creation import icosphere

import hapscene
from hapscene.paint.model.session import Session
from hapscene.paint.web.page import TABS, Page
from tests.paint.conftest import library_in, mesh_of

LONG = "polished_mahogany_veneer_of_the_old_harpsichord_lid_sample_17b"


CUT = """() => [...document.querySelectorAll('#hs *, .hs-card, .hs-swatch, .hs-swatch *, .hs-table, input[inputmode]')]
  .filter(n => n.checkVisibility() && n.clientWidth && n.scrollWidth > n.clientWidth + 1)
  .map(n => `${n.tagName} ${n.value || n.textContent}`)"""
"""What is wider than the place it has."""

AXE = Path(__file__).parents[3] / "build" / "node" / "node_modules" / "axe-core" / "axe.min.js"

AXE_RUN = """() => axe.run(document, {resultTypes: ['violations']}).then(found => found.violations
  .filter(rule => ['serious', 'critical'].includes(rule.impact))
  .map(rule => `${rule.id}: ${rule.nodes.map(node => node.html.slice(0, 200)).join(', ')}`))"""
"""What hinders people who cannot see, or have no pointer: nothing of viser's is left out."""

WIDTHS = {390: 844, 600: 900, 1024: 768, 1280: 800}
"""Width and height of windows [pixels]: phone in portrait, half a screen, tablet, laptop."""

UNTIPPED = """() => [...document.querySelectorAll('#hs button, .hs-bodies button, .mantine-Button-root[id]')]
  .filter(n => n.checkVisibility() && !n.dataset.tip && !window.hapscene.state.hints[n.id]).map(n => n.textContent)"""
"""Script that lists the buttons without a tooltip."""

SETTLED = """width => {
  const box = which => document.querySelector(which)?.getBoundingClientRect();
  const canvas = box('canvas[data-engine]'), panel = box('[role=region]');
  const bar = box('#hs-bar'), line = box('#hs-monitor');
  const below = canvas.bottom <= panel?.top + 1 && panel?.width === width, beside = canvas.right <= panel?.left + 1;
  return (width < 760 ? below : beside) && line.bottom <= canvas.bottom
    && line.top - bar.bottom > 0.5 * canvas.height && canvas.height > 0.5 * innerHeight
    && document.documentElement.scrollWidth <= width;
}"""
"""Whether nothing lies over anything else, and half of the picture is free: no plots before they are asked for."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("looks")
    scene = hapscene.Scene()
    scene.add(mesh_of(icosphere(subdivisions=2, radius=0.03)), name="ball", swatch="wood")
    session = Session(scene, folder / "ball.scene.json")
    session.tuning.copy_swatch(1, LONG)
    with library_in(folder), Page(session, port=0, with_hand=False) as page:
        yield page
    session.document.close()


@pytest.fixture(params=["light", "dark"])
def tab(request: pytest.FixtureRequest, page: Page, browser: Any) -> Iterator[Any]:
    """The page in a small window, as bright as the browser likes it."""
    with browser.new_context(viewport={"width": 800, "height": 600}, color_scheme=request.param) as context:
        tab = context.new_page()
        tab.goto(page.url)
        tab.wait_for_function("window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool")
        tab.evaluate("(name) => window.hapscene.send({ do: 'library', act: 'use', name })", LONG)
        tab.wait_for_function("(name) => window.hapscene.state.swatch === name", arg=LONG)
        tab.wait_for_function(f"document.documentElement.dataset.mantineColorScheme === '{request.param}'")
        yield tab


def test_model_is_visible_between_tools_and_panel_in_all_window_sizes(tab: Any) -> None:
    for width, height in WIDTHS.items():
        tab.set_viewport_size({"width": width, "height": height})
        tab.wait_for_function(SETTLED, arg=width)
        assert tab.evaluate(CUT) == [], width
        strange = ".tabler-icon-cloud-check, .tabler-icon-adjustments, .mantine-Notification-root"
        assert not [n for n in tab.locator(strange).all() if n.is_visible()], width


@pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not here: sh .ci/node-packages")
def test_nothing_serious_hinders_who_cannot_see_or_point(tab: Any) -> None:
    tab.evaluate(AXE.read_text(encoding="utf-8"))
    for width in (1280, 390):
        tab.set_viewport_size({"width": width, "height": WIDTHS[width]})
        tab.wait_for_function(SETTLED, arg=width)
        for name in TABS:
            tab.get_by_role("tab", name=name, exact=True).click()
            tab.wait_for_function("document.getAnimations().length === 0")
            assert tab.evaluate(AXE_RUN) == [], f"{name} at {width}"
            assert tab.evaluate(UNTIPPED) == [], f"{name} at {width}"
            assert tab.evaluate(CUT) == [], f"{name} at {width}"
    tab.keyboard.press("?")
    assert tab.evaluate(AXE_RUN.replace("document", "'#hs-keys'")) == []
