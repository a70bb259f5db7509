"""Compiled and interpreted code give the same results."""

import os
import subprocess
import sys

import numpy as np
import pytest

from hapscene.flags import Flag

SCRIPT = """
import sys, numpy as np, trimesh, hapscene
from hapscene.device.model import Limits
scene = hapscene.Scene()
scene.add(trimesh.creation.icosphere(subdivisions=2, radius=0.05), name="ball", unit="m", swatch="wood")
t = np.linspace(0, 1, 150)[:, None]
options = {"seed": 3}
if sys.argv[1] == "stabilised":
    limits = Limits(passivity_Ns_m=5.0, coupling_N_m=900.0, coupling_Ns_m=0.2, delay_ticks=1, force_N=1.5)
    options |= {"limits": limits, "crease_rad": 0.6}
path = (0.0505 - 0.002 * np.sin(60 * t)) * np.c_[np.cos(t), np.sin(t), 0 * t]
r = hapscene.Renderer(scene, **options).run(path)
names = ("p_WP_m", "f_W_N", "a_m_s2", "flags", "face", "nhat_W", "touching")
np.savez(sys.argv[2], **{name: getattr(r, name) for name in names})
"""


@pytest.mark.parametrize("kind", ["plain", "stabilised"])
def test_interpreted_mode_agrees_to_rounding(tmp_path, kind):
    """Compiled code may use fused multiply-add, and other implementations of sine and exponential."""
    results = []
    for name, environment in (("compiled", {}), ("interpreted", {"NUMBA_DISABLE_JIT": "1"})):
        command = [sys.executable, "-c", SCRIPT, kind, tmp_path / f"{name}.npz"]
        subprocess.run(command, check=True, env=os.environ | environment, timeout=120)
        results.append(np.load(tmp_path / f"{name}.npz"))
    compiled, interpreted = results
    assert compiled["touching"].sum() > 30
    assert (compiled["flags"] & Flag.ENERGY_DAMPED).any() == (kind == "stabilised")
    np.testing.assert_array_equal(interpreted["face"], compiled["face"])
    np.testing.assert_array_equal(interpreted["flags"], compiled["flags"])
    for name, tolerance in (("p_WP_m", 1e-9), ("nhat_W", 1e-9), ("f_W_N", 1e-9), ("a_m_s2", 1e-6)):
        np.testing.assert_allclose(interpreted[name], compiled[name], rtol=tolerance, atol=1e-9)
