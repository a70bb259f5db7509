"""The Z-width: classification of trials, and the boundary of the region."""

import pytest

from hapscene.device.model import device_named
from hapscene.device.sim.hand import grip_named
from hapscene.device.sim.omni import Omni
from hapscene.device.sim.point import PointMass
from hapscene.stability.rig import Rig
from hapscene.stability.study import _label
from hapscene.stability.z_width import REST_M_S, WORK_J, Point, describe, place, trace, try_wall
from hapscene.surface.swatch import Swatch

LIGHT = grip_named("light")
POINT = device_named("omni").point or PointMass(1.0)


def test_stable_and_unstable_walls() -> None:
    rig = Rig(POINT, 1e-3)
    still, loud = try_wall(rig, 500.0, 0.0, LIGHT), try_wall(rig, 5000.0, 0.0, LIGHT)
    assert still.stable and still.end_speed_m_s < 1e-6 and still.work_J < 0.0
    assert not loud.stable and loud.end_speed_m_s > REST_M_S and loud.work_J > WORK_J


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
    assert felt.stable and felt.capped_stable and felt.capped_N_m == 200.0


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
    ],
)
def test_describe(point: Point, expected: str) -> None:
    assert describe(point, 1000.0, 0) == expected
