"""Editing the bodies of a scene: each edit is one undo step and is saved."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from trimesh.creation import box, icosphere

import hapscene
from hapscene.errors import SceneError
from hapscene.paint.model.composing import FAR, GAP_SHARE, _box, _room_beside, numbered
from hapscene.paint.model.painting import UNUSED_MESHES_MAX
from hapscene.paint.model.session import Session
from hapscene.scene.body import Body
from hapscene.scene.scene import load_scene

from .conftest import mesh_of, turned


@pytest.fixture
def session(scene, tmp_path: Path) -> Session:
    made = Session(scene, tmp_path / "made.scene.json")
    ticks = iter(range(0, 10_000, 10))
    made.painting.clock = lambda: float(next(ticks))  # edits 10 s apart are separate undo steps
    return made


def body_rows(session: Session) -> list[tuple[object, ...]]:
    """Return the stored properties of all bodies."""
    return [
        (b.name, b.mesh.digest, b.X_WB.tobytes(), b.parent, b.made_of, b.face_swatch.tobytes())
        for b in session.scene.bodies
    ]


def ball(name: str = "ball") -> hapscene.Scene:
    scene = hapscene.Scene()
    scene.add(mesh_of(icosphere(subdivisions=1, radius=0.01)), name=name, swatch="wood")
    return scene


@pytest.mark.parametrize(
    ("name", "taken", "free"),
    [
        ("plate", [], "plate"),
        ("plate", ["plate"], "plate 2"),
        ("plate 2", ["plate 2"], "plate 3"),
        ("plate", ["plate", "plate 7", "plates 9"], "plate 8"),
        ("(*+", ["(*+"], "(*+ 2"),
    ],
)
def test_new_name_has_the_next_number(name: str, taken: list[str], free: str) -> None:
    assert numbered(name, taken) == free


def test_each_edit_can_be_undone_and_redone(session: Session) -> None:
    composing = session.composing
    states = [body_rows(session)]

    def did() -> None:
        states.append(body_rows(session))
        assert states[-1] != states[-2]

    (added,) = composing.add(ball("plate"))
    assert added == "plate 2" and session.scene.swatches[-1].name == "wood"
    did()
    session.fill_body(added, 0)
    did()
    composing.move("ball", turned(0.2, (0.0, 0.0, 0.1)))
    did()
    assert composing.copy(added) == "plate 3"
    did()
    composing.attach("plate 3", "ball")
    did()
    composing.rename("ball", "globe")
    did()
    assert session.scene.body("plate 3").parent == "globe"
    composing.move("globe", turned(0.3, (0.0, 0.1, 0.1)))
    did()
    composing.scale("plate 3", 2.5)
    did()
    session.fill_body("plate 3", 1)
    did()
    composing.delete("globe")
    did()
    assert session.scene.body("plate 3").parent is None
    for state in reversed(states[:-1]):
        assert session.undo()
        assert body_rows(session) == state
    assert len(session.scene.swatches) == 2 and session.undo() is None
    for state in states[1:]:
        assert session.redo()
        assert body_rows(session) == state
    shapes = session.painting.shapes
    assert [shape.mesh for shape in shapes] == [body.mesh for body in session.scene.bodies]
    assert len(session.defaults) == len(shapes)


def test_copies_share_a_mesh_and_not_their_painting(session: Session) -> None:
    copy = session.composing.copy("ball")
    one, other = session.scene.body("ball"), session.scene.body(copy)
    assert one.mesh is other.mesh
    session.fill_body(copy, 1)
    assert (other.face_swatch == 1).all() and (one.face_swatch == 0).all()


def test_added_body_is_moved_beside_an_overlapping_body(session: Session) -> None:
    composing = session.composing
    inside, outside, far = ball("inside"), ball("outside"), ball("far")
    inside.bodies[0].X_WB[:3, 3] = session.scene.body("ball").X_WB[:3, 3]
    outside.bodies[0].X_WB[:3, 3] = place = (0.0, 0.0, 0.5)
    far.bodies[0].X_WB[:3, 3] = (5e5, 5e6, 0.0)
    composing.add(far)
    assert session.scene.body("far").X_WB[:3, 3].max() < 0.2
    session.undo()
    composing.add(inside)
    composing.add(outside)
    np.testing.assert_array_equal(session.scene.body("outside").X_WB[:3, 3], place)
    inner = session.scene.body("inside")
    low = (inner.mesh.vertices_m + inner.X_WB[:3, 3]).min(axis=0)
    first = session.scene.bodies[:2]
    corners = [b.mesh.vertices_m @ b.X_WB[:3, :3].T + b.X_WB[:3, 3] for b in first]
    assert low[0] > max(c[:, 0].max() for c in corners)
    assert low[2] == pytest.approx(min(c[:, 2].min() for c in corners), abs=1e-12)


def bodies_of(*boxes: tuple[tuple[float, ...], tuple[float, ...]]) -> list[Body]:
    """Boxes, each given by its centre and size."""
    scene = hapscene.Scene()
    return [scene.add(mesh_of(box(size)), pose=turned(0.0, centre)) for centre, size in boxes]


def test_room_is_made_for_bodies_that_overlap_others_or_lie_far_away() -> None:
    """Bodies that fill (−0.1 … 1.1, −0.2 … 2.1, −0.3 … 3.1), and new ones of 0.5 by 0.25 by 0.1 whose centre moves."""
    there = bodies_of(((0, 0, 0), (0.2, 0.4, 0.6)), ((1, 2, 3), (0.2, 0.2, 0.2)))

    def moved(*to: float, of: float = 1.0) -> list[float]:
        low, high = (np.add(to, of * np.array(part)) for part in ((-0.2, -0.075, 0), (0.2, 0.075, 0)))
        sizes = (of * np.array(size) for size in ((0.1, 0.1, 0.1), (0.1, 0.1, 0.02)))
        step = _room_beside(bodies_of(*zip((low, high), sizes, strict=True)), there)
        return (step + to).tolist()

    beside = pytest.approx([1.1 + 0.25 + GAP_SHARE * 0.5, 0.95, -0.3 + 0.05])
    for centre in ((0, 0, 0), (0.9, 1.9, 3), (0.3, 0.3, 0.3)):
        assert moved(*centre) == beside
    for centre in ((0.5, 1.0, 1.5), (1.36, 2, 3), (0.5, -0.4, 0), (1, 2, 2.84)):  # in the gap between, or beside
        assert moved(*centre) == list(centre)
    for axis, (low, high) in enumerate(((-0.1 - 0.25, 1.1 + 0.25), (-0.2 - 0.125, 2.1 + 0.125), (-0.35, 3.15))):
        for sign, edge in ((-1.0, low), (1.0, high)):
            for share in (0.99, 1.01):
                centre = np.array([0.5, 1.0, 1.5])
                centre[axis] = edge + sign * share * FAR * 3.4
                assert moved(*centre) == (beside if share > 1.0 else centre.tolist())
    for share in (0.99, 1.01):  # the larger of the two counts
        centre = (0.0, 2.1 + 1.25 + share * FAR * 5.0, 0.0)
        assert (moved(*centre, of=10.0) == list(centre)) == (share < 1.0)


def test_children_go_along_and_cycles_are_refused(session: Session) -> None:
    composing, scene = session.composing, session.scene
    composing.attach("plate", "ball")
    (third,) = composing.add(ball("third"))
    composing.attach(third, "plate")
    with pytest.raises(SceneError, match="'ball'"):
        composing.attach("ball", third)
    with pytest.raises(SceneError, match="'ball'"):
        composing.attach("ball", "ball")
    before = {b.name: np.linalg.inv(scene.body("ball").X_WB) @ b.X_WB for b in scene.bodies}
    composing.move("ball", turned(1.0, (0.2, 0.0, -0.1)))
    for body in scene.bodies:
        np.testing.assert_allclose(np.linalg.inv(scene.body("ball").X_WB) @ body.X_WB, before[body.name], atol=1e-12)
    assert [(b.name, depth) for b, depth in composing.tree()] == [("ball", 0), ("plate", 1), ("third", 2)]
    assert composing.copy("plate") == "plate 2"
    assert [(b.name, depth) for b, depth in composing.tree()][3:] == [("plate 2", 1), ("third 2", 2)]


def test_moves_within_a_second_are_one_step_and_a_drag_is_however_long_it_takes(session: Session) -> None:
    composing, scene = session.composing, session.scene
    now = [0.0]
    session.painting.clock = lambda: now[0]
    was = scene.body("ball").X_WB

    def go(x_m: float, after_s: float, **more: bool) -> None:
        now[0] += after_s
        composing.move("ball", turned(0.0, (x_m, 0.0, 0.0)), **more)

    go(0.1, 0.0)
    go(0.2, 0.5)
    assert len(session.history.done) == 1
    go(0.3, 2.0)
    assert len(session.history.done) == 2
    composing.begin_move()
    go(0.4, 0.1, goes_on=True)
    go(0.5, 9.0, goes_on=True)
    assert len(session.history.done) == 3
    for x_m in (0.3, 0.2):
        session.undo()
        assert scene.body("ball").X_WB[0, 3] == x_m
    session.undo()
    np.testing.assert_array_equal(scene.body("ball").X_WB, was)


def test_hidden_bodies_are_not_painted(session: Session) -> None:
    composing, painting = session.composing, session.painting
    eye = session.scene.body("ball").X_WB[:3, 3] + (0.0, 0.0, 1.0)
    hit = session.pick(eye, (0.0, 0.0, -1.0))
    assert hit is not None and hit.body == 0
    composing.hide("ball")
    assert painting.hidden == {"ball"} and session.pick(eye, (0.0, 0.0, -1.0)) is None
    assert session.fill_body("ball", 1) == 0 < session.fill_body("plate", 0)
    middle, wood = session.scene.body("ball").X_WB[:3, 3], session.add_swatch("wood")
    assert session.fill_sphere(middle, 0.03, wood) == 0
    composing.hide("ball", False)
    assert not painting.hidden and session.pick(eye, (0.0, 0.0, -1.0)) is not None
    assert session.fill_sphere(middle, 0.03, wood) > 0


def test_scaling_keeps_the_centre_and_scaling_back_restores_the_mesh(session: Session) -> None:
    composing, scene = session.composing, session.scene
    far, way = ball("far"), (0.1, -0.2, 0.3)
    far.bodies[0].mesh = replace(far.bodies[0].mesh, vertices_m=far.bodies[0].mesh.vertices_m + way)
    far.bodies[0].X_WB = turned(0.7, (0.0, 0.0, 0.0))
    (name,) = composing.add(far)
    one = scene.body(name)
    mesh = one.mesh
    middle = one.X_WB[:3, :3] @ one.mesh.bounds_m.mean(axis=0) + one.X_WB[:3, 3]
    composing.scale(name, 3.0)
    other = scene.body(name)
    assert other.mesh.diagonal_m == pytest.approx(3 * mesh.diagonal_m) and composing.scale_of(name) == 3.0
    np.testing.assert_allclose(other.X_WB[:3, :3] @ other.mesh.bounds_m.mean(axis=0) + other.X_WB[:3, 3], middle)
    composing.scale(name, 1 / 3.0)
    assert scene.body(name).mesh is mesh
    for factor in (0.0, -1.0, np.nan, 1e9, 1e-9):
        with pytest.raises(SceneError):
            composing.scale(name, factor)


def test_scaling_is_refused_when_the_mesh_file_has_changed(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "ball.stl"
    icosphere(subdivisions=1, radius=0.01).export(file)
    other = hapscene.Scene()
    other.add(file, unit="m", scale=2.0, name="file")
    session.composing.add(other)
    icosphere(subdivisions=2, radius=0.01).export(file)
    before = body_rows(session)
    with pytest.raises(SceneError):
        session.composing.scale("file", 2.0)
    assert body_rows(session) == before


def test_sizes_that_were_tried_are_not_kept_prepared_for_ever(session: Session) -> None:
    for _ in range(20):
        session.composing.scale("plate", 1.01)
    assert len(session.painting._made) <= UNUSED_MESHES_MAX + 2
    for _ in range(20):
        session.undo()
    assert session.shapes[1].mesh is session.scene.body("plate").mesh


@pytest.mark.parametrize(("size_m", "factor"), [(1e-4, 1e3), (20.0, 5e-3)])
def test_corrected_unit_keeps_the_body_beside_the_others(session: Session, size_m: float, factor: float) -> None:
    session.composing.delete("plate")
    scene = hapscene.Scene()
    scene.add(mesh_of(box((size_m,) * 3)), name="cube")
    session.composing.add(scene)
    session.composing.scale("cube", factor, beside=True)
    (low, high), (cube_low, cube_high) = (_box(body) for body in session.scene.bodies)
    apart_m = np.maximum(low - cube_high, cube_low - high).max()
    assert 0.0 <= apart_m < 3.0 and cube_low[2] == pytest.approx(low[2])


def test_last_body_cannot_be_deleted_and_invalid_names_are_refused(session: Session) -> None:
    composing = session.composing
    composing.delete("plate")
    with pytest.raises(SceneError):
        composing.delete("ball")
    composing.add(ball("other"))
    for name, why in (("other", "'other'"), (" ", "printable"), ("a\nb", "printable")):
        with pytest.raises(SceneError, match=why):
            composing.rename("ball", name)


def test_different_swatch_with_an_existing_name_is_renamed(session: Session) -> None:
    strange = ball()
    strange.swatches[1] = hapscene.Swatch(name="paper", stiffness_N_m=321.0)
    (name,) = session.composing.add(strange)
    index = int(session.scene.body(name).face_swatch[0])
    assert session.scene.swatches[index].name == "paper 2"
    assert session.scene.swatches[index].stiffness_N_m == 321.0


def test_a_composed_scene_is_saved_and_recovered(session: Session, tmp_path: Path) -> None:
    session.save()
    composing = session.composing
    session.document.start_autosave(interval_s=60.0)
    (name,) = composing.add(ball("third"))
    composing.attach(name, "ball")
    composing.scale(name, 2.0)
    composing.copy(name)
    composing.delete("plate")
    state = [row[:4] for row in body_rows(session)]
    assert session.document.close(keep=True)

    again = Session.open(session.path)
    recovery = again.document.recovery()
    assert recovery is not None
    again.document.recover(recovery)
    assert [row[:4] for row in body_rows(again)] == state
    assert again.scene.bodies[1].mesh is again.scene.bodies[2].mesh
    path = again.save(tmp_path / "mybunny")
    assert path.name == "mybunny.scene.json"
    loaded = load_scene(path)
    assert [(b.name, b.parent) for b in loaded.bodies] == [(row[0], row[3]) for row in state]
    again.undo()
    assert [b.name for b in again.scene.bodies] == ["ball", "plate"]
