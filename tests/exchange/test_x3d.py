"""X3D as other programs see it."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from hapscene.exchange import export_scene
from hapscene.exchange.x3d import FIELDS, axis_angle
from hapscene.exchange.x3d_read import rotation
from hapscene.scene.scene import Scene


def test_each_body_and_swatch_is_a_shape_with_h3ds_surface(scene: Scene, tmp_path: Path) -> None:
    root = etree.parse(export_scene(scene, tmp_path / "desk.x3d")[0]).getroot()
    assert root.tag == "X3D" and [child.tag for child in root] == ["head", "Scene"]
    (world,) = root.find("Scene")
    places = world.findall("Transform")
    assert len(places) == 3
    stone = places[0].findall("Shape")
    for shape, swatch in zip(stone, scene.swatches, strict=True):
        appearance = shape.find("Appearance")
        assert [float(c) for c in appearance.find("Material").get("diffuseColor").split()] == list(swatch.albedo_rgb)
        surface = appearance[-1]
        assert surface.tag == ("FrictionalSurface" if swatch.friction_static else "SmoothSurface")
        assert surface.get("useRelativeValues") == "false"  # so that H3D takes N/m
        for field in FIELDS:
            if surface.get(field) is not None:
                assert float(surface.get(field)) == swatch.own_numbers[FIELDS[field]]
    # the numbers of the first body's faces, gathered over its shapes
    point = np.array(stone[0].find("IndexedTriangleSet/Coordinate").get("point").split(), float).reshape(-1, 3)
    assert np.array_equal(point, scene.bodies[0].mesh.vertices_m)
    faces = [np.array(s.find("IndexedTriangleSet").get("index").split(), int).reshape(-1, 3) for s in stone]
    order = np.argsort(scene.bodies[0].face_swatch, kind="stable")
    assert np.array_equal(np.concatenate(faces), scene.bodies[0].mesh.faces[order])
    # what is there already is used again
    assert [s.get("USE") for s in places[2].findall("Shape")] == [s.get("DEF") for s in stone]
    assert places[1].find("Shape/Appearance").get("USE") == stone[0].find("Appearance").get("DEF")
    assert places[1].find("Shape/IndexedTriangleSet").get("solid") == "false"
    assert len({e.get("DEF") for e in root.iter() if e.get("DEF")}) == sum(1 for e in root.iter() if e.get("DEF"))


def test_poses_are_those_of_x3d(scene: Scene, tmp_path: Path) -> None:
    """X3D: a point p is turned about the axis by the right hand, then moved."""
    from scipy.spatial.transform import Rotation

    root = etree.parse(export_scene(scene, tmp_path / "desk.x3d")[0]).getroot()
    for place, body in zip(root.find("Scene/Transform").findall("Transform"), scene.bodies, strict=True):
        x, y, z, angle = map(float, place.get("rotation").split())
        R = Rotation.from_rotvec(angle * np.array([x, y, z])).as_matrix()
        np.testing.assert_allclose(R, body.X_WB[:3, :3], rtol=0, atol=1e-15)
        assert [float(t) for t in place.get("translation").split()] == body.X_WB[:3, 3].tolist()


unit = st.floats(-1, 1)


@settings(max_examples=60, deadline=None)
@given(st.tuples(unit, unit, unit), st.one_of(st.floats(0, np.pi), st.sampled_from([1e-9, np.pi, np.pi - 1e-9, 0])))
def test_axis_and_angle_are_the_rotation(axis: tuple[float, float, float], angle_rad: float) -> None:
    from scipy.spatial.transform import Rotation

    if np.linalg.norm(axis) < 1e-3:
        axis = (0.0, 0.0, 1.0)
    R = Rotation.from_rotvec(np.array(axis) / np.linalg.norm(axis) * angle_rad).as_matrix()
    x, y, z, turned = axis_angle(R)
    assert x * x + y * y + z * z == pytest.approx(1.0)  # of no turn too
    np.testing.assert_allclose(Rotation.from_rotvec(turned * np.array([x, y, z])).as_matrix(), R, rtol=0, atol=3e-15)
    np.testing.assert_allclose(rotation(2 * x, 2 * y, 2 * z, turned), R, rtol=0, atol=3e-15)


def test_names_of_any_signs(tmp_path: Path) -> None:
    from hapscene.exchange.x3d import quoted
    from hapscene.exchange.x3d_read import unquoted

    for name in ('a "b" \\', "\\\\", '"', "<&>'", "ü ß 漢", "  two  "):
        assert unquoted(quoted(name)) == name
    assert unquoted("bare") == "bare"


@pytest.mark.parametrize("subject", ["head", "Scene"])
def test_the_file_is_utf8_xml(subject: str, scene: Scene, tmp_path: Path) -> None:
    content = export_scene(scene, tmp_path / "desk.x3d")[0].read_bytes()
    assert content.startswith(b"<?xml") and b"UTF-8" in content[:60] and f"<{subject}>".encode() in content
