"""The Z-width: classification of trials, and the boundary of the region."""

import csv
import math
from dataclasses import astuple, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.device.model import TOUCH_SPEED_M_S, device_named, limits_of
from hapscene.device.sim.hand import Grip, grip_named
from hapscene.device.sim.omni import Omni
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.stability import study, z_width
from hapscene.stability.closed_form import limit_of_small_motion
from hapscene.stability.rig import Rig
from hapscene.stability.study import LABEL_RATIO, TOP_N_M, _draw_regions, _label, stability, verdicts
from hapscene.stability.z_width import (
    ABOVE_M,
    BELOW_M,
    MORE,
    REST_M_S,
    STIFFNESS_N_M,
    STILL_N,
    WORK_J,
    Point,
    StableRegion,
    Trial,
    describe,
    place,
    touch,
    trace,
    trace_all,
    try_wall,
)
from hapscene.surface.swatch import Swatch

LIGHT = grip_named("light")
POINT = device_named("omni").point or PointMass(1.0)


def test_stable_and_unstable_walls() -> None:
    rig = Rig(POINT, 1e-3)
    still, loud = try_wall(rig, 500.0, 0.0, LIGHT), try_wall(rig, 5000.0, 0.0, LIGHT)
    assert still.stable and still.end_speed_m_s < 1e-6 and still.work_J < 0.0
    assert not loud.stable and loud.end_speed_m_s > REST_M_S and loud.work_J > WORK_J


def test_a_trial_is_judged_by_speed_force_and_energy() -> None:
    at_rest = Trial(0.99 * REST_M_S, 0.99 * STILL_N, WORK_J)
    assert at_rest.stable
    for change in ({"end_speed_m_s": REST_M_S}, {"end_force_N": STILL_N}, {"work_J": 1.01 * WORK_J}):
        assert not replace(at_rest, **change).stable


class Played:
    """A rig of ticks of 10 ms whose tool moves with given speeds; each motion adds 0.9 mJ if `work`."""

    tick_s = 0.01

    def __init__(self, speeds_m_s: list[float], work: bool = False) -> None:
        self.speeds, self.work, self.asked = iter(speeds_m_s), work, list[Any]()

    def felt(self) -> Any:
        late = np.arange(30) >= 20  # what is before the last 0.1 s does not count
        speed = np.outer(np.where(late, next(self.speeds), 9.0), (0.6, 0.0, 0.8))
        force = np.outer(np.where(late, 0.03 * (-1.0) ** np.arange(30), 9.0), (0.0, 0.0, 1.0))
        return SimpleNamespace(v_W_m_s=speed, f_motor_W_N=force, work_J=np.full(30, 3e-5 * self.work))

    def follow(self, depth_m: Any, grip: object) -> Any:
        self.asked.append(depth_m)
        return self.felt()

    def stay(self, *asked: object) -> Any:
        self.asked.append(asked[:2])
        return self.felt()


def test_a_wall_is_pressed_at_three_depths_and_longer_while_the_tool_becomes_calmer() -> None:
    rig = Played([1e-3, 0.1, 0.08, 1e-3, 1e-3])
    assert astuple(touch(rig, LIGHT)) == pytest.approx((1e-3, 0.03, 0.0))  # type: ignore[arg-type]
    for depth, below in zip(np.array(rig.asked, object)[[0, 1, 4]], BELOW_M, strict=True):
        count = round((ABOVE_M + below) / TOUCH_SPEED_M_S / 0.01)
        assert len(depth) == count + 35 and (depth[0], *depth[count - 1 :]) == (-ABOVE_M, *[below] * 36)
    assert rig.asked[2:4] == [(BELOW_M[1], 35)] * 2
    for speeds, count in (([0.1, 0.081], 2), ([0.1 * 0.79**k for k in range(20)], 1 + MORE)):
        rig = Played(speeds)
        assert touch(rig, LIGHT).end_speed_m_s == pytest.approx(speeds[count - 1])  # type: ignore[arg-type]
        assert len(rig.asked) == count
    rig = Played([0.1 * 0.79**k for k in range(20)], work=True)
    assert touch(rig, LIGHT).work_J == pytest.approx(2.7e-3) and len(rig.asked) == 3  # type: ignore[arg-type]


