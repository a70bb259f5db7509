"""Subdivision of faces along borders, and its representation in scene files."""

import json
import math
from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.errors import SceneError
from hapscene.scene import Box, Sphere, Tube
from hapscene.scene.fine_paint import (
    LEVEL_MAX,
    NOTHING,
    FinePaint,
    blend,
    paint_faces,
    paint_over,
    paint_region,
    parts,
    whole_faces,
)
from hapscene.scene.scene_file import encode_fine
from tests.subface_areas import areas_m2

SIDE_M = 0.1
CENTRE, RADIUS_M = np.array([0.01, -0.005, SIDE_M / 2]), 0.03


def cube(unit="m"):
    scene = hapscene.Scene()
    body = scene.add(trimesh.creation.box((SIDE_M,) * 3), "cube", unit=unit)
    for name in ("steel", "foam", "glass"):
        scene.swatch_index(hapscene.Swatch(name))
    return scene, body


def area_m2(body, swatch):
    """Area of a swatch on a body, by weight."""
    fine = body.fine or NOTHING
    a, b, w = parts(fine.paint)
    whole = np.setdiff1d(np.flatnonzero(body.face_swatch == swatch), fine.faces)
    fine_m2 = ((a == swatch) * (1 - w) + (b == swatch) * w) @ areas_m2(fine, body.mesh)
    return fine_m2 + areas_m2(whole_faces(whole, whole), body.mesh).sum()


def check(body):
    """Check that subfaces cover each face once, are sorted, consistent and merged."""
    fine = body.fine
    start = fine.path.astype(np.int64)
    size = 1 << (LEVEL_MAX - fine.level.astype(np.int64))
    for face in fine.faces:
        mine = fine.face == face
        assert start[mine][0] == 0 and (start[mine][1:] == (start + size)[mine][:-1]).all()
        assert (start + size)[mine][-1] == 1 << LEVEL_MAX
    assert fine.is_consistent() and len(fine.joined()) == len(fine)
    assert (np.diff(fine.face) >= 0).all()
    b = fine.corners()
    area = np.abs(np.linalg.det(b))  # relative to the face
    np.testing.assert_allclose(area, 0.5**fine.level, rtol=1e-12)
    assert (np.linalg.det(b) > 0).all()  # same winding as the face


def test_sphere_paints_a_disc():
    scene, body = cube()
    assert scene.paint("cube", hapscene.Swatch("steel"), Sphere(CENTRE, RADIUS_M)) == 2
    check(body)
    assert area_m2(body, 1) == pytest.approx(math.pi * RADIUS_M**2, rel=1e-4)
    assert areas_m2(body.fine, body.mesh).sum() == pytest.approx(SIDE_M**2)
    assert (body.face_swatch == 0).all()  # the larger part of each side is plain
    assert body.fine.nbytes < 1500 * 2 * math.pi * 1e3 * RADIUS_M  # bytes per millimetre of border


@pytest.mark.parametrize("resolution_m", [2e-4, 2e-3])
def test_border_error_is_below_the_resolution(resolution_m):
    _, body = cube()
    region = Tube([(-0.03, -0.02, 0.05), (0.0, 0.03, 0.05), (0.03, -0.01, 0.05)], 0.004)
    paint_region(body, region, 1, resolution_m=resolution_m)
    corners = body.fine.corners_m(body.mesh)
    off_m = np.abs(region.distance_m(corners.mean(axis=1)))
    wrong = (region.distance_m(corners.reshape(-1, 3)).reshape(-1, 3) <= 0) != (body.fine.paint == 1)[:, None]
    assert np.abs(region.distance_m(corners[wrong])).max() < resolution_m
    assert off_m.max() > 5 * resolution_m  # and elsewhere the subfaces are large
    side_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    assert side_m.min() > resolution_m / 2.1 and side_m.max() > 8 * resolution_m


def test_uniform_paint_removes_subfaces():
    _, body = cube()
    hit = paint_region(body, Sphere(CENTRE, RADIUS_M), 1)
    before = body.fine
    paint_region(body, Sphere((0.0, 0.0, 0.06), 0.02), 2, falloff_m=0.004, resolution_m=5e-4)
    check(body)
    body.fine = body.fine.with_faces(hit, before.of_faces(hit))
    for mine, old in zip(body.fine.columns, before.columns, strict=True):
        np.testing.assert_array_equal(mine, old)
    paint_region(body, Box((-1, -1, -1), (1, 1, 1)), 3)
    assert body.fine is None and (body.face_swatch == 3).all()
    paint_region(body, Sphere(CENTRE, RADIUS_M), 1)
    paint_faces(body, np.array([4, 6]), 2)
    assert body.fine is None and body.face_swatch[4] == 2


