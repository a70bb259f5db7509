"""The page in Chromium, against a real servo: what is done there is felt at the right place."""

import time
from collections.abc import Iterator
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
    until(lambda: is_ready(tab))
    yield tab
    tab.close()
    assert not wrong
    until(lambda: not any(live[1].state(tool=tool).touching for tool in (0, 1)))


def pixel(tab: Page, x_m: float, y_m: float, z_m: float = 0.0) -> tuple[float, float]:
    """Where on the page a place of the scene is."""
    at = tab.evaluate("(p) => ({ ...hapscene.project(p), box: pad.getBoundingClientRect() })", [x_m, y_m, z_m])
    return at["box"]["left"] + at["x"], at["box"]["top"] + at["y"]


def line_of_sight(tab: Page, p_m: tuple[float, float, float]) -> Any:
    """Unit vector from a place to the eye."""
    back = tab.evaluate("lens().eye") - np.array(p_m)
    return back / np.linalg.norm(back)


def normal_of(p_m: tuple[float, float, float]) -> Any:
    """Normal of the ball, or of the plate beside it."""
    radius_m = np.linalg.norm(p_m)
    return np.array(p_m) / radius_m if radius_m < 0.031 else np.array((0.0, 0.0, 1.0))


def is_ready(tab: Page) -> bool:
    return bool(tab.evaluate("!!window.hapscene && hapscene.state.ready && hapscene.drawn"))


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
        place = (x_m, y_m, z_m)
        tab.mouse.move(*pixel(tab, *place))
        tab.wait_for_timeout(50)
        assert not servo.state().touching  # it only hovers
        tab.mouse.down()
        state = settled(servo)
        assert state.p_WT_m == pytest.approx(np.array(place) - 1.2e-3 * normal_of(place), abs=4e-4)
        assert state.body == body
        tab.mouse.wheel(0, -100)
        until(lambda deep=state.depth_m: servo.state().depth_m > deep + 0.5e-4)  # type: ignore[misc]
        tab.mouse.wheel(0, 100)
        tab.mouse.up()
        until(lambda: not servo.state().touching)


def test_a_turned_and_zoomed_view_is_touched_where_it_is_pressed(live: Live, tab: Page) -> None:
    servo = live[1]
    before = tab.evaluate("[hapscene.camera.yaw, hapscene.camera.pitch]")
    x, y = pixel(tab, 0.0, 0.0, 0.03)
    tab.mouse.move(x, y)
    tab.mouse.down(button="right")
    tab.mouse.move(x + 90, y - 40, steps=5)
    tab.mouse.up(button="right")
    after = tab.evaluate("[hapscene.camera.yaw, hapscene.camera.pitch]")
    assert abs(after[0] - before[0]) > 0.4 and after[1] < before[1] - 0.2
    assert not servo.events(0)[0] or not servo.state().touching
    scale = tab.evaluate("hapscene.project([0, 0, 0.03]).scale")
    tab.mouse.wheel(0, -200)
    until(lambda: tab.evaluate("hapscene.project([0, 0, 0.03]).scale") > 1.2 * scale)
    toward = line_of_sight(tab, (0.0, 0.0, 0.0)) * (1.0, 1.0, 0.0)
    place = tuple(0.0299 * np.array([*(0.8 * toward / np.linalg.norm(toward))[:2], 0.6]))  # the side that is seen
    tab.mouse.move(*pixel(tab, *place))
    tab.mouse.down()
    state = settled(servo)
    assert state.body == 1
    assert state.p_WT_m == pytest.approx(np.array(place) - 1.2e-3 * normal_of(place), abs=6e-4)
    assert not tab.evaluate("document.querySelector('#hint').hidden")
    tab.mouse.up()
    tab.keyboard.press("ArrowLeft")
    tab.keyboard.press("-")
    assert tab.evaluate("hapscene.camera.yaw") != after[0]


def test_two_fingers_turn_the_view_and_lift_the_tool(live: Live, tab: Page) -> None:
    cdp = tab.context.new_cdp_session(tab)
    points = [dict(zip("xy", pixel(tab, x_m, 0.02), strict=True), id=k) for k, x_m in enumerate((-0.07, 0.07))]
    cdp.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": points[:1]})
    settled(live[1])
    cdp.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": points})
    until(lambda: not live[1].state().touching)
    yaw, scale = tab.evaluate("[hapscene.camera.yaw, hapscene.project([0, 0, 0]).scale]")
    for k in range(1, 9):
        moved = [point | {"x": point["x"] + k * shift} for point, shift in zip(points, (0.0, 12.0), strict=True)]
        cdp.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": moved})
    until(lambda: abs(tab.evaluate("hapscene.camera.yaw") - yaw) > 0.1)
    assert tab.evaluate("hapscene.project([0, 0, 0]).scale") > 1.1 * scale
    assert not live[1].state().touching
    cdp.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_force_increases_with_pen_pressure(live: Live, tab: Page) -> None:
    servo, cdp = live[1], tab.context.new_cdp_session(tab)
    x, y = pixel(tab, 0.07, 0.03)

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


def test_escape_lifts_space_pauses_and_a_closed_page_lifts(live: Live, browser: Browser, tab: Page) -> None:
    servo = live[1]
    tab.mouse.move(*pixel(tab, 0.07, 0.0))
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
    until(lambda: is_ready(other))
    other.mouse.move(*pixel(other, 0.07, 0.0))
    other.mouse.down()
    settled(servo)
    other.close()
    until(lambda: not servo.state().touching)


def test_from_pointer_to_touch_is_a_matter_of_milliseconds(live: Live, tab: Page) -> None:
    """From when the browser has the event to the tick that touches."""
    servo = live[1]
    tab.evaluate(
        "pad.addEventListener('pointerdown', (e) => { window.at = performance.timeOrigin + e.timeStamp; }, true)"
    )
    late_ms = []
    for k in range(20):
        tab.mouse.move(*pixel(tab, 0.06 + 1e-3 * k, 0.03))
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
