"""Ten minutes with foreign files, a model, a part and a scan: painted, killed, recovered, exported."""

import io
import json
import shutil
import signal
import subprocess
import sys
import time
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
pytest.importorskip("playwright", reason="playwright is not installed: pip install 'hapscene[dev]'")

import hapscene
from hapscene.exchange import import_scene
from hapscene.paint.model.document import find_recovery
from tests.nightly.paint.composer import Composer, painter
from tests.until import until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no kill -9 there")

VALIDATOR = Path(__file__).resolve().parents[3] / "build" / "node" / "node_modules" / "gltf-validator"
ASK = "require(process.argv[1]).validateBytes(new Uint8Array(require('fs').readFileSync(process.argv[2])))"

CUBE, SIDE_MM = "20mm-xyz-cube", 20.0
DAB, SOFT, LATER = (6.0, 0.0), (-6.5, 0.0), (0.0, -7.0)
"""Where the top of the cube is painted, from its middle [mm]: beside the letter that is cut into it."""

RADIUS_MM = 2.0
CLOSE_MM = 0.15
"""How near to the true border the painted one is [mm]: pieces of a face are 0.1 mm along it, a pixel 0.04 mm."""

COMPILE_S = 300.0
"""How long the hand may take to be ready where the tick must be compiled first [s]."""


class Top:
    """View of the top of the cube from above, with the other bodies hidden; converts its points to pixels."""

    def __init__(self, page: Composer) -> None:
        self.page = page
        page.see_bodies()
        page.choose(CUBE)
        for body in ("bunny", "Duck"):
            page.press("hide", body)
            page.tab.locator(f'[data-body-act="hide"][data-body="{body}"]', has_text="Show").wait_for()
        page.press("choose", CUBE)  # deselect, so that no handles cover the cube
        page.tab.get_by_role("tab", name="Paint").click()
        page.tab.mouse.move(5, 300)
        page.tab.keyboard.press("Shift+5")
        page.tab.evaluate("window.hapscene.stamp.enabled = false")  # the pictures show what the server has painted
        self._left_px, self._across_px = 0, 0
        until(self._is_seen)

    def _is_seen(self) -> bool:
        """Whether the cube stands still, a square in the middle; then its middle and size are known."""
        before = self._left_px, self._across_px
        box = self.page.tab.locator("canvas[data-engine]").bounding_box()
        picture = self.picture()
        row, column = int(box["y"] + box["height"] / 2), int(box["x"] + box["width"] / 2)
        inside = slice(int(box["x"]) + 5, int(box["x"] + box["width"]) - 5)
        seen = np.flatnonzero(np.abs(picture[row, inside] - picture[row, inside.start]).sum(axis=1) > 40)
        if len(seen) < 200:
            return False
        self._left_px, self._across_px = int(seen[0]), int(seen[-1] - seen[0]) + 1
        self._middle_px = np.array([inside.start + (seen[0] + seen[-1]) / 2, row])
        assert abs(self._middle_px[0] - column) < 3.0
        return before == (self._left_px, self._across_px)

    def picture(self) -> NDArray[np.int16]:
        """What is seen (height, width, 3)."""
        return np.asarray(Image.open(io.BytesIO(self.page.tab.screenshot())).convert("RGB")).astype(np.int16)

    def still(self) -> NDArray[np.int16]:
        """What is seen once it no longer changes: while the scene changes, frames are simpler."""
        seen = [self.picture()]
        until(lambda: bool(seen.append(self.picture()) or np.array_equal(*seen[-2:])))
        return seen[-1]

    def at(self, place_mm: Any) -> NDArray[np.float64]:
        """Where a place of the top is in the window (2,) [pixels]."""
        return self._middle_px + np.multiply(place_mm, (1, -1)) * self._across_px / SIDE_MM

    def colour(self, place_mm: Any, picture: NDArray[np.int16] | None = None) -> NDArray[np.int16]:
        """Of one pixel (3,)."""
        x, y = np.rint(self.at(place_mm)).astype(int)
        return (self.picture() if picture is None else picture)[y, x]

    def drag(self, *places_mm: Any) -> None:
        """Hold Shift, press, and go over places; then away, so that nothing is over what was painted."""
        mouse, keyboard = self.page.tab.mouse, self.page.tab.keyboard
        keyboard.down("Shift")
        mouse.move(*self.at(places_mm[0]))
        mouse.down()
        for place_mm in places_mm[1:]:
            mouse.move(*self.at(place_mm))
        mouse.up()
        keyboard.up("Shift")
        mouse.move(5, 300)

    def borders_mm(self, middle_mm: Any) -> NDArray[np.float64]:
        """How far from its middle a dab ends (24,) [mm], seen along as many ways: where the colour turns."""
        picture = self.still()
        inner = self.colour(middle_mm, picture)
        outer = self.colour(np.add(middle_mm, (0, 2 * RADIUS_MM)), picture)
        assert np.abs(inner - outer).sum() > 60, (inner, outer)
        found = []
        for turn in np.linspace(0, 2 * np.pi, 24, endpoint=False):
            out_mm = np.arange(0, 1.4 * RADIUS_MM, 0.01)
            way = [self.colour(np.add(middle_mm, r * np.array([np.cos(turn), np.sin(turn)])), picture) for r in out_mm]
            is_outer = np.abs(way - outer).sum(axis=1) < np.abs(way - inner).sum(axis=1)
            turns = np.flatnonzero(np.diff(is_outer))
            assert len(turns) % 2 and np.ptp(out_mm[turns]) < 0.3  # the new up to there, leaves aside, then the old
            found.append(np.median(out_mm[turns]))
        return np.array(found)


