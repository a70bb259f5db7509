"""What the painter's page does in a real browser: from click to pixel, the servo beside it, from slider to sound.

python -m hapscene_benchmarks.paint_page
"""

import statistics
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from typing import Any, Final

from hapscene.paint.web.page import Page
from hapscene.servo.servo_loop import request_realtime_priority

from . import paint_click, paint_delay
from .idle import IdleLoop
from .machine import describe_machine
from .markdown import shown, table
from .paint_browser import SIZE, ball_page, browser, open_tab, orbiting
from .paint_click import measure_click
from .paint_delay import Delay, measure_delay
from .paint_late import QUANTILES, Window, late_us, measure_orbit, measure_rest, measure_stroke
from .sheet import Sheet

SMALL: Final = 5
LARGE: Final = 7
"""Subdivisions of the balls [count]: 20,480 and 327,680 triangles."""

CLICK_COUNT: Final = 9
WINDOW_COUNT: Final = 5
WINDOW_S: Final = 3.0
CHANGE_COUNT: Final = 8


def main() -> None:
    """Print tables; takes some minutes."""
    print(machine_line(), flush=True)
    clicks: dict[str, Sequence[float]] = {}
    with browser() as chromium, IdleLoop() as idle:
        with ball_page(SMALL) as page:
            clicks[_size(page)] = _click(page, chromium)
        with ball_page(LARGE) as page:
            rest = [measure_rest(page, idle, WINDOW_S) for _ in range(WINDOW_COUNT)]
            clicks[_size(page)] = _click(page, chromium)
            print(click_table(clicks), flush=True)
            print(late_table({"nothing is drawn": rest, **_draw(page, chromium, idle)}), flush=True)
            print(delay_table(_change(page, chromium)), flush=True)


def machine_line() -> str:
    """What the figures are from."""
    sheet = Sheet()
    describe_machine(sheet)
    with ThreadPoolExecutor(1) as lane:
        priority = "real-time" if lane.submit(request_realtime_priority).result() else "ordinary"
    told = [
        f"{figure.name} {figure.value:g}" if figure.name == "cores" else f"{figure.name} {figure.value}"
        for figure in sheet
    ]
    told += [f"Chromium without a graphics card, {SIZE['width']}×{SIZE['height']}", f"{priority} priority"]
    return ", ".join(told) + "\n"


def click_table(took_ms: Mapping[str, Sequence[float]]) -> str:
    """From click to changed pixel, by the size of what is painted."""
    rows = [(size, f"{statistics.median(took):.0f}", f"{max(took):.0f}") for size, took in took_ms.items()]
    return table(("from click to pixel", "median [ms]", "longest [ms]"), rows)


def late_table(windows: Mapping[str, Sequence[Window]]) -> str:
    """How late ticks began, medians over the windows of what is drawn."""
    head = (
        "while",
        "frames [1/s]",
        f"ticks begin late: {', '.join(QUANTILES)} [µs]",
        "empty loop [µs]",
        "ratio",
        "left out",
    )
    rows = []
    for name, some in windows.items():
        pairs = [late_us(some, share) for share in QUANTILES.values()]
        missed = sum(window.servo.missed for window in some), sum(window.idle.missed for window in some)
        rows.append(
            (
                name,
                f"{statistics.median(window.frames_s for window in some):.1f}",
                " / ".join(shown(servo) for servo, _ in pairs),
                " / ".join(shown(idle) for _, idle in pairs),
                " / ".join(f"{servo / idle:.2f}" for servo, idle in pairs),
                f"{missed[0]}, empty {missed[1]}",
            )
        )
    return table(head, rows)


def delay_table(delays: Mapping[str, Delay]) -> str:
    """From the press on a slider to what is felt and heard."""
    head = (
        "from slider, while",
        "felt [ms]",
        "at the page [ms]",
        "heard [ms]",
        "heard, longest [ms]",
        "gaps in the sound",
    )
    rows = []
    for name, delay in delays.items():
        medians = (f"{statistics.median(some):.0f}" for some in (delay.felt_ms, delay.arrived_ms, delay.heard_ms))
        gaps = f"{delay.gap_count} in {delay.sound_s:.0f} s"
        rows.append((name, *medians, f"{max(delay.heard_ms):.0f}", gaps))
    return table(head, rows)


def _click(page: Page, chromium: Any) -> list[float]:
    tab = open_tab(chromium, page, paint_click.WATCH)
    took_ms = measure_click(tab, CLICK_COUNT)
    tab.close()
    return took_ms


def _draw(page: Page, chromium: Any, idle: IdleLoop) -> dict[str, list[Window]]:
    tab = open_tab(chromium, page)
    orbit, stroke = [], []
    for _ in range(WINDOW_COUNT):
        orbit.append(measure_orbit(page, idle, tab, WINDOW_S))
        stroke.append(measure_stroke(page, idle, tab, WINDOW_S))
    tab.close()
    return {"the camera goes round": orbit, "a stroke is painted": stroke}


def _change(page: Page, chromium: Any) -> dict[str, Delay]:
    found = {}
    drawing: dict[str, Callable[[], Any]] = {"the camera rests": nullcontext, "it goes round": lambda: orbiting(page)}
    for name, drawn in drawing.items():
        tab = open_tab(chromium, page, paint_delay.WATCH)
        with drawn():
            found[name] = measure_delay(page, tab, CHANGE_COUNT)
        tab.close()
    return found


def _size(page: Page) -> str:
    return f"{len(page.context.session.scene.bodies[0].mesh.faces):,} triangles"


if __name__ == "__main__":
    main()
