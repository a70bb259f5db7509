"""Undo steps of a painting: changes in an open step are undone together; any other edit ends the step."""

import numpy as np
import pytest

from hapscene.errors import SceneError
from hapscene.paint.model.painting import Painting
from hapscene.scene.scene import Scene

from .conftest import plate_mesh


@pytest.fixture
def painting() -> Painting:
    """Two plates of 12 faces, the second made of paper."""
    scene = Scene()
    scene.add(plate_mesh(cells=0), name="plain")
    scene.add(plate_mesh(cells=0), name="sheet", swatch="paper")
    return Painting(scene)


def swatches_of(painting: Painting) -> list[list[int]]:
    return [body.face_swatch.tolist() for body in painting.scene.bodies]


def test_an_open_step_is_one_undo_over_all_bodies(painting: Painting) -> None:
    before, state = swatches_of(painting), painting.state
    painting.begin_step("brush", "paper")
    assert painting.undo_text is None
    assert [painting.paint_faces(body, np.arange(3)) for body in (0, 0, 1)] == [3, 0, 0]
    painting.paint_faces(0, np.array([7]))
    assert painting.open_step is not None and painting.undo_text == "stroke" and painting.state != state
    assert painting.end_step() == 4 and painting.open_step is None
    painted = swatches_of(painting)
    assert np.flatnonzero(painted[0]).tolist() == [0, 1, 2, 7]
    assert painting.undo() == "brush, 4 faces"
    assert swatches_of(painting) == before and painting.state == state
    assert painting.redo() == "brush, 4 faces" and swatches_of(painting) == painted
    assert painting.redo() is None
    steps = [*painting.history.done]
    painting.undo()
    painting.replay(steps)
    assert swatches_of(painting) == painted and painting.undo() == "brush, 4 faces" and swatches_of(painting) == before


def test_other_edits_end_an_open_step(painting: Painting) -> None:
    before = swatches_of(painting)
    painting.begin_step("brush", "paper")
    painting.paint_faces(0, np.array([0]))
    painting.begin_step("line", "paper")
    painting.paint_faces(0, np.array([1]))
    assert painting.undo() == "line, 1 face" and painting.undo() == "brush, 1 face" and painting.undo() is None
    assert swatches_of(painting) == before
    with pytest.raises(SceneError):
        painting.paint_faces(0, np.array([0]))


def test_step_without_changes_is_not_recorded(painting: Painting) -> None:
    both = {0: np.zeros(12, bool), 1: np.ones(12, bool)}
    assert painting.paint("fill", both, "paper") == 0 and painting.undo() is None and not painting.changes()
    assert painting.paint("fill", {0: np.ones(12, bool)}, "paper") == 12 and painting.changes()


def test_another_painting_is_taken_whole_or_not_at_all(painting: Painting) -> None:
    before = swatches_of(painting)
    other = painting.snapshot()
    other.bodies[0].face_swatch[:4] = 1
    assert swatches_of(painting) == before  # a snapshot shares no faces
    painting.take_painting(other, "take")
    assert swatches_of(painting)[0] == [1] * 4 + [0] * 8 and painting.undo() == "take"
    assert swatches_of(painting) == before
    for body in other.bodies:
        body.name += " 2"  # no body in common
    with pytest.raises(SceneError):
        painting.take_painting(other, "take")
    assert swatches_of(painting) == before
