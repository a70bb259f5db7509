"""Teleoperation: a MuJoCo arm follows a leader that a hand holds; the hand feels what the tip of the arm touches.

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

STIFFNESS_N_M = 500.0  # coupling of leader and follower
FRICTION = 0.5  # between crate and table, as in the model
OMNI_N_M = 2310.0  # vertical stiffness of the leader's arm, from its data sheet

ReferenceTrajectory = hapscene.loop.ReferenceTrajectory
model = mujoco.MjModel.from_xml_string(ARM)
data = mujoco.MjData(model)
data.qpos[:3] = (0.0, -0.6, 1.5)
robot = hapscene.bridge.MuJoCo(model, data)
tip = robot.names.index("tip")
print(f"effective mass of the tip along z: {1e3 / robot.mobility(tip)[2, 2]:.0f} g")

coupling = hapscene.teleoperation.Coupling("position", stiffness_N_m=STIFFNESS_N_M)
leader_m = (0.0, 0.0, 0.0)  # start of the leader, an Omni; the arm follows relative to its own start
operation = hapscene.teleoperation.Operation(robot, leader_m, coupling=coupling, body="tip")
offset_m = data.body("tip").xpos - leader_m


def move(*points: tuple[float, float, float]) -> hapscene.teleoperation.OperationResult:
    """Move the hand along points (x, z, t): displacement from the leader's start [mm], time [s]."""
    x, z, t_s = np.transpose(points)
    now_s = np.arange(0.0, t_s[-1], 1e-3)
    target_m = 1e-3 * np.column_stack((np.interp(now_s, t_s, x), 0.0 * now_s, np.interp(now_s, t_s, z)))
    return operation.run(ReferenceTrajectory.along(target_m, "medium"))


pressed = move((0, 0, 0.2), (0, -55, 0.7), (0, -55, 1.5))  # the table is 48 mm below the tip's ball
table_N, hand_N = robot.contact(tip)[2], pressed.f_leader_W_N[-1, 2]
gap_m = (pressed.follower_W_m[-1] - offset_m - pressed.leader_W_m[-1])[2]
touched = int(np.argmax(pressed.touching))
tap_m_s2 = np.abs(pressed.a_follower_m_s2[touched - 1 : touched + 4]).max()
tapped_m_s2 = np.abs((pressed.a_tip_m_s2 + pressed.a_handle_m_s2)[touched : touched + 20]).max()
print(f"tap: {tap_m_s2:.1f} m/s² at the tip, {tapped_m_s2:.1f} m/s² in the hand")
print(f"force of the table in MuJoCo: {table_N:.3f} N; force of the leader on the hand: {hand_N:.3f} N")
print(f"distance between the tip and its target: {1e3 * gap_m:.2f} mm")

# The hand receives the contact force of MuJoCo. The distance is that of two springs in series: the coupling and the
# structure of the Omni, whose encoders have steps of 55 µm.
assert table_N > 0.5 and abs(hand_N / table_N - 1.0) < 0.01
assert abs(gap_m - hand_N * (1.0 / STIFFNESS_N_M + 1.0 / OMNI_N_M)) < 2 * 55e-6

crate_m = data.body("crate").xpos[0]
pushed = move((0, -55, 0.0), (0, -40, 0.3), (80, -40, 1.9))
crate_m, drag_N = data.body("crate").xpos[0] - crate_m, FRICTION * 9.81 * model.body("crate").mass[0]
in_air_N, sliding_N = (-pushed.f_leader_W_N[part, 0].mean() for part in (slice(600, 900), slice(-300, None)))
print(f"the crate moved by {1e3 * crate_m:.1f} mm; force of the hand: {sliding_N:.2f} N, in the air {in_air_N:.2f} N")

# The hand feels the friction between crate and table.
assert 0.01 < crate_m < 0.04
assert abs(sliding_N - in_air_N - drag_N) < 0.1 * drag_N
