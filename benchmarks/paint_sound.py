"""Gaps in what the painter's page sounds like, in a real browser: while a ball of 20 k triangles is painted.

python -m hapscene_benchmarks.paint_sound [SECONDS]
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any, Final, NamedTuple

from hapscene.paint.web.page import Page

from .paint_browser import ball_page, browser, open_tab, pressed, sweep, touching

SUBDIVISIONS: Final = 5
WINDOW_S: Final = 60.0

NOTE: Final = """
window.note_sound = () => {
  const { sound } = window.hapscene, told = sound.told;
  const noted = window.noted = { first: sound.gaps, gaps: 0, leads_ms: [] };
  sound.told = function (what) {
    noted.gaps = what.gaps - noted.first;
    noted.leads_ms.push(1e3 * what.lead_s);
    return told.call(this, what);
  };
};
"""
"""Notes how often the sound ran dry, and how long each message waited to be heard."""


class Heard(NamedTuple):
    """What became of the sound.

    Attributes:
        gaps_1_min: how often it ran dry [1/min].
        wait_ms: how long what came waited to be heard, at the median [ms].
    """

    gaps_1_min: float
    wait_ms: float


def measure_sound(page: Page, tab: Any, seconds: float) -> Heard:
    """Paint to and fro while the hand strokes the ball."""
    tab.get_by_role("tab", name="Feel").click()  # which wakes the sound
    tab.wait_for_function("window.hapscene.sound.context && window.hapscene.sound.context.state === 'running'")
    with touching(page, strokes=True), pressed(tab):
        sweep(tab, 2.0)
        tab.evaluate("window.note_sound()")
        sweep(tab, seconds)
        noted = tab.evaluate("window.noted")
    leads_ms = sorted(noted["leads_ms"])
    return Heard(60.0 * noted["gaps"] / seconds, leads_ms[len(leads_ms) // 2])


@contextmanager
def burning() -> Iterator[None]:
    """Meanwhile another process keeps a core busy."""
    process = get_context("spawn").Process(target=_burn, daemon=True)
    process.start()
    try:
        yield
    finally:
        process.terminate()
        process.join()


def _burn() -> None:
    while True:
        pass


def main(seconds: float) -> None:
    """Print what is heard while painting, alone and beside a busy process."""
    with browser() as chromium, ball_page(SUBDIVISIONS) as page:
        tab = open_tab(chromium, page, NOTE)
        tab.keyboard.press("1")
        found = {"painting": measure_sound(page, tab, seconds)}
        with burning():
            found["painting beside a process that keeps a core busy"] = measure_sound(page, tab, seconds)
    for what, heard in found.items():
        print(f"{what}: {heard.gaps_1_min:.3g} gaps a minute; {heard.wait_ms:.0f} ms until it is heard")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else WINDOW_S)
