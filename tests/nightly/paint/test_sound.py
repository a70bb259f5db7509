"""The audio worklet of the page plays the received samples without clicks and keeps the latency low."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
pytest.importorskip("playwright", reason="playwright is not installed: pip install 'hapscene[dev]'")

import hapscene
from hapscene.paint.model.session import Session
from hapscene.paint.web.page import Page
from tests.paint.conftest import plate_mesh

RATE_HZ = 10_000
BLOCK_S = 0.015
NOTHING = np.zeros(0)

RENDER = """
async ([blocks, rate, seconds, later, later_s]) => {
  const context = new OfflineAudioContext(1, seconds * rate, rate);
  await context.audioWorklet.addModule("/hapscene-audio_monitor.js");
  const player = new AudioWorkletNode(context, "hapscene-audio-monitor", { numberOfInputs: 0 });
  const { port1, port2 } = new MessageChannel(), reports = [];
  const all = new Promise((done) => {
    player.port.onmessage = ({ data }) => { reports.push(data); if (reports.length === blocks.length) done(); };
  });
  player.port.postMessage({ wire: port1 }, [port1]);
  player.connect(context.destination);
  const post = (a, count) => port2.postMessage({ a: Float32Array.from(a), rate, count });
  blocks.forEach(post);
  if (later.length) context.suspend(later_s).then(async () => {
    post(later, blocks.length);
    await new Promise((done) => setTimeout(done, 200));
    context.resume();
  });
  await Promise.race([all, new Promise((done) => setTimeout(done, 5000))]);
  const played = await context.startRendering();
  return { played: [...played.getChannelData(0)], reports };
}
"""


@pytest.fixture(scope="module")
def tab(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    folder: Path = tmp_path_factory.mktemp("sound")
    scene = hapscene.Scene()
    scene.add(plate_mesh(cells=1), name="plate", swatch="paper")
    session = Session(scene, folder / "plate.scene.json")
    with Page(session, port=0, with_hand=False) as page:
        found = browser.new_page()
        found.goto(page.url)
        yield found
    session.document.close()


def render(
    tab: Any, a: NDArray[np.float64], seconds: float, later: NDArray[np.float64] = NOTHING, later_s: float = 0.0
) -> tuple[NDArray[np.float64], list[dict[str, float]]]:
    """Send samples at once, in messages of `BLOCK_S`; return the played samples (n,) and the reports of the worklet.

    The samples `later` are sent at `later_s`.
    """
    blocks = np.array_split(a, max(round(len(a) / RATE_HZ / BLOCK_S), 1))
    found = tab.evaluate(RENDER, [[block.tolist() for block in blocks], RATE_HZ, seconds, later.tolist(), later_s])
    return np.array(found["played"]), found["reports"]


def test_burst_is_played_completely_slightly_faster_and_without_clicks(tab: Any) -> None:
    t_s = np.arange(round(0.3 * RATE_HZ)) / RATE_HZ
    played, reports = render(tab, np.sin(2 * np.pi * 100.0 * t_s), 0.5)
    sounding = np.flatnonzero(np.abs(played) > 0.95)  # the fade at the end is quieter
    assert sounding[0] < 0.02 * RATE_HZ
    length_s = (sounding[-1] - sounding[0]) / RATE_HZ
    assert 0.3 / 1.08 - 0.02 < length_s < 0.3
    assert np.abs(played).max() == pytest.approx(1.0, abs=0.01)
    assert np.abs(np.diff(played)).max() < 1.1 * 2 * np.pi * 100.0 * 1.08 / RATE_HZ
    assert [t["count"] for t in reports] == list(range(len(reports)))
    lead_s = np.array([t["lead_s"] for t in reports])
    assert (np.diff(lead_s) >= 0).all() and lead_s[-1] == pytest.approx(0.3 - BLOCK_S, abs=0.02)
    assert reports[-1]["gaps"] == 0


def test_backlog_of_more_than_a_second_is_dropped(tab: Any) -> None:
    played, reports = render(tab, np.ones(2 * RATE_HZ), 1.8)
    assert np.count_nonzero(played > 0.9) / RATE_HZ < 1.05
    assert reports[-1]["lead_s"] <= 1.0
    assert reports[-1]["gaps"] == 1


def test_late_samples_cause_one_gap_without_a_click(tab: Any) -> None:
    t_s = np.arange(round(0.4 * RATE_HZ)) / RATE_HZ
    a = np.sin(2 * np.pi * 100.0 * t_s)
    cut = round(0.1 * RATE_HZ)
    played, reports = render(tab, a[:cut], 0.5, a[cut:], 0.16)
    steepest = 2 * np.pi * 100.0 * 1.08 / RATE_HZ + 1.0 / (0.005 * RATE_HZ)  # slope of the tone and of the cross-fade
    assert np.abs(np.diff(played)).max() < 1.1 * steepest
    end = round(0.12 * RATE_HZ)  # the buffer is empty by then; the next samples arrive at 0.16 s
    assert np.abs(played[end : end + 100]).max() > 0.2
    assert reports[-1]["gaps"] == 1


WAIT = """
async ([late_s, seconds]) => {
  const { JitterBuffer } = await import("/hapscene-audio_monitor.js"), wait = new JitterBuffer(), target_s = [];
  let waits_s = 0.1, last_s = 0;
  for (let tick = 1; tick * 0.015 < seconds; tick++) {
    const at_s = tick * 0.015, blocked = late_s.some(([from_s, for_s]) => from_s <= at_s && at_s < from_s + for_s);
    if (blocked) continue;
    wait.note(waits_s - (at_s - last_s), at_s - last_s);
    last_s = at_s;
    target_s.push(wait.target_s);
  }
  return target_s;
}
"""


def test_jitter_buffer_covers_twice_the_longest_delay_of_a_minute(tab: Any) -> None:
    def target_s(late_s: list[tuple[float, float]], seconds: float) -> float:
        return float(tab.evaluate(WAIT, [late_s, seconds])[-1])

    assert 0.03 < target_s([], 100.0) < 0.05  # messages come every 15 ms
    assert 0.24 < target_s([(50.0, 0.12), (55.0, 0.06)], 70.0) < 0.29
    assert target_s([(5.0, 0.12), (8.0, 0.3)], 80.0) < 0.05  # delays of more than a minute ago do not count
    assert target_s([(t, 2.0) for t in range(10, 40, 5)], 45.0) < 0.6  # the buffer is limited


@pytest.mark.parametrize(("silent_s", "later_s", "gaps"), [(1.3, 1.35, 1), (1.3, 0.015, 0)])
def test_long_delay_is_a_gap_and_a_pause_is_none(tab: Any, silent_s: float, later_s: float, gaps: int) -> None:
    later = np.ones(round(later_s * RATE_HZ))  # after a delay, one message has all samples since; after a pause, few
    _, reports = render(tab, np.ones(round(0.1 * RATE_HZ)), 0.2 + silent_s, later, 0.1 + silent_s)
    assert reports[-1]["gaps"] == gaps
