"""Two hands lift a MuJoCo crate by friction. Needs `pip install 'hapscene[mujoco]'`."""

import sys

import numpy as np

import hapscene

try:
    import mujoco
except ImportError:
    print("MuJoCo is not installed: pip install 'hapscene[mujoco]'")
    sys.exit()

MODEL = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="crate" pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05" mass=".2"/></body>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
grip = hapscene.Swatch("grip", stiffness_N_m=600.0, friction_static=0.9, friction_dynamic=0.9)
bridge = hapscene.bridge.MuJoCo(model, data, swatches=grip)
hands = [hapscene.Renderer(bridge.scene, device="omni") for _ in range(2)]  # a renderer for each tool

lifted_N: list[float] = []  # by both hands
while data.time < 3.0:
    x_m = 0.052 - 0.006 * min(data.time, 1.0)  # squeeze by 4 mm, …
    z_m = 0.05 + 0.03 * min(max(data.time - 1.5, 0.0), 1.0)  # … then lift by 3 cm
    left, right = bridge.step(hands, [(-x_m, 0.0, z_m), (x_m, 0.0, z_m)])
    lifted_N.append(-left.f_W_N[2] - right.f_W_N[2])

print(f"lifted by {1e3 * (data.qpos[2] - 0.05):.1f} mm; the hands carry {np.mean(lifted_N[-250:]):.2f} N")
assert data.qpos[2] > 0.075
assert abs(np.mean(lifted_N[-250:]) - 0.2 * 9.81) < 0.1
