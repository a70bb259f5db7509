"""Pages to touch in Chromium: the sound against the synthesis of the package, strokes, and layouts."""

import base64
import io
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
import trimesh
from PIL import Image

import hapscene
from hapscene.capture.fit.synthesis import synthesize
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.exchange.html_page import html_page
from hapscene.scene.scene import Scene
from tests.chromium import AXE, AXE_RUN
from tests.until import until

SHAPES = {"desktop": (1280, 800), "phone": (390, 844)}
AUDIO_HZ = 48000.0
SECONDS = 20

PLAY = """([index, force, speed, seconds]) => {  // a stroke at constant force and speed, as the loudspeaker gets it
  const swatch = {...scene.swatches[index], depth: 0, norm: 0, tap: [], listen: 0.01, knock: 0};
  swatch.table = array(swatch.table);
  const player = new Player([swatch], 48000, 7), out = new Float32Array(48000 * seconds);
  player.queue = [{swatch: 0, force, speed, s: 10 * seconds}];
  player.fill(out);
  return btoa(Array.from(new Uint8Array(out.buffer), (byte) => String.fromCharCode(byte)).join(""));
}"""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "demo.html"
    file.write_text(html_page(hapscene.load_scene("assets/demo.scene.json"), "demo"), encoding="utf-8")
    return file


