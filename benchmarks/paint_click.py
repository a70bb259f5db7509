"""How long the painter's page takes from a click to the changed pixel."""

from typing import Any, Final

from .paint_browser import middle

CHANGE: Final = 40
"""By how much a channel of the pixel must have changed [0 to 255]: more than light and rounding do."""

WATCH: Final = """
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
