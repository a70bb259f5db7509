"""Compiles, once and before pytest starts its processes, what most tests share: tick, twin and servo loop."""

import numpy as np
import trimesh

import hapscene
from hapscene.device.omni import Omni
from hapscene.device.point import PointMass
from hapscene.servo import Servo
from hapscene.twin import Intent, Twin

if __name__ == "__main__":  # a servo starts a process, which imports this file
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="box", unit="m", swatch="wood")
    renderer = hapscene.Renderer(scene)
    renderer.step((0.0, 0.0, 0.049))
    renderer.run(np.tile((0.0, 0.0, 0.049), (10, 1)))
    for device in (PointMass(0.045, 0.1, 0.26, 5.5e-5), Omni()):
        twin = Twin(scene, device)
        twin.run(Intent.hold((0.0, 0.0, 0.049), 10))
    with Servo(scene, PointMass(0.045, 0.1, 0.26, 5.5e-5)) as servo:
        servo.start((0.0, 0.0, 0.06))
        servo.state()
