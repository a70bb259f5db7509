"""That the page can be read: contrast of all its text, light and dark; nothing cut in a small window."""

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
from tests.until import until

LONG = "polished_mahogany_veneer_of_the_old_harpsichord_lid_sample_17b"


CONTRAST_MIN = 4.5
"""Of text to its ground: WCAG 2.1, 1.4.3, level AA."""

FAINT = """least => {
  const parse = text => { const n = text.match(/[\\d.]+/g).map(Number); return n.length > 3 ? n : [...n, 1]; };
  const over = (a, b) => [0, 1, 2].map(i => a[i] * a[3] + b[i] * (1 - a[3])).concat(1);
  const linear = v => v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4;
  const light = c => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]) + 0.05;
  const dark = document.documentElement.dataset.mantineColorScheme === 'dark';
  const faint = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  let count = 0;
  while (walk.nextNode()) {
    const text = walk.currentNode.textContent.trim(), node = walk.currentNode.parentElement;
    if (text.length < 2 || /SCRIPT|STYLE/.test(node.tagName) || node.closest(':disabled') || !node.checkVisibility())
      continue;
    let opacity = 1, ground = dark ? [20, 20, 20, 1] : [255, 255, 255, 1];
    const layers = [];
    for (let n = node; n; n = n.parentElement) {
      opacity *= Number(getComputedStyle(n).opacity);
      layers.unshift(parse(getComputedStyle(n).backgroundColor));
    }
    for (const layer of layers) ground = over(layer, ground);
    const colour = parse(getComputedStyle(node).color);
    colour[3] *= opacity;
    const [a, b] = [light(over(colour, ground)), light(ground)];
    count += 1;
    if (Math.max(a, b) / Math.min(a, b) < least) faint.push(`${text}: ${(Math.max(a, b) / Math.min(a, b)).toFixed(2)}`);
  }
  return [count, faint];
}"""
"""How much text is seen, and that whose contrast is less than that, with it; what cannot be pressed now is left out."""

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


def test_text_is_readable_and_whole(tab: Any) -> None:
    for name in TABS:
        tab.get_by_role("tab", name=name, exact=True).click()
        tab.wait_for_function("document.querySelectorAll('[role=tab][aria-selected=true]').length === 1")
        count, faint = tab.evaluate(FAINT, CONTRAST_MIN)
        assert count > 25 and not faint, f"{name}: {faint}"
        assert tab.evaluate(CUT) == [], name


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
    tab.keyboard.press("?")
    assert tab.evaluate(AXE_RUN.replace("document", "'#hs-keys'")) == []


def test_tool_settings_stay_visible_while_the_swatches_scroll(tab: Any) -> None:
    tab.get_by_role("tab", name="Paint", exact=True).click()
    size = tab.get_by_role("slider", name="Size [mm]")
    size.wait_for()
    tab.get_by_text("leather").first.hover()
    tab.mouse.wheel(0, 5000)
    until(lambda: not tab.get_by_role("textbox", name="Search").evaluate("n => n.getBoundingClientRect().top > 60"))
    assert 60 < size.evaluate("n => n.getBoundingClientRect().top") < 300
    assert size.evaluate(
        "n => { const b = n.getBoundingClientRect(); return n.contains(document.elementFromPoint(b.x + 2, b.y + 2)); }"
    )


def test_unsaved_state_is_marked(tab: Any, page: Page) -> None:
    save = tab.locator("#hs-bar button", has_text="Save")
    assert page.context.session.dirty and tab.inner_text("#hs-saved") == "Unsaved"
    assert save.evaluate("n => n.classList.contains('due') && !n.hasAttribute('aria-pressed')")
    marked = save.evaluate("n => getComputedStyle(n, '::before').content + getComputedStyle(n).backgroundColor")
    assert marked == '"●"rgba(0, 0, 0, 0)'
