"""The renderer as programs use it: run and step, reset, poses, limits, what it refuses, and the interpreted mode."""

import os
import subprocess
import sys

import numpy as np
import trimesh

import hapscene

INTERPRETED = """
import sys, numpy as np, trimesh, hapscene
from hapscene.native import INTERPRETED
assert INTERPRETED
mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
scene = hapscene.Scene()
scene.add(mesh, name="ball", unit="m", swatch="wood")
path = np.load(sys.argv[1])
r = hapscene.Renderer(scene, seed=3).run(path)
np.savez(sys.argv[2], p_WP_m=r.p_WP_m, f_W_N=r.f_W_N, a_m_s2=r.a_m_s2, flags=r.flags, face=r.face)
"""


def test_interpreted_mode_agrees_to_rounding(tmp_path):
    """Compiled code may fuse a product and a sum, and has a sine and an exponential of its own."""
    t = np.linspace(0, 1, 150)[:, None]
    path = (0.052 - 0.004 * np.sin(np.pi * t)) * np.c_[np.cos(t), np.sin(t), 0 * t]
    np.save(tmp_path / "path.npy", path)
    arguments = [sys.executable, "-c", INTERPRETED, tmp_path / "path.npy", tmp_path / "out.npz"]
    subprocess.run(arguments, check=True, env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, timeout=120)
    compiled_scene = hapscene.Scene()
    compiled_scene.add(trimesh.creation.icosphere(subdivisions=2, radius=0.05), name="ball", unit="m", swatch="wood")
    compiled = hapscene.Renderer(compiled_scene, seed=3).run(path)
    interpreted = np.load(tmp_path / "out.npz")
    assert compiled.touching.sum() > 50
    np.testing.assert_array_equal(interpreted["face"], compiled.face)
    np.testing.assert_array_equal(interpreted["flags"], compiled.flags)
    np.testing.assert_allclose(interpreted["p_WP_m"], compiled.p_WP_m, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(interpreted["f_W_N"], compiled.f_W_N, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(interpreted["a_m_s2"], compiled.a_m_s2, rtol=1e-6, atol=1e-9)
