"""What the painter's page does in a real browser: from click to pixel, the servo beside it, from slider to sound.

python -m hapscene_benchmarks.paint_page
"""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from typing import Any, Final, NamedTuple

import numpy as np

from hapscene.loop.timing import TimingStatistics, request_realtime_priority
from hapscene.paint.web.page import Page

from .idle import IdleLoop
from .machine import describe_machine, machine_words
from .markdown import shown, table
from .paint_browser import SIZE, ball_page, browser, do, middle, open_tab, orbiting, pressed, sweep, touching
from .sheet import Sheet

SMALL: Final = 5
LARGE: Final = 7
"""Subdivisions of the balls [count]: 20,480 and 327,680 triangles."""

CLICK_COUNT: Final = 9
WINDOW_COUNT: Final = 5
WINDOW_S: Final = 3.0
CHANGE_COUNT: Final = 8


# From click to pixel.

CHANGE: Final = 40
"""By how much a channel of the pixel must have changed [0 to 255]: more than light and rounding do."""

WATCH_PIXEL: Final = """
const get = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, more) {
  return get.call(this, kind, String(kind).startsWith("webgl") ? { ...more, preserveDrawingBuffer: true } : more);
};
addEventListener("pointerdown", (event) => { window.pressed_ms = event.timeStamp; }, true);
window.watch_pixel = (x, y) => {
  const seen = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const read = () => {
    const canvas = document.querySelector("canvas[data-engine]"), box = canvas.getBoundingClientRect();
    const scale = canvas.width / box.width;
    seen.drawImage(canvas, (x - box.left) * scale, (y - box.top) * scale, 1, 1, 0, 0, 1, 1);
    return seen.getImageData(0, 0, 1, 1).data;
  };
  const before = read();
  window.pressed_ms = window.took_ms = null;
  (function look() {
    const now = read();
    const change = Math.max(...[0, 1, 2].map((i) => Math.abs(now[i] - before[i])));
    if (window.pressed_ms !== null && change > CHANGE) window.took_ms = performance.now() - window.pressed_ms;
    else requestAnimationFrame(look);
  })();
};
""".replace("CHANGE", str(CHANGE))
"""Watches a pixel from frame to frame: what is drawn is kept, so that it can be read, which makes drawing slower."""


def measure_click(tab: Any, count: int) -> list[float]:
    """Paint and undo, again and again; from the press to the pixel [ms]."""
    x, y = middle(tab)
    took_ms = []
    tab.keyboard.down("Shift")
    tab.mouse.move(x, y)
    for _ in range(count + 1):
        tab.wait_for_timeout(500)
        tab.evaluate(f"window.watch_pixel({x}, {y})")
        tab.mouse.down()
        tab.mouse.up()
        tab.wait_for_function("window.took_ms !== null")
        took_ms.append(float(tab.evaluate("window.took_ms")))
        tab.evaluate("window.hapscene.send({ do: 'undo' })")
        tab.wait_for_function("!window.hapscene.state.undo")
    tab.keyboard.up("Shift")
    return took_ms[1:]  # the first has the browser compile its shaders


# The servo beside an empty loop, while the page draws.

QUANTILES: Final = {"median": 0.5, "p99": 0.99, "p99.9": 0.999}


class Window(NamedTuple):
    """The servo and the empty loop over the same time, and how much was drawn meanwhile."""

    servo: TimingStatistics
    idle: TimingStatistics
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
    servo, idle = zip(*((window.servo.delay_us(share), window.idle.delay_us(share)) for window in windows), strict=True)
    return statistics.median(servo), statistics.median(idle)


def _watch(page: Page, idle: IdleLoop, act: Callable[[], Any], frame_count: Callable[[], int]) -> Window:
    """Let the hand stroke the ball and the empty loop run while `act` goes on; both start anew, by chance apart."""
    with touching(page, strokes=True) as servo:
        idle.start()
        before = servo.timing(), idle.timing(), frame_count(), time.monotonic()
        act()
        after = servo.timing(), idle.timing(), frame_count(), time.monotonic()
        idle.rest()
    frames_s = (after[2] - before[2]) / (after[3] - before[3])
    return Window(after[0].since(before[0]), after[1].since(before[1]), frames_s)


def _frames(tab: Any) -> int:
    return int(tab.evaluate("window.frame_count"))


