"""Speed of the simulated closed loop of hand, device, handle and five effects, and time per tick."""

import timeit
from functools import partial
from typing import Final

import trimesh

from hapscene.device.sim.omni import Omni
from hapscene.handle.plant import Plant
from hapscene.loop import Twin
from hapscene.motion.gestures import act
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.swatches.library import load_swatch

from .sheet import Sheet

REPEATS: Final = 7
"""Runs, of which the fastest counts [count]."""


def measure_twin(sheet: Sheet) -> None:
    """Measure a hand that scrubs wood with an Omni and a handle: 1 kHz force and 10 kHz acceleration."""
    scene = Scene()
    box = Mesh.from_trimesh(trimesh.creation.box((0.12, 0.12, 0.02)), "m")
    scene.add(box, name="plate", swatch=load_swatch("wood"))
    intent = act("scrub", scene, 1e-3, grip="medium")
    twin = Twin(scene, Omni(), handle=Plant())
    ticks = len(twin.run(intent))  # compiles, and moves the Omni to its start
    run, reset = partial(twin.run, intent), partial(twin.reset, intent.target_W_m[0])
    least_s = min(timeit.repeat(run, reset, number=1, repeat=REPEATS))
    sheet.add("twin, Omni, handle", "tick", 1e6 * least_s / ticks, "µs")
