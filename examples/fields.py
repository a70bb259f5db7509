"""Fields, fixtures and puncture: a needle with weight follows a guide, breaks the skin and meets the bone."""

import numpy as np
import trimesh

import hapscene

skin = hapscene.Swatch("skin", stiffness_N_m=300.0, effects={"puncture": {"puncture_force_N": 1.0, "drag_N": 0.4}})
bone = hapscene.Swatch("bone", stiffness_N_m=1000.0)
scene = hapscene.Scene()
scene.add(trimesh.creation.icosphere(subdivisions=4, radius=0.05), name="arm", unit="m", swatch=skin)
scene.add(trimesh.creation.icosphere(subdivisions=4, radius=0.02), name="bone", unit="m", swatch=bone)

renderer = hapscene.Renderer(
    scene,
    effects=["wall", "puncture", "weight", "guide", "viscosity"],
    settings={
        "weight": {"mass_kg": 0.03},
        "guide": {"points_m": [[0.0, 0.0, 0.02], [0.0, 0.0, 0.1]], "bodies": "arm"},  # a line above and inside the arm
        "viscosity": {"center_m": [0.0, 0.0, 0.0], "radius_m": 0.05, "bodies": "arm"},
    },
)

# Start 30 mm above the arm, 2 mm beside the line; move down at 20 mm/s until the tool is 1 mm deep in the bone.
t_s = np.arange(3051) * renderer.tick_s
p_WT = np.column_stack([np.full(len(t_s), 0.002), np.zeros(len(t_s)), 0.08 - 0.02 * t_s])
recording = renderer.run(p_WT)
f_W_N = recording.f_W_N
weight_N = 0.03 * 9.81
in_skin = recording.body_names.index("arm")
broke = int(np.flatnonzero(recording.body == in_skin)[-1])
print(f"in the air: {f_W_N[1000, 2]:.2f} N weight, {f_W_N[1000, 0]:.2f} N towards the line")
print(f"the skin broke at {recording.normal_force_N[broke]:.2f} N, {1e3 * (0.05 - p_WT[broke, 2]):.1f} mm deep")
print(f"inside the arm: {f_W_N[2500, 2]:.2f} N of drag, viscosity and weight; on the bone: {f_W_N[-1, 2]:.1f} N")

assert np.isclose(f_W_N[1000, 2], -weight_N, atol=1e-6)
assert np.isclose(f_W_N[1000, 0], -200.0 * 0.002 * (1.0 - 0.2**2) ** 2, atol=1e-6)
assert 1.0 < recording.normal_force_N[broke] < 1.0 + 300.0 * 2.1e-5
assert np.isclose(f_W_N[2500, 2], 0.4 + 2.0 * 0.02 - weight_N, atol=0.01)
assert recording.body[-1] == recording.body_names.index("bone") and f_W_N[-1, 2] > 1.0

# On the way out, the arm holds the needle as before; at the end only its weight remains.
back = renderer.run(p_WT[::-1])
assert not back.touching[-500:].any() and np.isclose(back.f_W_N[-1, 2], -weight_N, atol=1e-6)
