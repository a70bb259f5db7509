"""A painted scene with all properties that a format can lose."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.swatches.library import load_swatch


def rotation(axis: tuple[float, float, float], angle_rad: float) -> np.ndarray:
    """Pose (4, 4) rotated about an axis."""
    from scipy.spatial.transform import Rotation

    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec(np.array(axis) / np.linalg.norm(axis) * angle_rad).as_matrix()
    return X


def ball(subdivisions: int, seed: int) -> Mesh:
    """A ball with a rough surface, in two groups, coloured."""
    import trimesh

    shape = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.03)
    rng = np.random.default_rng(seed)
    vertices = np.asarray(shape.vertices) * rng.uniform(0.9, 1.1, (len(shape.vertices), 1))
    count = len(shape.faces)
    return Mesh(
        vertices,
        np.asarray(shape.faces, np.int32),
        (np.arange(count) % 2).astype(np.int16),
        ("lid", "base"),
        rng.integers(0, 256, (count, 3)).astype(np.uint8),
    )


@pytest.fixture(scope="session")
def make_scene() -> Callable[[int], Scene]:
    def make(subdivisions: int = 2) -> Scene:
        scene = Scene()
        rng = np.random.default_rng(0)
        stone, nut = ball(subdivisions, 1), ball(subdivisions, 2)
        mine = replace(load_swatch("paper"), name='mine <&> "ü"\\', stiffness_N_m=1234.5, damping_Ns_m=0.75)
        first, second = rotation((1, 2, 3), 1.1), rotation((-1, 0.2, 0), np.pi)
        first[:3, 3], second[:3, 3] = (0.1, -0.02, 0.05), (-0.1, 0.3, 0.01)
        scene.add(stone, name='Stein "1" <&>', pose=first)
        scene.add(nut, name="nut", two_sided=True)
        scene.add(stone, name="twin  of stone", pose=second)
        for swatch in ("wood", mine):
            scene.swatch_index(swatch)
        for body in scene.bodies[:2]:
            body.face_swatch[:] = rng.integers(0, 3, len(body.face_swatch))
        scene.bodies[2].face_swatch[:] = scene.bodies[0].face_swatch
        return scene

    return make


@pytest.fixture
def scene(make_scene: Callable[[int], Scene]) -> Scene:
    return make_scene(2)


@pytest.fixture(autouse=True)
def own_library(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty library, so that the user's library has no influence."""
    folder = tmp_path_factory.mktemp("library")
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(folder))
    return folder
