"""Fixtures of the contact tests: a world of meshes, and a face with known corners."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import trimesh

from hapscene.contact.proxy import place_proxy
from hapscene.contact.world import World, build_world
from hapscene.scene.scene import Scene


@pytest.fixture
def world() -> "Callable[..., World]":
    """`world(mesh, …, two_sided=False)`: the meshes as bodies, with the proxy placed at `at`."""

    def build(*meshes: trimesh.Trimesh, two_sided: bool = False, at: Sequence[float] = (0.0, 0.0, 1.0)) -> World:
        scene = Scene()
        for mesh in meshes:
            scene.add(mesh, unit="m", two_sided=two_sided)
        built = build_world(scene.bodies)
        place_proxy(built, tuple(map(float, at)))
        built.near[: len(meshes)] = np.arange(len(meshes))  # casts test all bodies
        built.proxy[0].near_count = len(meshes)
        return built

    return build


@pytest.fixture
def triangle() -> trimesh.Trimesh:
    """One face in the plane z = 0, facing up: (0, 0), (0.1, 0), (0, 0.1) [m]."""
    return trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]], process=False)


@pytest.fixture
def turned() -> np.ndarray[Any, Any]:
    """A rotation that maps no axis to an axis of the world."""
    return trimesh.transformations.euler_matrix(0.3, -0.7, 1.1)[:3, :3]
