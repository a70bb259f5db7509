"""The painter's page in a real browser: painting, touching, sound, saving and loading."""

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.scene.scene import load_scene
from tests.paint.window import BESIDE, FRONT, Window


def test_paint_undo_fill_touch_save_and_load_in_a_browser(window: Window) -> None:
    page, tab = window.page, window.tab
    window.see(FRONT, "wood")
    first = window.pixels()

    window.drag(FRONT, np.add(FRONT, (0.001, 0.0, 0.0)))  # with epoxy, the last of the scene
    window.see(FRONT, "epoxy")
    assert window.wears(BESIDE) == "wood"
    window.wait("window.hapscene.state.undo && window.hapscene.state.undo.includes('brush')")

    tab.keyboard.press("Control+z")
    window.see(FRONT, "wood")
    tab.mouse.move(5, 300)
    window.wait("!window.hapscene.state.undo")

    tab.keyboard.press("2")
    tab.get_by_label("Fill", exact=True).first.click()
    tab.get_by_role("option", name="whole body").click()
    tools = window.tools
    window.when(lambda: tools.fill == "whole body")
    window.drag(FRONT)
    window.see(BESIDE, "epoxy")
    assert (page.context.session.scene.bodies[0].face_swatch == 2).all()
    assert np.abs(window.pixels() - first).max(axis=2).mean() > 1.0

    tab.get_by_role("tab", name="Haptics").click()
    field = tab.locator("input[inputmode=decimal]:visible").first
    field.fill("222")
    field.press("Enter")
    window.wait("document.activeElement.tagName !== 'INPUT'")  # keys are the page's again
    window.when(lambda: page.context.session.scene.swatches[2].stiffness_N_m == 222.0)

    window.wait("window.hapscene.state.hand === 'ready'")
    tab.keyboard.press("6")
    window.wait("window.hapscene.state.tool === 'touch'")
    tab.keyboard.down("Shift")
    tab.mouse.move(*window.at(FRONT))
    tab.mouse.down()
    window.wait("window.hapscene.state.status.startsWith('epoxy:')")
    window.wait("Math.max(...window.hapscene.trace.force) > 0.5")
    for x_m in np.tile(np.linspace(0.0, 0.008, 12), 40):
        tab.mouse.move(*window.at(np.add(FRONT, (x_m, 0.0, 0.0))))
        if window.ask("window.hapscene.sound.played > 5000 && window.hapscene.sound.peak > 0.05"):
            break
    tab.mouse.up()
    tab.keyboard.up("Shift")
    assert window.ask("window.hapscene.sound.peak") > 0.05

    tab.keyboard.press("Control+s")
    window.wait("!window.hapscene.state.dirty")
    saved = load_scene(page.context.session.path)
    assert (saved.bodies[0].face_swatch == 2).all() and saved.swatches[2].stiffness_N_m == 222.0

    assert not window.troubles
    tab.reload()  # without the token in the address: refused, and found again in the browser's storage
    window.wait("window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool === 'touch'")
    window.see(BESIDE, "epoxy")
    home = page.url.rsplit("/", 2)[0]
    troubles = [said for said in window.troubles if said != f"{home}/"]  # the refused page may be left half loaded
    assert len(troubles) == 1 and "403" in troubles[0]
    window.troubles.clear()
    ours = ("blob:", "data:", home, home.replace("http", "ws"))
    assert not [url for url in window.requests if not url.startswith(ours)]
