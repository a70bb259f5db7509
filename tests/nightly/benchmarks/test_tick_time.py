"""What is timed is what was meant: the ticks in contact. No test looks at a time itself."""

import numpy as np

from hapscene.renderer import EFFECTS, Renderer
from hapscene_benchmarks.case import sphere_cases
from hapscene_benchmarks.order import swatch_of_order
from hapscene_benchmarks.sheet import Sheet
from hapscene_benchmarks.tick_time import (
    PARTS,
    hot,
    measure_clock,
    measure_contact,
    measure_harness,
    measure_profile,
    measure_tick,
)

(CASE,) = sphere_cases((2,), 400)


def test_hot_times_each_tick_in_contact() -> None:
    found = hot(Renderer(CASE.scene(), effects=["wall"]), CASE.p_WT_m, repeats=2)
    deep = np.linalg.norm(CASE.p_WT_m, axis=1) < 0.048
    assert found.recording.touching[deep].all()
    assert not found.recording.touching[[0, -1]].any()
    assert len(found.contact_ns) == len(found.tick_ns) == found.recording.touching.sum()
    assert np.all(found.contact_ns <= found.tick_ns)


def test_all_figures_are_noted() -> None:
    sheet = Sheet()
    measure_clock(sheet)
    measure_contact(sheet, CASE, repeats=1)
    measure_tick(sheet, CASE, swatch_of_order(8), 8, repeats=1)
    measure_harness(sheet, CASE, repeats=1)
    assert sheet.number(CASE.name, "triangles") == 320
    assert sheet.number(CASE.name, "ticks in contact") > 100
    assert ("tick, order 8", "tick p99.9") in sheet
    assert ("harness", "four idle effects median") in sheet
    measure_profile(sheet, CASE, swatch_of_order(8), repeats=1)
    assert all(("profile", name) in sheet for name in (*PARTS, "clock", *EFFECTS))


def test_swatch_has_the_order_asked_for() -> None:
    texture = swatch_of_order(20).texture
    assert texture is not None
    assert texture.order == 20