def pick(page: Composer, swatch: str) -> None:
    page.tab.locator(f'.hs-pick[data-name="{swatch}"]').click()
    page.wait(f"window.hapscene.state.swatch === {swatch!r}")


def type_in(page: Composer, label: str, value: str) -> None:
    """Type a number into a field of the panel."""
    field = page.tab.locator(f'input[inputmode=decimal][aria-label="{label}"]:visible')
    field.click()
    page.tab.keyboard.press("Control+a")
    page.tab.keyboard.type(value)
    page.tab.keyboard.press("Enter")
    until(lambda: field.input_value() == value)


def test_ten_minutes_with_foreign_files(browser: Any, shared: Path, tmp_path: Path) -> None:
    meshes, folder = shared / "data" / "meshes", tmp_path / "work"
    folder.mkdir()
    file = folder / f"{CUBE}.scene.json"
    command = (str(meshes / f"{CUBE}.stl"), str(meshes / "bunny.ply"), "--unit", "mm", "--up", "z")  # a bunny in metres
    with painter(folder, *command) as (process, url):
        page = Composer(browser, url)
        tab = page.tab
        tab.get_by_text("bunny.ply is 156 × 153 × 121 µm in size").wait_for()
        tab.get_by_role("button", name="Scale to 156 × 153 × 121 mm").click()
        page.did("scale 'bunny'")
        page.see_bodies()
        page.drop(meshes / "Duck.glb")
        page.bodies(CUBE, "bunny", "Duck")
        tab.get_by_role("dialog").get_by_role("button", name="Scale to 82.7 × 57.6 × 77 mm").click()
        page.has("scale", "0.05")

        for field, value in (
            ("rotation z", "-40"),
            ("position x", "150"),
            ("position y", "-150"),
            ("position z", "-60"),
        ):
            page.put(field, value)
            page.has(field, value)
        page.choose(CUBE)
        tab.locator('select[data-body-set="parent"]').select_option("bunny")
        page.bodies("bunny", CUBE, "Duck")
        page.has("parent", "bunny")
        page.put("position y", "-200")
        page.did(f"move '{CUBE}'")
        page.choose("bunny")
        rise_m = 0.02 - 1e-3 * float(page.value("position z"))
        page.put("position z", "20")  # with the cube on it
        page.has("position z", "20")
        page.tab.keyboard.press("Home")

        top = Top(page)
        type_in(page, "Size [mm]", f"{2 * RADIUS_MM:g}")
        pick(page, "sandpaper-p60")
        plain = top.colour(DAB)
        top.drag(DAB)
        until(lambda: (top.colour(DAB) != plain).any())
        np.testing.assert_allclose(top.borders_mm(DAB), RADIUS_MM, atol=CLOSE_MM)

        type_in(page, "Falloff [%]", "100")
        pick(page, "leather")
        top.drag(np.add(SOFT, (0, -4)), np.add(SOFT, (0, 4)))
        until(lambda: (top.colour(SOFT) != plain).any())
        picture = top.picture()
        way = np.array([top.colour(np.add(SOFT, (x, 0)), picture) for x in np.linspace(0, RADIUS_MM, 9)], float)
        share = (way - way[-1]) @ (way[0] - way[-1]) / np.square(way[0] - way[-1]).sum()
        assert (np.diff(share) < 0.02).all()  # the grain changes the shade a little
        assert len(np.unique(share.round(2))) >= 8  # two places may be on one piece

        tab.locator('.hs-play[data-name="leather"]').click()
        page.wait("window.hapscene.sound.played > 5000")
        tab.wait_for_function("window.hapscene.state.hand === 'ready'", timeout=1e3 * COMPILE_S)
        tab.keyboard.press("6")
        page.wait("window.hapscene.state.tool === 'touch'")
        tab.evaluate("Object.assign(window.hapscene.sound, { peak: 0 })")
        tab.keyboard.down("Shift")
        tab.mouse.move(*top.at(DAB))
        tab.mouse.down()
        statuses, end_s = set(), time.monotonic() + COMPILE_S
        for x_mm in cycle(np.concatenate([np.linspace(0, 3.2, 16), np.linspace(3.2, 0, 16)])):
            tab.mouse.move(*top.at(np.add(DAB, (-x_mm, 0))))
            statuses.add(tab.evaluate("window.hapscene.state.status").partition(":")[0])
            audible = tab.evaluate("window.hapscene.sound.played > 5000 && window.hapscene.sound.peak > 0.05")
            if audible and "sandpaper-p60" in statuses:
                break
            assert time.monotonic() < end_s, f"no sound on the sandpaper; status lines: {statuses}"
        tab.mouse.up()
        tab.keyboard.up("Shift")

        tab.keyboard.press("Control+s")
        page.wait("!window.hapscene.state.dirty")
        pick(page, "leather")
        top.drag(LATER)
        page.wait("window.hapscene.state.dirty")
        until(lambda: any((folder / f".{CUBE}.autosave").glob("*/*.scene.json")))
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not page.troubles
    assert find_recovery(file) is not None

    with painter(folder, file.name) as (process, url):
        page = Composer(browser, url)
        page.tab.get_by_text("Recover unsaved work?").wait_for()
        page.tab.get_by_role("button", name="Recover", exact=True).click()
        page.wait("window.hapscene.state.dirty")
        page.see_bodies()
        page.bodies("bunny", CUBE, "Duck")
        top = Top(page)
        np.testing.assert_allclose(top.borders_mm(DAB), RADIUS_MM, atol=CLOSE_MM)
        hue = [c / np.linalg.norm(c) for c in (top.colour(LATER), top.colour(SOFT))]  # the grain changes the brightness
        np.testing.assert_allclose(*hue, atol=0.03)
        page.tab.keyboard.press("Control+s")
        page.wait("!window.hapscene.state.dirty")
        page.tab.get_by_role("tab", name="File").click()
        page.tab.get_by_role("button", name="Export", exact=True).click()
        until((folder / f"{CUBE}.glb").is_file)
        page.wait("document.getElementById('hs-say').textContent.startsWith('Exported')")
        assert not page.troubles
        process.send_signal(signal.SIGTERM)
        assert process.wait(120.0) == 0

    scene = hapscene.load_scene(file)
    bunny, cube, duck = (scene.body(name) for name in ("bunny", CUBE, "Duck"))
    assert cube.parent == "bunny" and len(cube.mesh.faces) == 260
    np.testing.assert_allclose(np.ptp(bunny.mesh.bounds_m, axis=0), (0.1555, 0.1533, 0.1206), atol=1e-4)
    np.testing.assert_allclose(bunny.X_WB[2, 3], 0.02)
    np.testing.assert_allclose(cube.X_WB[:3, 3], (0.0, -0.2, rise_m), atol=1e-7)
    np.testing.assert_allclose(duck.X_WB[:3, 3], (0.15, -0.15, -0.06))

    top_m = cube.X_WB[:3, 3] + cube.mesh.bounds_m.mean(axis=0) + (0, 0, 1e-3 * SIDE_MM / 2 - 2e-4)
    renderer = hapscene.Renderer(scene, seed=0)
    names = [swatch.name for swatch in scene.swatches]
    x_mm = np.linspace(3.1, DAB[0], 600)
    way_mm = np.column_stack([x_mm, np.full(600, DAB[1]), np.zeros(600)])
    renderer.run(top_m + 1e-3 * (way_mm[0] + np.outer(np.linspace(1, 0, 50), (0, 0, 1))))  # from above
    felt = renderer.run(top_m + 1e-3 * way_mm)
    assert felt.touching.all()
    worn = [names[i] for i in felt.swatch[1:]]
    turns = [i for i in range(1, len(worn)) if worn[i] != worn[i - 1]]
    assert len(turns) == 1 and (worn[0], worn[-1]) == ("plain", "sandpaper-p60")
    assert x_mm[turns[0] + 1] == pytest.approx(DAB[0] - RADIUS_MM, abs=CLOSE_MM)

    leather, weights = names.index("leather"), []
    for x in np.linspace(-RADIUS_MM - 0.3, 0.0, 400):
        renderer.step(top_m + 1e-3 * np.array([SOFT[0] + x, SOFT[1], 0.0]))
        touch = renderer.surface.touch[0]
        lighter = float(touch["weight"]) if touch["other"] >= 0 else 0.0
        weights.append(1 - lighter if touch["swatch"] == leather else lighter)
    assert weights[10] == 0.0 and weights[-1] > 0.95 and len(np.unique(weights)) > 20
    assert (np.diff(weights[10:]) >= -0.03).all()  # a piece beside a piece

    again = import_scene(folder / f"{CUBE}.glb")
    for body in scene.bodies:
        np.testing.assert_allclose(again.body(body.name).X_WB, body.X_WB, atol=1e-7)
    assert len(again.body(CUBE).fine) == len(cube.fine)
    if shutil.which("node") is not None and VALIDATOR.exists():
        ask = f"{ASK}.then(report => console.log(JSON.stringify(report.issues)))"
        words = ["node", "-e", ask, str(VALIDATOR), str(folder / f"{CUBE}.glb")]
        issues = json.loads(subprocess.run(words, capture_output=True, text=True, check=True, timeout=60).stdout)
        assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]
