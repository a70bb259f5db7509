"""What is painted grows and shrinks along its border."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from trimesh.creation import box

import hapscene
from hapscene.errors import SceneError
from hapscene.paint.model.session import Session
from hapscene.scene.fine_paint import NOTHING, parts, swatches_of
from hapscene.scene.region import PlaneSide, Sphere

from .conftest import mesh_of

SIDE_M = 0.04


def plate(thickness_m: float = 0.002) -> Session:
    """A plate of twelve triangles, a disc of wood in the middle of its top."""
    scene = hapscene.Scene()
    scene.add(mesh_of(box((SIDE_M, SIDE_M, thickness_m))), name="plate")
    top = Sphere((0.0, 0.0, thickness_m / 2), 0.006)
    session = Session(scene)
    session.add_swatch("wood")
    session.painting.begin_step("disc", "wood")
    session.painting.paint_region(0, top, np.flatnonzero(scene.bodies[0].mesh.normals[:, 2] > 0.9))
    session.end_stroke()
    return session


def area_m2(session: Session, swatch: str) -> float:
    """What is painted with a swatch."""
    body = session.scene.bodies[0]
    fine, index = body.fine or NOTHING, session.painting.swatch_index(swatch)
    whole = body.face_swatch == index
    whole[fine.faces] = False
    a, b, c = np.moveaxis(body.mesh.triangles_m, 1, 0)
    faces_m2: NDArray[np.float64] = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return float(faces_m2[whole].sum() + fine.areas_m2(body.mesh)[parts(fine.paint)[0] == index].sum())


@pytest.mark.parametrize(("by_mm", "radius_mm"), [(2.0, 8.0), (0.3, 6.3), (-2.0, 4.0), (-0.3, 5.7), (-7.0, 0.0)])
def test_a_disc_grows_and_shrinks_by_a_distance_on_its_own_side(by_mm: float, radius_mm: float) -> None:
    session = plate()
    before = area_m2(session, "wood")
    assert session.grow("wood", 1e-3 * by_mm) > 0
    edge_mm2 = 0.15 * 2 * math.pi * max(radius_mm, 1.0)  # a leaf is 0.1 mm long
    assert area_m2(session, "wood") * 1e6 == pytest.approx(math.pi * radius_mm**2, abs=edge_mm2)
    session.undo()
    assert area_m2(session, "wood") == before


def test_growth_goes_over_an_edge_and_never_through_a_wall() -> None:
    session = plate()
    session.undo()
    body = session.scene.bodies[0]
    session.painting.begin_step("half", "wood")
    top = np.flatnonzero(body.mesh.normals[:, 2] > 0.9)
    session.painting.paint_region(0, PlaneSide((0.0195, 0.0, 0.0), (1.0, 0.0, 0.0)), top)
    session.grow("wood", 0.003)
    found = {tuple(np.round(body.mesh.normals[f]).astype(int)) for f in (body.fine or NOTHING).faces}
    found |= {tuple(np.round(body.mesh.normals[f]).astype(int)) for f in np.flatnonzero(body.face_swatch)}
    assert (1, 0, 0) in found and (0, 0, -1) not in found


def test_what_is_beside_a_swatch_shrinks_it_each_from_its_side() -> None:
    session = plate()
    session.add_swatch("epoxy")
    body = session.scene.bodies[0]
    session.painting.begin_step("right", "epoxy")
    top = np.flatnonzero(body.mesh.normals[:, 2] > 0.9)
    session.painting.paint_region(0, PlaneSide((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), top)
    session.end_stroke()
    session.grow("wood", -0.001)
    epoxy = session.painting.swatch_index("epoxy")
    at = lambda x, y: session.swatch_at(session.pick((x, y, 1.0), (0.0, 0.0, -1.0)))  # type: ignore[arg-type]  # noqa: E731
    assert at(-0.0005, 0.0) == epoxy
    assert at(-0.0055, 0.0) == 0 and session.scene.swatches[at(-0.003, 0.0)].name == "wood"


def test_a_whole_body_has_no_border_and_a_width_is_a_number() -> None:
    session = plate()
    session.fill_body(0, "wood")
    assert session.grow("wood", 0.001) == 0 == session.grow("wood", -0.001)
    assert swatches_of(session.scene.bodies[0]).tolist() == [1]
    for by_m in (0.0, math.nan, math.inf):
        with pytest.raises(SceneError, match="grow"):
            session.grow("wood", by_m)
