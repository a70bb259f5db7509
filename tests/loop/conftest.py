"""Fixtures of the loop tests: scenes with a plate whose top is z = 0."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch


def make_plate(stiffness_N_m: float = 500.0, **numbers: Any) -> Scene:
    scene = Scene()
    X_WB = np.eye(4)
    X_WB[2, 3] = -0.01
    swatch = Swatch("stone", stiffness_N_m=stiffness_N_m, **numbers)
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.12, 0.12, 0.02)), "m"), name="plate", pose=X_WB, swatch=swatch)
    return scene


@pytest.fixture(scope="session")
def plate() -> Scene:
    """With a surface that vibrates."""
    return make_plate(texture=hapscene.load_swatch("wood").texture)


@pytest.fixture(scope="session")
def plate_of() -> Callable[..., Scene]:
    """Plates with numbers of your own."""
    return make_plate