# From slider to what is felt and heard.

SHARES: Final = (0.4, 0.9)
"""Where on its track the slider of the stiffness is pressed, in turn: the force jumps to double or half."""

JUMP: Final = 0.2
"""By how much of itself the force must differ from the tick before, for the change to have been felt [1]."""

LEAST_N: Final = 0.2
"""Force under which none is looked for [N]: the hand comes down, or bounces."""

REST_S: Final = 0.7
"""How long the hand takes to come to rest on the ball [s]."""

WATCH_FORCE: Final = """
window.watch_force = () => {
  const { trace, sound } = window.hapscene, add = trace.add, told = sound.told;
  const change = window.change = { sound_s: 0, gap_count: 0 }, leads_s = new Map(), first = sound.gaps;
  window.next_change = () => Object.assign(change, { pressed_ms: null, arrived_ms: null, heard_ms: null });
  addEventListener("pointerdown", (event) => { change.pressed_ms = event.timeStamp; }, true);
  const meet = () => {
    if (change.arrived_ms !== null && change.heard_ms === null && leads_s.has(change.count))
      change.heard_ms = change.arrived_ms + 1e3 * (leads_s.get(change.count) + change.at_s);
  };
  trace.add = function (force, a, tick_s, block, came) {
    const before = (i) => (i ? force[i - 1] : trace.force.at(-1));
    const at = force.findIndex((f, i) => before(i) > LEAST_N && Math.abs(f - before(i)) > JUMP * before(i));
    if (change.pressed_ms !== null && change.arrived_ms === null && at >= 0)
      Object.assign(change, { arrived_ms: came.at_ms - performance.timeOrigin, at_s: at * tick_s, count: came.count });
    change.sound_s += force.length * tick_s;
    meet();
    return add.call(this, force, a, tick_s, block, came);
  };
  sound.told = function (what) {
    leads_s.set(what.count, what.lead_s);
    change.gap_count = what.gaps - first;
    meet();
    return told.call(this, what);
  };
};
""".replace("JUMP", str(JUMP)).replace("LEAST_N", str(LEAST_N))
"""Notes when the slider is pressed, when the force that follows arrives, and when its tick will be heard."""


class Delay(NamedTuple):
    """From the press on the slider, each of n changes [ms].

    Attributes:
        felt_ms: to the first tick with the new number.
        arrived_ms: to when the page has that tick's force and sound.
        heard_ms: to when it sounds, before what the sound device adds.
        gap_count: how often the sound ran dry meanwhile.
        sound_s: how much of it there was.
    """

    felt_ms: list[float]
    arrived_ms: list[float]
    heard_ms: list[float]
    gap_count: int
    sound_s: float


def measure_delay(page: Page, tab: Any, count: int) -> Delay:
    """Move the slider of the touched swatch's stiffness `count` times, the hand at rest on it."""
    tab.get_by_role("tab", name="Feel").click()  # which wakes the sound
    tab.wait_for_function("window.hapscene.sound.context && window.hapscene.sound.context.state === 'running'")
    tab.evaluate("window.watch_force()")
    track = tab.locator(".mantine-Slider-track:visible").first
    with touching(page, strokes=False) as servo:
        touched = do(page, lambda: _take(page, servo.state().swatch))
    tab.get_by_text(f"Numbers of {touched}").wait_for()
    _press(tab, track, SHARES[1])
    found = [_change(page, tab, track, SHARES[i % 2]) for i in range(count + 1)][1:]  # the first wakes much else
    felt_ms, arrived_ms, heard_ms = (list(part) for part in zip(*found, strict=True))
    change = tab.evaluate("window.change")
    return Delay(felt_ms, arrived_ms, heard_ms, change["gap_count"], change["sound_s"])


def _change(page: Page, tab: Any, track: Any, share: float) -> tuple[float, float, float]:
    """Press the slider there. From the press to the tick that feels it, to the page, to the ear [ms]."""
    with touching(page, strokes=False) as servo:
        tab.wait_for_timeout(1e3 * REST_S)
        tab.evaluate("window.next_change()")
        since = servo.state().tick + 1
        _press(tab, track, share)
        tab.wait_for_function("window.change.heard_ms !== null")
        felt_s = _felt(servo, since)
    change = tab.evaluate("({ ...window.change, origin_ms: performance.timeOrigin })")
    felt_ms = 1e3 * felt_s - change["origin_ms"]
    felt, arrived, heard = (at - change["pressed_ms"] for at in (felt_ms, change["arrived_ms"], change["heard_ms"]))
    return felt, arrived, heard


