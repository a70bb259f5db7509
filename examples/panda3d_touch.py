"""The tool pushes a floating crate in panda3d's Bullet world. Needs `pip install panda3d`."""

import sys
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

import hapscene

try:
    from panda3d.bullet import BulletBoxShape, BulletRigidBodyNode, BulletWorld
    from panda3d.core import Vec3
except ImportError:
    print("panda3d is not installed: pip install panda3d")
    sys.exit()

Array = NDArray[np.float64]


class Panda:
    """Rigid bodies of a `BulletWorld` as a `hapscene.bridge.Simulation`."""

    def __init__(self, world: Any, nodes: list[Any], step_s: float) -> None:
        self.names, self.step_s = tuple(node.name for node in nodes), step_s
        self._world, self._nodes = world, nodes
        for node in nodes:
            node.setDeactivationEnabled(False)  # a sleeping body would not move under the tool

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
        self._world.doPhysics(self.step_s, 0)  # sub-steps would delay the poses by one step


crate = BulletRigidBodyNode("crate")
crate.addShape(BulletBoxShape(Vec3(0.05, 0.05, 0.05)))
crate.setMass(0.2)
world = BulletWorld()  # without gravity
world.attach(crate)

scene = hapscene.Scene()
scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="crate", unit="m", swatch="wood")
renderer = hapscene.Renderer(scene, device="omni")
bridge = hapscene.bridge.Bridge(Panda(world, [crate], 1 / 60))

p_WT = np.array([-0.06, 0.02, 0.0])  # 1 cm in front of the crate
for _ in range(120):
    p_WT[0] += 0.03 / 60  # 3 cm/s
    bridge.step(renderer, p_WT)

impulse = renderer.impulse("crate")
v_m_s, w_rad_s = (np.array(v) for v in (crate.getLinearVelocity(), crate.getAngularVelocity()))
print(f"velocity {1e3 * v_m_s[0]:.0f} mm/s, angular velocity {w_rad_s[2]:.2f} rad/s")

# The momentum of the crate equals the impulse of the tool, in single precision.
assert v_m_s[0] > 0.02
assert np.allclose(crate.getMass() * v_m_s, impulse.linear_N_s, rtol=1e-5, atol=1e-8)
assert np.allclose(crate.getInertia()[2] * w_rad_s[2], impulse.angular_N_m_s[2], rtol=1e-5)
