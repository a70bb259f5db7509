"""The tool pushes a MuJoCo crate over the floor. Needs `pip install 'hapscene[mujoco]'`."""

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
    <body name="crate" pos="0 0 .05">
      <freejoint/>
      <geom type="box" size=".05 .05 .05" mass=".2"/>
    </body>
  </worldbody>
</mujoco>
"""

model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
bridge = hapscene.bridge.MuJoCo(model, data, swatches={"crate": "wood", "floor": "leather"})
renderer = hapscene.Renderer(bridge.scene, device="omni")

forces: list[np.ndarray] = []
p_WT = np.array([-0.06, 0.0, 0.04])  # 1 cm in front of the crate
while data.time < 2.0 - 1e-9:
    p_WT[0] += 0.03 * model.opt.timestep  # 3 cm/s
    bridge.step(renderer, p_WT, lambda command: forces.append(command.f_W_N))

f_N = np.array(forces)
print(f"pushed by {1e3 * data.qpos[0]:.1f} mm, with {-f_N[-500:, 0].mean():.2f} N at the end")

# The tool moved 6 cm, 1 cm of it to reach the crate. The crate lags by the penetration depth that friction causes.
assert 0.035 < data.qpos[0] < 0.05
assert 0.5 * 0.2 * 9.81 < -f_N[-500:, 0].mean() < 1.05 * 0.2 * 9.81
assert len(forces) == 2000