def test_the_limit_is_found_by_doubling_and_bisection(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[float]()

    def trial(rig: object, stiffness_N_m: float, damping_Ns_m: float, grip: object) -> Any:
        assert rig == (point, 5e-4, 1)
        asked.append(stiffness_N_m)
        return SimpleNamespace(stable=stiffness_N_m < damping_Ns_m)

    monkeypatch.setattr(z_width, "try_wall", trial)
    monkeypatch.setattr(z_width, "Rig", lambda *given: given)
    point, grip = PointMass(0.05, 0.2), Grip(300.0, 2.0, 0.01)
    region = trace("a", point, point, 2000.0, 1, grip, (40.0, 700.0, 1e9))
    assert (region.device, region.rate_Hz, region.delay_ticks, region.damping_Ns_m) == (
        "a", 2000.0, 1, (40.0, 700.0, 1e9)
    )  # fmt: skip
    assert region.limit_N_m == (0.0, pytest.approx(700.0, rel=0.011), math.inf)
    assert asked == [50.0, 50.0, 100.0, 200.0, 400.0, 800.0, *asked[6:11], *(50.0 * 2.0**k for k in range(11))]
    closed = [limit_of_small_motion(0.06, 2.2, 5e-4, 1, B) for B in region.damping_Ns_m]
    assert list(region.closed_N_m) == closed


def test_regions_of_all_rates_delays_and_models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def traced(name: str, device: object, point: object, *given: Any) -> StableRegion:
        assert given[2:] == (LIGHT, [0.5]) and isinstance(device, Omni) == (name == "Omni")
        return StableRegion(name, *given[:2], (0.5,), (1.0,), (2.0,))

    monkeypatch.setattr(z_width, "trace", traced)
    said = list[str]()
    for device, names in (("omni", ["Omni", "as a point mass"]), ("premium-1.5", ["as a point mass"])):
        made = trace_all(device, (1e3, 4e3), (0, 1), LIGHT, said.append, (0.5,), journal=tmp_path / device, jobs=1)
        expected = [(name, rate, delay) for delay in (0, 1) for rate in (1e3, 4e3) for name in names]
        assert [(r.device, r.rate_Hz, r.delay_ticks) for r in made] == expected
        assert made[0] == StableRegion(names[0], 1e3, 0, (0.5,), (1.0,), (2.0,))
    assert len(said) == 12 and said[7] == "Z-width 8 of 8: as a point mass at 4 kHz, delay 1\n"


def test_friction_increases_and_delay_decreases_the_limit() -> None:
    dampings = (0.0, 2.0)
    with_it = trace("a", POINT, POINT, 1000.0, 0, LIGHT, dampings)
    late = trace("a", POINT, POINT, 1000.0, 1, LIGHT, dampings)
    assert with_it.limit_N_m[0] > 1.5 * with_it.closed_N_m[0]
    assert all(a < b for a, b in zip(late.limit_N_m, with_it.limit_N_m, strict=True))


def test_closed_form_bounds_the_limit_without_friction() -> None:
    bare = PointMass(POINT.mass_kg, 0.5)
    region = trace("bare", bare, bare, 1000.0, 0, LIGHT, (0.0, 1.0))
    for found, closed in zip(region.limit_N_m, region.closed_N_m, strict=True):
        assert 0.4 * closed < found < 1.05 * closed  # near the limit, bounces add more energy than allowed


def test_the_omni_is_stable_within_its_limits() -> None:
    points = place("omni", Omni(), 1000.0, 1, LIGHT, [Swatch("steel", 20_000.0, 3.0), Swatch("felt", 200.0)])
    steel, felt = points
    assert not steel.stable and steel.capped_stable and steel.capped_N_m < 1000.0
    assert felt.stable and felt.capped_stable and (felt.capped_N_m, felt.capped_Ns_m) == (200.0, felt.damping_Ns_m)


def test_many_swatches_at_one_position_share_a_label() -> None:
    several = [Point(name, 700.0, 0.0, 700.0, 0.0, False, False) for name in "abcde"]
    felt = Point("felt", 200.0, 0.5, 200.0, 0.5, True, True)
    labels = [_label(point, [*several, felt]) for point in (*several, felt)]
    assert labels == ["5 swatches: unstable", "", "", "", "", "felt"]
    assert _label(several[1], several[:4]) == "b: unstable"


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        (
            Point("wood", 5000.0, 0.0, 700.0, 0.0, False, True),
            "wood: 5000 N/m is unstable at 1 kHz; the device limits it to 700 N/m, which is stable",
        ),
        (Point("felt", 200.0, 0.5, 200.0, 0.5, True, True), "felt: 200 N/m, 0.5 N·s/m is stable at 1 kHz"),
        (
            Point("gel", 700.0, 0.0, 700.0, 0.0, False, False),
            "gel: 700 N/m is unstable at 1 kHz; it is within the limits of the device",
        ),
        (
            Point("gel", 700.0, 0.0, 700.0, 0.0, False, True),
            "gel: 700 N/m is unstable at 1 kHz; with the damping that the haptic tick adds, it is stable",
        ),
        (
            Point("tin", 5000.0, 2.0, 5000.0, 0.5, True, False),
            "tin: 5000 N/m, 2 N·s/m is stable at 1 kHz; the device limits it to 5000 N/m, 0.5 N·s/m, which is also "
            "unstable",
        ),
    ],
)
def test_describe(point: Point, expected: str) -> None:
    assert describe(point, 1000.0, 0) == expected
    assert describe(point, 4000.0, 2) == expected.replace("1 kHz", "4 kHz with a delay of 2 tick")


