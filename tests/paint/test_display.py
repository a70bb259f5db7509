"""The displayed mesh: complete for small scenes, reduced for large ones, always with the current painting."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from trimesh.creation import icosphere
from trimesh.triangles import closest_point

import hapscene
from hapscene.contact.embree import Search, first_face, new_ray
from hapscene.errors import ViewError
from hapscene.paint.model.display import CHUNK, ChunkKey, Display, reduce_mesh, subface_triangles, triangle_shares
from hapscene.paint.model.mesh import PaintableMesh
from hapscene.paint.model.session import Hit, Session
from hapscene.scene.scene import Scene

from .conftest import mesh_of, plate_mesh

BALL = mesh_of(icosphere(subdivisions=4, radius=0.02))  # 5,120 faces


@pytest.fixture
def session() -> Session:
    scene = Scene()
    scene.add(BALL, name="ball")
    scene.add(BALL, name="twin")
    scene.add(plate_mesh(cells=2), name="plate")
    return Session(scene)


def test_subfaces_overlap_by_moving_their_corners_away_from_their_middle() -> None:
    halves: Any = SimpleNamespace(corners=lambda: np.array([np.eye(3), [[1, 0, 0], [0.5, 0.5, 0], [0, 0, 1]]]))
    face_m = np.array([[0.0, 0, 1], [0.4, 0, 1], [0, 0.6, 1]])
    whole_m = subface_triangles(halves, np.array([face_m, face_m]), 0.0)
    np.testing.assert_allclose(whole_m, [face_m, [[0, 0, 1], [0.2, 0, 1], [0, 0.6, 1]]], atol=1e-7)
    middle_m = whole_m.mean(axis=1, keepdims=True)
    before, after = (x - middle_m for x in (whole_m, subface_triangles(halves, np.array([face_m, face_m]), 0.05)))
    length_m = np.linalg.norm(before, axis=2, keepdims=True)
    np.testing.assert_allclose(after, before * (1 + 0.05 / length_m), atol=1e-6)


def test_chunks_hold_each_face_once_and_are_small(session) -> None:
    display = Display(session.painting)
    wood = session.add_swatch("wood")
    session.fill_sphere([0.0, 0.0, 0.01], 0.0125, wood)
    assert {key.body for key in display.update(session.painting.changes())} == {0, 1, 2}
    for b, shown in enumerate(display.bodies):
        seen = np.zeros(len(shown.mesh.faces), int)
        for c in range(shown.chunk_count):
            layers = display.layers(ChunkKey(b, c))
            assert len({layer.swatch for layer in layers}) == len(layers)
            assert 0 < sum(len(layer.faces) for layer in layers) <= CHUNK
            for layer in layers:
                seen[layer.shown] += 1
                assert layer.vertices_m.dtype == np.float32 and layer.faces.dtype == np.uint32
                assert len(np.unique(layer.faces)) == len(layer.vertices_m)  # nothing that is not used
                corners = shown.mesh.vertices_m[shown.mesh.faces[layer.shown]]
                np.testing.assert_array_equal(layer.vertices_m[layer.faces], corners)
                assert (shown.swatch[layer.shown] == layer.swatch).all()
        fine = session.scene.bodies[b].fine
        assert (seen == np.isin(np.arange(len(seen)), fine.faces, invert=True)).all()  # these are drawn as their leaves
        leaves = [layer for c in shown.chunks() if not 0 <= c < shown.chunk_count for layer in shown.layers(c)]
        assert sum(len(layer.faces) for layer in leaves) == len(fine) > 0


def test_painted_body_is_redrawn_while_another_is_deleted(session) -> None:
    session.fill_body("ball", session.add_swatch("wood"))
    session.composing.copy("plate")
    display = Display(session.painting)
    session.painting.changes()
    session.undo()
    session.undo()  # both before anybody looks, as a click in the history has it
    assert session.painting.changes().bodies
    anew = display.compose()
    assert {key.body for key in anew} == {0}
    assert {layer.swatch for key in anew for layer in display.layers(key)} == {0}


def drawn(display: Display, key: ChunkKey) -> list[tuple[int, bytes]]:
    """What a chunk looks like, to be compared."""
    return [(layer.swatch, layer.vertices_m[layer.faces].tobytes()) for layer in display.layers(key)]


def stroke(session: Session, rng: np.random.Generator, swatch: int) -> None:
    session.begin_stroke(swatch, 0.003)
    for x, y in rng.uniform(-0.015, 0.015, (3, 2)):
        session.drag_to([0.0, 0.0, 1.0], [x, y, -1.0])
    session.end_stroke()


def test_reduced_only_changed_chunks_are_drawn_again_through_strokes_and_undo(session) -> None:
    display = Display(session.painting, shown_max=2500)
    assert [len(shown.mesh.faces) for shown in display.bodies] == pytest.approx([1154, 1154, 192], abs=40)
    fresh = {key: drawn(display, key) for key in display.chunks()}
    wood, paper = session.add_swatch("wood"), session.add_swatch("paper")
    rng = np.random.default_rng(0)
    now = fresh
    for step in range(8):
        before = now
        stroke(session, rng, (wood, paper)[step % 2])
        updated = set(display.update(session.painting.changes()))
        now = {key: drawn(display, key) for key in display.chunks()}
        both = now.keys() | before.keys()
        assert {key for key in both if now.get(key, []) != before.get(key, [])} == updated
    while session.undo() is not None:
        pass
    display.update(session.painting.changes())
    assert {key: drawn(display, key) for key in display.chunks()} == fresh


def test_reduced_every_face_is_seen_in_its_own_swatch(session) -> None:
    display = Display(session.painting, shown_max=2500)
    wood, paper = session.add_swatch("wood"), session.add_swatch("paper")
    rng = np.random.default_rng(1)
    for step in range(12):
        stroke(session, rng, (wood, paper)[step % 2])
    display.update(session.painting.changes())
    layers = [layer for key in display.chunks() if key.body == 0 for layer in display.layers(key)]
    corners = np.concatenate([layer.vertices_m[layer.faces] for layer in layers]).astype(float)
    wears = np.repeat([layer.swatch for layer in layers], [len(layer.faces) for layer in layers])
    assert 0 < sum(len(np.setdiff1d(layer.over, session.scene.bodies[0].fine.faces)) for layer in layers) < 1280
    look = Search(corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3), 0.0)
    ray, seen = new_ray(), []
    middle = np.average(BALL.triangles_m, axis=1, weights=(0.34, 0.335, 0.325))  # a ray on an edge may slip through
    for face, normal in zip(middle, BALL.normals, strict=True):  # from 10 mm outside
        start, down = tuple(face + 0.01 * normal - look.center_m), tuple(-normal)
        hit = first_face(look.handle, ray, start, down, 0.02, 0)
        assert hit >= 0
        seen.append(wears[hit])
    hits = [Hit(0, face, p, p, np.zeros(3), 0.0) for face, p in enumerate(middle)]
    wrong = np.array(seen) != [session.swatch_at(hit) for hit in hits]
    assert wrong.mean() < 0.005  # leaves reach over each other by a hair


@pytest.mark.parametrize("thickness_m", [0.004, 0.0004])  # of the thin one the rim is slivers: see SLIVER_SINE
def test_reduced_mesh_is_close_to_the_original_with_equal_sides(thickness_m: float) -> None:
    shape = PaintableMesh(plate_mesh(thickness_m, cells=5))  # 12,288 faces, 1.25 mm on top
    made = reduce_mesh(shape, 1000)
    assert 300 < len(made.faces) <= 1000
    low, high = made.vertices_m.min(axis=0), made.vertices_m.max(axis=0)
    np.testing.assert_allclose(high, [0.02, 0.02, thickness_m / 2], rtol=0.1)
    np.testing.assert_allclose(low, -high, rtol=0.2)
    corners = made.vertices_m[made.faces].astype(float)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    flat = np.abs(shape.normal[:, 2]) > 0.9
    cosine = np.einsum("ij,ij->i", normal[made.overlay.shown_of], shape.normal)
    assert (cosine[flat] > -0.1).all()  # no front face is represented by a back face
    ball = reduce_mesh(PaintableMesh(BALL), 1000)
    assert np.linalg.norm(ball.vertices_m, axis=1) == pytest.approx(0.02, rel=0.02)
    middle = PaintableMesh(BALL).centroid_m
    nearest = closest_point(ball.vertices_m[ball.faces][ball.overlay.shown_of].astype(float), middle)
    gap = np.linalg.norm(nearest - middle, axis=1)
    assert gap.max() < 0.0005  # what stands for a face is over or under it
    height = np.linalg.norm(ball.overlay.raised_m, axis=1) - 0.02
    assert (height > 0).all() and height.max() < 0.0005  # above the facets, which lie inside the ball


def test_without_the_package_a_large_mesh_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "fast_simplification", None)
    with pytest.raises(ViewError):
        reduce_mesh(PaintableMesh(BALL), 1000)


def test_shares() -> None:
    assert triangle_shares([10, 20], 60_000) == [10, 20]
    assert triangle_shares([90_000, 90_000], 60_000) == [30_000, 30_000]
    assert triangle_shares([1_000_000, 300, 50], 60_000) == [59_650, 300, 50]


@pytest.mark.parametrize("counts", [[10**7] + [1000] * 999, [3] * 9999 + [10**6]])
def test_many_bodies_are_no_more_than_one(counts: list[int]) -> None:
    shown = triangle_shares(counts, 60_000)
    assert 59_000 - len(counts) < sum(shown) <= 60_000
    assert all(1 <= n <= count for n, count in zip(shown, counts, strict=True))


def test_painter_model_does_not_import_the_page() -> None:
    files = sorted((Path(hapscene.__file__).parent / "paint" / "model").glob("*.py"))
    assert len(files) > 5
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert not re.search(r"^\s*(import|from) (viser|hapscene\.paint\.web)", text, re.MULTILINE), file


def test_prepared_strokes_are_drawn_like_those_that_prepare_themselves() -> None:
    drawn = []
    for prepared in (False, True):
        scene = Scene()
        scene.add(BALL, name="ball")
        session = Session(scene)
        painting, wood = session.painting, session.add_swatch("wood")
        display = Display(painting, shown_max=1000)
        if prepared:
            display.prepare_strokes()
        painting.paint("fill", {0: BALL.triangles_m[:, :, 2].mean(axis=1) > 0.0}, wood)
        keys = display.update(painting.changes())
        drawn.append([(key, layer.paint, layer.vertices_m.tolist()) for key in keys for layer in display.layers(key)])
    assert drawn[0] and drawn[0] == drawn[1]
