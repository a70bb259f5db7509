"""How soon a slider that is moved on the painter's page is felt and heard."""

import time
from typing import Any, Final, NamedTuple

import numpy as np

from hapscene.paint.web.page import Page

from .paint_browser import do
from .paint_hand import touching

SHARES: Final = (0.4, 0.9)
"""Where on its track the slider of the stiffness is pressed, in turn: the force jumps to double or half."""

JUMP: Final = 0.2
"""By how much of itself the force must differ from the tick before, for the change to have been felt [1]."""

LEAST_N: Final = 0.2
"""Force under which none is looked for [N]: the hand comes down, or bounces."""

REST_S: Final = 0.7
"""How long the hand takes to come to rest on the ball [s]."""

WATCH: Final = """
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