STEEL = Point("steel", 20_000.0, 2.0, 700.0, 0.0, False, True)
GEL = Point("gel", 19_000.0, 2.0, 19_000.0, 2.0, False, False)
FELT = Point("felt", 200.0, 0.0, 200.0, 0.0, True, True)


def test_swatches_that_are_stable_nowhere_or_within_limits_only_have_a_verdict_each() -> None:
    lines = verdicts({(1000.0, 0): [STEEL, FELT], (1000.0, 1): [FELT, GEL]})
    assert lines == [describe(STEEL, 1000.0, 0), describe(GEL, 1000.0, 1), "stable at every rate and delay: felt"]
    assert verdicts({(1000.0, 0): [GEL]}) == [describe(GEL, 1000.0, 0)]


def test_study_writes_its_tables_and_a_panel_for_each_rate_and_delay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures, said = list[Any](), list[str]()
    region = StableRegion("omni", 1000.0, 0, (0.0, 2.0, 8.0), (800.0, math.inf, 0.0), (-1.0, 900.0, 1e6))
    regions = [replace(region, rate_Hz=rate_Hz, delay_ticks=delay) for delay in (0, 2) for rate_Hz in (1e3, 2e3)]
    workers = list[Any]()
    monkeypatch.setattr(study, "trace_all", lambda *given, **more: workers.append((*given, more)) or regions)
    journal = tmp_path / ".out.sweep.jsonl"
    journal.write_text("")
    bodies = list[object]()
    monkeypatch.setattr(study, "place", lambda name, body, *given: bodies.append(body) or [STEEL, GEL, FELT])
    monkeypatch.setattr(study, "save_both", lambda figure, path, dpi: pictures.append(figure))
    made = stability(tmp_path / "out", "omni", (1000.0, 2000.0), (0, 2), LIGHT, [], said.append)
    assert [file.name for file in made] == ["swatches.csv", "z_width.csv"]
    assert len(said) == 9 and len(bodies) == 4 and all(isinstance(body, Omni) for body in bodies)
    assert not journal.exists() and workers == [
        ("omni", (1000.0, 2000.0), (0, 2), LIGHT, said.append, z_width.DAMPINGS_NS_M,
         {"journal": journal, "jobs": None, "scheduler": None})
    ]  # fmt: skip
    with made[1].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12 and list(rows[1].values()) == ["omni", "1000", "0", "2", "inf", "900"]
    with made[0].open(encoding="utf-8", newline="") as file:
        assert list(list(csv.reader(file))[-1]) == ["2000", "2", "felt", "200", "0", "200", "0", "True", "True"]

    axes = pictures[0].axes
    titles = ["1 kHz, no delay", "2 kHz, no delay", "1 kHz, delay 2 ticks", "2 kHz, delay 2 ticks"]
    assert [ax.get_title("left") for ax in axes] == titles
    assert pictures[0].get_size_inches().tolist() == [10.0, 8.8] and pictures[0].legends[0]._ncols == 2
    assert [bool(ax.get_xlabel()) for ax in axes] == [False, False, True, True]
    assert [bool(ax.get_ylabel()) for ax in axes] == [True, False, True, False]
    lines = {line.get_label(): line.get_xydata() for line in axes[0].lines}
    bottom = axes[0].get_ylim()[0]
    assert lines["omni: simulated limit"].tolist() == [[0.0, 800.0], [2.0, TOP_N_M], [8.0, bottom]]
    assert lines["closed form, without friction"].tolist() == [[2.0, 900.0], [8.0, TOP_N_M]]
    caps = limits_of("omni", 1e-3, 0)
    K, B = caps.stiffness_N_m, caps.damping_Ns_m
    assert lines["limits of the device"].tolist() == [[0.0, K], [B, K], [B, bottom]]
    marks = [(line.get_marker(), *line.get_xydata()[0]) for line in axes[0].lines if line.get_zorder() == 5]
    assert marks == [("o", 0.0, 200.0), ("X", 2.0, 19_000.0), ("X", 2.0, 20_000.0)]
    assert axes[0].get_legend_handles_labels()[1][-2:] == ["stable swatch", "unstable swatch"]
    assert [line.get_marker() for line in axes[0].lines[-2:]] == ["o", "X"]
    ideal = Point("felt", 200.0, 0.0, 200.0, 0.0, True, True)
    monkeypatch.setattr(study, "place", lambda name, body, *given: bodies.append(body) or [ideal])
    del regions[1:]
    stability(tmp_path / "point", "premium-1.5", (1000.0,), (0,), LIGHT, [], dampings_Ns_m=(0.0, 1.0), jobs=3)
    assert isinstance(bodies[-1], PointMass) and workers[-1][5:] == (
        (0.0, 1.0), {"journal": tmp_path / ".point.sweep.jsonl", "jobs": 3, "scheduler": None}
    )  # fmt: skip
    assert pictures[1].get_size_inches().tolist() == [5.2, 4.4] and pictures[1].legends[0]._ncols == 1
    labels = {note.get_text(): (note.xy, note.get_position(), note.get_ha()) for note in axes[0].texts}
    assert labels == {
        "felt": ((0.0, 200.0), (-0.12, 200.0), "right"),
        "gel: unstable": ((2.0, 19_000.0), (2.7, 19_000.0), "left"),
        "steel: unstable": ((2.0, 20_000.0), (2.7, pytest.approx(LABEL_RATIO * 19_000.0)), "left"),
    }
    with pytest.raises(HapsceneError, match="no mass"):
        stability(tmp_path / "out", "ideal", (1000.0,), (0,), LIGHT, [])