def test_falloff_and_repeated_strokes():
    _, body = cube()
    falloff_m = 0.006
    paint_region(body, Sphere(CENTRE, RADIUS_M), 1, falloff_m=falloff_m)
    check(body)
    # integral of the weight ½ − d / falloff over the disc: π (r² + falloff² / 12)
    assert area_m2(body, 1) == pytest.approx(math.pi * (RADIUS_M**2 + falloff_m**2 / 12), rel=1e-4)
    before = body.fine
    paint_region(body, Sphere(CENTRE, RADIUS_M), 1, falloff_m=falloff_m)
    for mine, old in zip(body.fine.columns, before.columns, strict=True):
        np.testing.assert_array_equal(mine, old)
    rng = np.random.default_rng(1)
    face = int(body.fine.faces[0])
    for bary in rng.dirichlet((1, 1, 1), 200):
        p = bary @ body.mesh.triangles_m[face]
        a, b, w = (x.item() for x in parts(body.fine.at(face, bary)))
        got = {a: 1 - w, b: w} if w else {a: 1.0}
        wanted = float(np.clip(0.5 - (np.linalg.norm(p - CENTRE) - RADIUS_M) / falloff_m, 0, 1))
        assert got.get(1, 0.0) == pytest.approx(wanted, abs=0.07)


def test_blend_keeps_the_two_heaviest_swatches():
    half = blend(1, 2, 0.4)
    over = paint_over(half[None], 3, np.array([0.3]))
    assert [x.item() for x in parts(over)] == pytest.approx([1, 3, 0.3 / (0.3 + 0.7 * 0.6)], abs=1 / 256)
    assert paint_over(half[None], 3, np.array([0.1])) == half  # the lightest of the three
    assert paint_over(half[None], 2, np.array([0.2])) == half  # the weight is higher already
    assert [x.item() for x in parts(paint_over(half[None], 2, np.array([0.75])))] == [2, 1, 0.25]
    assert paint_over(half[None], 3, np.array([1.0])) == 3 and blend(5, 5, 0.3) == 5
    assert blend(4, 2, 0.5) == blend(2, 4, 0.5)
    assert whole_faces([3, 5], [blend(4, 2, 0.5), blend(4, 2, 0.4)]).main_swatch().tolist() == [2, 4]


def test_faces_and_opacity():
    _, body = cube()
    hit = paint_region(body, Sphere(CENTRE, RADIUS_M), 1, faces=np.array([4]))
    assert hit.tolist() == body.fine.faces.tolist() == [4]
    _, body = cube()
    paint_region(body, Box((-1, -1, -1), (1, 1, 1)), 1, opacity=0.25)
    assert len(body.fine) == 12 and (body.fine.level == 0).all() and (body.face_swatch == 0).all()
    assert area_m2(body, 1) == pytest.approx(6 * SIDE_M**2 / 4)
    body = hapscene.Scene().add(hapscene.Mesh([[0, 0, 0], [1, 0, 0], [0, 0.05, 0]], [[0, 1, 2]]))
    assert paint_region(body, Sphere((0.97, 0.0, 0.0), 0.01), 1).tolist() == [0]  # far from the middle of its face


@pytest.mark.parametrize(
    ("setting", "field"),
    [
        ({"resolution_m": 0.0}, "resolution_m"),
        ({"falloff_m": -1.0}, "falloff_m"),
        ({"opacity": math.nan}, "opacity"),
        ({"falloff_m": "3 mm"}, "falloff_m"),
        ({"resolution_m": [1e-3, 2e-3]}, "resolution_m"),
        ({"resolution_m": 1e-7}, "4,000"),
    ],
)
def test_invalid_numbers_raise(setting, field, monkeypatch):
    _, body = cube()
    monkeypatch.setattr("hapscene.scene.fine_paint.SUBFACE_MAX", 4000)
    with pytest.raises(SceneError, match=field):
        paint_region(body, Sphere(CENTRE, RADIUS_M), 1, **setting)
    assert body.fine is None