@pytest.fixture
def opened(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens a page; fails at the end if the page reported an error."""
    contexts, errors = [], list[str]()

    def open_page(file: Path, shape: str = "desktop") -> Any:
        width, height = SHAPES[shape]
        phone = shape == "phone"
        contexts.append(
            browser.new_context(
                viewport={"width": width, "height": height}, has_touch=phone, is_mobile=phone, reduced_motion="reduce"
            )
        )
        tab = contexts[-1].new_page()
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
        tab.goto(file.as_uri())
        tab.wait_for_selector("html[data-ready]", state="attached", timeout=60_000)
        return tab

    yield open_page
    for context in contexts:
        context.close()
    assert errors == []


def half_octaves_dB(a_m_s2: np.ndarray, rate_Hz: float) -> np.ndarray:
    """Levels in eleven bands from 20 to 1000 Hz, about half an octave wide."""
    f, density = scipy.signal.welch(a_m_s2, rate_Hz, nperseg=round(0.4 * rate_Hz))
    edges = np.geomspace(20.0, 1000.0, 12)
    return np.array([10 * np.log10(density[(f >= a) & (f < b)].sum()) for a, b in itertools.pairwise(edges)])


PLACE = """(name) => {  // middle pixel of a swatch in the picture, in the window
  const {width, height, words} = picked ??= pick();
  const wanted = scene.swatches.findIndex((swatch) => swatch.name === name) + 1;
  const found = [], {left, top} = canvas.getBoundingClientRect();
  for (let at = 0; at < width * height; at++) if (words[4 * at + 1] === wanted) found.push(at);
  const middle = found[Math.floor(found.length / 2)];
  return [left + middle % width + 0.5, top + height - 1 - Math.floor(middle / width) + 0.5];
}"""

BOX = """() => {  // part of the canvas that the bodies fill: smallest and largest column and row, 0 to 1
  const {width, height, words} = picked ??= pick();
  let box = [1, 0, 1, 0];
  for (let at = 0; at < width * height; at++) if (words[4 * at + 1]) {
    const x = (at % width) / width, y = Math.floor(at / width) / height;
    box = [Math.min(box[0], x), Math.max(box[1], x), Math.min(box[2], y), Math.max(box[3], y)];
  }
  return box;
}"""

RECORD = """() => {  // movements, and the highest level since it was set to 0
  window.sent = [];
  window.loudest = 0;
  const show = show_level;
  show_level = (peak) => { loudest = Math.max(loudest, peak); show(peak); };
  const play = move;
  move = (movements) => { sent.push(...movements.map((one) => ({...one}))); play(movements); };
}"""

NAMES = ("wood", "leather", "epoxy", "glass", "sandpaper-p120", "weave-silk")


def test_spectra_are_those_of_the_package(opened: Callable[..., Any], tmp_path: Path) -> None:
    """Within 1 dB in every band of half an octave that is not 40 dB below the loudest, at several forces and speeds."""
    scene = Scene()
    for name in NAMES:
        scene.add(trimesh.creation.box((0.01, 0.01, 0.01)), name=name, unit="m", swatch=name)
    file = tmp_path / "swatches.html"
    file.write_text(html_page(scene, "swatches"), encoding="utf-8")
    tab = opened(file)
    shown = tab.evaluate("scene.swatches.map((swatch) => swatch.name)")
    count = round(SECONDS * ACCELERATION_RATE_HZ)
    for name in NAMES:
        for force_N, speed_m_s in ((0.5, 0.05), (1.0, 0.1), (1.5, 0.25)):
            raw = base64.b64decode(tab.evaluate(PLAY, [shown.index(name), force_N, speed_m_s, SECONDS]))
            page = np.frombuffer(raw, "<f4")[4800:] / 0.01
            force, speed = np.full(count, force_N), np.full(count, speed_m_s)
            package = synthesize(name, force, speed, rate_Hz=ACCELERATION_RATE_HZ, modulation=0.0)
            level, expected = half_octaves_dB(page, AUDIO_HZ), half_octaves_dB(package, ACCELERATION_RATE_HZ)
            loud = expected > expected.max() - 40.0
            assert np.abs(level - expected)[loud].max() < 1.0, (name, force_N, speed_m_s, level - expected)


def test_strokes(opened: Callable[..., Any], demo: Path) -> None:
    tab = opened(demo)

    def level() -> float:
        return float(tab.evaluate("level"))

    def sounds() -> None:
        """Wait for a sound, also one that has ended."""
        until(lambda: tab.evaluate("loudest") > 0.005)
        tab.evaluate("loudest = 0")

    def touched() -> str:
        return str(tab.inner_text("#name"))

    tab.click("#bodies button:has-text('toad')")
    paper, leather = tab.evaluate(PLACE, "paper"), tab.evaluate(PLACE, "leather")
    tab.evaluate(RECORD)
    tab.mouse.move(*leather)
    tab.mouse.down()
    assert touched() == "leather"
    tab.wait_for_selector("#start", state="hidden")
    sounds()  # the tap
    until(lambda: level() < 0.002)  # a pointer at rest is silent
    tab.evaluate("loudest = 0")
    tab.mouse.move(*paper, steps=12)
    assert touched() == "paper"
    sounds()
    sent = tab.evaluate("sent")
    order = [one["swatch"] for one in sent]
    assert order == sorted(order, key=lambda i: i == order[-1]) and len(set(order)) == 2  # one border
    length_m = sum(one["speed"] * one["s"] for one in sent)
    straight_m = tab.evaluate(
        """(ends) => {
          const {left, top} = canvas.getBoundingClientRect();
          const [a, b] = ends.map(([x, y]) => surface_at(x - left, y - top).place);
          return Math.hypot(...add(a, b, -1));
        }""",
        [leather, paper],
    )
    assert straight_m <= length_m < 1.3 * straight_m  # along the surface
    tab.mouse.move(5, 795, steps=8)
    assert touched() == "beside the body"
    until(lambda: level() < 0.002)
    tab.mouse.up()
    tab.evaluate("loudest = sent.length = 0")
    tab.mouse.move(5, 400)
    tab.mouse.down()
    assert touched() == "beside the body"
    tab.mouse.move(*paper, steps=20)
    assert touched() == "paper"
    sounds()
    order = [one["swatch"] for one in tab.evaluate("sent")]
    assert order[0] == -1 and order[-1] >= 0
    tab.mouse.up()
    assert touched() == "not touching"
    tab.evaluate("sent.length = 0")
    before = tab.evaluate("({...camera})")
    tab.mouse.down(button="right")
    tab.mouse.move(paper[0] + 50, paper[1], steps=3)
    tab.mouse.up(button="right")
    tab.mouse.wheel(0, -100)
    until(lambda: tab.evaluate("camera.distance") < before["distance"])
    assert tab.evaluate("camera.yaw") < before["yaw"] and touched() == "not touching"
    assert all(one["swatch"] < 0 for one in tab.evaluate("sent"))
    tab.evaluate("loudest = 0")
    tab.click("#legend button:has-text('wood')")
    sounds()
    tab.click("#mute")
    until(lambda: tab.evaluate("audio.state") == "suspended")


@pytest.mark.parametrize("shape", SHAPES)
def test_layout(shape: str, opened: Callable[..., Any], demo: Path) -> None:
    tab = opened(demo, shape)
    width, height = SHAPES[shape]
    assert tab.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]") == [
        width,
        height,
    ]
    left, right, low, high = tab.evaluate(BOX)
    assert max(right - left, high - low) > 0.8
    assert 0.3 < (left + right) / 2 < 0.7 and 0.3 < (low + high) / 2 < 0.7
    boxes = [item.bounding_box() for item in tab.query_selector_all("button, input, #task, h1") if item.is_visible()]
    assert len(boxes) >= 12
    for i, a in enumerate(boxes):
        assert a["x"] >= 0 and a["x"] + a["width"] <= width and a["y"] >= 0 and a["y"] + a["height"] <= height
        for b in boxes[:i]:
            apart = a["x"] >= b["x"] + b["width"] - 0.5 or b["x"] >= a["x"] + a["width"] - 0.5
            assert apart or a["y"] >= b["y"] + b["height"] - 0.5 or b["y"] >= a["y"] + a["height"] - 0.5
    for name in tab.query_selector_all("#legend bdi"):
        assert name.evaluate("(e) => e.scrollWidth <= e.clientWidth")
    if AXE.exists():
        tab.evaluate(AXE.read_text(encoding="utf-8"))
        assert tab.evaluate(AXE_RUN) == []
    with Image.open(io.BytesIO(tab.screenshot())) as picture:
        assert len(picture.convert("RGB").getcolors(1 << 22)) > 2000  # a shaded picture


def test_pen_pressure_is_the_force(opened: Callable[..., Any], demo: Path) -> None:
    tab = opened(demo)
    tab.evaluate(RECORD)
    x, y = tab.evaluate(PLACE, "leather")
    pen = tab.context.new_cdp_session(tab)
    for kind, pressure in (("mousePressed", 0.5), ("mouseMoved", 0.8), ("mouseReleased", 0.0)):
        event = {"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1}
        pen.send("Input.dispatchMouseEvent", event | {"pointerType": "pen", "force": pressure})
    force = [one["force"] for one in tab.evaluate("sent")]
    assert force[0] == pytest.approx(1.5) and force[1] == pytest.approx(2.4)
    assert tab.inner_text("#newton") == "2.4 N"


def test_fingers_stroke_and_turn(opened: Callable[..., Any], demo: Path) -> None:
    tab = opened(demo, "phone")
    tab.evaluate(RECORD)
    hand = tab.context.new_cdp_session(tab)

    def touch(kind: str, *points: tuple[float, float]) -> None:
        fingers = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
        hand.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})

    tab.evaluate("() => { window.buzz = []; navigator.vibrate = (ms) => buzz.push(ms); }")
    x, y = tab.evaluate(PLACE, "epoxy")
    touch("touchStart", (x, y))
    assert tab.evaluate("buzz[0]") == 20  # the texture adds more
    touch("touchMove", (x + 20, y))
    assert tab.inner_text("#name") == "epoxy"
    touch("touchEnd")
    assert [one["swatch"] for one in tab.evaluate("sent")][-1] == -1
    before = tab.evaluate("({...camera})")
    touch("touchStart", (150, 300), (250, 300))
    touch("touchMove", (130, 300), (310, 300))
    touch("touchEnd")
    after = tab.evaluate("({...camera})")
    assert after["distance"] < before["distance"] and after["yaw"] != before["yaw"]
    assert tab.inner_text("#name") == "not touching"


def test_demo_is_small(demo: Path) -> None:
    assert demo.stat().st_size < 3_000_000
