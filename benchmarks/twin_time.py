"""How many times faster than real time the twin's closed loop runs: hand, device, handle and four effects."""

import time
from typing import Final

import trimesh

from hapscene.device.omni import Omni
from hapscene.device.point import PointMass
from hapscene.handle.plant import Plant
from hapscene.motion.gestures import act
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.library import load_swatch
from hapscene.twin import Twin

from .sheet import Sheet

REPEATS: Final = 7
"""Runs of which the fastest counts [count]."""

DEVICES: Final[dict[str, PointMass | Omni]] = {"point mass": PointMass(0.045, 0.1, 0.26, 5.5e-5), "Omni": Omni()}
HANDLES: Final = {"no handle": None, "handle": Plant()}


def measure_twin(sheet: Sheet) -> None:
    """A hand that scrubs wood at 1 kHz force and 10 kHz acceleration: times real time, and time per tick."""
    scene = Scene()
    box = Mesh.from_trimesh(trimesh.creation.box((0.12, 0.12, 0.02)), "m")
    scene.add(box, name="plate", swatch=load_swatch("wood"))
    for device, model in DEVICES.items():
        for handle, plant in HANDLES.items():
            intent = act("scrub", scene, 1e-3, "medium")
            twin = Twin(scene, model, handle=plant)
            twin.run(intent)  # compiles, and places an Omni
            times = []
            for _ in range(REPEATS):
                twin.reset(intent.target_W_m[0])
                start_s = time.perf_counter()
                feel = twin.run(intent)
                times.append(time.perf_counter() - start_s)
            case = f"twin, {device}, {handle}"
            sheet.add(case, "times real time", len(feel) * twin.renderer.tick_s / min(times), "1")
            sheet.add(case, "tick", 1e6 * min(times) / len(feel), "µs")
