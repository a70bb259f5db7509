"""plots.png: what it shows, and that nothing in it overlaps."""

from dataclasses import fields, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from PIL import Image

from hapscene.recording import Recording
from hapscene.view.plot import draw_plot, envelope, write_plot


def test_every_plot_names_its_quantity_and_unit(recording: Recording) -> None:
    axes = draw_plot(recording, "a title").axes
    labels = [" ".join(ax.get_ylabel().split()) for ax in axes]
    assert labels == [
        "swatch",
        "force [N]",
        "depth [mm]",
        "acceleration [m/s²]",
        "acceleration, frequency [Hz]",
        "dB re 1 (m/s²)²/Hz",
    ]
    assert axes[4].get_xlabel() == "time [s]"
    legend = axes[0].get_legend()
    assert legend is not None
    assert {text.get_text() for text in legend.get_texts()} <= set(recording.swatch_names)


def test_no_two_texts_overlap(recording: Recording) -> None:
    figure = draw_plot(recording, "a title of a common length")
    figure.canvas.draw()
    hidden = set()  # ticks outside the view are not drawn
    for axis in (axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)):
        low, high = sorted(axis.get_view_interval())
        hidden |= {tick.label1 for tick in axis.get_major_ticks() if not low <= tick.get_loc() <= high}
    texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
    texts = [text for text in texts if text not in hidden]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    whole = figure.bbox
    for (name_a, a), (name_b, b) in combinations(boxes, 2):
        inside = all(whole.contains(*corner) for box in (a, b) for corner in box.corners())
        assert not (inside and a.shrunk(0.98, 0.9).overlaps(b.shrunk(0.98, 0.9))), f"{name_a!r} over {name_b!r}"


def test_spectrogram_is_brightest_where_the_sine_is(recording: Recording) -> None:
    image = draw_plot(recording).axes[4].images[0]
    level_dB = np.asarray(image.get_array())
    frequency_Hz = np.linspace(*image.get_extent()[2:], len(level_dB))
    assert abs(frequency_Hz[level_dB.max(axis=1).argmax()] - 250.0) <= 10.0


def test_no_peak_is_lost() -> None:
    values = np.zeros(100_000)
    values[12_345], values[77_777] = 9.0, -7.0
    _, low, high = envelope(np.arange(100_000.0), values)
    assert len(low) <= 2001
    assert high.max() == 9.0 and low.min() == -7.0


@pytest.mark.parametrize("count", [1, 2, 90])
def test_short_and_silent_recordings_are_drawn(tmp_path: Path, recording: Recording, count: int) -> None:
    arrays = {f.name: getattr(recording, f.name) for f in fields(recording)}
    cut = {name: a[:count] for name, a in arrays.items() if isinstance(a, np.ndarray)}
    write_plot(replace(recording, **cut), tmp_path / "plots.png")
    with Image.open(tmp_path / "plots.png") as image:
        assert image.format == "PNG" and image.width > 1000