def test_limit_of_subfaces_includes_those_of_other_faces(monkeypatch):
    _, body = cube()
    paint_region(body, Sphere(CENTRE, RADIUS_M), 1)
    before, other = body.fine, Sphere(-CENTRE, RADIUS_M / 2)
    paint_region(body, other, 2)
    count, body.fine = len(body.fine), before
    assert count > 1.3 * len(before)
    monkeypatch.setattr("hapscene.scene.fine_paint.SUBFACE_MAX", count - 1)
    with pytest.raises(SceneError):
        paint_region(body, other, 2)
    assert body.fine is before
    monkeypatch.setattr("hapscene.scene.fine_paint.SUBFACE_MAX", 2 * count)  # some are merged at the end
    paint_region(body, other, 2)
    assert len(body.fine) == count


def test_falloff_needs_a_volume():
    scene, _ = cube()
    with pytest.raises(SceneError, match="falloff_m"):
        scene.paint("cube", "wood", [1, 2], falloff_m=0.01)


@pytest.mark.parametrize(
    "region",
    [Sphere((0.1, 0, 0), 0.3), Box((-0.1, -0.2, 0), (0.2, 0.1, 0.3)),
     Tube([(0, 0, 0)], 0.2), Tube([(0, 0, 0), (0.2, 0.1, 0), (0.2, 0.1, 0), (0, 0.3, 0.1)], 0.1)],
)  # fmt: skip
def test_signed_distances(region):
    rng = np.random.default_rng(3)
    p, q = rng.uniform(-0.5, 0.5, (2, 4000, 3))
    a, b = region.distance_m(p), region.distance_m(q)
    assert (np.abs(a - b) <= np.linalg.norm(p - q, axis=1) + 1e-12).all()
    # a step along the gradient leads to the border
    step = np.stack([region.distance_m(p + d) - region.distance_m(p - d) for d in 1e-7 * np.eye(3)], 1) / 2e-7
    smooth = np.abs(np.linalg.norm(step, axis=1) - 1) < 1e-5
    away = region.distance_m(p - a[:, None] * step)
    assert smooth.mean() > 0.9 and np.median(np.abs(away[smooth])) < 1e-6


def saved(tmp_path):
    scene, body = cube()
    paint_region(body, Sphere(CENTRE, RADIUS_M), 1, resolution_m=1e-3)
    paint_region(body, Sphere((0.05, 0, 0), 0.02), 2, falloff_m=0.01, resolution_m=1e-3)
    path = tmp_path / "my.scene.json"
    scene.save(path)
    return scene, path


def test_scene_file_roundtrip(tmp_path):
    scene, path = saved(tmp_path)
    content = json.loads(path.read_text())
    assert content["version"] == 3
    again = hapscene.load_scene(path)
    for mine, old in zip(again.bodies[0].fine.columns, scene.bodies[0].fine.columns, strict=True):
        np.testing.assert_array_equal(mine, old)
        assert mine.dtype == old.dtype
    np.testing.assert_array_equal(again.bodies[0].face_swatch, scene.bodies[0].face_swatch)
    copy = scene.copy()
    scene.paint("cube", "wood")
    assert scene.bodies[0].fine is None and len(copy.bodies[0].fine) == len(again.bodies[0].fine)
    scene.save(path)
    assert json.loads(path.read_text())["version"] == 1  # older readers support version 1


class Reversed(FinePaint):
    """Subfaces whose faces are in the wrong order."""

    faces = property(lambda self: super().faces[::-1])  # type: ignore[assignment]


def painted(fine, index, paint):
    return replace(fine, paint=np.where(np.arange(len(fine)) == index, paint, fine.paint))


INVALID = [
    lambda fine: encode_fine(fine) | {"leaves": 10**12},
    lambda fine: encode_fine(fine) | {"leaves": len(fine) - 1},
    lambda fine: encode_fine(Reversed(*(getattr(fine, field.name) for field in fields(fine)))),
    lambda fine: encode_fine(replace(fine, face=fine.face + np.int32(12))),
    lambda fine: encode_fine(replace(fine, level=fine.level + (np.arange(len(fine)) == 0).astype(np.uint8))),
    lambda fine: encode_fine(replace(fine, edge=fine.edge | np.uint64(3 << 62))),
    lambda fine: encode_fine(painted(fine, 2, 4)),
    lambda fine: encode_fine(painted(fine, 2, 1 | 2 << 16)),
]


@pytest.mark.parametrize("change", INVALID)
def test_invalid_data_raises_one_line(tmp_path, change):
    scene, path = saved(tmp_path)
    content = json.loads(path.read_text())
    content["bodies"][0]["fine"] = change(scene.bodies[0].fine)
    path.write_text(json.dumps(content))
    with pytest.raises(SceneError) as refused:
        hapscene.load_scene(path)
    assert "bodies[0]: 'fine'" in str(refused.value) and "\n" not in str(refused.value)
