"""What stands between tick and motors, against closed forms: each cause, each limit, in its order."""

import math

import numpy as np
import pytest

from hapscene.constants import TICK_S
from hapscene.device.driver import Driver
from hapscene.device.model import Device, Limits
from hapscene.device.safety import (
    CALM_S,
    FALL_S,
    HEARTBEAT_AGE_S,
    RAMP_S,
    RESUME_S,
    begin_safety,
    no_safety,
    protect,
    resume_safety,
    safety_of,
    simulated_safety,
)
from hapscene.flags import Flag

LIMITS = Limits(force_N=8.0, slew_N_s=8000.0)
DRIVER = Driver(
    "test",
    "A box of 0.2 m.",
    model=Device("test", None, LIMITS),
    continuous_N=2.0,
    heat_s=3.0,
    low_D_m=(-0.1, -0.1, -0.1),
    high_D_m=(0.1, 0.1, 0.1),
    speed_m_s=2.0,
)


class Bench:
    """A device with given positions, states and heartbeats."""

    def __init__(self, driver: Driver = DRIVER) -> None:
        self.safety = safety_of(driver)[0]
        begin_safety(self.safety)
        self.count = 0

    def tick(self, f_N=(0.0, 0.0, 1.0), *, p_m=(0.0, 0.0, 0.0), ready=1, fresh=True, alive=True):
        """One tick; the force sent, and flags."""
        self.count += fresh
        self.safety.heartbeat_now += alive
        sent, flags = protect(self.safety, p_m, ready, self.count, np.array(f_N), TICK_S)
        return np.array(sent), Flag(flags)

    def run(self, seconds: float, f_N=(0.0, 0.0, 1.0), **given):
        """Run for some seconds. Returns forces (n, 3) and the union of all flags."""
        ticks = [self.tick(f_N, **given) for _ in range(round(seconds / TICK_S))]
        flags = Flag(0)
        for _, flag in ticks:
            flags |= flag
        return np.array([sent for sent, _ in ticks]), flags

    def settled(self, f_N=(0.0, 0.0, 1.0)) -> "Bench":
        self.run(RAMP_S + CALM_S, f_N)
        return self


def test_force_rises_over_two_seconds_after_the_start() -> None:
    sent, flags = Bench().run(RAMP_S)
    want = np.minimum(np.arange(1, len(sent) + 1) * TICK_S / RAMP_S, 1.0)
    assert sent[:, 2] == pytest.approx(want, abs=1e-9)
    assert flags == Flag.RAMPED
    assert Bench().settled().tick()[1] == Flag(0)


def test_over_the_peak_the_magnitude_is_cut_and_the_direction_kept() -> None:
    bench = Bench(Driver("cold", "Never warm.", model=Device("cold", None, LIMITS))).settled((6.0, 0.0, 0.0))
    sent, flags = bench.run(0.1, (60.0, 0.0, 80.0))
    assert sent[-1] == pytest.approx((4.8, 0.0, 6.4))
    assert Flag.PEAK_LIMITED in flags


def test_rate_of_force_change_is_limited() -> None:
    bench = Bench(Driver("slow", "Slow.", model=Device("slow", None, Limits(force_N=8.0, slew_N_s=100.0))))
    bench.settled((0.0, 0.0, 0.0))
    sent, flags = bench.run(0.1, (0.0, 0.0, 5.0))
    assert sent[:, 2] == pytest.approx(np.minimum(0.1 * np.arange(1, 101), 5.0))
    assert Flag.STEP_LIMITED in flags


def test_motor_heats_with_squared_force_and_is_derated_to_its_continuous_rating() -> None:
    bench = Bench()
    bench.safety.ramp_s = 0.0
    begin_safety(bench.safety)
    warming_s = -DRIVER.heat_s * math.log(1.0 - 0.9 / (4.0 / 2.0) ** 2)  # heat 0.9 at 4 N, where 2 N are borne
    sent, flags = bench.run(warming_s - 0.01, (0.0, 4.0, 0.0))
    assert sent[-1] == pytest.approx((0.0, 4.0, 0.0)) and flags == Flag(0)
    sent, flags = bench.run(20.0, (0.0, 4.0, 0.0))
    assert flags == Flag.HEAT_LIMITED
    assert sent[-1, 1] == pytest.approx(2.0, rel=1e-3) and bench.safety.heat == pytest.approx(1.0, rel=1e-3)
    assert np.diff(sent[:, 1]).max() <= 0.0


@pytest.mark.parametrize(
    ("given", "flag"),
    [
        ({"p_m": (0.0, 0.11, 0.0)}, Flag.OUT_OF_WORKSPACE),
        ({"ready": 0}, Flag.DEVICE_NOT_READY),
        ({"p_m": (math.nan, 0.0, 0.0)}, Flag.DEVICE_NOT_READY),
    ],
)
def test_fault_removes_the_force_at_once_and_it_returns_slowly(given, flag) -> None:
    bench = Bench().settled()
    if "p_m" in given and not math.isnan(given["p_m"][1]):
        bench.safety.p_DT_m = given["p_m"]  # it did not jump there
    sent, flags = bench.run(FALL_S, **given)
    assert sent[-1] == pytest.approx((0.0, 0.0, 0.0), abs=1e-12) and flag in flags
    bench.safety.p_DT_m = 0.0
    sent, _ = bench.run(CALM_S - 0.002)
    assert not sent.any()
    sent, _ = bench.run(RAMP_S + 0.01)
    assert sent[-1] == pytest.approx((0.0, 0.0, 1.0)) and np.diff(sent[:, 2]).max() < 1.01 * TICK_S / RAMP_S