def _press(tab: Any, track: Any, share: float) -> None:
    box = track.bounding_box()
    tab.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)


def _felt(servo: Any, since: int) -> float:
    """When the first tick since then whose force is another was due [s since 1970]."""
    force_N = np.linalg.norm(servo.read(since).rows["f_W_N"], axis=1)
    before_N = force_N[:-1]
    tick = since + 1 + int(np.argmax((before_N > LEAST_N) & (np.abs(np.diff(force_N)) > JUMP * before_N)))
    due_s: list[float] = []
    for _ in range(50):  # a tick that is complete was due before: of 50 looks the earliest is within a fraction of one
        due_s.append(time.time() - (servo.state().tick - tick) * servo.tick_s)
        time.sleep(0.3 * servo.tick_s)
    return min(due_s)


def _take(page: Page, index: int) -> str:
    """Have the sliders show that swatch of the scene; returns its name."""
    swatch = page.context.session.scene.swatches[index]
    page.context.tools.choose_swatch(swatch.name, swatch)
    page.refresh()
    return swatch.name


# What is printed.


def machine_line() -> str:
    """What the figures are from."""
    sheet = Sheet()
    describe_machine(sheet)
    with ThreadPoolExecutor(1) as lane:
        priority = "real-time" if lane.submit(request_realtime_priority).result() else "ordinary"
    screen = f"Chromium without a graphics card, {SIZE['width']}×{SIZE['height']}"
    return ", ".join([*machine_words(sheet), screen, f"{priority} priority"]) + "\n"


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
        frames = f"{statistics.median(window.frames_s for window in some):.1f}"
        servo_us, idle_us = (" / ".join(map(shown, late)) for late in zip(*pairs, strict=True))
        ratios = " / ".join(f"{servo / idle:.2f}" for servo, idle in pairs)
        missed = f"{sum(window.servo.missed for window in some)}, empty {sum(window.idle.missed for window in some)}"
        rows.append((name, frames, servo_us, idle_us, ratios, missed))
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


# All of it.


def main() -> None:
    """Print tables; takes some minutes."""
    print(machine_line(), flush=True)
    clicks: dict[str, Sequence[float]] = {}
    with browser() as chromium, IdleLoop() as idle:
        with ball_page(SMALL) as page:
            clicks[_size(page)] = _clicks(page, chromium)
        with ball_page(LARGE) as page:
            rest = [measure_rest(page, idle, WINDOW_S) for _ in range(WINDOW_COUNT)]
            clicks[_size(page)] = _clicks(page, chromium)
            print(click_table(clicks), flush=True)
            print(late_table({"nothing is drawn": rest, **_windows(page, chromium, idle)}), flush=True)
            print(delay_table(_delays(page, chromium)), flush=True)


def _clicks(page: Page, chromium: Any) -> list[float]:
    tab = open_tab(chromium, page, WATCH_PIXEL)
    took_ms = measure_click(tab, CLICK_COUNT)
    tab.close()
    return took_ms


def _windows(page: Page, chromium: Any, idle: IdleLoop) -> dict[str, list[Window]]:
    tab = open_tab(chromium, page)
    orbit, stroke = [], []
    for _ in range(WINDOW_COUNT):
        orbit.append(measure_orbit(page, idle, tab, WINDOW_S))
        stroke.append(measure_stroke(page, idle, tab, WINDOW_S))
    tab.close()
    return {"the camera goes round": orbit, "a stroke is painted": stroke}


def _delays(page: Page, chromium: Any) -> dict[str, Delay]:
    found = {}
    drawing: dict[str, Callable[[], Any]] = {"the camera rests": nullcontext, "it goes round": lambda: orbiting(page)}
    for name, drawn in drawing.items():
        tab = open_tab(chromium, page, WATCH_FORCE)
        with drawn():
            found[name] = measure_delay(page, tab, CHANGE_COUNT)
        tab.close()
    return found


def _size(page: Page) -> str:
    return f"{len(page.context.session.scene.bodies[0].mesh.faces):,} triangles"


if __name__ == "__main__":
    main()
