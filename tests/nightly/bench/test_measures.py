"""Measurements of the benchmark: paths, cases, errors and figures. No test depends on a time."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene.handle import COMPENSATORS, Plant
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene_evidence.bench import handle
from hapscene_evidence.bench.accuracy import distances, measure_accuracy
from hapscene_evidence.bench.case import (
    sphere,
    sphere_cases,
)
from hapscene_evidence.bench.sheet import Sheet
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


def test_random_handles_are_within_their_spread() -> None:
    for plant in handle.plants(20):
        off = [getattr(plant, name) / getattr(Plant(), name) for name in handle.PARAMETERS]
        assert min(off) >= 0.7 and max(off) <= 1.3 and len(set(off)) == 6
    sheet = Sheet()
    handle.measure_handle(sheet, 1)
    assert all(sheet.number(f"handle, {name}", "sample least") > 0.0 for name in COMPENSATORS)
    assert sheet.number("handle, none", "tap p95") == 100.0 and sheet.number("handle, adaptive", "white median") < 5.0


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
