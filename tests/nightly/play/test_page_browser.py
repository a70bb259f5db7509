"""The page in Chromium, against a real servo: what is done there is felt at the right place."""

import time
from collections.abc import Iterator
from threading import Event
from typing import Any

import numpy as np
import pytest
import trimesh

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
pytest.importorskip("playwright", reason="playwright is not installed: pip install 'hapscene[dev]'")
from playwright.sync_api import Browser, Page, expect

import hapscene
from hapscene.loop import Servo
from hapscene.play.page_server import PageServer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from tests.until import until

Live = tuple[PageServer, Servo]


def make_scene() -> Scene:
    """A ball of 60 mm half sunk into a plate, whose top is z = 0."""
    scene, X_WB = Scene(), np.eye(4)
    X_WB[2, 3] = -0.01
    box = Mesh.from_trimesh(trimesh.creation.box((0.2, 0.12, 0.02)), "m")
    scene.add(box, name="plate", pose=X_WB, swatch=hapscene.load_swatch("wood"))
    scene.add(Mesh.from_trimesh(trimesh.creation.icosphere(4, 0.03), "m"), name="ball", swatch="paper")
    return scene


@pytest.fixture(scope="module")
def live() -> Iterator[Live]:
    scene = make_scene()
    with PageServer(scene, title="a ball", tools=2) as page, Servo(scene, page.devices) as servo:
        servo.start([(0.0, 0.0, 0.0)] * 2)
        page.attach(servo)
        yield page, servo


@pytest.fixture
def tab(live: Live, browser: Browser) -> Iterator[Page]:
    tab = browser.new_page(viewport={"width": 1000, "height": 640}, has_touch=True)
    wrong: list[str] = []
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.goto(live[0].url)
    until(lambda: tab.evaluate("hapscene.state.ready"))
    yield tab
    tab.close()
    assert not wrong
    until(lambda: not any(live[1].state(tool=tool).touching for tool in (0, 1)))


def pixel(live: Live, tab: Page, x_m: float, y_m: float) -> tuple[float, float]:
    """Where on the page a place of the scene is."""
    at = tab.evaluate("hapscene.place()")
    u, v = live[0].frame.point(x_m, y_m)
    u, v = (1.0 - v, u) if at["turned"] else (u, v)
    return at["box"]["left"] + at["x"] + u * at["w"], at["box"]["top"] + at["y"] + v * at["h"]


def settled(servo: Servo, tool: int = 0) -> Any:
    """What is felt once the tool rests on the surface."""
    until(lambda: servo.state(tool=tool).touching)
    before = servo.state(tool=tool)

    def rests() -> bool:
        nonlocal before
        tick, now = before.tick, servo.state(tool=tool)
        if now.tick < tick + 100:
            return False
        still = np.abs(now.p_WT_m - before.p_WT_m).max() < 1e-6
        before = now
        return bool(still)

    until(rests)
    return before


def test_press_sets_position_and_depth(live: Live, tab: Page) -> None:
    servo = live[1]
    for x_m, y_m, z_m, body in ((0.07, 0.03, 0.0, 0), (0.0, 0.0, 0.03, 1), (0.01, -0.012, 0.0256, 1)):
        x, y = pixel(live, tab, x_m, y_m)
        tab.mouse.move(x, y)
        tab.wait_for_timeout(50)
        assert not servo.state().touching  # it only hovers
        tab.mouse.down()
        state = settled(servo)
        assert state.p_WT_m == pytest.approx([x_m, y_m, z_m - 1.2e-3], abs=1e-3)
        assert state.p_WT_m[2] == pytest.approx(z_m - 1.2e-3, abs=3e-4)
        assert state.body == body
        tab.mouse.wheel(0, -100)
        until(lambda deep=state.depth_m: servo.state().depth_m > deep + 0.5e-4)  # type: ignore[misc]
        tab.mouse.wheel(0, 100)
        tab.mouse.up()
        until(lambda: not servo.state().touching)


def test_a_stroke_from_beside_the_picture_touches(live: Live, tab: Page) -> None:
    servo = live[1]
    x, y = pixel(live, tab, 0.07, 0.0)
    top = tab.evaluate("hapscene.place().box.top")
    tab.mouse.move(x, top + 3)
    tab.mouse.down()
    tab.wait_for_timeout(100)
    assert not servo.state().touching
    for share in np.linspace(0.0, 1.0, 20):
        tab.mouse.move(x, top + 3 + share * (y - top - 3))
    assert settled(servo).p_WT_m[:2] == pytest.approx([0.07, 0.0], abs=1e-3)
    tab.mouse.up()


