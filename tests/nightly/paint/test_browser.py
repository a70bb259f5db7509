"""The painter's page in headless Chromium with software rendering and without a network."""

import socket
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
from tests.paint.window import BESIDE, FRONT, Window
from tests.until import until


def test_page_cannot_connect_to_other_servers(window: Window) -> None:
    """The content security policy blocks connections to other servers, also on other ports of this computer."""
    before = len(window.troubles)
    with socket.create_server(("127.0.0.1", 0)) as other:
        other.settimeout(0.5)
        place = f"127.0.0.1:{other.getsockname()[1]}"
        for way in (f"new WebSocket('ws://{place}')", f"fetch('http://{place}').catch(() => 0)"):
            blocked = window.ask(
                "new Promise(done => { document.addEventListener('securitypolicyviolation', "
                f"e => done(e.effectiveDirective), {{once: true}}); setTimeout(() => done('nothing'), 5000); "
                f"try {{ {way} }} catch (e) {{}} }})"
            )
            assert blocked == "connect-src"
        with pytest.raises(TimeoutError):
            other.accept()
    del window.troubles[before:]  # the browser tells of it


def test_token_is_hidden_in_the_address_bar_and_stored_in_this_browser_only(window: Window) -> None:
    page, tab = window.page, window.tab
    before, home, token = len(window.troubles), page.url.rsplit("/", 2)[0] + "/", page.url.split("/")[-2]
    tab.wait_for_url(home)
    here = "window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool"
    second = tab.context.new_page()
    second.goto(home)
    second.wait_for_function(here)
    second.close()
    stranger = tab.context.browser.new_context().new_page()
    for url in (home, f"{home}of-another-start/"):
        assert stranger.goto(url).status == 403
        assert "terminal printed" in stranger.inner_text("body") and token not in stranger.content()
    stranger.evaluate("localStorage.setItem('hapscene', location.pathname)")  # as a start before this one left it
    stranger.goto(home)
    stranger.wait_for_url(f"{home}of-another-start/")
    assert "terminal printed" in stranger.inner_text("body")
    stranger.context.close()

    count = tab.evaluate("window.hapscene.client()")
    page.server._websock_server.disconnect_all_clients()
    window.wait(f"window.hapscene.client() > {count}")  # it finds its way back
    del window.troubles[before:]


def test_views_have_keys_and_show_all(window: Window) -> None:
    page, tab = window.page, window.tab
    camera = page.server.get_clients()[window.ask("window.hapscene.client()")].camera

    def seen_from(way: Any) -> bool:
        eye = np.array(camera.position)
        return bool(np.allclose(eye / np.linalg.norm(eye), way, atol=1e-3) and np.abs(camera.look_at).max() < 1e-6)

    tab.mouse.move(*window.at(FRONT))
    for key, way in (("Shift+1", (0, -1, 0)), ("Shift+4", (1, 0, 0)), ("Shift+5", (0, 0, 1)), ("Shift+6", (0, 0, -1))):
        tab.keyboard.press(key)
        until(lambda way=way: seen_from(way))
    camera.position = (0.1, -0.2, 0.3)
    until(lambda: not seen_from((0, 0, -1)))
    tab.keyboard.press("f")
    until(lambda: np.linalg.norm(camera.position) > 3.0)
    tab.keyboard.press("Home")
    way = np.array([0.35, -0.8, 0.6])
    until(lambda: seen_from(way / np.linalg.norm(way)))


def test_a_stroke_is_shown_before_it_is_painted_and_in_the_colour_that_follows(window: Window) -> None:
    tab, session = window.tab, window.page.context.session
    window.tools.choose_swatch("leather", "leather")
    tab.keyboard.press("1")
    window.wait("window.hapscene.state.swatch === 'leather' && window.hapscene.state.brush")
    x, y = (round(place) for place in window.at(BESIDE))

    def hue() -> np.ndarray:
        seen = window.pixels()[y - 2 : y + 3, x - 2 : x + 3].mean(axis=(0, 1))
        return np.asarray(seen / np.linalg.norm(seen))

    bare, step = hue(), session.history.state
    tab.keyboard.down("Shift")
    with session.lock:  # nothing can be painted
        tab.mouse.move(x, y)
        tab.mouse.down()
        until(lambda: np.linalg.norm(hue() - bare) > 0.1)
        stamp = hue()
        assert session.history.state == step
    tab.mouse.up()
    tab.keyboard.up("Shift")
    window.when(lambda: session.history.state != step)
    window.ask("window.hapscene.stamp.clear()")
    window.see(BESIDE, "leather")
    assert np.linalg.norm(hue() - stamp) < 0.03
    session.undo()


