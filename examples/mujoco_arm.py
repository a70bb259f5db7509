"""Teleoperation: an arm of MuJoCo follows a leader in a hand, and what its tip touches is felt there.

Needs `pip install 'hapscene[mujoco]'`.
"""

import sys

import numpy as np

import hapscene

try:
    import mujoco
except ImportError:
    print("MuJoCo is not installed: pip install 'hapscene[mujoco]'")
    sys.exit()

ARM = """
<mujoco>
  <compiler autolimits="true"/>
  <option timestep=".0005" integrator="implicitfast"/>
  <default>
    <joint damping=".003" armature=".001"/>
    <geom type="capsule" size=".01" density="600" contype="0" conaffinity="0"/>
  </default>
  <worldbody>
    <geom name="table" type="box" pos=".3 0 -.01" size=".2 .2 .01" friction=".5" contype="1" conaffinity="1"/>
    <body name="shoulder" pos="0 0 .1" gravcomp="1">
      <joint axis="0 0 1"/>
      <joint axis="0 1 0"/>
      <geom fromto="0 0 0  .2 0 0"/>
      <body name="elbow" pos=".2 0 0" gravcomp="1">
        <joint axis="0 1 0"/>
        <geom fromto="0 0 0  .2 0 0"/>
        <body name="tip" pos=".2 0 0" gravcomp="1">
          <geom type="sphere" size=".008" contype="1" conaffinity="1" friction=".3"/>
        </body>
      </body>
    </body>
    <body name="crate" pos=".37 0 .03">
      <freejoint/>
      <geom type="box" size=".03 .03 .03" density="500" friction=".5" contype="1" conaffinity="1"/>
    </body>
  </worldbody>
</mujoco>
"""

STIFFNESS_N_M = 500.0  # of the spring between leader and follower
FRICTION = 0.5  # of the crate on the table, as above
OMNI_N_M = 2310.0  # of the leader's arm, up and down, between the tip and its encoders: by its data sheet

ReferenceTrajectory = hapscene.loop.ReferenceTrajectory
model = mujoco.MjModel.from_xml_string(ARM)
data = mujoco.MjData(model)
data.qpos[:3] = (0.0, -0.6, 1.5)
robot = hapscene.bridge.MuJoCo(model, data)
tip = robot.names.index("tip")
print(f"pushed from below, the arm's tip weighs {1e3 / robot.mobility(tip)[2, 2]:.0f} g")

coupling = hapscene.teleoperation.Coupling("position", stiffness_N_m=STIFFNESS_N_M)
leader_m = (0.0, 0.0, 0.0)  # an Omni on a desk elsewhere: the arm follows from where it is
operation = hapscene.teleoperation.Operation(robot, leader_m, coupling=coupling, body="tip")
offset_m = data.body("tip").xpos - leader_m


def move(*points: tuple[float, float, float]) -> hapscene.teleoperation.OperationResult:
    """The hand means to go through points: x and z from the leader's start [mm], and when [s]."""
    x, z, t_s = np.transpose(points)
    now_s = np.arange(0.0, t_s[-1], 1e-3)
    target_m = 1e-3 * np.column_stack((np.interp(now_s, t_s, x), 0.0 * now_s, np.interp(now_s, t_s, z)))
    return operation.run(ReferenceTrajectory.along(target_m, "medium"))


pressed = move((0, 0, 0.2), (0, -55, 0.7), (0, -55, 1.5))  # the table is 48 mm below the tip's ball
table_N, told_N = robot.contact(tip)[2], pressed.f_leader_W_N[-1, 2]
gap_m = (pressed.follower_W_m[-1] - offset_m - pressed.leader_W_m[-1])[2]
touched = int(np.argmax(pressed.touching))
tap_m_s2 = np.abs(pressed.a_follower_m_s2[touched - 1 : touched + 4]).max()
tapped_m_s2 = np.abs((pressed.a_tip_m_s2 + pressed.a_handle_m_s2)[touched : touched + 20]).max()
print(f"the tap: {tap_m_s2:.1f} m/s² at the tip, {tapped_m_s2:.1f} m/s² in the hand")
print(f"the table gives {table_N:.3f} N, as MuJoCo has it, and the leader {told_N:.3f} N to the hand,")
print(f"from which the tip is {1e3 * gap_m:.2f} mm away")

# What MuJoCo says of the contact is what the hand gets, and the tip is as far behind as two springs in a row give: that
# between leader and follower, and the Omni's own structure. Its encoders have steps of 55 µm.
assert table_N > 0.5 and abs(told_N / table_N - 1.0) < 0.01
assert abs(gap_m - told_N * (1.0 / STIFFNESS_N_M + 1.0 / OMNI_N_M)) < 2 * 55e-6

crate_m = data.body("crate").xpos[0]
pushed = move((0, -55, 0.0), (0, -40, 0.3), (80, -40, 1.9))
crate_m, drag_N = data.body("crate").xpos[0] - crate_m, FRICTION * 9.81 * model.body("crate").mass[0]
in_air_N, sliding_N = (-pushed.f_leader_W_N[part, 0].mean() for part in (slice(600, 900), slice(-300, None)))
print(f"a crate is pushed by {1e3 * crate_m:.1f} mm, with {sliding_N:.2f} N by the hand, {in_air_N:.2f} N in the air")

# It drags at the hand as its friction does at the table.
assert 0.01 < crate_m < 0.04
assert abs(sliding_N - in_air_N - drag_N) < 0.1 * drag_N
