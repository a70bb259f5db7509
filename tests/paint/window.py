"""The browser's window on the painter's page."""

import io
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from hapscene.paint.web.page import Page
from hapscene.paint.web.tools import Tools

CANVAS = "document.querySelector('canvas').getBoundingClientRect()"

SIZE = {"width": 1000, "height": 640}
PATIENCE_S = 120.0
"""How long anything may take on a machine that does much else besides [s]."""


LOOKS_MAX = 200
"""Screenshots until something must be seen [count]."""


class WatchedPage(Page):
    """A page that tells when something may have changed."""

    changed = threading.Condition()

    def refresh(self) -> None:
        super().refresh()
        with self.changed:
            self.changed.notify_all()


class Window:
    """The browser's window on the page."""

    def __init__(self, browser: Any, page: WatchedPage) -> None:
        self.page = page
        self.troubles: list[str] = []
        self.requests: list[str] = []
        self.tab = browser.new_context(viewport=SIZE).new_page()
        self.tab.set_default_timeout(1e3 * PATIENCE_S)
        self.tab.on("pageerror", lambda error: self.troubles.append(str(error)))
        self.tab.on("requestfailed", lambda request: self.troubles.append(request.url))
        self.tab.on("console", lambda m: self.troubles.append(m.text) if m.type == "error" else None)
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.on("websocket", lambda wire: self.requests.append(wire.url))
        self.tab.goto(page.url)
        self.wait("window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool")

    def wait(self, script: str) -> None:
        self.tab.wait_for_function(script)

    def ask(self, script: str, *given: Any) -> Any:
        return self.tab.evaluate(script, *given)

    def at(self, p_W_m: Any) -> tuple[float, float]:
        """Where a place of the scene is in the window [pixels]."""
        client = self.page.server.get_clients()[self.ask("window.hapscene.client()")]
        box = self.ask(f"(() => {{ const b = {CANVAS}; return [b.left, b.top, b.width, b.height]; }})()")
        camera = client.camera
        w, x, y, z = camera.wxyz
        R = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        right, down, forth = R.T @ (self.page.context.view.to_view(p_W_m) - camera.position)
        half = box[3] / 2 / np.tan(camera.fov / 2)
        return box[0] + box[2] / 2 + half * right / forth, box[1] + box[3] / 2 + half * down / forth

    @property
    def tools(self) -> Tools:
        """The tools of this window."""
        return self.page.clients[self.ask("window.hapscene.client()")].context.tools

    def pixels(self) -> NDArray[np.int16]:
        """What is seen (height, width, 3)."""
        picture = Image.open(io.BytesIO(self.tab.screenshot())).convert("RGB")
        return np.asarray(picture).astype(np.int16)

    def wears(self, p_W_m: Any) -> str:
        """Which of the scene's swatches a place is seen to wear, by hue: the nearest of their colours."""
        x, y = self.at(p_W_m)
        seen = self.pixels()[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3].mean(axis=(0, 1))
        swatches = self.page.context.session.scene.swatches
        off = [np.linalg.norm(_hue(seen) - _hue(255 * np.array(s.albedo_rgb))) for s in swatches]
        return swatches[int(np.argmin(off))].name

    def see(self, p_W_m: Any, name: str) -> None:
        """Look until a place is seen to wear a swatch."""
        assert any(self.wears(p_W_m) == name for _ in range(LOOKS_MAX))

    def when(self, true: Callable[[], bool]) -> None:
        """Wait until something of the page has come true."""
        with self.page.changed:
            assert self.page.changed.wait_for(true, PATIENCE_S)

    def drag(self, *places: Any) -> None:
        """Hold Shift, press and drag over places."""
        self.tab.keyboard.down("Shift")
        self.tab.mouse.move(*self.at(places[0]))
        self.tab.mouse.down()
        for place in places[1:]:
            self.tab.mouse.move(*self.at(place))
        self.tab.mouse.up()
        self.tab.keyboard.up("Shift")


def _hue(rgb: Any) -> NDArray[np.float64]:
    """A colour without its lightness."""
    colour = np.asarray(rgb, np.float64)
    return colour / max(float(np.linalg.norm(colour)), 1.0)


FRONT = (0.004, -0.024, 0.0176)
"""On the side of the ball that is seen."""

BESIDE = (0.019, -0.0222, 0.006)
