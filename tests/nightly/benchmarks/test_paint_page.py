"""The page's figures in a real browser: what is measured is what was meant. No test looks at a time itself."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
pytest.importorskip("playwright", reason="playwright is not installed: pip install 'hapscene[dev]'")

from hapscene.errors import ViewError
from hapscene.loop.timing import BIN_COUNT, TimingStatistics, count_in_bin
from hapscene.paint.web.page import Page
from hapscene_benchmarks import paint_browser, paint_page
from hapscene_benchmarks.idle import IdleLoop
from hapscene_benchmarks.paint_browser import ball_page, open_tab
from hapscene_benchmarks.paint_page import (
    Window,
    click_table,
    delay_table,
    late_table,
    late_us,
    machine_line,
    measure_orbit,
    measure_rest,
    measure_stroke,
)

WINDOW_S = 0.5


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small ball is drawn sooner than a large one."""
    monkeypatch.setattr(paint_browser, "SETTLE_S", 1.0)


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with ball_page(3) as running:
        yield running


def test_clicks_paint_and_are_undone(page: Page, browser: Any) -> None:
    tab = open_tab(browser, page, paint_page.WATCH_PIXEL)
    took_ms = paint_page.measure_click(tab, 2)
    tab.close()
    assert len(took_ms) == 2 and min(took_ms) > 0.0
    assert page.context.session.painting.undo_text is None and page.context.session.painting.redo_text is not None


def test_servo_and_empty_loop_tick_beside_each_other(page: Page, browser: Any) -> None:
    with IdleLoop() as idle:
        rest = measure_rest(page, idle, WINDOW_S)
        tab = open_tab(browser, page)
        orbit = measure_orbit(page, idle, tab, WINDOW_S)
        before = page.context.session.painting.undo_text
        stroke = measure_stroke(page, idle, tab, WINDOW_S)
        tab.close()
    for window in (rest, orbit, stroke):
        assert window.servo.delay.sum() + window.servo.missed > 100
        assert window.idle.delay.sum() + window.idle.missed > 100
        assert window.servo.busy.sum() > 0 and window.idle.busy.sum() == 0
    assert rest.frames_s == 0.0 and orbit.frames_s > 0.0
    assert before is None
    paint_browser.until(lambda: "brush" in (page.context.session.painting.undo_text or ""), "nothing was painted")


def test_a_change_is_felt_comes_and_is_heard(page: Page, browser: Any) -> None:
    stiffness = [swatch.stiffness_N_m for swatch in page.context.session.scene.swatches]
    tab = open_tab(browser, page, paint_page.WATCH_FORCE)
    delay = paint_page.measure_delay(page, tab, 2)
    tab.close()
    for felt, arrived, heard in zip(delay.felt_ms, delay.arrived_ms, delay.heard_ms, strict=True):
        assert felt > 0.0 and 0.0 < arrived < heard
    assert len(delay.felt_ms) == 2 and delay.sound_s > 0.5
    after = [swatch.stiffness_N_m for swatch in page.context.session.scene.swatches]
    assert len([k for k, was in zip(after, stiffness, strict=True) if k != was]) == 1


def test_without_a_browser_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paint_browser, "find_chromium", lambda: None)
    with pytest.raises(ViewError, match="apt-get install chromium"), paint_browser.browser():
        pass


def counted(*span_us: float) -> TimingStatistics:
    late, busy = np.zeros(BIN_COUNT, np.int64), np.zeros(BIN_COUNT, np.int64)
    for span in span_us:
        count_in_bin(late, round(1e3 * span))
    return TimingStatistics(late, busy, 0)


def test_lateness_is_told_as_medians_over_windows() -> None:
    windows = [
        Window(counted(*[servo] * 10), counted(*[idle] * 10), 5.0) for servo, idle in ((8, 4), (900, 5), (16, 4))
    ]
    servo, idle = late_us(windows, 0.99)
    assert servo == pytest.approx(16.0, rel=0.1) and idle == pytest.approx(4.0, rel=0.1)
    rows = late_table({"it is drawn": windows}).splitlines()
    assert rows[0].count("|") == rows[2].count("|")
    assert rows[2].startswith("| it is drawn | 5.0 |") and rows[2].endswith("| 0, empty 0 |")
    assert f"{servo / idle:.2f}" in rows[2]


def test_tables_have_medians_and_the_longest() -> None:
    assert "| 20 triangles | 3 | 9 |" in click_table({"20 triangles": [9.0, 1.0, 3.0]})
    delay = paint_page.Delay([10.0, 20.0, 30.0], [11.0, 21.0, 31.0], [50.0, 60.0, 99.0], 2, 7.4)
    assert "| it rests | 20 | 21 | 60 | 99 | 2 in 7 s |" in delay_table({"it rests": delay})


def test_the_machine_is_named_with_its_date() -> None:
    line = machine_line()
    assert "cores" in line and "priority" in line and "20" in line
