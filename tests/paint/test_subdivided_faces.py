"""Display of subdivided faces: position, swatch, number of redrawn patches, and colours of the mesh file."""

import numpy as np
import pytest
from trimesh.creation import box

from hapscene.paint.model.display import COLOURS, SUBFACES_MAX, Display, FileColours
from hapscene.paint.model.session import Session
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

from .conftest import mesh_of

DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture
def session() -> Session:
    scene = Scene()
    scene.add(mesh_of(box((0.04, 0.04, 0.04))), name="cube")
    session = Session(scene)
    session.add_swatch("wood")
    return session


def dab(session: Session, x_m: float, y_m: float, radius_m: float = 0.004) -> None:
    session.begin_stroke("wood", radius_m)
    session.drag_to([x_m, y_m, 0.3], DOWN)
    session.end_stroke()


def area_of(display: Display, swatch: int) -> float:
    corners = [
        layer.vertices_m[layer.faces].astype(float)
        for key in display.chunks()
        for layer in display.layers(key)
        if layer.swatch == swatch
    ]
    a, b, c = np.moveaxis(np.concatenate(corners), 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_dab_on_a_cube_of_twelve_faces_is_a_disc(session: Session) -> None:
    display = Display(session.painting)
    dab(session, 0.006, 0.003)
    display.update(session.painting.changes())
    disc = np.pi * 0.004**2
    assert area_of(display, 1) == pytest.approx(disc, rel=0.05)
    assert area_of(display, 0) == pytest.approx(6 * 0.04**2 - disc, rel=0.01)


def test_no_patch_is_too_large_to_be_sent(session: Session) -> None:
    rng = np.random.default_rng(0)
    display = Display(session.painting)
    for x, y in rng.uniform(-0.018, -0.012, (40, 2)):
        dab(session, x, y, 0.0004)
    display.update(session.painting.changes())
    counts = [sum(len(layer.faces) for layer in display.layers(key)) for key in display.chunks()]
    assert max(counts) <= SUBFACES_MAX < len(session.scene.bodies[0].fine)


def test_colours_of_a_mesh_file_are_reduced_to_few_similar_ones() -> None:
    cube = box((0.04, 0.04, 0.04)).subdivide().subdivide()
    grey = np.linspace(0, 255, len(cube.faces)).astype(np.uint8)
    rgb = np.stack([grey, 255 - grey, np.full_like(grey, 80)], axis=1)
    mesh = Mesh(vertices_m=np.asarray(cube.vertices), faces=np.asarray(cube.faces, np.int32), colour_rgb=rgb)
    look = FileColours.of(mesh)
    assert look is not None and 4 <= len(look.rgb) <= COLOURS
    assert np.abs(255 * look.rgb[look.tint] - rgb).max() < 30
    scene = Scene()
    scene.add(mesh, name="cube")
    display = Display(Session(scene).painting)
    layers = [layer for key in display.chunks() for layer in display.layers(key)]
    assert {layer.tint for layer in layers} == set(look.tint.tolist())
    assert sum(len(layer.faces) for layer in layers) == len(mesh.faces)
    assert FileColours.of(mesh_of(cube)) is None
