"""A body moves while it is touched: a lid rises under a finger that stays in place."""

import numpy as np
import trimesh

import hapscene

SPEED_M_S = 0.02

scene = hapscene.Scene()
scene.add(trimesh.creation.box((0.08, 0.08, 0.01)), name="lid", unit="m", swatch="wood")
renderer = hapscene.Renderer(scene, device="omni")

p_WT = np.array([0.0, 0.0, 0.0051])  # 0.1 mm above the lid
X_WB = np.eye(4)
renderer.reset(p_WT)
forces = []
for tick in range(200):
    X_WB[2, 3] = SPEED_M_S * tick * renderer.tick_s
    command = renderer.step(p_WT, {"lid": X_WB})
    forces.append(command.f_W_N[2])

first = int(np.flatnonzero(forces)[0])
print(f"contact after {first} ms, force at the end: {forces[-1]:.2f} N")

# The lid needs 5 ms for 0.1 mm, then it carries the proxy along. The penetration depth grows in each tick, and so does
# the force: depth times stiffness of the wood.
stiffness_N_m = min(hapscene.load_swatch("wood").stiffness_N_m, renderer.limits.stiffness_N_m)
depth_m = X_WB[2, 3] + 0.005 - p_WT[2]
assert abs(first - 5) <= 1
assert forces[-1] >= stiffness_N_m * depth_m > 0.5
