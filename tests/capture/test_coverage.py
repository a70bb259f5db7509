"""What a recording lacks: against the fit's own pieces, and against simulated signals."""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.capture.fit.friction import Friction, fit_friction
from hapscene.capture.fit.segment import segment
from hapscene.capture.fit.windows import cut
from hapscene.capture.io.streams import clean
from hapscene.capture.record.coverage import Coverage, Wanted
from hapscene.errors import CaptureError
from tests.capture.probe_simulator import COLUMNS, strokes

from .simulated_tool import noisy, pulled

RATE_HZ = 5000.0
ALL = ("acceleration", "force", "speed")


def slid(force_N: float, speed_m_s: float, seconds: float, rms: float = 1.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Noise of a level, at one force and speed."""
    count = round(seconds * RATE_HZ)
    noise = rms * np.random.default_rng(seed).normal(size=count)
    return {"acceleration": noise, "force": np.full(count, force_N), "speed": np.full(count, speed_m_s)}


def add(coverage: Coverage, streams: Mapping[str, np.ndarray]) -> None:
    coverage.feed(round(coverage.seconds * coverage.rate_Hz), streams)


def middles(coverage: Coverage) -> list[tuple[float, float]]:
    force, speed = (np.sqrt(edges[1:] * edges[:-1]) for edges in (coverage.force_N, coverage.speed_m_s))
    return [(float(f), float(v)) for f in force for v in speed]


def test_pieces_are_those_of_the_fit() -> None:
    rng = np.random.default_rng(3)
    t_s = np.arange(round(20.0 * RATE_HZ)) / RATE_HZ
    force = np.exp(0.6 * np.sin(1.1 * t_s))
    speed = 0.08 * np.exp(0.8 * np.sin(1.7 * t_s))
    acceleration = 5.0 * speed / 0.1 * np.sqrt(force) * rng.normal(size=len(t_s))
    coverage = Coverage(RATE_HZ, ALL)
    coverage.feed(0, {"acceleration": acceleration, "force": force, "speed": speed})
    own = cut(clean(acceleration, RATE_HZ, force, speed))
    table = np.zeros_like(coverage.pieces)
    for f, v in zip(own.force_N, own.speed_m_s, strict=True):
        table[coverage.cell(f, v)] += 1
    assert coverage.pieces.sum() == len(own) == 200
    assert np.abs(coverage.pieces - table).sum() <= 6  # of those that lie on an edge


@given(st.lists(st.integers(1, 3000), min_size=1, max_size=30))
@settings(max_examples=20, deadline=None)
def test_any_blocks_give_the_same(sizes: list[int]) -> None:
    streams = slid(1.0, 0.1, 1.0)
    streams["force"] = np.geomspace(0.4, 2.0, len(streams["force"]))
    whole, parts = Coverage(RATE_HZ, ALL), Coverage(RATE_HZ, ALL)
    whole.feed(0, streams)
    edges = np.unique(np.clip(np.cumsum([0, *sizes]), 0, len(streams["force"])))
    edges = np.unique([*edges, len(streams["force"])])
    for first, last in pairwise(edges):
        parts.feed(int(first), {name: row[first:last] for name, row in streams.items()})
    np.testing.assert_array_equal(whole.pieces, parts.pieces)
    assert parts.advice() == whole.advice()


def test_it_is_enough_when_every_cell_is() -> None:
    coverage = Coverage(RATE_HZ, ALL, Wanted(taps=0))
    for k, place in enumerate(middles(coverage) * 2):
        assert not coverage.enough
        add(coverage, slid(*place, 0.5, seed=k))
        if coverage.enough:
            break
    assert coverage.enough and coverage.advice() == "enough: every cell is filled"
    assert (coverage.pieces >= 10).all() and coverage.target is None


def test_advice_leads_there() -> None:
    """Who does as the words say comes to the cell that is shown, wherever he was."""
    for force, speed in ((0.32, 0.02), (2.9, 0.29), (0.32, 0.29), (2.9, 0.021), (5.0, 0.5), (0.2, 0.01)):
        coverage = Coverage(RATE_HZ, ALL, Wanted(taps=0))
        for turn in range(400):
            add(coverage, slid(force, speed, 0.05, seed=turn))
            words = coverage.advice()
            if words.startswith("enough"):
                break
            force *= 1.1 ** (("harder" in words) - ("lightly" in words))
            speed *= 1.1 ** (("faster" in words) - ("slower" in words))
        assert coverage.enough, (coverage.pieces, words)
        assert turn < 350


def test_words() -> None:
    coverage = Coverage(RATE_HZ, ALL)
    add(coverage, slid(0.0, 0.1, 0.3))
    assert coverage.advice() == "put the tool down and stroke"
    add(coverage, slid(1.0, 0.0, 0.3))
    assert coverage.advice() == "stroke"
    coverage = Coverage(RATE_HZ, ALL)
    add(coverage, slid(1.0, 0.1, 0.08))  # where it begins it may stay, until that is enough
    assert coverage.advice() == "good: go on like this"
    add(coverage, slid(1.0, 0.1, 3.0))  # that is enough there
    assert set(coverage.advice().split(", ")) < {"press harder", "press more lightly", "faster", "slower"}
    assert coverage.target is not None and coverage.share[coverage.target] < 1.0


def test_a_cell_that_the_hand_does_not_come_to_waits() -> None:
    coverage = Coverage(RATE_HZ, ALL)
    targets = set()
    for turn in range(300):
        add(coverage, slid(1.0, 0.1, 0.05, seed=turn))
        coverage.advice()
        targets.add(coverage.target)
    assert len(targets) > 2


def test_taps_and_slides_that_break_away() -> None:
    coverage = Coverage(RATE_HZ, (*ALL, "tangential_force"))
    assert coverage.lacks == [
        "lift and tap three times",
        "stop, stay pressed, and pull gently until it slides, three times",
    ]
    for k in range(3):
        for force, speed, seconds in ((0.0, 0.0, 0.2), (2.0, 0.0, 0.06), (0.0, 0.0, 0.2), (1.0, 0.0, 0.3)):
            add(coverage, slid(force, speed, seconds, seed=k))
        assert (coverage.taps, coverage.starts) == (k + 1, k)  # one that lasts is none
        add(coverage, slid(1.0, 0.1, 0.3))
    assert coverage.starts == 3 and coverage.lacks == []


def test_without_force_or_speed_it_says_what_cannot_be_guided() -> None:
    streams = slid(1.0, 0.1, 5.0)
    for left_out, shape in (("force", (1, 4)), ("speed", (3, 1))):
        there = tuple(name for name in ALL if name != left_out)
        coverage = Coverage(RATE_HZ, there)
        coverage.feed(0, {name: streams[name] for name in there})
        assert coverage.pieces.shape == shape and coverage.pieces.sum() == 50
        assert [text.split()[0] for text in coverage.limits] == [left_out]
        assert "press" not in coverage.advice() if left_out == "force" else "faster" not in coverage.advice()
    coverage = Coverage(RATE_HZ, ("acceleration",))
    for turn in range(10):
        add(coverage, {"acceleration": slid(1.0, 0.1, 1.0, seed=turn)["acceleration"]})
    assert len(coverage.limits) == 2 and coverage.enough
    with pytest.raises(CaptureError, match="no acceleration"):
        Coverage(RATE_HZ, ("force", "speed"))


def test_a_position_gives_the_speed() -> None:
    t_s = np.arange(round(3.0 * RATE_HZ)) / RATE_HZ
    at = 0.05 / 2.0 * np.array([np.cos(2.0 * t_s), np.sin(2.0 * t_s)])  # a circle, 50 mm/s
    coverage = Coverage(RATE_HZ, ("acceleration", "force", "position"))
    noise = np.random.default_rng(0).normal(size=len(t_s))
    for part in np.array_split(np.arange(len(t_s)), 37):
        coverage.feed(int(part[0]), {"acceleration": noise[part], "force": np.ones(len(part)), "position": at[:, part]})
    assert coverage.now.speed_m_s == pytest.approx(0.05, rel=0.01)
    assert coverage.pieces[:, 1].sum() == coverage.pieces.sum() >= 28


def test_what_is_cut_off_is_told() -> None:
    streams = slid(1.0, 0.1, 2.0, rms=10.0)
    from scipy.signal import butter, sosfilt

    smooth = sosfilt(butter(2, 400.0, fs=RATE_HZ, output="sos"), streams["acceleration"])
    counts = np.round(smooth / 0.01) * 0.01
    for most, cut_off in ((np.inf, False), (6.0, True)):
        coverage = Coverage(RATE_HZ, ALL)
        coverage.feed(0, {**streams, "acceleration": np.clip(counts, -most, most)})
        assert (coverage.clipped > 0) == cut_off
    truth = np.count_nonzero(np.abs(counts) >= 6.0)
    assert 0.3 * truth < coverage.clipped < truth


def test_a_probe_of_coarse_steps_is_not_cut_off() -> None:
    """The simulator's columns, in its own counts; and a still sensor of three steps."""
    coverage, made = Coverage(10_000.0, ALL), strokes(10_000.0)
    for turn in range(1000):
        counts = next(made)
        rows = {c.name: counts[:, i] * c.scale for i, c in enumerate(COLUMNS)}
        coverage.feed(turn * len(counts), rows)
    assert coverage.clipped == 0 and coverage.pieces.sum() > 60
    still = Coverage(RATE_HZ, ("acceleration",))
    still.feed(0, {"acceleration": np.random.default_rng(0).integers(-1, 2, 20_000) * 0.01})
    assert still.clipped == 0


def test_gaps_are_counted_and_no_piece_reaches_over_one() -> None:
    coverage, streams = Coverage(RATE_HZ, ALL), slid(1.0, 0.1, 1.0)
    half = {name: row[: 2400 + 1] for name, row in streams.items()}  # 0.48 s: four pieces and a rest
    coverage.feed(0, half)
    coverage.feed(2401 + 99, half)
    assert coverage.dropped == 99 and coverage.pieces.sum() == 8
    assert coverage.seconds == pytest.approx((2 * 2401 + 99) / RATE_HZ)


def test_what_is_wanted_must_make_sense() -> None:
    for wrong in ({"force_N": (2.0, 1.0)}, {"speed_m_s": (0.0, 1.0)}, {"force_N": (1.0, np.inf)}):
        with pytest.raises(CaptureError, match="must range from"):
            Wanted(**wrong)  # type: ignore[arg-type]
    with pytest.raises(CaptureError, match="rate_Hz must be above"):
        Coverage(100.0, ALL)


def pulling(stops: int, gently_s: float, seed: int = 0, rate_Hz: float = 2000.0) -> tuple[Coverage, Friction]:
    """What is counted and what friction is fitted where a hand on a spring slides on, or stops so often and pulls on.

    Friction is 0.55 at rest and 0.4 in sliding, by the equations of a mass that is pulled.
    """
    rng, speed_m_s, drive = np.random.default_rng(seed), 0.08, []
    for stop in range(4):
        drive.append(speed_m_s * (1.0 + 0.3 * np.sin(2.0 * np.pi * np.arange(2000) / rate_Hz)))
        if stop < stops:
            rest = np.maximum(np.linspace(speed_m_s, -7.0 * speed_m_s, 800), 0.0)  # it stops within 50 ms
            drive += [rest, speed_m_s * np.linspace(0.0, 1.0, round(gently_s * rate_Hz))]
    driven = np.concatenate(drive)
    normal = 1.5 + 0.2 * np.sin(2.0 * np.arange(len(driven)) / rate_Hz)
    speed, pull = pulled(driven, normal, 0.55, lambda v: 0.4, rate_Hz, spring_N_m=300.0)
    streams = {
        "acceleration": np.where(speed > 1e-3, 1.0, 0.02) * rng.standard_normal(len(speed)),
        "force": noisy(normal, rng, 30.0),
        "speed": np.abs(speed + 5e-4 * rng.standard_normal(len(speed))),
        "tangential_force": noisy(pull, rng, 30.0),
    }
    coverage = Coverage(rate_Hz, tuple(streams))
    coverage.feed(0, streams)
    channels = clean(streams["acceleration"], rate_Hz, *(streams[name] for name in tuple(streams)[1:]))
    return coverage, fit_friction([(channels, segment(channels))])


def test_who_stops_and_pulls_gently_as_advised_has_friction_found() -> None:
    coverage, found = pulling(3, 0.3)
    assert coverage.starts == 3 and coverage.lacks == ["lift and tap three times"]
    assert found.static == pytest.approx(0.55, rel=0.05) and found.dynamic == pytest.approx(0.4, rel=0.05)


def test_who_does_not_has_no_static_friction() -> None:
    coverage, found = pulling(0, 0.1)
    assert coverage.starts == 0 and "stop, stay pressed, and pull gently" in coverage.lacks[1]
    assert "friction_static" in found.absent and found.static == found.dynamic
