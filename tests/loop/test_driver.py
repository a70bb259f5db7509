"""The driver: start of ticks, counted delays, targets of the hand, and arguments that a servo rejects."""

import ctypes
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import trimesh

from hapscene.clock import LOOK_NS, VIRTUAL, new_clock
from hapscene.compiled.native import INTERPRETED
from hapscene.device.driver_registry import DeviceChoice
from hapscene.device.model import Limits
from hapscene.device.safety import STALL_S
from hapscene.device.sim.hand import grip_named
from hapscene.device.sim.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.loop import Servo, Twin, servo_process, timing
from hapscene.loop.driver import CHANNEL, FOLLOW_RAD_S, _follow, _note_start, _read_aim
from hapscene.loop.servo_process import OrderHandler
from hapscene.loop.shared_memory import open_channel
from hapscene.loop.timing import (
    BIN_COUNT,
    BIN_NS,
    BINS_PER_OCTAVE,
    LATE_MAX,
    SLACK_NS,
    TIMING,
    Timer,
    TimingStatistics,
    count_in_bin,
    percentile_us,
    request_realtime_priority,
    start_timer,
    wait_for_tick,
)
from hapscene.records import records
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

TICK_NS = 1_000_000
SECOND_NS = 1_000_000_000
BEGIN_NS = 1_000 * SECOND_NS


def timer(tick_ns: int = TICK_NS, behind_ns: int = 0) -> Timer:
    """Return a timer on a virtual clock whose next tick was due `behind_ns` ago."""
    made = Timer(records(1, CHANNEL)[0], new_clock(BEGIN_NS), records(1, TIMING)[0], tick_ns)
    start_timer(made)
    made.timing.due_ns -= behind_ns + tick_ns
    return made


def test_tick_begins_when_due() -> None:
    made = timer()
    due = made.timing.due_ns
    for k in range(1, 21):
        wait_for_tick(made)
        assert made.timing.due_ns == due + k * TICK_NS and 0 <= made.timing.began_ns - made.timing.due_ns <= LOOK_NS
        assert made.channel.late.sum() == k and made.timing.late == made.timing.stalled == 0


def test_long_delay_skips_and_counts_ticks() -> None:
    made = timer(behind_ns=(LATE_MAX + 30) * TICK_NS)
    wait_for_tick(made)
    assert 0 <= made.timing.began_ns - made.timing.due_ns < TICK_NS and made.channel.missed == LATE_MAX + 30
    assert made.channel.late.nonzero()[0][0] > 0  # the full delay is counted
    assert made.timing.stalled == 1 and made.timing.late == 0


def test_short_delay_is_made_up() -> None:
    made = timer(SECOND_NS, behind_ns=3 * SECOND_NS)
    due = made.timing.due_ns
    wait_for_tick(made)
    assert (made.timing.due_ns, made.channel.missed) == (due + SECOND_NS, 0)
    assert made.timing.late == 1 and made.timing.stalled == 0


@pytest.mark.parametrize("tick_ns", [200_000, SECOND_NS])
def test_limit_of_delay_is_in_ticks(tick_ns: int) -> None:
    for behind, missed in ((LATE_MAX - 0.9, False), (LATE_MAX + 1, True)):
        made = timer(tick_ns, behind_ns=int(behind * tick_ns))
        wait_for_tick(made)
        assert bool(made.channel.missed > LATE_MAX) == missed


def test_a_tick_that_a_vendor_calls_is_late_by_the_time_since_the_last() -> None:
    made, missed, delays = timer(), 0, np.zeros(BIN_COUNT, np.int64)
    for spans in (0.9, 2.5, 1e3 * STALL_S + 0.9, 1e3 * STALL_S + 1.1):
        before, late = int(made.timing.began_ns), max(spans - 1.0, 0.0)
        made.clock[VIRTUAL] += int(spans * TICK_NS) - LOOK_NS
        _note_start(made)
        missed += int(late)
        assert made.timing.due_ns == made.timing.began_ns == before + int(spans * TICK_NS) and made.timing.late == 0
        assert made.timing.elapsed_ns == int(spans * TICK_NS) and made.channel.missed == missed
        assert made.timing.stalled == int(late > 1e3 * STALL_S)
        count_in_bin(delays, int(late * TICK_NS))
        assert np.array_equal(made.channel.late, delays)


