"""A body of 20,480 faces that deforms 60 times a second while it is touched: time of `deform`, and of the ticks."""

import time
from typing import Final

import numpy as np

from hapscene.loop import Servo
from hapscene.render.renderer import Renderer
from hapscene.scene.scene import Scene

from .case import RADIUS_M, sphere
from .sheet import Sheet

CASE: Final = "shapes 20 k"

PERIOD_S: Final = 1.0 / 60.0

PRESSED_M: Final = (0.0, 0.0, RADIUS_M - 0.003)


def measure_deform(sheet: Sheet, duration_s: float) -> None:
    """Measure the time of `deform`, and duration and latency of servo ticks with and without deformation."""
    scene = Scene()
    body = scene.add(sphere(5), name="body", swatch="wood")
    vertices = np.array(body.mesh.vertices_m)
    shapes = [(1.0 + 0.02 * np.sin(0.3 * k)) * vertices for k in range(21)]
    renderer = Renderer(scene)
    renderer.deform("body", vertices)  # builds the search structure
    took = []
    for k in range(200):
        start_s = time.perf_counter()
        renderer.deform("body", shapes[k % len(shapes)])
        took.append(time.perf_counter() - start_s)
        renderer.step((0.0, 0.0, 1.0))
    sheet.add_spread(CASE, "deform", took, "ms", 1e3)
    with Servo(scene, "omni") as servo:
        servo.start((0.0, 0.0, 1.2 * RADIUS_M))
        servo.deform("body", vertices)
        servo.aim(PRESSED_M, "medium")
        time.sleep(1.0)
        for name, changing in (("at rest", False), ("changing", True)):
            before, due_s = servo.timing(), time.perf_counter()
            for k in range(round(duration_s / PERIOD_S)):
                if changing:
                    servo.deform("body", shapes[k % len(shapes)])
                due_s += PERIOD_S
                time.sleep(max(due_s - time.perf_counter(), 0.0))
            now = servo.timing().since(before)
            for share, quantile in ((0.5, "median"), (0.99, "p99"), (0.999, "p99.9")):
                sheet.add(CASE, f"tick, {name} {quantile}", now.busy_us(share), "µs")
    ratio = sheet.number(CASE, "tick, changing p99") / sheet.number(CASE, "tick, at rest p99")
    sheet.add(CASE, "tick p99, changing to at rest", ratio, "1")
