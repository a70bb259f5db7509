"""A custom effect: viscous drag on a sliding tool. `third_party_effect` shows an effect as a package."""

from typing import Any

import numpy as np
import trimesh

import hapscene


def render(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Add a force against the direction of sliding, proportional to speed and normal force [N]."""
    if touch.touching:
        for i in range(3):
            out.f_W_N[i] -= p.drag_s_m * touch.normal_force_N * touch.slip_W_m[i] / touch.tick_s


honey = hapscene.Effect(
    "honey",
    "Viscous drag on a sliding tool.",
    render,
    params=(hapscene.Param("drag_s_m", 5.0, "s/m", "drag coefficient over speed", minimum=0.0),),
)

scene = hapscene.Scene()
scene.add(trimesh.creation.box((0.1, 0.1, 0.02)), name="plate", unit="m")
scene.paint("plate", hapscene.Swatch("honey", stiffness_N_m=500.0))
renderer = hapscene.Renderer(scene, effects=["wall", honey])

t_s = np.arange(1000) * renderer.tick_s
p_WT = np.column_stack([-0.04 + 0.08 * t_s, np.zeros(1000), np.full(1000, 0.009)])  # 80 mm/s, 1 mm deep
p_WT[0, 2] = 0.011
recording = renderer.run(p_WT)
drag_N = -recording.f_W_N[500:, 0]
print(recording)
print(f"drag {drag_N.mean():.3f} N")

assert np.allclose(drag_N, 5.0 * 0.08 * 500.0 * 0.001, rtol=1e-3)  # drag · speed · stiffness · depth
renderer.tune("honey", drag_s_m=0.0)
assert np.allclose(renderer.run(p_WT).f_W_N[500:, 0], 0.0, atol=1e-9)