def test_a_body_fills_the_view(live: Live, tab: Page) -> None:
    whole = tab.evaluate("hapscene.place().w")
    tab.locator("#view").select_option(label="ball")
    assert tab.evaluate("hapscene.place().w") > 1.5 * whole
    tab.mouse.move(*pixel(live, tab, 0.01, -0.012))
    tab.mouse.down()
    assert settled(live[1]).p_WT_m == pytest.approx([0.01, -0.012, 0.0256 - 1.2e-3], abs=1e-3)
    tab.mouse.up()
    x, y = pixel(live, tab, 0.01, -0.012)
    tab.mouse.move(x, y)
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -100)
    tab.keyboard.up("Control")
    assert tab.evaluate("hapscene.place().w") > 1.6 * whole
    assert pixel(live, tab, 0.01, -0.012) == pytest.approx((x, y), abs=1.0)  # it stays under the pointer
    assert tab.locator("#legend li").all_inner_texts() == ["wood", "paper"]


def test_force_increases_with_pen_pressure(live: Live, tab: Page) -> None:
    servo, cdp = live[1], tab.context.new_cdp_session(tab)
    x, y = pixel(live, tab, 0.07, 0.03)

    def pen(kind: str, force: float) -> None:
        pressed = {"pointerType": "pen", "button": "left", "buttons": 1, "clickCount": 1}
        cdp.send("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, "force": force, **pressed})

    felt_N = []
    pen("mousePressed", 0.1)
    for force in (0.1, 0.3, 0.6, 1.0):
        x += 0.25  # the browser sends no event without a movement
        pen("mouseMoved", force)
        tab.wait_for_timeout(150)
        felt_N.append(float(settled(servo).f_W_N[2]))
    pen("mouseReleased", 0.0)
    assert (np.diff(felt_N) > 0.2).all()
    assert felt_N[3] == pytest.approx(650 * 0.003, rel=0.05)


def test_two_fingers_are_two_tools_and_lie_where_they_lie(live: Live, tab: Page) -> None:
    servo, cdp = live[1], tab.context.new_cdp_session(tab)
    places = ((-0.07, 0.02), (0.07, -0.02))
    points = [dict(zip("xy", pixel(live, tab, *place), strict=True), id=k) for k, place in enumerate(places)]
    cdp.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": points})
    for tool, (x_m, y_m) in enumerate(places):
        assert settled(servo, tool).p_WT_m[:2] == pytest.approx([x_m, y_m], abs=1e-3)
    tab.wait_for_timeout(700)  # held still longer than what says nothing is believed
    assert servo.state(tool=0).touching and servo.state(tool=1).touching
    until(lambda: tab.evaluate("hapscene.felt.length === 2"))
    tab.evaluate("pad.dispatchEvent(new PointerEvent('pointerup', { pointerId: [...hapscene.down.keys()][0] }))")
    until(lambda: not servo.state(tool=0).touching)
    assert servo.state(tool=1).touching
    cdp.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_escape_lifts_space_pauses_and_a_closed_page_lifts(live: Live, browser: Browser, tab: Page) -> None:
    servo = live[1]
    tab.mouse.move(*pixel(live, tab, 0.07, 0.0))
    tab.mouse.down()
    settled(servo)
    tab.keyboard.press("Escape")
    until(lambda: not servo.state().touching)
    tab.mouse.up()
    tab.keyboard.press("Space")
    expect(tab.locator("#pause")).to_have_text("resume")
    until(lambda: servo.state().age_s > 0.05)
    tab.keyboard.press("Space")
    until(lambda: servo.state().age_s < 0.02)
    other = browser.new_page(viewport={"width": 1000, "height": 640})
    other.goto(live[0].url)
    until(lambda: other.evaluate("hapscene.state.ready"))
    other.mouse.move(*pixel(live, other, 0.07, 0.0))
    other.mouse.down()
    settled(servo)
    other.close()
    until(lambda: not servo.state().touching)


def test_page_reports_a_lost_connection_and_reconnects(live: Live, tab: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    back, felt = Event(), live[0]._felt
    expect(tab.locator("#said")).to_have_text("")
    monkeypatch.setattr(live[0], "_felt", lambda servo, since: felt(servo, since) if back.wait(120.0) else None)
    expect(tab.locator("#said")).to_contain_text("Connection lost", timeout=120_000)
    back.set()
    expect(tab.locator("#said")).to_have_text("", timeout=120_000)


def test_kiosk_mode_resets_after_a_visitor(live: Live, tab: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    page, servo = live
    x, y = pixel(live, tab, -0.08, 0.03)
    tab.mouse.move(x, y)
    tab.mouse.down()
    for k in range(30):
        tab.mouse.move(x + 2 * k, y)
    moved = "Math.max(...hapscene.traces.a.values) > 0.1 && Math.max(...hapscene.traces.v.values) > 1"
    until(lambda: tab.evaluate(moved))
    expect(tab.locator("#swatch")).to_have_text("wood")
    tab.mouse.up()
    friction = tab.locator("[data-effect=friction]")
    friction.click()
    expect(friction).to_have_attribute("aria-pressed", "false")
    tab.locator("#depth").fill("2.5")
    resets = page.state()["resets"]
    monkeypatch.setattr(page, "_kiosk_s", 0.5)
    expect(friction).to_have_attribute("aria-pressed", "true", timeout=120_000)
    expect(tab.locator("#depth")).to_have_value("1.2")
    assert tab.evaluate("Math.max(...hapscene.traces.f.values, 0)") == 0
    tab.locator("#depth").fill("2.5")  # nothing else
    until(lambda: page.state()["resets"] == resets + 2)
    expect(tab.locator("#depth")).to_have_value("1.2")
    assert servo.state().age_s < 1.0


SHARE = """(() => {
  const at = hapscene.place(), [u0, v0, u1, v1] = hapscene.state.bodies[document.getElementById("view").value][1];
  return Math.max(at.w * (u1 - u0) / at.box.width, at.h * (v1 - v0) / at.box.height);
})()"""
"""Share of the canvas that the body fills in one direction."""


def test_on_a_phone_the_picture_is_turned_and_what_is_pressed_is_large_enough(live: Live, browser: Browser) -> None:
    tab = browser.new_page(viewport={"width": 390, "height": 860}, has_touch=True, is_mobile=True)
    tab.goto(live[0].url)
    until(lambda: tab.evaluate("hapscene.state.ready"))
    for one in tab.locator("button, input").all():
        assert (one.bounding_box() or {})["height"] >= 44
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert tab.evaluate("document.documentElement.scrollHeight <= innerHeight")
    assert tab.evaluate(SHARE) > 0.8  # the body in the middle
    tab.locator("#view").select_option("")  # the whole scene, which is wide
    cdp = tab.context.new_cdp_session(tab)
    point = dict(zip("xy", pixel(live, tab, -0.07, 0.02), strict=True))
    cdp.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})
    assert settled(live[1]).p_WT_m[:2] == pytest.approx([-0.07, 0.02], abs=1e-3)
    tab.set_viewport_size({"width": 390, "height": 1100})
    assert tab.evaluate("hapscene.place().turned")
    tab.close()
    until(lambda: not live[1].state().touching)


def test_from_pointer_to_touch_is_a_matter_of_milliseconds(live: Live, tab: Page) -> None:
    """From when the browser has the event to the tick that touches."""
    servo = live[1]
    tab.evaluate(
        "pad.addEventListener('pointerdown', (e) => { window.at = performance.timeOrigin + e.timeStamp; }, true)"
    )
    late_ms = []
    for k in range(20):
        tab.mouse.move(*pixel(live, tab, 0.06 + 1e-3 * k, 0.03))
        first = servo.state().tick
        tab.mouse.down()
        until(lambda: servo.state().touching)
        state, clock_ms = servo.state(), 1e3 * time.time()
        began = next(event.tick for event in servo.events(first)[0] if event.kind == "began")
        ended_ms = clock_ms - 1e3 * state.age_s - 1e3 * servo.tick_s * (state.tick - began)
        late_ms.append(ended_ms - tab.evaluate("window.at"))
        tab.mouse.up()
        until(lambda: not servo.state().touching)
    print(f"pointer to touch: {np.median(late_ms):.1f} ms, p95 {np.percentile(late_ms, 95):.1f} ms")
    assert np.median(late_ms) < 60.0
