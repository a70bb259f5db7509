"""The border of a soft brush."""

import numpy as np
import pytest
from trimesh.creation import box

from hapscene.errors import SceneError
from hapscene.paint.model.session import SPLIT_MAX, Brush, Session, Stroke
from hapscene.scene.scene import Scene

from .conftest import mesh_of, turned

POSE, MIDDLE = turned(0.8, (0.02, -0.01, 0.03)), np.array([0.1, 0.0, 0.0])


@pytest.fixture
def session() -> Session:
    """A cube of 12 faces at a pose, its middle beside its frame's."""
    cube = box((0.04, 0.04, 0.04))
    cube.apply_translation((0.1, 0.0, 0.0))
    scene = Scene()
    scene.add(mesh_of(cube), name="cube", pose=POSE)
    session = Session(scene)
    session.add_swatch("wood")
    return session


def test_soft_and_thin_paint_is_a_blend_that_ends_at_the_ring(session: Session) -> None:
    from hapscene.scene.fine_paint import parts

    p_W = POSE[:3, :3] @ np.array([0.1, 0.0, 0.02]) + POSE[:3, 3]
    for opacity in (0.25, 0.25, 0.4):  # a stroke over another does not add to it
        session.begin_stroke("wood", 0.008, falloff=1.0, opacity=opacity)
        session.drag_to(p_W + 0.2 * POSE[:3, 2], -POSE[:3, 2])
        session.end_stroke()
        body = session.scene.bodies[0]
        middle_m = body.fine.corners_m(body.mesh).mean(axis=1) - [0.1, 0.0, 0.02]
        weight, away_m = parts(body.fine.paint)[2], np.linalg.norm(middle_m, axis=1)
        assert weight.max() == pytest.approx(opacity, abs=0.02)
        assert (weight[away_m > 0.0082] == 0.0).all() and (weight[away_m < 0.006] > 0.0).all()


def test_a_move_is_split_into_steps_of_half_a_radius(session: Session) -> None:
    x, _, z = POSE[:3, :3].T
    top = POSE[:3, :3] @ np.array([0.1, 0.0, 0.02]) + POSE[:3, 3]
    over, beside = (top + 0.1 * z, -z), (top + 0.1 * z + 0.0105 * x, -z)
    eye = top - 0.05 * x + 0.01 * z  # grazing: a small turn of the ray is a long way on the surface
    for radius_m, first, last, count in (
        (0.002, over, beside, 11),
        (0.002, (eye, 0.035 * x - 0.01 * z), (eye, 0.0655 * x - 0.01 * z), 31),
        (1e-5, over, beside, SPLIT_MAX),
    ):
        stroke = Stroke(session.painting, "wood", Brush(radius_m))
        stroke.drag_to(*first)
        ray = last[0], last[1] / np.linalg.norm(last[1])
        assert stroke._pieces(ray, session.pick(*last)) == count
        assert count == 31 or stroke._pieces(ray, None) == count  # beside the surface, the depth of the last point
        assert stroke._pieces((first[0], first[1] / np.linalg.norm(first[1])), None) == 1


@pytest.mark.parametrize("setting", [{"falloff": 1.1}, {"falloff": np.nan}, {"opacity": 0.0}])
def test_settings_of_the_brush_are_checked(setting) -> None:
    with pytest.raises(SceneError, match=next(iter(setting))):
        Brush(0.001, **setting)
