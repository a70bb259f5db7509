"""How late the servo's ticks begin while the painter's page draws, beside an empty loop."""

import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from hapscene.paint.web.page import Page
from hapscene.servo.servo_loop import Lateness

from .idle import IdleLoop
from .paint_browser import orbiting, pressed, sweep
from .paint_hand import touching

QUANTILES: Final = {"median": 0.5, "p99": 0.99, "p99.9": 0.999}


class Window(NamedTuple):
    """The servo and the empty loop over the same time, and how much was drawn meanwhile."""

    servo: Lateness
    idle: Lateness
    frames_s: float


def measure_rest(page: Page, idle: IdleLoop, seconds: float) -> Window:
    """Nothing is drawn: there is no tab."""
    return _watch(page, idle, lambda: time.sleep(seconds), lambda: 0)


def measure_orbit(page: Page, idle: IdleLoop, tab: Any, seconds: float) -> Window:
    """The camera goes round the ball."""
    with orbiting(page):
        return _watch(page, idle, lambda: tab.wait_for_timeout(1e3 * seconds), lambda: _frames(tab))


def measure_stroke(page: Page, idle: IdleLoop, tab: Any, seconds: float) -> Window:
    """A stroke is painted to and fro."""
    with pressed(tab):
        return _watch(page, idle, lambda: sweep(tab, seconds), lambda: _frames(tab))


def late_us(windows: Sequence[Window], share: float) -> tuple[float, float]:
    """Medians over windows: how late that share of the servo's ticks were at most, and of the empty loop's."""
    servo, idle = zip(*((window.servo.late_us(share), window.idle.late_us(share)) for window in windows), strict=True)
    return statistics.median(servo), statistics.median(idle)


def _watch(page: Page, idle: IdleLoop, act: Callable[[], Any], frame_count: Callable[[], int]) -> Window:
    """Let the hand stroke the ball and the empty loop run while `act` goes on; both start anew, by chance apart."""
    with touching(page, strokes=True) as servo:
        idle.start()
        before = servo.lateness(), idle.lateness(), frame_count(), time.monotonic()
        act()
        after = servo.lateness(), idle.lateness(), frame_count(), time.monotonic()
        idle.rest()
    frames_s = (after[2] - before[2]) / (after[3] - before[3])
    return Window(after[0].since(before[0]), after[1].since(before[1]), frames_s)


def _frames(tab: Any) -> int:
    return int(tab.evaluate("window.frame_count"))
