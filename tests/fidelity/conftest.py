"""A scene of three shapes, and a simplified version of each."""

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.fidelity.fidelity import BodyFidelity, Fidelity, Level, SwatchFidelity
from hapscene.scene.mesh import Mesh


def meshes(kind):
    """One shape with decreasing numbers of faces; all boxes have the same shape."""
    creation = trimesh.creation
    if kind == "sphere":
        made = [creation.icosphere(subdivisions=n, radius=0.05) for n in (4, 3, 2)]
    elif kind == "torus":
        made = [creation.torus(0.04, 0.015, major_sections=n, minor_sections=n // 2) for n in (64, 36, 20)]
    else:
        box = creation.box((0.08, 0.08, 0.08))
        made = [box.subdivide().subdivide(), box.subdivide(), box]
    return [Mesh.from_trimesh(one, "m") for one in made]


def scene_of(kind, swatch="wood"):
    scene = hapscene.Scene()
    scene.add(meshes(kind)[0], name="body", swatch=swatch)
    return scene


@pytest.fixture(scope="session")
def fidelity():
    """The fidelity of a kind of scene: a coarser mesh and a lower order."""

    def make(kind):
        return Fidelity(Level({"body": BodyFidelity(meshes(kind)[1])}, {"wood": SwatchFidelity(order=5)}))

    return make


def stroke(kind, seed, count=1500):
    """A random stroke over a shape, from 2 mm above to 2 mm below its surface."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / 1000.0
    turn = rng.uniform(0.5, 2.0, 3) @ np.sin(np.outer(rng.uniform(0.5, 3.0, 3), t) + rng.uniform(0, 6, (3, 1)))
    rise = 0.7 * np.sin(2.0 * t + rng.uniform(0, 6))
    along = np.stack([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)], axis=1)
    height = 0.002 * np.cos(2 * np.pi * rng.uniform(1.0, 3.0) * t)[:, None]  # begins above
    if kind == "sphere":
        return (0.05 + height) * along
    if kind == "torus":
        ring = 0.04 * np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=1)
        out = np.stack([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)], axis=1)
        return ring + (0.015 + height) * out
    return along / np.abs(along).max(axis=1)[:, None] * (0.04 + height)
