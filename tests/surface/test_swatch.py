"""The swatch: its checks and what effects get from it."""

import pickle

import numpy as np
import pytest

from hapscene.errors import SwatchError
from hapscene.surface.swatch import FRICTION_MAX, NAME_MAX, PLAIN, Swatch, tip_radius_of, touched_with
from hapscene.surface.taps import Taps


def test_plain_swatch() -> None:
    assert PLAIN.stiffness_N_m > 0.0
    assert (PLAIN.friction_static, PLAIN.friction_dynamic, PLAIN.texture, PLAIN.taps) == (0.0, 0.0, None, None)


def test_parameter_precedence() -> None:
    swatch = Swatch("oak", stiffness_N_m=600.0, effects={"wall": {"stiffness_N_m": 300.0}, "push": {"push_N": 2}})
    assert swatch.parameter("wall", "stiffness_N_m", 1.0) == 300.0
    assert swatch.parameter("friction", "stiffness_N_m", 1.0) == 600.0
    assert swatch.parameter("push", "push_N", 0.1) == 2.0
    assert swatch.parameter("push", "other", 0.1) == 0.1


def test_what_is_given_is_copied_and_converted() -> None:
    effects, intervals, absent = {"push": {"push_N": 2}}, {"damping_Ns_m": [1, 1]}, {"taps": "none"}
    swatch = Swatch("oak", 600, albedo_rgb=[0, 0.5, 1], effects=effects, intervals=intervals, absent=absent)
    effects["push"]["push_N"], intervals["damping_Ns_m"], absent["taps"] = 3, [0, 9], "some"
    assert swatch.effects == {"push": {"push_N": 2.0}} and type(swatch.effects["push"]["push_N"]) is float
    assert swatch.intervals == {"damping_Ns_m": (1.0, 1.0)} and swatch.absent == {"taps": "none"}
    assert swatch.albedo_rgb == (0.0, 0.5, 1.0) and type(swatch.stiffness_N_m) is float
    assert swatch.own_numbers == {
        "stiffness_N_m": 600.0, "damping_Ns_m": PLAIN.damping_Ns_m, "friction_static": 0.0, "friction_dynamic": 0.0
    }  # fmt: skip
    assert Swatch("oak", adhesion_N=0.1).own_numbers["adhesion_N"] == 0.1


def test_largest_values_are_accepted() -> None:
    longest = "x" * NAME_MAX
    swatch = Swatch(longest, 1e9, 0.0, FRICTION_MAX, FRICTION_MAX, tool=longest, tip=longest)
    assert (swatch.friction_static, swatch.name, swatch.tip) == (FRICTION_MAX, longest, longest)


def test_the_tool_and_the_radius_of_its_tip() -> None:
    assert touched_with(Swatch("a", tool="probe", tip="3 mm ball")) == "probe, 3 mm ball"
    assert touched_with(Swatch("a", tip="felt")) == "felt" and touched_with(PLAIN) == ""
    tips = ("3.2 mm ball", "3mm ball", "0 mm ball", "felt", "")
    assert [tip_radius_of(Swatch("a", tip=tip)) for tip in tips] == [1.6e-3, 1.5e-3, None, None, None]


def test_equality_hash_and_pickle() -> None:
    swatch = Swatch("oak", taps=Taps([0.1], [1.0], [100.0], [80.0]))
    same = Swatch("oak", taps=Taps([0.1], [1.0], [100.0], [80.0]))
    assert swatch == same and hash(swatch) == hash(same)
    assert swatch != Swatch("oak")
    assert pickle.loads(pickle.dumps(swatch)) == swatch


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"name": "a\nb"}, "name"),
        ({"name": ""}, "name"),
        ({"name": "x" * (NAME_MAX + 1)}, "name"),
        ({"tool": "x" * (NAME_MAX + 1)}, "tool"),
        ({"tool": 3}, "tool"),
        ({"intervals": {"friction_static": (0.0, np.inf)}}, "intervals.friction_static"),
        ({"intervals": {"friction_static": (-np.inf, 0.0)}}, "intervals.friction_static"),
        ({"intervals": {"friction_static": (0.0, 0.5, 1.0)}}, "intervals.friction_static"),
        ({"intervals": {"\ud800": (0.0, 1.0)}}, "intervals"),
        ({"licence": "\ud800"}, "licence"),
        ({"absent": {"\ud800": ""}}, "absent"),
        ({"effects": {"\ud800": {}}}, "effects"),
        ({"albedo_rgb": (-0.1, 0.2, 0.3)}, "albedo_rgb"),
        ({"stiffness_N_m": -1.0}, "stiffness_N_m"),
        ({"stiffness_N_m": 1e308}, "stiffness_N_m"),
        ({"damping_Ns_m": np.nan}, "damping_Ns_m"),
        ({"friction_static": 0.1, "friction_dynamic": 0.2}, "friction"),
        ({"friction_static": 6.0}, "friction"),
        ({"albedo_rgb": (0.1, 0.2)}, "albedo_rgb"),
        ({"albedo_rgb": (0.1, 0.2, 1.1)}, "albedo_rgb"),
        ({"effects": {"push": {"push_N": np.inf}}}, "effects.push.push_N"),
        ({"provenance": "by \ud800"}, "provenance"),
        ({"effects": {"push": {"\ud800": 1.0}}}, "effects"),
        ({"absent": {"taps": "\ud800"}}, "absent"),
    ],
)
def test_invalid_numbers_are_rejected(change: dict[str, object], field: str) -> None:
    with pytest.raises(SwatchError, match=field):
        Swatch(**({"name": "oak"} | change))


@pytest.mark.parametrize("part", ["texture", "taps", "leaving"])
def test_a_part_of_another_type_is_refused(part: str) -> None:
    with pytest.raises(SwatchError, match=part):
        Swatch("oak", **{part: {"approach_m_s": [0.1]}})