def test_position_jump_is_flagged_as_too_fast() -> None:
    bench = Bench().settled()
    assert bench.tick(p_m=(0.0019, 0.0, 0.0))[1] == Flag(0)
    sent, flags = bench.tick(p_m=(0.0045, 0.0, 0.0))
    assert Flag.TOO_FAST in flags and sent[2] < 1.0


@pytest.mark.parametrize(("speed_m_s", "flag"), [(1.9, Flag(0)), (2.1, Flag.TOO_FAST)])
def test_speed_limit_allows_for_a_low_position_rate(speed_m_s: float, flag: Flag) -> None:
    bench, flags = Bench().settled(), Flag(0)
    for tick in range(40):  # a place every five ticks
        flags |= bench.tick(p_m=(speed_m_s * TICK_S * (tick // 5 * 5 + 1), 0.0, 0.0), fresh=tick % 5 == 0)[1]
    assert flags & Flag.TOO_FAST == flag


def test_after_an_order_the_force_comes_back_without_a_knock_wherever_the_tool_is_by_then() -> None:
    bench = Bench().settled()
    resume_safety(bench.safety)
    sent, flags = bench.run(RESUME_S + TICK_S, p_m=(0.05, 0.0, 0.0))
    assert flags == Flag.RAMPED and sent[-1, 2] == pytest.approx(1.0)
    assert sent[0, 2] < 0.02 and np.diff(sent[:, 2]).max() < 1.01 * TICK_S / RESUME_S
    bench = Bench()
    bench.run(RAMP_S / 2)
    resume_safety(bench.safety)  # no short cut to the whole of it
    assert bench.run(RAMP_S / 2)[0][-1, 2] == pytest.approx(0.5, abs=0.01)


def test_speed_limit_allows_for_the_delay_of_a_late_tick() -> None:
    bench = Bench().settled()
    bench.safety.late, bench.safety.elapsed_s = 1, 5e-6
    assert bench.tick(p_m=(0.015, 0.0, 0.0))[1] == Flag(0)
    assert bench.run(0.019, p_m=(0.015, 0.0, 0.0), fresh=False)[1] == Flag(0)
    assert Flag.TOO_FAST in bench.tick(p_m=(0.06, 0.0, 0.0))[1]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_nan_force_counts_as_zero(bad: float) -> None:
    sent, flags = Bench().settled().tick((0.0, bad, 1.0))
    assert sent.tolist() == [0.0, 0.0, 0.0] and Flag.FORCE_NOT_FINITE in flags


def test_the_force_ends_within_20_ms_without_heartbeats() -> None:
    bench = Bench().settled()
    sent, flags = bench.run(0.02, alive=False)
    assert sent[int(HEARTBEAT_AGE_S / TICK_S) - 2, 2] == 1.0  # and not before
    assert sent[-1].tolist() == [0.0, 0.0, 0.0] and Flag.APPLICATION_SILENT in flags


def test_catching_up_after_a_missed_deadline_is_no_safety_stop() -> None:
    bench = Bench().settled()
    bench.safety.late, bench.safety.elapsed_s = 1, 5e-6
    assert bench.run(0.03, alive=False, fresh=False)[1] == Flag(0)


@pytest.mark.parametrize("silent", [{"fresh": False}, {"alive": False}])
def test_silence_is_measured_by_the_clock_if_every_tick_misses_its_deadline(silent: dict[str, bool]) -> None:
    bench = Bench().settled()
    bench.safety.late, bench.safety.elapsed_s = 1, 0.0025
    sent, flags = bench.run(0.008, **silent)  # eight ticks, which take 20 ms
    assert sent[-1].tolist() == [0.0, 0.0, 0.0] and flags & (Flag.DEVICE_NOT_READY | Flag.APPLICATION_SILENT)


def test_stop_force_ends_the_force_within_6_ms() -> None:
    bench = Bench().settled()
    bench.safety.stopped = 1
    assert bench.run(0.006)[0][-1].tolist() == [0.0, 0.0, 0.0]
    bench.safety.stopped = 0
    assert bench.run(CALM_S + RAMP_S)[0][-1, 2] == pytest.approx(1.0)


def test_device_without_new_samples_is_not_ready() -> None:
    bench = Bench().settled()
    sent, flags = bench.run(0.02, fresh=False)
    assert sent[-1].tolist() == [0.0, 0.0, 0.0] and Flag.DEVICE_NOT_READY in flags
    slow = Bench(Driver("slow", "100 Hz.", rate_Hz=100.0, speed_m_s=math.inf)).settled()
    assert slow.run(0.03, fresh=False)[1] == Flag(0)


def test_after_a_loop_that_stood_still_the_force_begins_anew() -> None:
    bench = Bench().settled()
    bench.safety.stalled = 1
    sent, flags = bench.tick()
    assert Flag.STALLED in flags and sent[2] == 0.0


def test_simulated_device_has_only_the_application_watchdog() -> None:
    safety = simulated_safety()[0]
    begin_safety(safety)
    f_N = np.array([1e3, 0.1, -7.0])
    for k in range(HEARTBEAT_TICKS := round(HEARTBEAT_AGE_S / TICK_S)):
        sent, flags = protect(safety, (0.0, 0.0, 0.0), 1, k, f_N, TICK_S)
        assert sent == tuple(f_N) and flags == 0  # to the bit
    for k in range(10):
        sent, flags = protect(safety, (0.0, 0.0, 0.0), 1, HEARTBEAT_TICKS + k, f_N, TICK_S)
    assert sent == (0.0, 0.0, 0.0)
    safety.heartbeat_now += 1
    assert protect(safety, (0.0, 0.0, 0.0), 1, 99, f_N, TICK_S) == (tuple(f_N), 0)


def test_a_twin_has_no_safety() -> None:
    assert no_safety()[0].on == 0 and simulated_safety()[0].on == 1
