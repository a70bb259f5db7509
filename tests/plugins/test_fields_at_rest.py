"""Scene effects in a closed loop with a simulated device and hand: the tool comes to rest."""

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.device import PointMass
from hapscene.loop import ReferenceTrajectory, Twin
from hapscene_plugins.effects import guide, magnet, puncture, viscosity, weight

HERE = (0.0, 0.0, 0.05)
CASES = {
    "weight": (weight.EFFECT, "mass_kg", {}),
    "viscosity": (viscosity.EFFECT, "damping_Ns_m", {"center_m": HERE}),
    "point": (guide.EFFECT, "stiffness_N_m", {"points_m": HERE}),
    "polyline": (guide.EFFECT, "stiffness_N_m", {"points_m": [[0, 0, 0.05], [0.02, 0, 0.05], [0.02, 0.03, 0.05]]}),
    "plane": (guide.EFFECT, "stiffness_N_m", {"points_m": HERE, "normal": (0, 1, 1)}),
    "away": (guide.EFFECT, "stiffness_N_m", {"points_m": HERE, "repelling": 1.0}),
    "forbidden": (guide.EFFECT, "stiffness_N_m", {"points_m": HERE, "normal": (0, 1, 1), "repelling": 1.0}),
    "magnet": (magnet.EFFECT, "strength_N", {"points_m": [HERE, (0.012, 0.0, 0.05)]}),
}


@pytest.mark.parametrize("device", ["omni", PointMass(0.045, 0.1)], ids=["omni", "point"])
@pytest.mark.parametrize("times", [1.0, 2.0])
@pytest.mark.parametrize("case", CASES)
def test_tool_comes_to_rest(case, times, device):
    """A light grip moves 12 mm through the field in 0.2 s and then holds for 4 s; also at twice the strength."""
    effect, name, setting = CASES[case]
    default = next(param.default for param in effect.params if param.name == name)
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((0.1, 0.1, 0.02)), unit="m")
    settings = {effect.name: {**setting, name: times * default}}
    path = np.tile(HERE, (4000, 1)) + np.outer(np.clip(np.arange(4000) / 200.0, 0.0, 1.0), (0.008, 0.008, -0.004))
    feel = Twin(scene, device, [effect], settings=settings).run(ReferenceTrajectory.along(path, "light"))
    assert np.ptp(feel.p_W_m[-200:], axis=0).max() < 2e-6
    assert np.ptp(feel.recording.f_W_N[-200:], axis=0).max() < 1e-3


@pytest.mark.parametrize("device", ["omni", PointMass(0.045, 0.1)], ids=["omni", "point"])
def test_an_inserted_needle_comes_to_rest(device):
    """After insertion the hand aims 3 mm to the side against drag and lateral stiffness."""
    skin = hapscene.Swatch("skin", stiffness_N_m=200.0, effects={"puncture": {"puncture_force_N": 0.6}})
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), unit="m", swatch=skin)
    way = np.clip(np.arange(5000) / np.array([[500.0], [1000.0]]) - np.array([[0.0], [1.0]]), 0.0, 1.0)
    path = np.array(HERE) + np.outer(way[0], (0.0, 0.0, -0.02)) + np.outer(way[1], (0.003, 0.0, 0.0))
    twin = Twin(scene, device, ["wall", puncture.EFFECT])
    feel = twin.run(ReferenceTrajectory.along(path, "medium"))
    assert twin.renderer.surface.touch[0].inside == 1
    assert np.ptp(feel.p_W_m[-200:], axis=0).max() < 2e-6
    assert 0.0 < feel.recording.f_W_N[-1, 2] <= 0.5 and feel.recording.f_W_N[-1, 0] < -0.05
