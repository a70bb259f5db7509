"""A crate of panda3d's Bullet world, pushed over the floor by the tool; needs `pip install panda3d`."""

import sys
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

import hapscene

try:
    from panda3d.bullet import BulletBoxShape, BulletPlaneShape, BulletRigidBodyNode, BulletWorld
    from panda3d.core import TransformState, Vec3
except ImportError:
    print("panda3d is not installed: pip install panda3d")
    sys.exit()

Array = NDArray[np.float64]


class Panda:
    """Rigid bodies of a `BulletWorld`, as a bridge takes them: see `hapscene.bridge.Simulation`."""

    def __init__(self, world: Any, nodes: list[Any], step_s: float) -> None:
        self.names, self.step_s = tuple(node.name for node in nodes), step_s
        self._world, self._nodes = world, nodes
        for node in nodes:
            node.setDeactivationEnabled(False)  # it would sleep under the tool

    def read(self, X_WB: Array) -> None:
        for i, node in enumerate(self._nodes):
            X_WB[i] = np.transpose(node.getTransform().getMat())  # panda3d multiplies from the left

    def mobility(self, body: int) -> Array:
        node = self._nodes[body]
        R_WB = np.transpose(node.getTransform().getMat())[:3, :3]
        return hapscene.bridge.free_mobility(node.getMass(), tuple(node.getInertia()), R_WB)

    def advance(self, wrench_W: Array) -> None:
        for node, wrench in zip(self._nodes, wrench_W, strict=True):
            node.applyCentralForce(Vec3(*wrench[:3]))
            node.applyTorque(Vec3(*wrench[3:]))
        self._world.doPhysics(self.step_s, 1, self.step_s)


def solid(world: Any, name: str, shape: Any, mass_kg: float = 0.0, z_m: float = 0.0) -> Any:
    node = BulletRigidBodyNode(name)
    node.addShape(shape)
    node.setMass(mass_kg)
    node.setTransform(TransformState.makePos(Vec3(0, 0, z_m)))
    world.attach(node)
    return node


world = BulletWorld()
world.setGravity(Vec3(0, 0, -9.81))
solid(world, "floor", BulletPlaneShape(Vec3(0, 0, 1), 0))
crate = solid(world, "crate", BulletBoxShape(Vec3(0.05, 0.05, 0.05)), 0.2, 0.05)

scene = hapscene.Scene()
scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="crate", unit="m", swatch="wood")
renderer = hapscene.Renderer(scene, device="omni")
bridge = hapscene.bridge.Bridge(Panda(world, [crate], 1 / 60))

p_WT = np.array([-0.06, 0.0, 0.04])  # a centimetre before the crate
for _ in range(120):
    p_WT[0] += 0.03 / 60  # 3 cm/s
    bridge.step(renderer, p_WT)

x_m = crate.getTransform().getPos().x
push_N = renderer.impulse("crate").linear_N_s[0] / 1.5
print(f"pushed by {1e3 * x_m:.1f} mm, with {push_N:.2f} N on average")

# The tool came 6 cm, of which 1 to the crate. What holds the crate back is friction, a quarter of its weight.
assert 0.035 < x_m < 0.055
assert 0.15 * 0.2 * 9.81 < push_N < 0.7 * 0.2 * 9.81
