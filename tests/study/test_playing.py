"""Playback of intervals on outputs."""

from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest

from hapscene.errors import HapsceneError, StudyError
from hapscene.handle.handle_loop import play
from hapscene.handle.plant import Plant
from hapscene.study.plan import Stimulus
from hapscene.study.stimulus import TIMEOUT_S, StimulusMaker, _Samples, handle_player, headphone_player
from hapscene.study.trial_order import Interval
from tests.virtual_clock import BEGIN_NS, VirtualClock


def stimulus(**keys: Any) -> Stimulus:
    return Stimulus(name="a", **keys)


class FakeOutput(VirtualClock):
    """An output with a virtual clock, which reads a block at each wait and records it."""

    name, reads_back, gain, ceiling, highpass_Hz, lag_s = "fake", False, 0.02, 0.99, 15.0, 0.0
    latency_s = 0.0

    def __init__(self, takes_force: bool = False, rate_Hz: float = 48_000.0, block: int = 777) -> None:
        super().__init__()
        self.takes_force, self.rate_Hz, self.fault, self.counts = takes_force, rate_Hz, "", {"underruns": 0}
        self.blocks: list[np.ndarray] = []
        self._block, self.feed = block, None

    def start(self, feed: Any) -> None:
        self.feed = feed

    def wait(self, event: Event, timeout_s: float) -> bool:
        if self.feed is not None:
            out = np.full(self._block, np.nan)
            self.feed.pull(out)
            self.blocks.append(out)
            timeout_s = self._block / self.rate_Hz
        return super().wait(event, timeout_s)

    def close(self) -> None:
        self.feed = None

    @property
    def played(self) -> np.ndarray:
        """The recorded samples, without silence at the start and end."""
        samples = np.concatenate(self.blocks)
        (loud,) = np.nonzero(samples)
        return samples[loud[0] : loud[-1] + 1]


@pytest.fixture
def maker(tmp_path: Path) -> StimulusMaker:
    return StimulusMaker(tmp_path)


def test_headphones_get_all_samples(maker: StimulusMaker) -> None:
    one, two = (stimulus(swatch=name, seconds=0.3) for name in ("wood", "paper"))
    output = FakeOutput()
    player = headphone_player(maker, output, [one, two], clock=output)
    shown = player.report()
    for presented, seed in ((one, 5), (two, 6), (one, 5)):
        output.blocks.clear()
        player.ready(Interval(presented, seed))()
        exact = maker.samples(presented, seed, 48_000.0) / shown["full_scale_m_s2"]
        (loud,) = np.nonzero(exact)
        np.testing.assert_allclose(output.played, exact[loud[0] : loud[-1] + 1], rtol=1e-12)
    player.close()
    player.close()
    assert player.report()["clipped"] == 0 and player.report()["underruns"] == 0


def test_a_handle_gets_the_force_of_its_compensator(maker: StimulusMaker) -> None:
    flat, naive = (stimulus(swatch="wood", seconds=0.3, compensator=name) for name in ("", "naive"))
    output = FakeOutput(takes_force=True, rate_Hz=10_000.0)
    output.gain, output.ceiling = 1.0, 5.0  # type: ignore[misc]
    player = handle_player(maker, output, [flat, naive], clock=output)
    played = {}
    for presented, name in ((flat, "flat"), (naive, "naive")):
        output.blocks.clear()
        player.ready(Interval(presented, 3))()
        wanted = play(maker.samples(presented, 3, 1e4), 1e4, Plant(), compensator=name, nominal=Plant(), seed=3).force_N
        (loud,) = np.nonzero(wanted)
        np.testing.assert_array_equal(output.played, wanted[loud[0] : loud[-1] + 1])
        played[name] = output.played
    assert len(played["flat"]) != len(played["naive"]) or not np.allclose(played["flat"], played["naive"])
    player.close()


def test_unsuitable_outputs_and_faults(maker: StimulusMaker) -> None:
    with pytest.raises(StudyError, match='channel = "handle"'):
        headphone_player(maker, FakeOutput(takes_force=True), [stimulus(swatch="wood")])
    with pytest.raises(HapsceneError, match="no compensator 'flatt'"):
        handle_player(maker, FakeOutput(), [stimulus(swatch="wood", compensator="flatt")])
    output = FakeOutput()
    player = headphone_player(maker, output, [stimulus(swatch="wood", seconds=0.1)], clock=output)
    output.fault = "fake: plays no more: was it unplugged?"
    with pytest.raises(StudyError, match="was it unplugged"):
        player.ready(Interval(stimulus(swatch="wood", seconds=0.1), 1))()
    player.close()


def test_samples_given_during_a_read_are_played_completely() -> None:
    feed, out = _Samples(), np.full(7, np.nan)
    ended = []

    class Out:
        """Memory of a sound card that is filled while the next sound is given."""

        def __len__(self) -> int:
            return len(out)

        def __setitem__(self, places: slice, values: Any) -> None:
            if not ended:
                ended.append(feed.give(np.arange(1.0, 11.0)))
            out[places] = values

    feed.pull(Out())  # type: ignore[arg-type]
    assert not out.any() and not ended[0].is_set()
    feed.pull(out)
    np.testing.assert_array_equal(out, np.arange(1.0, 8.0))
    feed.fade_in()  # after an interruption, the sound restarts
    played = []
    while not ended[0].is_set():
        feed.pull(out)
        played.append(out.copy())
    np.testing.assert_array_equal(np.concatenate(played), [*np.arange(1.0, 11.0), 0.0, 0.0, 0.0, 0.0])
    feed.fade_in()
    feed.pull(out)
    assert not out.any()


def test_a_stalled_output_is_an_error(maker: StimulusMaker) -> None:
    output = FakeOutput()
    player = headphone_player(maker, output, [stimulus(swatch="wood", seconds=0.1)], clock=output)
    output.close()
    with pytest.raises(StudyError, match="fake: "):
        player.ready(Interval(stimulus(swatch="wood", seconds=0.1), 1))()
    assert output.now_s() == pytest.approx(1e-9 * BEGIN_NS + 0.1 + TIMEOUT_S, abs=0.02)
