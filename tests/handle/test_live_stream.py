"""The stream from acceleration channel to output plays the desired samples without clicks."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import freqz

from hapscene.errors import HandleError
from hapscene.handle.handle_dynamics import amplify
from hapscene.handle.handle_loop import play
from hapscene.handle.handle_record import new_handle
from hapscene.handle.live_stream import FADE_S, PHASES, QUICK, LiveStream, filter_table
from hapscene.handle.plant import Plant

RATE_HZ = 10_000.0
CARD_HZ = 48_000.0


def output(**other: float) -> Any:
    options = {"rate_Hz": CARD_HZ, "gain": 1.0, "ceiling": 1.0, "highpass_Hz": 0.0, "lag_s": 0.005}
    return SimpleNamespace(**options | other)


def played(samples: np.ndarray, block: int = 480, late: bool = False, handle: Any = None, **other: float) -> np.ndarray:
    """What an output gets of a recording; without the limiter's delay unless `late`."""
    left = [np.asarray(samples, dtype=np.float64)]

    def fetch(wanted: int) -> np.ndarray:
        part, left[0] = left[0][:wanted].copy(), left[0][wanted:]
        return part

    stream = LiveStream(fetch, RATE_HZ, output(**other), handle=handle, steered=False)
    out = np.zeros(round((len(samples) / RATE_HZ + 0.1) * stream.output_rate_Hz) // block * block)
    for i in range(0, len(out), block):
        stream.pull(out[i : i + block])
    return out if late else out[int(stream._state[0].delay) :]


class Clocks:
    """A channel whose clock is off, and an output that pulls by its own."""

    def __init__(self, signal: Callable[[np.ndarray], np.ndarray], ppm: float = 0.0, **other: float) -> None:
        self.t_s, self.sent, self.stopped_s = 0.0, 0, np.inf
        self._signal, self._rate = signal, 1.0 + 1e-6 * ppm
        self.stream = LiveStream(self._fetch, RATE_HZ, output(**other), steered=True)

    def _fetch(self, wanted: int) -> np.ndarray:
        ticks = int(1000.0 * min(self.t_s, self.stopped_s) * self._rate)  # of 10 samples
        first, self.sent = self.sent, 10 * ticks
        return self._signal(np.arange(first, self.sent) / RATE_HZ)

    def run(self, seconds: float, block: int = 480) -> np.ndarray:
        out = np.zeros(int(seconds * CARD_HZ) // block * block)
        for i in range(0, len(out), block):
            self.t_s += block / CARD_HZ
            self.stream.pull(out[i : i + block])
        return out


def sine(t_s: np.ndarray) -> np.ndarray:
    return 0.5 * np.sin(2.0 * np.pi * 250.0 * t_s)


@pytest.mark.parametrize(("rate_Hz", "card_Hz"), [(10_000, 48_000), (5_000, 48_000), (10_000, 44_100), (10_000, 5_000)])
def test_the_filter_is_flat_in_the_vibrotactile_band_and_rejects_images(rate_Hz: int, card_Hz: int) -> None:
    table = filter_table(rate_Hz, card_Hz)
    taps = table.shape[1]
    whole = np.zeros(taps * PHASES)
    for p in range(PHASES):
        whole[p::PHASES] = table[p][::-1]
    frequency_Hz = np.concatenate([np.linspace(1.0, 1000.0, 500), np.linspace(0.5, 20.0, 5000) * min(rate_Hz, card_Hz)])
    level_dB = 20.0 * np.log10(np.abs(freqz(whole / PHASES, worN=frequency_Hz, fs=rate_Hz * PHASES)[1]) + 1e-12)
    assert np.abs(level_dB[:500]).max() < 0.01
    assert level_dB[500:].max() < -96.0


@pytest.mark.parametrize("block", [64, 479, 4096])
def test_a_sine_is_undistorted_for_all_block_sizes(block: int) -> None:
    t_s = np.arange(20_000) / RATE_HZ
    got = played(sine(t_s), block=block)
    inside = slice(int(2 * FADE_S * CARD_HZ), 90_000)
    assert np.abs(got[inside] - sine(np.arange(len(got)) / CARD_HZ)[inside]).max() < 2e-6


def test_it_fades_in_and_out() -> None:
    got = played(np.full(5000, 0.5), late=True)
    assert not got[:90].any() and not got[-1000:].any()
    assert np.abs(np.diff(got)).max() < 0.025  # the filter's own edge, within the fade
    at = int(FADE_S * CARD_HZ)
    np.testing.assert_allclose(got[at : 24_000 - at], 0.5, rtol=1e-6)


def test_the_limiter_attenuates_in_advance_without_clipping() -> None:
    t_s = np.arange(20_000) / RATE_HZ
    loud = np.where((t_s > 0.8) & (t_s < 1.2), 8.0, 1.0) * sine(t_s)
    stream_out = played(loud, ceiling=0.9)
    assert np.abs(stream_out).max() <= 0.9
    spectrum = np.abs(np.fft.rfft(stream_out[int(0.9 * CARD_HZ) : int(1.1 * CARD_HZ)] * np.hanning(9600)))
    assert (
        spectrum[150 * 9600 // 48000 * 5 :].max() < 3e-3 * spectrum.max()
    )  # 750 Hz: a cut sine has a third of a third
    np.testing.assert_allclose(stream_out[20_000:35_000], sine(np.arange(20_000, 35_000) / CARD_HZ), atol=2e-6)


def test_the_high_pass_removes_low_frequencies() -> None:
    t_s = np.arange(30_000) / RATE_HZ
    got = played(0.4 + sine(t_s), highpass_Hz=15.0)
    assert abs(got[48_000:96_000].mean()) < 1e-4
    assert np.abs(got[48_000:96_000]).max() == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("ppm", [0.0, 200.0, -200.0])
def test_clocks_that_differ_are_synchronised_without_a_click(ppm: float) -> None:
    """60 s. A sample left out or put in of the 250 Hz would be a step of 0.08; the derivative's bound is 0.0164."""
    clocks = Clocks(sine, ppm)
    silence = clocks.run(1.0)
    assert not silence[:12_000].any()
    got = clocks.run(30.0)
    hand = clocks.stream.latency_s
    got = np.concatenate([got, clocks.run(29.0)])
    assert np.abs(np.diff(got)).max() < 0.5 * 2.0 * np.pi * 250.0 / CARD_HZ * 1.005
    assert clocks.stream.latency_s == pytest.approx(hand, abs=1.1e-3) and hand < 0.014
    assert not any(clocks.stream.counts.values())
    part = got[-(1 << 19) :] * np.blackman(1 << 19)
    spectrum = np.abs(np.fft.rfft(part))
    frequency_Hz = np.fft.rfftfreq(1 << 19, 1.0 / CARD_HZ)
    away = np.abs(frequency_Hz - 250.0) > 5.0
    assert spectrum[away].max() < 10.0 ** (-90 / 20) * spectrum.max()
    assert frequency_Hz[spectrum.argmax()] == pytest.approx(250.0, rel=3e-4)
    if ppm == 0.0:
        assert clocks.stream.drift == 0.0


def test_it_fades_out_when_ticks_stop_and_in_when_they_resume() -> None:
    clocks = Clocks(sine)
    clocks.run(2.0)
    clocks.stopped_s = clocks.t_s
    tail = clocks.run(0.5)
    loud = np.flatnonzero(np.abs(tail) > 1e-9)
    assert loud[-1] / CARD_HZ < 0.005 + FADE_S / QUICK + 0.005  # what was in hand, the fade, the limiter's delay
    assert np.abs(np.diff(tail)).max() < 0.025
    clocks.stopped_s = np.inf
    back = clocks.run(2.0)
    assert clocks.stream.counts["gaps"] == 1 and np.abs(back[-9600:]).max() == pytest.approx(0.5, rel=1e-3)
    assert np.abs(np.diff(back)).max() < 0.025


def test_samples_that_are_not_finite_are_silent_and_counted() -> None:
    bad = np.zeros(3000)
    bad[1500:1503] = np.nan, np.inf, 1e300
    got = played(bad, ceiling=0.5)
    assert np.isfinite(got).all() and np.abs(got).max() <= 0.5


def test_a_compensator_makes_the_force_that_the_simulated_handle_gets() -> None:
    t_s = np.arange(8000) / RATE_HZ
    wanted = 4.0 * np.sin(2.0 * np.pi * 90.0 * t_s)
    force = play(wanted, RATE_HZ, compensator="flat").force_N
    handle = new_handle(Plant(), Plant(), "flat", RATE_HZ)
    command = played(wanted, handle=handle, rate_Hz=RATE_HZ, ceiling=9.0)
    got = np.array([amplify(handle[0], x) for x in command])
    delay, fade, last = round(0.004 * RATE_HZ), round(FADE_S * RATE_HZ), len(force) - 100
    np.testing.assert_allclose(got[delay:][fade:last], force[fade:last], atol=3e-5)


def test_rates_that_are_too_far_apart_are_refused() -> None:
    with pytest.raises(HandleError, match="cannot be played at 100 Hz"):
        LiveStream(lambda count: np.zeros(0), RATE_HZ, output(rate_Hz=100.0), steered=False)


def test_the_clock_control_stays_the_same() -> None:
    """A clock 5000 ppm off, more than is corrected; a burst that is skipped; an end without notice. Recorded."""
    clocks = Clocks(sine, 5000.0, ceiling=0.3, highpass_Hz=20.0)
    s = clocks.stream._state[0]

    def shown(seconds: float) -> list[float]:
        out = clocks.run(seconds)
        control = [s.part, s.change, s.in_hand, s.whole, s.state, s.windows, clocks.stream.drift]
        return [*control, *clocks.stream.counts.values(), np.abs(out).mean()]

    assert shown(2.0) == pytest.approx(
        [0.232409495, 28.5768253, 97.1410242, 85483, 1, 2, 0.000571536507, 0, 0, 72000, 0, 0, 0.142269319], rel=1e-6
    )
    assert shown(8.0)[6] == pytest.approx(0.003)
    clocks.t_s += 0.2
    assert shown(1.5) == pytest.approx(
        [0.042027001, 128.860626, 74.068829, 183027, 1, 2, 0.00257721252, 0, 1, 528000, 0, 0, 0.127362352], rel=1e-6
    )
    clocks.stopped_s = clocks.t_s
    assert shown(0.5) == pytest.approx(
        [0.928089599, 128.860626, -512.566803, 188039, 0, 0, 0.00257721252, 1, 1, 552000, 0, 0, 0.00370745972], rel=1e-6
    )
    assert clocks.stream.latency_s == 0.002  # nothing in hand
    clocks.stream.end()
    clocks.run(0.1)
    assert clocks.stream.over and clocks.stream.played == s.whole - 65_536


def test_feeding_volume_and_measurements() -> None:
    wanted, parts = [], [np.array([np.nan, -1e9]), np.ones(40_000), None]

    def fetch(count: int) -> np.ndarray:
        wanted.append(count)
        return parts.pop(0)

    handle = new_handle(Plant(), Plant(), "adaptive", RATE_HZ)
    stream = LiveStream(fetch, RATE_HZ, output(rate_Hz=RATE_HZ, gain=0.5), handle=handle, steered=False)
    s, half = stream._state[0], stream._table.shape[1] // 2
    assert stream.latency_s == pytest.approx((20 + 40) / RATE_HZ) and not stream.over and stream.played == 0
    assert not stream.pull(np.zeros(0)) and stream._ring[:3].tolist() == [0.0, -1e6, 0.0]
    assert s.written == 65_538 and stream.counts["not_finite"] == 1
    assert not stream.pull(np.zeros(100)) and s.written == 65_538 + 32_768  # the newest half of the ring
    assert stream.pull(np.zeros(100)) and stream.played == 200
    assert wanted == [half + 2, half + 2 + 100 - 2, 0]
    for volume, gain in ((0.25, 0.125), (2.0, 0.5), (-1.0, 0.0)):
        stream.set_volume(volume)
        assert s.gain == gain
    stream.receive_feedback(np.arange(50), np.zeros(50), np.zeros(50))
    assert handle[0].next_sample == 30 and handle[0].pause == 0
    assert s.state != 0 and s.faded > 0.0
    stream.fade_in()
    assert (s.state, s.faded, s.windows) == (0, 0.0, 0)
