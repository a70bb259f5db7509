"""The tool pushes a PyBullet crate over the floor. Needs `pip install pybullet`."""

import sys
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

import hapscene

try:
    import pybullet
except ImportError:
    print("PyBullet is not installed: pip install pybullet")
    sys.exit()

Array = NDArray[np.float64]


class PyBullet:
    """Bodies of PyBullet as a `hapscene.bridge.Simulation`."""

    def __init__(self, bodies: dict[str, int], step_s: float) -> None:
        self.names, self.step_s = tuple(bodies), step_s
        self._bodies = list(bodies.values())
        pybullet.setTimeStep(step_s)

    def _pose(self, body: int) -> tuple[Array, Array]:
        """Return rotation and position of a body's frame, which is its inertial frame here."""
        p, quaternion = pybullet.getBasePositionAndOrientation(self._bodies[body])
        return np.reshape(pybullet.getMatrixFromQuaternion(quaternion), (3, 3)), np.array(p)

    def read(self, X_WB: Array) -> None:
        for i in range(len(self.names)):
            X_WB[i, :3, :3], X_WB[i, :3, 3] = self._pose(i)

    def mobility(self, body: int) -> Array:
        mass_kg, _, inertia_kg_m2, *_ = pybullet.getDynamicsInfo(self._bodies[body], -1)
        return hapscene.bridge.free_mobility(mass_kg, inertia_kg_m2, self._pose(body)[0])

    def advance(self, wrench_W: Array) -> None:
        for i, wrench in enumerate(wrench_W):
            body = self._bodies[i]
            pybullet.applyExternalForce(body, -1, wrench[:3], self._pose(i)[1], pybullet.WORLD_FRAME)
            pybullet.applyExternalTorque(body, -1, wrench[3:], pybullet.WORLD_FRAME)
        pybullet.stepSimulation()


def solid(kind: int, mass_kg: float, z_m: float, **shape: Any) -> int:
    body: int = pybullet.createMultiBody(
        mass_kg, pybullet.createCollisionShape(kind, **shape), basePosition=(0, 0, z_m)
    )
    pybullet.changeDynamics(body, -1, lateralFriction=1.0)
    return body


pybullet.connect(pybullet.DIRECT)
pybullet.setGravity(0, 0, -9.81)
solid(pybullet.GEOM_PLANE, 0.0, 0.0)
crate = solid(pybullet.GEOM_BOX, 0.2, 0.05, halfExtents=(0.05, 0.05, 0.05))

scene = hapscene.Scene()
scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="crate", unit="m", swatch="wood")
renderer = hapscene.Renderer(scene, device="omni")
bridge = hapscene.bridge.Bridge(PyBullet({"crate": crate}, 1 / 240))

p_WT = np.array([-0.06, 0.0, 0.04])  # 1 cm in front of the crate
for _ in range(480):
    p_WT[0] += 0.03 / 240  # 3 cm/s
    bridge.step(renderer, p_WT)

x_m = pybullet.getBasePositionAndOrientation(crate)[0][0]
push_N = renderer.impulse("crate").linear_N_s[0] / (5 / 3)
print(f"pushed by {1e3 * x_m:.1f} mm, with {push_N:.2f} N on average")

# The tool moved 6 cm, 1 cm of it to reach the crate, and pushed for 5/3 s. Friction equals the weight of the crate.
assert 0.035 < x_m < 0.051
assert 0.9 * 0.2 * 9.81 < push_N < 1.1 * 0.2 * 9.81
