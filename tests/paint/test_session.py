"""Operations on a scene can be undone and redone exactly, saved and loaded."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import hapscene
from hapscene.errors import HapsceneError, SceneError
from hapscene.paint.model.history import NOTHING
from hapscene.paint.model.session import ERASE, Hit, Session
from hapscene.scene.mesh import Mesh
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import swatch_to_json
from hapscene.swatches.library import find

from .conftest import hit_at, make_scene

SLATE = Swatch("slate", stiffness_N_m=1200.0, friction_static=0.5, friction_dynamic=0.4, albedo_rgb=(0.2, 0.2, 0.3))


def bits(session: Session) -> Any:
    """All that an operation may change, to compare."""
    scene = session.scene
    faces = tuple(body.face_swatch.tobytes() for body in scene.bodies)
    leaves = tuple(b"".join(c.tobytes() for c in (body.fine or NOTHING).columns) for body in scene.bodies)
    swatches = tuple((swatch_to_json(s), source) for s, source in zip(scene.swatches, scene.swatch_source, strict=True))
    return faces, leaves, swatches


def do(session: Session, kind: int, rng: np.random.Generator) -> None:
    """One random operation."""
    count = len(session.scene.swatches)
    swatch = int(rng.integers(-1, count))
    body = int(rng.integers(2))
    some = hit_at(session, body, int(rng.integers(len(session.shapes[body].normal))))
    radius_m = float(rng.uniform(0.001, 0.015))
    if kind == 0:
        session.begin_stroke(
            swatch, radius_m, falloff=float(rng.choice([0.0, 0.5])), opacity=float(rng.uniform(0.1, 1))
        )
        for _ in range(3):
            session.drag_to([0.0, 0.0, 1.0], rng.normal(size=3) * 0.02 - [0.0, 0.0, 1.0])
        if rng.random() < 0.7:
            session.end_stroke()  # else the next operation ends it
    elif kind == 1:
        session.fill_at(some, "facet", swatch, float(rng.uniform(0.0, 0.5)))
    elif kind == 2:
        session.fill_body(body, swatch)
    elif kind == 3:
        session.fill_at(hit_at(session, 0, int(rng.integers(2) * 700)), "material", swatch)
    elif kind == 4:
        session.fill_sphere(some.p_W_m, radius_m, swatch)
    elif kind == 5:
        session.add_swatch(("wood", "epoxy", SLATE, Swatch(f"made {rng.integers(5)}"))[rng.integers(4)])
    elif kind == 6:
        name, high = (("stiffness_N_m", 3000), ("friction_static", 2), ("friction_dynamic", 2), ("tap_gain", 4))[
            rng.integers(4)
        ]
        session.tune(max(swatch, 1), **{name: float(rng.uniform(0, high))})
    elif kind == 7 and swatch > 0:
        name = f"new {rng.integers(1000)}"
        if session.painting.swatch_named(name) is None and find(name) is None:
            session.tuning.save_swatch_as(swatch, name)
    elif kind == 8:
        if session.painting.swatch_named(f"copy {count}") is None:
            session.tuning.copy_swatch(max(swatch, 0), f"copy {count}")
    elif kind == 9:
        session.undo()
    elif kind == 10:
        session.redo()


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.integers(0, 10), min_size=1, max_size=14), st.integers(0, 2**32 - 1))
def test_random_edits_are_undone_and_redone_exactly(tmp_path, kinds, seed) -> None:
    session = Session(make_scene(tmp_path))
    rng = np.random.default_rng(seed)
    first = bits(session)
    for kind in kinds:
        do(session, kind, rng)
    session.end_stroke()
    while session.redo() is not None:
        pass
    last = bits(session)
    states = [last]
    while session.undo() is not None:
        states.append(bits(session))
    assert states[-1] == first
    assert not session.document.changed
    for state in states[-2::-1]:
        assert session.redo() is not None
        assert bits(session) == state
    assert session.redo() is None
    path = tmp_path / "work.scene.json"
    session.save(path, force=True)
    assert not session.dirty
    back = hapscene.load_scene(path)
    assert [swatch_to_json(s) for s in back.swatches] == [swatch_to_json(s) for s in session.scene.swatches]
    for mine, theirs in zip(session.scene.bodies, back.bodies, strict=True):
        np.testing.assert_array_equal(mine.face_swatch, theirs.face_swatch)
        np.testing.assert_array_equal(mine.X_WB, theirs.X_WB)
        assert (mine.name, mine.mesh.digest) == (theirs.name, theirs.mesh.digest)


def test_a_stroke_is_one_step_and_follows_the_surface(scene) -> None:
    session = Session(scene)
    wood = session.add_swatch("wood")
    middle = scene.body("ball").X_WB[:3, 3]
    eye = np.add(middle, (0.0, 0.0, 0.5))
    session.begin_stroke(wood, 0.002)
    # the pointer jumps over the ball in one move: what lies between is painted as the eye saw it
    session.drag_to(eye, [-0.017, 0.0, -0.48])
    assert session.painting.undo_text == "stroke"
    session.drag_to(eye, [0.017, 0.0, -0.48])
    painted = session.end_stroke()
    ball = scene.bodies[0]
    assert painted == len(np.union1d(np.flatnonzero(ball.face_swatch == wood), ball.fine.faces))
    for x in np.linspace(-0.017, 0.017, 200):
        hit = session.pick(eye, [x, 0.0, -0.48])
        assert hit is not None and session.swatch_at(hit) == wood
    assert session.undo() == f"brush, {painted} faces"
    assert not (ball.face_swatch == wood).any() and ball.fine is None


def test_stroke_continues_after_leaving_the_surface(scene) -> None:
    session = Session(scene)
    session.begin_stroke(session.add_swatch("wood"), 0.003)
    assert session.drag_to([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]) is None
    assert session.drag_to([0.01, 0.0, 1.0], [0.0, 0.0, -1.0]) is not None
    assert session.end_stroke() > 0
    with pytest.raises(SceneError):
        session.drag_to([0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    for radius_m in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(SceneError):
            session.begin_stroke(0, radius_m)
    with pytest.raises(SceneError):
        session.begin_stroke(9, 0.01)


def test_eraser_restores_the_original_swatch_after_save_and_load(scene, tmp_path) -> None:
    session = Session(scene, tmp_path / "made.scene.json")
    paper = session.painting.swatch_named("paper")
    session.fill_sphere([0.0, 0.08, 0.0], 0.01, session.add_swatch("wood"))
    session.fill_body("ball", paper)
    session.save()
    again = Session.open(tmp_path / "made.scene.json")
    assert again.defaults == [0, paper]
    assert again.fill_body("plate", ERASE) > 0 and again.fill_body("ball", ERASE) == 1280
    assert (again.scene.bodies[1].face_swatch == paper).all() and not again.scene.bodies[0].face_swatch.any()


def test_sphere_is_where_it_says(scene) -> None:
    """At random places on the plate, but for those that the border runs by."""
    session = Session(scene)
    wood = session.add_swatch("wood")
    body, rng = scene.body("plate"), np.random.default_rng(0)
    faces, bary = rng.integers(0, len(body.mesh.faces), 400), rng.dirichlet([1.0, 1.0, 1.0], 400)
    p_B = np.einsum("ij,ijk->ik", bary, body.mesh.triangles_m[faces])
    p_W = p_B @ body.X_WB[:3, :3].T + body.X_WB[:3, 3]

    assert session.fill_sphere([0.0, 0.08, 0.003], 0.012, wood) > 0
    distance_m = np.linalg.norm(p_W - [0.0, 0.08, 0.003], axis=1) - 0.012
    hits = [Hit(1, int(f), w, b, np.zeros(3), 0.0) for f, w, b in zip(faces, p_W, p_B, strict=True)]
    painted = np.array([session.swatch_at(hit) == wood for hit in hits])
    clear = np.abs(distance_m) > 2e-4
    np.testing.assert_array_equal(painted[clear], distance_m[clear] < 0)
    assert painted.any() and not painted.all()


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda s: s.fill_sphere([0, 0, 0], 0.0, 0), "radius"),
        (lambda s: s.fill_sphere([0, 0], 0.1, 0), "centre"),
        (lambda s: s.fill_at(hit_at(s, 0, 0), "facet", 0, 4.0), "angle"),
        (lambda s: s.fill_body("cup", 0), "'cup'.*ball, plate"),
        (lambda s: s.tune(0, tap_gain=1.0), "'plain'"),
        (lambda s: s.add_swatch("oka"), "'oka'"),
        (lambda s: s.add_swatch(Swatch("paper")), "'paper'"),
        (lambda s: s.tuning.save_swatch_as(0, "bare"), "'plain'"),
        (lambda s: s.tuning.save_swatch_as(1, "plain"), "'plain'"),
        (lambda s: s.tuning.save_swatch_as(1, "wood"), "'wood'"),
        (lambda s: s.tuning.copy_swatch(0, "paper"), "'paper'"),
        (lambda s: s.tuning.choose_device("omnipotent"), "'omnipotent'"),
        (lambda s: s.save(), "scene.json"),
    ],
)
def test_invalid_edit_is_refused_without_changes(scene, act, message) -> None:
    session = Session(scene)
    before = bits(session)
    with pytest.raises(HapsceneError, match=message):
        act(session)
    assert bits(session) == before
    assert session.painting.undo_text is None and not session.document.changed


def test_slider_movement_is_one_undo_step(scene) -> None:
    session = Session(scene)
    now = [0.0]
    session.painting.clock = lambda: now[0]
    paper = session.painting.swatch_named("paper")
    assert paper is not None
    for value in (400.0, 380.0, 360.0):
        session.tune(paper, stiffness_N_m=value)
        now[0] += 0.3
    now[0] += 5.0
    session.tune(paper, stiffness_N_m=200.0)
    session.tune(paper, friction_static=0.9)
    assert [step.what for step in session.history.done] == [
        "stiffness of 'paper'",
        "stiffness of 'paper'",
        "static friction of 'paper'",
    ]
    session.undo(), session.undo()
    assert scene.swatches[paper].stiffness_N_m == 360.0
    session.undo()
    assert scene.swatch_source[paper] == "paper"
    session.redo()
    session.tune(paper, stiffness_N_m=350.0)  # not joined to a step that was just done again by another hand
    assert session.painting.undo_text is not None and session.painting.redo_text is None


def test_tuned_then_saved_as_new(scene, tmp_path, library) -> None:
    session = Session(scene)
    paper = session.painting.swatch_named("paper")
    assert paper is not None
    session.tune(paper, stiffness_N_m=120.0)
    session.tune(paper, texture_gain=2.0)
    file = session.tuning.save_swatch_as(paper, "soft paper")
    assert file.parent == library
    assert hapscene.load_swatch("soft paper").stiffness_N_m == 120.0
    assert session.painting.swatch_named("soft paper") == paper and session.painting.swatch_named("paper") is None
    assert session.add_swatch("paper") == len(scene.swatches) - 1  # the shipped one is free again
    session.save(tmp_path / "a.scene.json")
    back = hapscene.load_scene(tmp_path / "a.scene.json")
    assert back.swatches[paper].stiffness_N_m == 120.0
    slate = session.add_swatch(SLATE)
    session.tuning.save_swatch_as(slate, "soft paper 2")
    session.undo()
    with pytest.raises(HapsceneError):
        session.tuning.save_swatch_as(slate, "soft paper 2")


def test_changes_are_returned_once(scene) -> None:
    session = Session(scene)
    wood = session.add_swatch("wood")
    session.fill_at(hit_at(session, 0, 700), "material", wood)
    seen = session.painting.changes()
    assert list(seen.faces) == [0] and seen.swatches == (wood,) and seen.swatch_list
    np.testing.assert_array_equal(seen.faces[0], np.arange(700, 1280))
    assert not session.painting.changes()
    session.tune(wood, stiffness_N_m=100.0)
    assert (session.painting.changes().swatches, session.painting.changes().swatch_list) == ((wood,), False)
    session.undo(), session.undo()
    again = session.painting.changes()
    np.testing.assert_array_equal(again.faces[0], np.arange(700, 1280))

    session.undo()
    gone = session.painting.changes()
    assert gone.swatch_list and gone.swatches == () and not gone.faces


def test_new_swatch_is_a_copy(scene) -> None:
    session = Session(scene)
    foam = session.tuning.copy_swatch(0, "foam")
    session.tune(foam, stiffness_N_m=80.0)
    assert (scene.swatches[foam].name, scene.swatches[0].stiffness_N_m) == ("foam", 500.0)
    assert not any(parameter.applies for parameter in session.tuning.parameters(0))


def test_click_fills_only_the_group_with_exactly_that_name(scene) -> None:
    ball = scene.bodies[0].mesh
    mesh = Mesh(ball.vertices_m, ball.faces, (np.arange(len(ball.faces)) % 3).astype(np.int16), ("lid", "box/lid", "x"))
    scene.add(mesh, name="box")
    session = Session(scene)
    wood, face_swatch = session.add_swatch("wood"), scene.bodies[2].face_swatch
    assert session.fill_at(hit_at(session, 2, 3), "material", wood) == 427
    np.testing.assert_array_equal(face_swatch == wood, mesh.group == 0)
    assert session.painting.undo_text == "fill 'lid', 427 faces"


def test_swatch_is_given_by_name_or_index(scene) -> None:
    by_name, by_index = Session(scene), Session(Session(scene).painting.snapshot())
    wood = by_index.add_swatch("wood")
    by_name.add_swatch("wood")
    for session, swatch in ((by_name, "wood"), (by_index, wood)):
        session.begin_stroke(swatch, radius_m=0.004)
        session.drag_to(scene.body("ball").X_WB[:3, 3] + (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
        assert session.end_stroke() > 0
        session.fill_body("plate" if swatch == "wood" else 1, swatch)
        session.tune(swatch, stiffness_N_m=300.0)
        assert session.tuning.parameters(swatch)
    assert bits(by_name) == bits(by_index)
    with pytest.raises(SceneError, match="'wod'"):
        by_name.fill_body("ball", "wod")
