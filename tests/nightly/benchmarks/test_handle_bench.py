import numpy as np
import pytest

from hapscene.handle import COMPENSATORS, Plant
from hapscene_benchmarks import handle as bench


def test_signals_are_what_they_say() -> None:
    played = bench.signals()
    assert tuple(played) == bench.SIGNALS
    assert all(
        len(one) == round(bench.DURATION_S * bench.RATE_HZ) and np.isfinite(one).all() for one in played.values()
    )
    assert played["white"].std() == pytest.approx(2.0)
    assert np.abs(played["chirp"]).max() == pytest.approx(1.0, abs=1e-3)


def test_handles_are_drawn_inside_their_spread() -> None:
    for plant in bench.plants(20):
        off = [getattr(plant, name) / getattr(Plant(), name) for name in bench.PARAMETERS]
        assert min(off) >= 0.7 and max(off) <= 1.3 and len(set(off)) == 6
        assert plant.force_limit_N == Plant().force_limit_N


def test_the_sheet_and_its_chart() -> None:
    from matplotlib.figure import Figure

    sheet = bench.measure(count=1)
    for name in COMPENSATORS:
        assert sheet.number(f"handle, {name}", "sample least") > 0.0
    assert sheet.number("handle, none", "tap p95") == 100.0
    assert sheet.number("handle, adaptive", "white median") < 5.0
    left, right = Figure().subplots(1, 2)
    bench.draw_handle(sheet, left, right)
    assert left.get_ylabel() and right.get_ylabel() and left.get_xlabel()
