"""Triangles for rendering."""

from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene
from hapscene.view.feel_layer import OPACITY, scene_solids
from hapscene.view.offscreen import _has_gpu
from hapscene.view.triangles import Triangles, joined, lathe, moved, same, tube


def _solid(scene: Scene) -> Triangles:
    """All triangles of a scene, without their pictures."""
    return joined(scene_solids(scene))


def test_tube() -> None:
    t = np.linspace(0, 1, 400)
    line_m = np.column_stack((np.cos(6 * t), np.sin(6 * t), t))
    solid = tube(line_m, 0.01, "#0072B2")
    from scipy.spatial import cKDTree

    distance_m, _ = cKDTree(line_m).query(solid.corner_m)
    assert distance_m.min() > 0.0095 and distance_m.max() < 0.0135
    np.testing.assert_allclose(np.linalg.norm(solid.normal, axis=1), 1.0, atol=1e-9)
    assert np.linalg.norm(solid.corner_m - line_m[-1], axis=1).min() < 0.0101


def test_tube_of_degenerate_lines() -> None:
    assert len(tube(np.zeros((5, 3)), 0.01, "#000000").corner_m) == 0
    there_and_back = np.array([[0.0, 0, 0], [0, 0, 1], [0, 0, 0]])
    assert np.isfinite(tube(there_and_back, 0.01, "#000000").corner_m).all()


def test_normals_at_creases() -> None:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((1, 1, 1)), "m"), name="box")
    normal = _solid(scene).normal
    np.testing.assert_allclose(np.abs(normal).max(axis=1), 1.0, atol=1e-12)
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.icosphere(3, 0.5), "m"), name="ball")
    solid = _solid(scene)
    np.testing.assert_allclose(solid.normal, solid.corner_m / 0.5, atol=0.02)


def volume_and_flux(solid: Triangles) -> tuple[float, np.ndarray]:
    """Enclosed volume, and cosine between shading normals and face normals (k,)."""
    a, b, c = (solid.corner_m[k::3] for k in range(3))
    across = np.cross(b - a, c - a)
    size = np.linalg.norm(across, axis=1)
    there = size > 1e-12
    away = np.einsum("kx,kx->k", across[there] / size[there, None], solid.normal.reshape(-1, 3, 3).mean(axis=1)[there])
    return float(np.einsum("kx,kx->", a, across) / 6.0), away


def test_moved_and_scaled() -> None:
    ball = lathe([(0.01 * np.sin(a), -0.01 * np.cos(a)) for a in np.linspace(0.0, np.pi, 13)], "#00FF00")
    X = np.diag([1.0, 1.0, 5.0, 1.0])
    X[:3, 3] = 1.0, 2.0, 3.0
    long = moved(ball, X)
    volume, outwards = volume_and_flux(long._replace(corner_m=long.corner_m - X[:3, 3]))
    assert volume == pytest.approx(5.0 * volume_and_flux(ball)[0]) and outwards.min() > 0.95
    np.testing.assert_allclose(np.linalg.norm(long.normal, axis=1), 1.0, rtol=1e-9)
    assert moved(ball, np.eye(4)) is ball


def test_subdivided_faces() -> None:
    """A disc with falloff on a cube with twelve faces has its area and intermediate colours."""
    scene = Scene()
    scene.add(trimesh.creation.box((0.04, 0.04, 0.04)), name="cube", unit="m", swatch="wood")
    whole = _solid(scene)
    scene.paint("cube", "leather", Sphere((0.0, 0.0, 0.02), 0.01), falloff_m=0.002)
    solid = _solid(scene)
    assert surface_of(solid) == pytest.approx(surface_of(whole), rel=1e-12)
    colours = np.unique(solid.colour.round(9), axis=0)
    assert len(colours) > 10
    leather = np.abs(solid.colour - colours[0]).max(axis=1) < np.abs(solid.colour - colours[-1]).max(axis=1)
    chosen = Triangles(*(values[leather] for values in solid[:3]))
    assert surface_of(chosen) == pytest.approx(np.pi * 0.01**2, rel=0.05)


def test_layers_of_a_textured_body() -> None:
    """The look has the texture at its coordinates; the feel is a translucent disc with a grain over it."""
    cube = trimesh.creation.box((0.04, 0.04, 0.04))
    pixels = np.random.default_rng(0).integers(0, 256, (8, 8, 3)).astype(np.uint8)
    corners = cube.triangles.reshape(-1, 3)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(pixels))
    cube = trimesh.Trimesh(corners, np.arange(36).reshape(-1, 3), process=False)
    cube.visual = trimesh.visual.TextureVisuals(uv=corners[:, :2], material=material)
    scene = Scene()
    scene.add(cube, name="cube", unit="m")
    scene.paint("cube", "leather", Sphere((0.0, 0.0, 0.02), 0.01), falloff_m=0.002)
    plain, look, feel = scene_solids(scene)
    assert len(plain.corner_m) == 0
    assert look.picture is not None and np.array_equal(look.picture, pixels)
    assert look.uv is not None and np.allclose(look.uv, corners[:, :2])
    assert feel.picture is not None and feel.picture.std() > 5 and feel.uv is not None
    opacity = feel.colour[:, 3]
    assert opacity.max() == OPACITY and 0 < opacity.min() < 0.2  # it fades
    assert surface_of(feel) == pytest.approx(np.pi * 0.011**2, rel=0.05)  # with half of the falloff
    assert np.allclose(feel.corner_m[:, 2], 0.02, atol=1e-4)
    assert len(scene_solids(scene, "look")) == 2
    assert all(solid.simple or solid.colour.shape[1] == 3 for solid in scene_solids(scene, "feel"))


def surface_of(solid: Triangles) -> float:
    a, b, c = np.moveaxis(solid.corner_m.reshape(-1, 3, 3), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_frames_are_the_same_with_the_same_parts_at_the_same_poses() -> None:
    X, other = np.eye(4), np.diag([1.0, 1.0, 1.0, 2.0])
    assert same([(0, X), (1, other)], [(0, X.copy()), (1, other)])
    for shown in ([(0, X)], [(0, X), (2, other)], [(0, X), (1, X)]):
        assert not same([(0, X), (1, other)], shown)


def test_a_device_file_shows_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    for found in ("nvidia0", "renderD128", "null"):
        monkeypatch.setattr(Path, "glob", lambda folder, kind, found=found: [found] if fnmatch(found, kind) else [])
        assert _has_gpu() == (found != "null")