def test_the_chart_fills_the_first_region_and_draws_the_others_as_lines() -> None:
    from matplotlib.figure import Figure

    axes, damping = Figure().add_subplot(), (0.0, 1.0, 2.0)
    first = StableRegion("omni", 1000.0, 0, damping, (0.0, 500.0, math.inf), (300.0, 400.0, 0.0))
    _draw_regions(axes, [first, replace(first, device="falcon", limit_N_m=(60.0, 70.0, 80.0))])
    (filled,) = axes.collections
    low = STIFFNESS_N_M[0]
    assert filled.get_paths()[0].vertices[:, 1].min() == low and filled.get_paths()[0].vertices[:, 1].max() == TOP_N_M
    lines = [(line.get_xdata().tolist(), line.get_ydata().tolist()) for line in axes.lines]
    assert lines == [([0, 1, 2], [low, 500.0, TOP_N_M]), ([0, 1, 2], [60.0, 70.0, 80.0]), ([0, 1], [300.0, 400.0])]
    assert axes.get_ylim() == (low, TOP_N_M) and axes.get_yscale() == "log" and axes.get_xscale() == "symlog"
    assert axes.get_xlim()[0] == -0.75 and not len(axes.get_xticks(minor=True)) and not len(axes.get_yticks(minor=True))
    assert [text.get_text() for text in axes.get_xticklabels()] == ["0", "0.5", "2", "8", "32", "128"]
    assert [text.get_text() for text in axes.get_yticklabels()][2:4] == ["1,000", "5,000"]
    assert [text.split(":")[0] for text in axes.get_legend_handles_labels()[1]][:3] == ["omni", "omni", "falcon"]
