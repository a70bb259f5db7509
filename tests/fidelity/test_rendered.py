"""Rendering with a fidelity gives the same results as the simplified scene."""

import numpy as np
import pytest

import hapscene
from hapscene.errors import HapsceneError
from hapscene.fidelity.apply import apply_level

from .conftest import meshes, scene_of, stroke


@pytest.mark.parametrize("kind", ["sphere", "box", "torus"])
def test_results_are_those_of_the_simplified_scene(kind, fidelity):
    scene, path = scene_of(kind), stroke(kind, 0)
    want = hapscene.Renderer(apply_level(scene, fidelity(kind).level)).run(path)
    got = hapscene.Renderer(scene, fidelity=fidelity(kind)).run(path)
    for name in ("p_WP_m", "f_W_N", "a_m_s2", "face", "flags"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))


def test_tune_and_repaint(fidelity):
    scene = scene_of("box")
    renderer = hapscene.Renderer(scene, fidelity=fidelity("box"))
    p = np.tile([0.0, 0.0, 0.0395], (50, 1))
    renderer.run(np.linspace([0.0, 0.0, 0.041], p[0], 50))
    renderer.tune("wood", stiffness_N_m=300.0)
    assert renderer.run(p).f_W_N[-1, 2] == pytest.approx(300.0 * 0.0005, rel=1e-6)
    other = scene.copy()
    other.paint("body", "paper")
    renderer.repaint(other)
    assert renderer.run(p).swatch[-1] == other.swatches.index(hapscene.load_swatch("paper"))


def test_unsupported_operations(fidelity):
    scene = scene_of("sphere")
    renderer = hapscene.Renderer(scene, fidelity=fidelity("sphere"))
    with pytest.raises(HapsceneError):
        renderer.deform("body", scene.bodies[0].mesh.vertices_m)
    more = scene.copy()
    more.add(meshes("box")[2], name="more")
    with pytest.raises(HapsceneError):
        renderer.repaint(more)
    renderer.remove("body")
    assert not renderer.run(stroke("sphere", 0)).touching.any()
