"""The questions of forces, bodies, handles and sound: their error sides against closed forms; all advice."""

import json
import math

import numpy as np
import pytest

from hapscene.stability.closed_form import limit_with_wall_damping
from hapscene_evidence.chart import (
    audio_latency,
    compensator,
    force_rate,
    friction_model,
    pose_prediction,
    run,
    stabiliser,
)
from hapscene_evidence.chart.question import Point

NAMES = list(run.QUESTIONS)
OWN = NAMES[NAMES.index("texture-order") : NAMES.index("audio-latency") + 1]


@pytest.mark.parametrize("name", OWN)
def test_advice_is_of_the_points(name: str) -> None:
    question = run.question(name)
    told = []
    for seed in (0, 1):
        rng, points = np.random.default_rng(seed), []
        for s in question.settings(False, None):
            json.dumps(s.arguments)
            errors = {m.key: float(rng.uniform(0.2, 3.0)) for m in question.measures}
            points.append(Point(s.method, s.label, *sorted(rng.uniform(0.1, 2.0, 2).tolist()), errors))
        assert len({(p.method, p.label) for p in points}) == len(points)
        told.append(question.advice(points))
    assert told[0] != told[1] and "nan" not in "".join(told)
    assert 0 < len(question.settings(True, None)) <= len(question.settings(False, None))


def test_a_force_that_rises_is_late_by_what_it_rises_in_a_tick() -> None:
    """Held for 20 of the fast ones, of which the last five hundredths of the time are left out."""
    fast = np.zeros((20_000, 3))
    fast[:, 2] = 10.0 + 1e-4 * np.arange(20_000)
    expected = 0.95 * 19 * 1e-4 / (0.07 * 11.0)
    assert force_rate.off_jnd(fast[::20], fast) == pytest.approx(expected, rel=0.15)
    assert force_rate.off_jnd(fast, fast) == 0.0


@pytest.mark.parametrize(("device", "stiffest_N_m"), [("omni", 200.1), ("premium-1.5", 100.0), ("phantom-1.0", 10.0)])
def test_the_stiffest_wall_without_friction_is_the_reference_tables(device: str, stiffest_N_m: float) -> None:
    found = force_rate.error(device, 1000.0, quick=True)
    assert found["closed"] == pytest.approx(stiffest_N_m, rel=1e-3)
    assert (found["buzz"] > force_rate.REST_MM_S) == (device != "omni")


def test_friction_that_is_played_is_what_its_formula_says() -> None:
    press, speed = np.full(200, 1.2), np.full(200, 0.1)
    for model, expected in (
        ("sign", 0.4 * 1.2),
        ("viscous", 3.0 * 0.1),
        ("tanh", 0.48 * math.tanh(20.0)),
        ("stick", 0.48),
    ):
        played = friction_model.played_N(friction_model.rough(model, 0.4, 3.0), model, press, speed)
        np.testing.assert_allclose(played[50:], expected, rtol=1e-6)
    assert friction_model.off_jnd(np.full(100, 0.9), np.ones(100)) == pytest.approx(0.1 / 0.11)


def test_what_sticks_neither_creeps_nor_chatters_and_what_is_simpler_does() -> None:
    """Case F3: no drift; Dahl's model creeps many times the way that its bristle can bend."""
    bend_m = friction_model.COULOMB * friction_model.PRESS_N / friction_model.STIFFNESS_N_M
    assert friction_model.drift_m("stick") < 1e-9 and friction_model.ripple_N("stick") < 1e-4
    assert friction_model.drift_m("dahl") > 10.0 * bend_m
    assert friction_model.ripple_N("sign") > friction_model.COULOMB * friction_model.PRESS_N


def test_a_coupling_in_series_keeps_what_springs_in_series_keep() -> None:
    kept = stabiliser.error("coupling", "omni", 2000.0, ["press"])["kept"]
    assert kept == pytest.approx(100.0 / (1.0 + 2000.0 / 200.0), rel=0.02)


def test_a_wall_beyond_its_limit_gives_energy_and_one_damped_inside_it_none() -> None:
    assert limit_with_wall_damping(0.045, 0.1, 1e-3) < 2000.0
    bare = {name: stabiliser.error(name, "bare", 2000.0, ["tap"]) for name in ("none", "virtual damping")}
    assert bare["none"]["energy"] > 2.0 and bare["none"]["kept"] == 0.0
    assert bare["virtual damping"]["energy"] < 0.01 and bare["virtual damping"]["kept"] > 95.0


def test_a_body_that_goes_steadily_is_late_when_held_and_led_and_not_when_predicted() -> None:
    ticks, v = 20, 0.1  # of a frame, 50 a second
    off = {method: pose_prediction.swing_off_m(method, 50.0, v) for method in pose_prediction.METHODS}
    assert off["held"] == pytest.approx(v * 1e-3 * np.sqrt(np.mean(np.arange(ticks) ** 2.0)), rel=1e-9)
    assert off["led"] == pytest.approx(v * 1e-3 * ticks, abs=1.01 * v * 1e-3)
    assert off["predicted"] < 1e-12


def test_gaps_are_as_often_as_lateness_that_is_drawn_has_them() -> None:
    late_s = np.random.default_rng(0).exponential(3.1e-3 / math.log(2.0), 400_000)
    slack_s = 512 / audio_latency.CARD_HZ
    drawn = float(np.mean(late_s > slack_s)) * 60.0 * audio_latency.CARD_HZ / 512
    assert audio_latency.gaps_1_min(512, slack_s, 3.1e-3) == pytest.approx(drawn, rel=0.03)


def test_a_click_comes_as_late_as_the_stream_and_its_buffers_make_it() -> None:
    """5 ms in hand, 2 ms of the limiter's look-ahead, a tick, the filter's half, and the card's buffers."""
    block_s = 256 / audio_latency.CARD_HZ
    two, three = (audio_latency.felt_s(256, buffers) for buffers in (2, 3))
    assert three - two == pytest.approx(block_s, abs=1e-9)
    assert 7e-3 < two - block_s < 7e-3 + 2e-3 + 2.0 * block_s


def test_no_force_misses_all_and_what_is_learnt_misses_least() -> None:
    none, flat = (compensator.error(name, "", 1) for name in ("none", "flat"))
    learnt = compensator.error("adaptive", "known delay of 0 ms", 1)
    assert none["texture"] == pytest.approx(100.0) and none["tap"] == pytest.approx(100.0)
    assert learnt["texture"] < 5.0 < flat["texture"] < 60.0
