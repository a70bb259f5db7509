"""Measurements of the benchmark: paths, cases, errors and figures. No test depends on a time."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.constants import TICK_S
from hapscene.errors import HapsceneError
from hapscene.handle import COMPENSATORS, Plant
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene_evidence.bench import handle
from hapscene_evidence.bench.accuracy import angle_deg, distances, measure_accuracy
from hapscene_evidence.bench.case import (
    PRESS_M,
    RADIUS_M,
    SLIDE_M_S,
    START_M,
    WIGGLES,
    short,
    slide_path,
    sphere,
    sphere_cases,
)
from hapscene_evidence.bench.sheet import Sheet, spread
from hapscene_evidence.bench.surface_fit import measure_fit
from hapscene_evidence.bench.tick_time import (
    hot,
    measure_clock,
    measure_contact,
    measure_effects,
    measure_harness,
    measure_tick,
    swatch_of_order,
)

(CASE,) = sphere_cases((2,), 400)


def test_path_approaches_presses_slides_and_leaves() -> None:
    path = slide_path()
    distance_m = np.linalg.norm(path, axis=1)
    assert path.shape == (10_000, 3) and distance_m[[0, -1]] == pytest.approx(START_M)
    depth_m, most_m = RADIUS_M - distance_m[1000:9000], sum(a for _, a in WIGGLES)
    assert PRESS_M - most_m - 1e-12 <= depth_m.min() and depth_m.max() <= PRESS_M + most_m + 1e-12
    assert depth_m.mean() == pytest.approx(PRESS_M, abs=1e-4)
    assert np.all(np.diff(distance_m[:1000]) < 0.0) and np.all(np.diff(distance_m[9000:]) > 0.0)
    direction = path[1100:8900] / distance_m[1100:8900, None]
    assert RADIUS_M * np.linalg.norm(np.diff(direction, axis=0), axis=1) / TICK_S == pytest.approx(SLIDE_M_S, rel=1e-2)
    assert np.linalg.norm(slide_path(400), axis=1).min() < RADIUS_M - 1e-3


def test_sphere_has_its_faces_on_its_radius_and_counts_have_short_names() -> None:
    mesh = sphere(2)
    assert len(mesh.faces) == 320
    assert np.linalg.norm(mesh.vertices_m, axis=1) == pytest.approx(RADIUS_M)
    assert [short(count) for count in (1280, 81_920, 1_310_720)] == ["1 k", "82 k", "1.31 M"]


def test_direction_error_is_the_angle() -> None:
    p = np.array([[0.0, 0.0, 0.048], [0.048, 0.0, 0.0]])
    turned = np.array([[np.sin(0.1), 0.0, np.cos(0.1)], [3.0, 0.0, 0.0]])
    assert angle_deg(turned, p) == pytest.approx([np.degrees(0.1), 0.0])


def test_distances_to_facets() -> None:
    corners = sphere(2).triangles_m
    middle = corners.mean(axis=1)
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    gap, lag = distances(corners, middle - 1e-5 * n, middle - 5e-4 * n)
    assert gap == pytest.approx(-1e-5, abs=1e-12) and lag == pytest.approx(1e-5, abs=1e-12)


def test_proxy_of_a_slide_is_on_the_facets() -> None:
    (case,) = sphere_cases((3,), 400)
    sheet = Sheet()
    measure_accuracy(sheet, case, Renderer(case.scene(), effects=["wall"]).run(case.p_WT_m))
    assert sheet.number(case.name, "proxy to facets max") < 1e-7


def test_hot_times_each_tick_in_contact() -> None:
    found = hot(Renderer(CASE.scene(), effects=["wall"]), CASE.p_WT_m, repeats=2)
    assert found.recording.touching[np.linalg.norm(CASE.p_WT_m, axis=1) < 0.048].all()
    assert not found.recording.touching[[0, -1]].any()
    assert len(found.contact_ns) == len(found.tick_ns) == found.recording.touching.sum()
    assert np.all(found.contact_ns <= found.tick_ns)


def test_all_figures_of_the_tick_are_measured() -> None:
    sheet, swatch = Sheet(), swatch_of_order(8)
    assert swatch.texture is not None and swatch.texture.order == 8
    measure_clock(sheet)
    measure_contact(sheet, CASE, repeats=1)
    measure_tick(sheet, CASE, swatch, 8, repeats=1)
    measure_harness(sheet, CASE, repeats=1)
    measure_effects(sheet, CASE, swatch, repeats=1)
    assert sheet.number(CASE.name, "triangles") == 320 and sheet.number(CASE.name, "ticks in contact") > 100
    assert ("tick, order 8", "tick p99.9") in sheet and ("harness", "four idle effects median") in sheet
    assert all(("profile", name) in sheet for name in EFFECTS)


def test_time_and_memory_of_a_fit_are_measured() -> None:
    sheet = Sheet()
    measure_fit(sheet, (2.0,))
    assert sheet.cases("fit, ") == ["fit, 2 s"]
    assert sheet.number("fit, 2 s", "time") > 0.0 and sheet.number("fit, 2 s", "memory") > 2.0


def test_random_handles_are_within_their_spread() -> None:
    for plant in handle.plants(20):
        off = [getattr(plant, name) / getattr(Plant(), name) for name in handle.PARAMETERS]
        assert min(off) >= 0.7 and max(off) <= 1.3 and len(set(off)) == 6
    sheet = Sheet()
    handle.measure_handle(sheet, 1)
    assert all(sheet.number(f"handle, {name}", "sample least") > 0.0 for name in COMPENSATORS)
    assert sheet.number("handle, none", "tap p95") == 100.0 and sheet.number("handle, adaptive", "white median") < 5.0


def test_quantiles_are_nearest_ranks() -> None:
    values = np.random.default_rng(0).permutation(np.arange(1, 1001))
    assert spread(values) == {"median": 500, "p99": 990, "p99.9": 999, "max": 1000}
    with pytest.raises(HapsceneError):
        spread([])


def test_sheet_is_read_back_from_its_file(tmp_path: Path) -> None:
    sheet = Sheet()
    sheet.add("machine", "processor", "a, b")
    sheet.add_spread("one", "contact", [1000.0, 2000.0, 3000.0], "µs", 1e-3)
    sheet.write(tmp_path / "bench.csv")
    read = Sheet.read(tmp_path / "bench.csv")
    assert list(read) == list(sheet)
    assert read.number("one", "contact median") == 2.0 and read.cases("o") == ["one"]
    (tmp_path / "other.csv").write_text("x,y\n1,2\n")
    with pytest.raises(HapsceneError, match=r"other\.csv"):
        Sheet.read(tmp_path / "other.csv")
    with pytest.raises(HapsceneError, match="'b' of 'a'"):
        sheet.number("a", "b")