def test_without_a_gpu_frames_have_few_pixels_while_the_scene_changes(window: Window) -> None:
    canvas = "document.querySelector('canvas[data-engine]')"
    pixels = f"({canvas}.width / {canvas}.clientWidth)"
    assert window.ask(f"{canvas}.getContext('webgl2').getContextAttributes().antialias") is False
    window.ask("void (window.changing = setInterval(() => window.__viserMutable.requestRender(), 20))")
    window.wait(f"{pixels} < 0.65")
    window.ask("clearInterval(window.changing)")
    window.wait(f"{pixels} > 0.95")


def test_all_of_a_stroke_is_drawn_by_keys(window: Window) -> None:
    page, tab = window.page, window.tab
    scene, chosen = page.context.session.scene, window.tools.chosen
    window.tools.choose_swatch("paper", "paper")
    before = scene.bodies[0].face_swatch.copy()
    for key in ("1", "k", "Shift+ArrowLeft", "ArrowUp"):
        tab.keyboard.press(key)
    tab.keyboard.down(" ")
    until(lambda: not np.array_equal(scene.bodies[0].face_swatch, before))
    dabbed = scene.bodies[0].face_swatch.copy()
    tab.keyboard.press("Shift+ArrowRight")
    until(lambda: not np.array_equal(scene.bodies[0].face_swatch, dabbed))
    tab.keyboard.up(" ")
    until(lambda: not window.tools.pressed)
    tab.keyboard.press("Escape")
    window.wait("document.activeElement === document.body")
    tab.keyboard.press("Control+z")
    until(lambda: np.array_equal(scene.bodies[0].face_swatch, before))
    window.tools.choose_swatch(chosen, chosen)


def test_locked_a_plain_drag_paints_and_one_with_shift_turns_the_view(window: Window) -> None:
    page, tab = window.page, window.tab
    camera = page.server.get_clients()[window.ask("window.hapscene.client()")].camera

    def drag() -> tuple[bool, bool]:
        """Whether something was painted, and whether the view turned."""
        painting, place = page.context.session.painting, np.array(camera.position)
        state = painting.state
        x, y = window.at(FRONT)
        tab.mouse.move(x, y)
        tab.mouse.down()
        tab.mouse.move(x + 20, y + 5, steps=4)
        tab.mouse.up()
        until(lambda: painting.state != state or np.abs(np.array(camera.position) - place).max() > 0.01)
        until(lambda: not window.tools.pressed)  # the stroke's last drops, too
        window.ask("new Promise(done => setTimeout(done, 300))")  # whatever else comes has come
        return painting.state != state, bool(np.abs(np.array(camera.position) - place).max() > 0.01)

    window.tools.choose_swatch("leather", "leather")  # nothing wears it yet, whatever was painted before
    tab.mouse.move(*window.at(FRONT))
    tab.keyboard.press("1")
    tab.keyboard.press("l")
    window.wait("window.hapscene.state.tool === 'brush'")
    assert drag() == (True, False)
    tab.keyboard.down("Shift")
    assert drag() == (False, True)
    tab.keyboard.up("Shift")
    tab.keyboard.press("l")
    assert drag() == (False, True)


def test_swatch_panel_by_keyboard(window: Window) -> None:
    tab = window.tab
    tab.get_by_role("tab", name="Paint").click()
    window.wait("document.querySelectorAll('.hs-pick img').length > 24")
    before = len(window.troubles)
    tab.locator(".hs-pick[data-name=leather]").focus()
    tab.keyboard.press("ArrowRight")
    tab.keyboard.press("ArrowLeft")
    tab.keyboard.press("Enter")
    window.wait("window.hapscene.state.swatch === 'leather'")
    window.wait("document.activeElement.dataset.name === 'leather'")  # though all was drawn anew
    assert len(window.troubles) == before
