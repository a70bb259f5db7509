"""The page on a phone: swatches above the fold, words for fingers, one finger paints, busy states, own theme."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from tests.paint.window import BESIDE, FRONT, Window

pytestmark = pytest.mark.nightly

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


@pytest.fixture
def phone(window: Window, browser: Any) -> Any:
    """Another browser on the same page: a phone."""
    with browser.new_context(**PHONE, color_scheme="dark") as context:
        tab = context.new_page()
        tab.goto(window.page.url)
        tab.wait_for_function("window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool")
        tab.wait_for_selector(".hs-library img")
        yield tab


def test_swatches_are_above_the_fold_and_nothing_is_cut(phone: Any) -> None:
    edges = "(({ bottom, right }) => [bottom, right])(document.querySelector('.hs-library').getBoundingClientRect())"
    phone.wait_for_function(f"({edges})[0] < innerHeight && ({edges})[1] <= innerWidth && innerWidth === 390")
    card = "document.querySelector('.hs-pick[aria-pressed=\"true\"]')"
    for name in ("wood", "glass", "plain"):  # the row scrolls to the selected card
        phone.evaluate(f"window.hapscene.send({{ do: 'library', act: 'use', name: '{name}' }})")
        whole = "left >= 0 && right <= innerWidth"
        phone.wait_for_function(
            f"(({{ left, right }}) => {card}.dataset.name === '{name}' && {whole})({card}.getBoundingClientRect())"
        )
    hold = "getComputedStyle(document.querySelector('.hs-hold'), '::before').content"
    assert "Shift" not in phone.evaluate("document.body.innerText") + phone.evaluate(hold)


def test_a_finger_paints_with_draw_on_and_a_second_one_cancels(window: Window, phone: Any) -> None:
    page = window.page
    phone.get_by_role("button", name="Draw").tap()
    window.tab, desktop = phone, window.tab
    try:
        touch = phone.context.new_cdp_session(phone)

        def fingers(kind: str, *places: Any) -> None:
            points = [dict(zip("xy", window.at(place), strict=True)) | {"id": i} for i, place in enumerate(places)]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        fingers("touchStart", FRONT)
        fingers("touchMove", np.add(FRONT, (0.002, 0.0, 0.0)))
        fingers("touchEnd")
        window.when(lambda: "brush" in (page.context.session.painting.undo_text or ""))
        done = len(page.context.session.history.done)

        fingers("touchStart", BESIDE)
        fingers("touchStart", BESIDE, FRONT)
        fingers("touchEnd")
        phone.wait_for_function("document.querySelector('#hs-say').textContent.startsWith('Cancelled')")
        assert len(page.context.session.history.done) == done
    finally:
        window.tab = desktop


def test_two_browsers_have_their_own_theme(window: Window, phone: Any) -> None:
    scheme = "document.documentElement.dataset.mantineColorScheme"
    phone.wait_for_function(f"{scheme} === 'dark'")
    assert window.ask(scheme) == "light"
    phone.evaluate("[...document.querySelectorAll('#hs-views button')].find(b => b.textContent === 'Dark').click()")
    phone.wait_for_function(f"{scheme} === 'light'")
    phone.reload()
    phone.wait_for_function("window.hapscene && window.hapscene.client() >= 0")
    phone.wait_for_function(f"localStorage.getItem('hapscene-dark') === 'false' && {scheme} === 'light'")
