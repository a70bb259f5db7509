"""A scene is composed from third-party meshes in a real browser and recovered after kill -9."""

import signal
import subprocess
import sys
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
pytest.importorskip("playwright", reason="playwright is not installed: pip install 'hapscene[dev]'")

from hapscene.paint.model.document import find_recovery
from hapscene.scene.scene import load_scene
from tests.nightly.paint.composer import Composer, painter
from tests.until import until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no kill -9 there")


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Files as others make them: a part in STL, without a unit, and a model in GLB."""
    folder = tmp_path / "foreign"
    folder.mkdir()
    trimesh.creation.box((20.0, 20.0, 20.0)).export(folder / "cube.stl")
    trimesh.creation.annulus(8.0, 15.0, 6.0).export(folder / "ring.stl")
    trimesh.creation.cone(0.02, 0.05).export(folder / "cone.glb")
    return folder


def test_composed_scene_is_saved_and_recovered_after_kill(browser: Any, foreign: Path, tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    command = (str(foreign / "cube.stl"), "--unit", "mm", "--up", "z", "--no-hand")
    with painter(folder, *command) as (process, url):
        page = Composer(browser, url)
        page.see_bodies()
        page.bodies("cube")

        page.drop(foreign / "cone.glb")
        page.bodies("cube", "cone")
        page.drop(foreign / "ring.stl")
        page.tab.get_by_text("ring.stl does not contain a unit").wait_for()
        page.tab.get_by_role("button", name="mm: 30 × 30 × 6 mm").click()
        page.bodies("cube", "cone", "ring")
        page.tab.get_by_role("button", name="Yes", exact=True).click()  # upright
        assert (folder / "cone.glb").is_file() and (folder / "ring.stl").is_file()

        page.put("position z", "30")
        page.did("move 'ring'")
        page.put("rotation x", "90")
        page.wait("document.querySelector('[data-body-set=\"rotation x\"]')?.value === '90'")
        page.press("copy", "ring")
        page.bodies("cube", "cone", "ring", "ring 2")
        page.tab.locator('select[data-body-set="parent"]').select_option("cone")
        page.did("attach 'ring 2' to 'cone'")
        page.bodies("cube", "cone", "ring 2", "ring")  # below what it hangs on
        page.put("name", "brim")
        page.bodies("cube", "cone", "brim", "ring")
        page.put("size x", "45")
        page.did("scale 'brim'")
        page.press("hide", "cube")
        page.tab.locator('[data-body-act="hide"][data-body="cube"]', has_text="Show").wait_for()

        page.tab.locator("#hs").click(position={"x": 4, "y": 300}, force=True)
        steps = 0
        while page.tab.evaluate("!!window.hapscene.state.undo"):
            was = page.tab.evaluate("window.hapscene.state.undo")
            page.tab.keyboard.press("Control+z")
            page.wait(f"window.hapscene.state.undo !== {was!r} || window.hapscene.state.redo === {was!r}")
            steps += 1
        page.bodies("cube")
        for _ in range(steps):
            was = page.tab.evaluate("window.hapscene.state.redo")
            page.tab.keyboard.press("Control+y")
            page.wait(f"window.hapscene.state.redo !== {was!r} || window.hapscene.state.undo === {was!r}")
        page.bodies("cube", "cone", "brim", "ring")

        page.tab.keyboard.press("Control+s")
        page.wait("!window.hapscene.state.dirty")
        saved = load_scene(folder / "cube.scene.json")
        brim, ring = saved.body("brim"), saved.body("ring")
        assert brim.parent == "cone" and ring.parent is None
        assert ring.mesh.path == folder / "ring.stl"
        np.testing.assert_allclose(ring.X_WB[2, 3], 0.03, atol=2e-5)  # its middle stayed when it was turned
        assert np.ptp(brim.mesh.bounds_m, axis=0)[0] == pytest.approx(0.045)
        np.testing.assert_allclose(ring.X_WB[:3, :3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)

        page.press("choose", "cone")
        page.put("position y", "123")
        page.did("move 'cone'")
        until(lambda: any((folder / ".cube.autosave").glob("*/cube.scene.json")))
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not page.troubles

    moved_m = load_scene(find_recovery(folder / "cube.scene.json").file).body("cone").X_WB[1, 3]
    assert moved_m == pytest.approx(0.123)
    again = [sys.executable, "-m", "hapscene", "paint", *command, "--port", "0", "--no-browser"]
    with subprocess.Popen(again, stdout=-1, text=True, cwd=folder) as process:  # begins another scene
        said = "".join(takewhile(lambda line: "http://127.0.0.1:" not in line, process.stdout or ()))
        process.kill()
    assert "cube.scene.json was saved at" in said and "unsaved work" in said
    with painter(folder, "cube.scene.json", "--no-hand") as (process, url):
        page = Composer(browser, url)
        page.tab.get_by_text("Recover unsaved work?").wait_for()
        page.tab.get_by_role("button", name="Recover", exact=True).click()
        page.wait(
            "window.hapscene.state.title === 'cube.scene.json' && window.hapscene.state.undo === 'recovered painting'"
        )
        page.see_bodies()
        page.bodies("cube", "cone", "brim", "ring")
        page.press("choose", "cone")
        page.wait("document.querySelector('[data-body-set=\"position y\"]')?.value === '123'")
        page.tab.keyboard.press("Control+s")
        page.wait("!window.hapscene.state.dirty")
        process.send_signal(signal.SIGTERM)
        assert process.wait(120.0) == 0 and not page.troubles
    assert load_scene(folder / "cube.scene.json").body("cone").X_WB[1, 3] == moved_m
    assert find_recovery(folder / "cube.scene.json") is None
    assert [file.name for file in folder.glob("*.scene.json")] == ["cube.scene.json"]
