"""The errors of the questions of contact, held against closed forms."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.perception import DIRECTION_DEG
from hapscene.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.surface.swatch import PLAIN
from hapscene_evidence.bench.case import RADIUS_M, sphere, sphere_cases
from hapscene_evidence.bench.machine import held_MB
from hapscene_evidence.chart import groove, growth, mesh, painting, triangles, whole_tick
from hapscene_evidence.chart.question import Point
from hapscene_evidence.chart.touched_surface import SPHERE, closest_points, reduced, touched


def test_closest_points_are_those_of_every_triangle_looked_at() -> None:
    from trimesh.triangles import closest_point

    rng = np.random.default_rng(3)
    small = rng.uniform(-1.0, 1.0, (300, 1, 3)) + 0.05 * rng.standard_normal((300, 3, 3))
    large = rng.uniform(-1.0, 1.0, (6, 3, 3))
    corners = np.concatenate((small, large))
    made = Mesh(vertices_m=corners.reshape(-1, 3), faces=np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3))
    points = rng.uniform(-1.2, 1.2, (60, 3))
    at, face = closest_points(made, points)
    every = np.array([closest_point(corners, np.tile(p, (len(corners), 1))) for p in points])
    away = np.linalg.norm(every - points[:, None], axis=2)
    assert np.linalg.norm(at - points, axis=1) == pytest.approx(away.min(axis=1), abs=1e-12)
    assert (face == away.argmin(axis=1)).mean() > 0.95  # two triangles may be as close
    among = np.arange(100)
    assert np.linalg.norm(closest_points(made, points, among)[0] - points, axis=1) == pytest.approx(
        away[:, :100].min(axis=1), abs=1e-12
    )


def test_the_truth_of_the_sphere_is_round_and_that_of_a_body_its_closest_point() -> None:
    on = touched(None, SPHERE, 400)
    distance = np.linalg.norm(on.p_WT_m, axis=1)
    inside = distance < RADIUS_M
    surface = on.p_WT_m + on.into_m
    assert np.linalg.norm(surface[inside], axis=1) == pytest.approx(RADIUS_M, abs=1e-12)
    assert not on.into_m[~inside].any()
    plate = touched(None, "plate")
    assert plate.swatch.name in ("wood", "paper")
    depth = np.linalg.norm(plate.into_m, axis=1)
    assert 1e-3 < depth.max() < 4e-3  # not through to its back


def test_a_mesh_is_reduced_by_as_much_as_is_said() -> None:
    whole = reduced(None, SPHERE, 1, 400)
    fewer = reduced(None, SPHERE, 16, 400)
    assert len(fewer.faces) == pytest.approx(len(whole.faces) / 16, rel=0.02)


def test_a_mesh_of_a_hand_s_size_is_reduced_as_well_as_a_large_one() -> None:
    from fast_simplification import simplify

    whole, fewer = (reduced(None, SPHERE, divisor, 400) for divisor in (1, 16))
    places, index = np.unique(whole.vertices_m, axis=0, return_inverse=True)
    large, faces = simplify(1000.0 * places, index.reshape(-1)[whole.faces], target_count=len(whole.faces) // 16)
    off_m = [np.linalg.norm(t.mean(axis=1), axis=1) - RADIUS_M for t in (fewer.triangles_m, 1e-3 * large[faces])]
    assert np.sqrt(np.mean(off_m[0] ** 2)) < 1.1 * np.sqrt(np.mean(off_m[1] ** 2))


def recording(force_N: Any, touching: Any, depth_m: Any, **more: Any) -> Any:
    return SimpleNamespace(
        f_W_N=np.asarray(force_N), touching=np.asarray(touching), depth_m=np.asarray(depth_m), **more
    )


def test_errors_of_a_force_that_is_turned_and_larger_and_steps() -> None:
    turn = math.radians(10.0)
    into = np.tile([0.0, 0.0, 2e-3], (200, 1))
    force = 500.0 * 2e-3 * 1.14 * np.tile([math.sin(turn), 0.0, math.cos(turn)], (200, 1))
    found = mesh.force_errors(recording(force, [True] * 200, np.full(200, 2.3e-3)), into, 500.0)
    assert found["direction"] == pytest.approx(10.0)
    assert found["force"] == pytest.approx(2.0)
    assert found["depth"] == pytest.approx(0.3)
    assert found["edge"] == pytest.approx(0.0, abs=1e-6)
    force[100:] = 500.0 * 2e-3 * np.array([0.0, 0.0, 1.0])
    assert mesh.force_errors(recording(force, [True] * 200, np.full(200, 2e-3)), into, 500.0)["edge"] == (
        pytest.approx(10.0)
    )


def test_contact_that_is_missed_counts_as_much_as_its_force() -> None:
    into = np.tile([0.0, 0.0, 2e-3], (50, 1))
    found = mesh.force_errors(recording(np.zeros((50, 3)), [True] + [False] * 49, np.zeros(50)), into, 500.0)
    assert found["force"] == pytest.approx(1.0 / 0.07)


def test_a_coarser_sphere_is_farther_off_and_shading_turns_its_force_back() -> None:
    fine, coarse, shaded = (
        mesh.error(None, SPHERE, divisor, shade) for divisor, shade in ((4, False), (64, False), (64, True))
    )
    assert fine["direction"] < 0.5 * coarse["direction"]
    assert fine["depth"] < 0.2 * coarse["depth"]
    assert shaded["direction"] < 0.5 * coarse["direction"]
    assert shaded["depth"] == pytest.approx(coarse["depth"], rel=1e-6)
    # a facet of a sphere turns by at most the angle to its corners: edges of R √(4π / f · 4/√3 / 4) or so
    edge_m = math.sqrt(4.0 * math.pi * RADIUS_M**2 / 1280 * 4.0 / math.sqrt(3.0))
    assert coarse["direction"] < math.degrees(edge_m / RADIUS_M)


def test_facets_of_a_sphere_are_off_by_half_as_much_where_they_are_half_as_large() -> None:
    cases = sphere_cases((3, 4), 400)
    found = [triangles.errors(case, Renderer(case.scene(), effects=["wall"]).run(case.p_WT_m)) for case in cases]
    assert found[1]["direction"] == pytest.approx(found[0]["direction"] / 2, rel=0.25)
    assert [one["gap"] for one in found] == [triangles.GAP_LEAST_UM] * 2


def test_the_whole_tick_of_the_truth_is_off_by_nothing_and_a_held_force_by_its_lag() -> None:
    on = touched(None, "plate")
    swatch = whole_tick.swatch_of(on, 0)
    count = len(on.p_WT_m)
    force = swatch.stiffness_N_m * on.into_m
    touching = np.linalg.norm(on.into_m, axis=1) > 0.0

    class Felt(SimpleNamespace):
        def __len__(self) -> int:
            return len(self.touching)

    def felt(every: int) -> Any:
        size = np.linalg.norm(force, axis=1)[::every]
        return Felt(f_W_N=force[::every], touching=touching[::every], normal_force_N=size)

    found = whole_tick.errors(on, felt(1), swatch, swatch, 1)
    assert found["force"] == pytest.approx(0.0, abs=1e-6)
    assert found["vibration"] == pytest.approx(0.0, abs=1e-9)
    late = [whole_tick.errors(on, felt(every), swatch, swatch, every)["force"] for every in (2, 8)]
    assert 0.0 < late[0] < late[1]
    assert count > 1000


def test_projection_closes_in_by_the_cosine_and_the_active_set_is_there() -> None:
    one, next_ = (groove.error(20.0, steps)["off"] for steps in (10, 11))
    assert next_ / one == pytest.approx(math.cos(math.radians(20.0)), rel=1e-6)
    assert groove.error(20.0, 0)["off"] == groove.ROUNDING_M * 1e3


def test_swatches_of_a_growing_scene_are_all_worn() -> None:
    scene = growth._painted(10)
    worn = np.bincount(scene.bodies[0].face_swatch)
    assert worn[0] == 0
    assert len(worn) == 11
    assert worn[1:].min() == worn[1:].max() == 8192


def test_memory_that_is_held_is_counted() -> None:
    held_MB(lambda: np.ones(1000))
    assert held_MB(lambda: np.ones(5_000_000)) == pytest.approx(40.0, rel=0.1)


def test_advice_of_the_mesh_names_the_coarsest_that_is_not_felt() -> None:
    def point(label: str, direction: float, memory: float) -> Point:
        errors = {"direction": direction, "force": 0.5, "edge": 1.0, "memory": memory}
        return Point("toad", label, 1.0, 2.0, errors)

    points = [point("whole", 1.0, 9.0), point("÷8", DIRECTION_DEG - 1.0, 2.0), point("÷64", DIRECTION_DEG + 1.0, 0.1)]
    assert "toad ÷8 (2 MB of 9)" in mesh.advice(points)
    assert "toad whole" in mesh.advice(points[2:])


def test_a_body_alone_is_plain() -> None:
    on = touched(None, SPHERE, 400)
    assert on.scene(sphere(1)).swatches == [PLAIN]
    assert power_gain(ar_from_reflection(np.array([[0.5]])))[0] == pytest.approx(1.0 / 0.75)


def test_a_border_inside_faces_is_felt_nearer_its_place_the_finer_it_is_and_costs_as_much_more() -> None:
    coarse, fine = (painting.error(painting.SHARP, mm) for mm in (2.0, 0.5))
    soft = painting.error(painting.SOFT, 0.5)
    assert fine["border"] < 0.5 * coarse["border"] and coarse["border"] < 2.0 and soft["border"] < 0.5
    assert 2.0 < fine["memory"] / coarse["memory"] < 8.0
    assert painting.error("whole faces", 1e6)["border"] > 4.0
