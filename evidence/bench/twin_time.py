"""Speed of the simulated closed loop of hand, device, handle and five effects, and time per tick."""

import timeit
from functools import partial
from typing import Final

import numpy as np
import trimesh

from hapscene.device.sim.omni import Omni
from hapscene.device.sim.point import PointMass
from hapscene.handle.plant import Plant
from hapscene.loop import Twin
from hapscene.motion.gestures import act
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.swatches.library import load_swatch

from .sheet import Sheet

REPEATS: Final = 7
"""Runs, of which the fastest counts [count]."""

DEVICES: Final[dict[str, PointMass | Omni]] = {"point mass": PointMass(0.045, 0.1, 0.26, 5.5e-5), "Omni": Omni()}
HANDLES: Final = {"no handle": None, "handle": Plant()}


def measure_twin(sheet: Sheet) -> None:
    """Measure a hand that scrubs wood, with 1 kHz force and 10 kHz acceleration."""
    scene = Scene()
    box = Mesh.from_trimesh(trimesh.creation.box((0.12, 0.12, 0.02)), "m")
    scene.add(box, name="plate", swatch=load_swatch("wood"))
    for device, model in DEVICES.items():
        for handle, plant in HANDLES.items():
            intent = act("scrub", scene, 1e-3, grip="medium")
            twin = Twin(scene, model, handle=plant)
            case, ticks = (
                f"twin, {device}, {handle}",
                len(twin.run(intent)),
            )  # compiles, and moves the Omni to its start
            run, reset = partial(twin.run, intent), partial(twin.reset, intent.target_W_m[0])
            least_s = min(timeit.repeat(run, reset, number=1, repeat=REPEATS))
            sheet.add(case, "times real time", ticks * twin.renderer.tick_s / least_s, "1")
            sheet.add(case, "tick", 1e6 * least_s / ticks, "µs")
            reset()
            sheet.add(case, "rendering median", 1e-3 * np.median(run().recording.tick_ns), "µs")
