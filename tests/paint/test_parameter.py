"""A swatch's numbers: limits of the device as the renderer keeps them, and what follows when one is turned."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hapscene
from hapscene.device.model import IDEAL, limits_of
from hapscene.errors import EffectError
from hapscene.paint.model.tuning import Parameter, parameters_of, tuned
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.surface.effect import load_effect
from hapscene.surface.swatch import Swatch

ALL = [load_effect(name) for name in EFFECTS]
HARD = Swatch("hard", stiffness_N_m=5000.0, damping_Ns_m=1.0, friction_static=0.5, friction_dynamic=0.3)


def by_name(swatch: Swatch, device: str = "ideal") -> dict[str, Parameter]:
    limits = IDEAL if device == "ideal" else limits_of(device, 1e-3)
    return {p.name: p for p in parameters_of(swatch, ALL, limits)}


def test_displayed_values_equal_the_rendered_values(scene) -> None:
    scene.paint("plate", HARD)
    with pytest.warns(UserWarning, match="hard"):
        renderer = Renderer(scene, device="omni")
    clipped = {clip.number: clip.given for clip in renderer.clips if clip.swatch == "hard"}
    found = by_name(HARD, "omni")
    assert clipped["stiffness_N_m"] == found["stiffness_N_m"].given == limits_of("omni", 1e-3).stiffness_N_m
    assert found["stiffness_N_m"].value == 5000.0
    assert "omni" in found["stiffness_N_m"].note
    for name, given_value in clipped.items():
        assert found[name].given == given_value


@pytest.mark.parametrize("device", ["ideal", "omni", "premium-1.5"])
def test_slider_range_ends_at_the_device_limit(device) -> None:
    for swatch in (HARD, hapscene.load_swatch("wood"), Swatch("x", stiffness_N_m=0.0)):
        for p in by_name(swatch, device).values():
            assert p.minimum <= p.value <= p.maximum and np.isfinite(p.maximum)
    soft = by_name(Swatch("soft", stiffness_N_m=10.0), device)["stiffness_N_m"]
    assert soft.minimum == 0.0 and soft.maximum == min(limits_of(device, 1e-3).stiffness_N_m, 3000.0)


def test_a_parameter_of_two_effects_has_the_range_that_both_allow() -> None:
    ranges = {"wide": (0.0, 3.0), "high": (1.0, 5.0)}
    effects: list[Any] = [
        SimpleNamespace(name=name, params=[SimpleNamespace(name="give", minimum=low, maximum=high)])
        for name, (low, high) in ranges.items()
    ]
    for order in (effects, effects[::-1]):
        for value in (0.9, 3.1, np.nan):
            with pytest.raises(EffectError, match="1 to 3"):
                tuned(Swatch("x"), {"give": value}, order)
        for value in (1.0, 3.0):
            assert tuned(Swatch("x"), {"give": value}, order).effects == {name: {"give": value} for name in ranges}


def test_gains_without_what_they_turn_up_do_not_apply() -> None:
    assert not by_name(HARD)["texture_gain"].applies and not by_name(HARD)["tap_gain"].applies
    assert by_name(hapscene.load_swatch("wood"))["texture_gain"].applies


@settings(max_examples=40, deadline=None)
@given(
    st.dictionaries(st.sampled_from(["friction_static", "friction_dynamic", "stiffness_N_m"]), st.floats(0.0, 5.0)),
    st.floats(0.0, 2.0),
)
def test_friction_stays_in_order(numbers, start) -> None:
    made = tuned(Swatch("x", friction_static=start, friction_dynamic=start / 2), numbers, ALL)
    assert made.friction_dynamic <= made.friction_static
    if "friction_dynamic" in numbers:
        assert made.friction_dynamic == numbers["friction_dynamic"]
    elif "friction_static" in numbers:
        assert made.friction_static == numbers["friction_static"]


def test_effect_specific_value_does_not_override_a_new_value() -> None:
    swatch = Swatch("x", effects={"wall": {"damping_Ns_m": 3.0}, "other": {"kept": 1.0}})
    made = tuned(swatch, {"damping_Ns_m": 0.5, "tap_gain": 2.0}, ALL)
    assert by_name(made)["damping_Ns_m"].value == 0.5
    assert made.effects == {"other": {"kept": 1.0}, "tap": {"tap_gain": 2.0}}


def test_changed_parameter_loses_its_measured_interval() -> None:
    swatch = Swatch(
        "x",
        friction_static=0.4,
        friction_dynamic=0.2,
        intervals={"friction_dynamic": (0.1, 0.3), "friction_static": (0.3, 0.5)},
        absent={"stiffness_N_m": "no depth"},
    )
    made = tuned(swatch, {"friction_dynamic": 0.3, "stiffness_N_m": 400.0}, ALL)
    assert (dict(made.intervals), dict(made.absent)) == ({"friction_static": (0.3, 0.5)}, {})