# The loop in a thread of this process.


def make_cube() -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.box((0.02, 0.02, 0.02)), "m"), name="cube")
    return scene


@pytest.fixture
def handler(request: Any) -> Iterator[OrderHandler]:
    twin = Twin(make_cube(), PointMass(0.045, 0.1), tick_s=request.param)
    handler = OrderHandler(twin.renderer._scene, [twin], open_channel(2000, twin.renderer.block, bodies=1))
    yield handler
    handler.pause()
    handler._channel.memory.unlink()  # existing views stay valid


@pytest.mark.parametrize("handler", [1e-3], indirect=True)
def test_incomplete_target_is_ignored(handler: OrderHandler) -> None:
    shared, aim, clock = handler._channel.aims[0], np.full((5, 3), 7.0), new_clock()
    shared.aim = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]
    shared["count"] = 3
    _read_aim(shared, aim, clock)
    assert (aim == 7.0).all()
    shared["count"] = 4
    _read_aim(shared, aim, clock)
    assert aim.tolist() == [[1.0, 2.0, 3.0], [7.0] * 3, [7.0] * 3, [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]


@pytest.mark.parametrize("handler", [1e-3, 4e-3], indirect=True)
def test_hand_follows_target_critically_damped(handler: OrderHandler) -> None:
    """From rest, the remaining distance is (1 + ωt) e^(−ωt) on each axis, and exactly 0 in the end."""
    body, tick_s = handler._twins[0].tool, handler._twins[0].renderer.tick_s
    aim, hand, way = np.zeros((5, 3)), handler._twins[0].tool.arm.hand[0], np.array([0.01, -0.02, 0.03])
    aim[0], aim[3], aim[4] = way, (100.0, 2.0, 0.01), (0.1, 0.2, 0.3)
    for k in range(1, 600):
        _follow(body, aim, tick_s)
        left = (1.0 + FOLLOW_RAD_S * k * tick_s) * np.exp(-FOLLOW_RAD_S * k * tick_s)
        np.testing.assert_allclose(hand.target_m + tick_s * hand.target_m_s, (1.0 - left) * way, rtol=1e-9, atol=1e-12)
    assert (hand.k_N_m, hand.b_Ns_m, hand.mass_kg) == (100.0, 2.0, 0.01) and hand.push_N.tolist() == [0.1, 0.2, 0.3]
    for _ in range(int(1.0 / tick_s)):
        _follow(body, aim, tick_s)
    assert aim[1].tolist() == way.tolist() and not aim[2].any()


# Orders.


@pytest.mark.parametrize("handler", [1e-3], indirect=True)
def test_repainting_keeps_the_pause(handler: OrderHandler) -> None:
    channel, cube = handler._channel.channel[0], make_cube()
    painting = cube.swatches, [(body.face_swatch, body.fine) for body in cube.bodies]
    assert not handler.pause()
    handler.repaint(*painting)
    assert not handler.pause() and channel.done == 0
    handler.start([(0.0, 0.0, 0.05)], grip_named("light").row())
    handler.repaint(*painting)
    assert handler.pause() and not handler.pause() and channel.pause == 1


# Real-time priority.


on_linux = pytest.mark.skipif(sys.platform != "linux", reason="Linux only")

PR_GET_TIMERSLACK = 30


def slack_ns() -> int:
    return int(ctypes.CDLL(None).prctl(PR_GET_TIMERSLACK))


@on_linux
def test_priority_applies_to_the_calling_thread() -> None:
    before = os.sched_getscheduler(0), slack_ns()

    def ask() -> tuple[bool, int]:
        return request_realtime_priority(), os.sched_getscheduler(0)

    with ThreadPoolExecutor(1) as lane:
        granted, policy = lane.submit(ask).result()
    assert granted == (policy == os.SCHED_FIFO)
    assert (os.sched_getscheduler(0), slack_ns()) == before


@on_linux
def test_timer_slack_without_permission_for_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with ThreadPoolExecutor(1) as lane:
        assert lane.submit(lambda: (request_realtime_priority(), slack_ns())).result() == (False, SLACK_NS)


@on_linux
@pytest.mark.skipif(INTERPRETED, reason="interpreted anyway")
def test_interpreted_loop_gets_no_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "INTERPRETED", True)
    with ThreadPoolExecutor(1) as lane:
        granted, policy = lane.submit(lambda: (request_realtime_priority(), os.sched_getscheduler(0))).result()
    assert not granted and policy == os.sched_getscheduler(0)


