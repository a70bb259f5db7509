"""Time of a step while many bodies move; time of `deform`, and of ticks while a body of 20,480 faces changes shape."""

import math
import time
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.loop import Servo
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

from .case import RADIUS_M, sphere
from .sheet import Sheet

Array = NDArray[np.float64]

SPACING_M: Final = 0.2
"""Spacing of the grid of bodies [m]; spheres of 0.1 m diameter do not touch."""

SWAY_M, SWAY_HZ = 0.005, 1.6
"""Amplitude [m] and frequency [Hz] of the motion; at most 0.05 m/s."""

BOUND_COUNTS: Final = (1, 100, 1000)
"""Numbers of moving bodies, stepped from Python."""

MOVING_TICKS: Final = 1000
"""Ticks with moving bodies [count]; a pose per body and tick takes memory."""

DEFORMING: Final = "shapes 20 k"

PERIOD_S: Final = 1.0 / 60.0

PRESSED_M: Final = (0.0, 0.0, RADIUS_M - 0.003)


def measure_crowd(sheet: Sheet, repeats: int) -> None:
    """Measure a step from Python in contact while all bodies move; poses are written into slots."""
    for count in BOUND_COUNTS:
        place = grid(count)
        renderer = Renderer(crowd_of(sphere(3), place), effects=["wall"])
        slots = renderer.moving_bodies([f"body {i}" for i in range(count)])
        X_WB = _sway(place, MOVING_TICKS)
        took_ns = np.zeros((repeats, MOVING_TICKS), np.int64)
        renderer.step((0.0, 0.0, 0.06))
        for repeat in range(repeats):
            for k in range(MOVING_TICKS):
                slots.X_WB[:] = X_WB[k]
                start_ns = time.perf_counter_ns()
                renderer.step((X_WB[k, 0, 0, 3], 0.0, 0.049 + X_WB[k, 0, 2, 3]), slots)
                took_ns[repeat, k] = time.perf_counter_ns() - start_ns
        sheet.add(f"moving {count}", "step with bound bodies", 1e-3 * float(np.median(took_ns.min(axis=0))), "µs")


def grid(count: int) -> Array:
    """Return positions (count, 3) [m] on a cubic grid, the first at the origin."""
    edge = math.ceil(count ** (1 / 3))
    steps = np.stack(np.unravel_index(np.arange(count), (edge, edge, edge)), axis=1)
    return SPACING_M * steps.astype(np.float64)


def crowd_of(mesh: Mesh, place: Array) -> Scene:
    """Return a scene of bodies that share a mesh, at positions (n, 3) [m]."""
    scene = Scene()
    for i, p in enumerate(place):
        X_WB = np.eye(4)
        X_WB[:3, 3] = p
        scene.add(mesh, name=f"body {i}", pose=X_WB)
    return scene


def _sway(place: Array, tick_count: int) -> Array:
    """Return poses (tick_count, m, 4, 4) of bodies that oscillate about positions (m, 3)."""
    X_WB = np.tile(np.eye(4), (tick_count, len(place), 1, 1))
    X_WB[:, :, :3, 3] = place
    X_WB[:, :, 0, 3] += SWAY_M * np.sin(2 * np.pi * SWAY_HZ * 1e-3 * np.arange(tick_count))[:, None]
    return X_WB


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
    sheet.add_spread(DEFORMING, "deform", took, "ms", 1e3)
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
                sheet.add(DEFORMING, f"tick, {name} {quantile}", now.busy_us(share), "µs")
    ratio = sheet.number(DEFORMING, "tick, changing p99") / sheet.number(DEFORMING, "tick, at rest p99")
    sheet.add(DEFORMING, "tick p99, changing to at rest", ratio, "1")
