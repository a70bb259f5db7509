"""The swatch: its checks and what effects get from it."""

import pickle

import numpy as np
import pytest

from hapscene.errors import SwatchError
from hapscene.surface.swatch import PLAIN, Swatch
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