# Histograms of times: a percentile is never too small, and at most one bin too large.


BIN = 2.0 ** (1 / BINS_PER_OCTAVE)
LAST_NS = BIN_NS * 2.0 ** ((BIN_COUNT - 1) / BINS_PER_OCTAVE)


@pytest.mark.parametrize("span_ns", [-5, 100])
def test_first_bin_holds_shorter_times(span_ns: int) -> None:
    histogram = np.zeros(BIN_COUNT, np.int64)
    count_in_bin(histogram, span_ns)
    assert histogram[0] == 1
    assert percentile_us(histogram, 0.5) == BIN_NS / 1e3


def test_last_bin_holds_longer_times() -> None:
    histogram = np.zeros(BIN_COUNT, np.int64)
    count_in_bin(histogram, 10**15)
    assert histogram[-1] == 1
    assert percentile_us(histogram, 0.5) == pytest.approx(LAST_NS / 1e3)


def test_percentiles_equal_quantiles() -> None:
    span_ns = np.random.default_rng(0).lognormal(np.log(20_000), 2.0, 5000).astype(np.int64)
    histogram = np.zeros(BIN_COUNT, np.int64)
    for span in span_ns:
        count_in_bin(histogram, span)
    for share in (0.5, 0.9, 0.99, 0.999):
        true_us = np.quantile(span_ns, share, method="inverted_cdf") / 1e3
        assert true_us <= percentile_us(histogram, share) <= BIN * true_us


def test_percentile_of_empty_histogram() -> None:
    assert percentile_us(np.zeros(BIN_COUNT, np.int64), 0.5) == 0.0


def test_statistics_since_an_earlier_reading() -> None:
    late, busy = np.zeros(BIN_COUNT, np.int64), np.zeros(BIN_COUNT, np.int64)
    for _ in range(9):
        count_in_bin(late, 50)
        count_in_bin(busy, 10_000)
    before = TimingStatistics(late.copy(), busy.copy(), 3)
    count_in_bin(late, 1_000_000)
    after = TimingStatistics(late, busy, 5)
    assert after.delay_us() == BIN_NS / 1e3
    since = after.since(before)
    assert since.delay.sum() == 1 and since.delay_us() == pytest.approx(1000.0, rel=BIN - 1)
    assert since.busy_us() == 0.0 and after.busy_us() == pytest.approx(10.0, rel=BIN - 1)
    assert since.missed == 2


@pytest.mark.parametrize(
    "arguments", [{"limits": Limits()}, {"delay_ticks": 100}, {"X_WD": np.diag([9.0, 9.0, 9.0, 1.0])}]
)
def test_real_device_rejects_simulation_arguments(arguments: dict[str, object]) -> None:
    with pytest.raises(HapsceneError, match="haply2diy"):
        servo_process._twin(DeviceChoice("haply2diy", {"port": "none"}), [], {"tick_s": 1e-3, **arguments})


@pytest.mark.parametrize("force_N", [-30.0, float("nan")])
def test_invalid_maximum_force_is_rejected(force_N: float) -> None:
    with pytest.raises(HapsceneError, match="force_N"):
        Servo(Scene(), "omni", force_N=force_N)
