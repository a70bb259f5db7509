"""Plots of a touch."""

from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from hapscene.render.recording import Recording
from hapscene.view.chart import save_chart
from hapscene.view.plot import (
    BOTTOM,
    LEFT,
    LEGEND_ROW,
    RANGE_DB,
    RIGHT,
    TITLE,
    draw_hand_plot,
    draw_plot,
    envelope,
)


def test_spectrogram_of_a_sine(recording: Recording) -> None:
    silent = replace(recording, a_m_s2=np.zeros_like(recording.a_m_s2))
    axes, quiet = (draw_plot(one).axes[4] for one in (recording, silent))
    assert axes.get_ylim() == quiet.get_ylim() == (0.0, 1000.0) and quiet.texts[0].get_text() == "silence"
    image = axes.images[0]
    level_dB = np.asarray(image.get_array())
    assert level_dB.shape == (101, (20_000 - 500) // 16 + 1)  # of 50 ms, 16 samples apart, padded to twice the length
    assert image.get_extent() == pytest.approx([0.025, 0.025 + 1218 * 0.0016, 0.0, 1000.0])
    top_dB = np.ceil(level_dB.max())
    assert image.get_clim() == (top_dB - RANGE_DB, top_dB) and level_dB.min() == -300.0
    frequency_Hz = np.linspace(*image.get_extent()[2:], len(level_dB))
    assert abs(frequency_Hz[level_dB.max(axis=1).argmax()] - 250.0) <= 10.0


def test_envelope_keeps_peaks() -> None:
    values = np.zeros(100_000)
    values[12_345], values[77_777] = 9.0, -7.0
    _, low, high = envelope(np.arange(100_000.0), values)
    assert len(low) <= 2001
    assert high.max() == 9.0 and low.min() == -7.0


@pytest.mark.parametrize("count", [1, 2, 90])
def test_short_recordings(tmp_path: Path, recording: Recording, count: int) -> None:
    arrays = {f.name: getattr(recording, f.name) for f in fields(recording)}
    cut = {name: a[:count] for name, a in arrays.items() if isinstance(a, np.ndarray)}
    save_chart(draw_plot(replace(recording, **cut)), tmp_path / "plots.png")
    with Image.open(tmp_path / "plots.png") as image:
        assert image.format == "PNG" and image.width > 1000


def drawn(ax) -> dict[str, np.ndarray]:
    """Label and heights of each line."""
    return {line.get_label(): np.asarray(line.get_ydata()) for line in ax.lines}


def spans(collection) -> list[tuple[float, float]]:
    """Start and end of each bar."""
    return [(float(p.vertices[:, 0].min()), float(p.vertices[:, 0].max())) for p in collection.get_paths()]


def test_lines(recording: Recording) -> None:
    swatch, force, depth, acceleration, spectrum, bar = draw_plot(recording).axes
    units = ["", "N", "mm", "m/s²", "Hz", "dB re 1 (m/s²)²/Hz"]
    labels = [ax.get_ylabel() for ax in (swatch, force, depth, acceleration, spectrum, bar)]
    assert all(unit in label for unit, label in zip(units, labels, strict=True)) and depth.get_ylim()[0] == 0.0
    lines = drawn(force)
    np.testing.assert_allclose(lines["magnitude"], np.linalg.norm(recording.f_W_N, axis=1))
    np.testing.assert_array_equal(np.stack([lines[axis] for axis in "xyz"], axis=1), recording.f_W_N)
    (curve,) = depth.lines
    np.testing.assert_allclose(curve.get_ydata(), recording.depth_m * 1e3)
    low, high = acceleration.dataLim.intervaly
    assert (low, high) == pytest.approx((-3.0, 3.0), rel=0.01)


def test_axes_have_their_labels_legends_and_ticks(recording: Recording) -> None:
    figure = draw_plot(recording, "a title")
    silent = draw_plot(replace(recording, a_m_s2=np.zeros_like(recording.a_m_s2))).axes
    *rows, spectrum, bar = figure.axes
    assert figure.get_suptitle() == "a title" and spectrum.get_xlabel() == "time [s]"
    legends = [ax.get_legend() and [text.get_text() for text in ax.get_legend().get_texts()] for ax in rows]
    assert legends == [["wood", "leather", "paper", "epoxy"], ["magnitude", "x", "y", "z"], None, None]
    assert rows[0].get_ylabel() == "swatch" and rows[0].get_ylim() == (0.0, 1.0) and not len(rows[0].get_yticks())
    assert not any(rows[0].spines[side].get_visible() for side in ("left", "bottom"))
    assert not rows[0].xaxis.get_major_ticks()[0].tick1line.get_visible()
    shown = [ax.xaxis.get_tick_params()["labelbottom"] for ax in rows]
    assert shown == [False] * 4 and spectrum.xaxis.get_tick_params().get("labelbottom", True)
    places = [ax.yaxis.label.get_position() for ax in (*rows, spectrum)]
    assert places == [(-0.005, 0.5), *[(-0.052, 0.5)] * 4]
    assert not any(line.get_visible() for line in (*spectrum.get_xgridlines(), *spectrum.get_ygridlines()))
    assert bar.get_visible() and not silent[5].get_visible() and silent[3].get_ylim() == (-1.0, 1.0)


def test_swatch_bar_and_shading(recording: Recording) -> None:
    axes = draw_plot(recording).axes
    shown = {bar.get_label(): spans(bar) for bar in axes[0].collections}
    assert shown["wood"] == [pytest.approx(span) for span in ((0.2, 0.25), (1.2, 1.4))]
    assert shown["leather"] == [pytest.approx(span) for span in ((0.5, 0.55), (1.6, 1.8))]
    touched = spans(axes[1].collections[-1])
    assert touched == [pytest.approx(span) for span in ((0.2, 0.25), (0.5, 0.55), (0.8, 1.4), (1.6, 1.9))]
    assert axes[0].get_xlim() == pytest.approx((0.0, 2.0))


def test_rows_leave_space_for_their_legends(recording: Recording) -> None:
    *rows, bar = (ax.get_position() for ax in draw_plot(recording).axes)
    assert (rows[0].y1, rows[-1].y0) == pytest.approx((1.0 - TITLE - LEGEND_ROW, BOTTOM))
    assert [above.y0 - below.y1 for above, below in pairwise(rows)] == pytest.approx([LEGEND_ROW] * 4)
    assert [row.height / rows[1].height for row in rows] == pytest.approx([0.4 / 3, 1.0, 2 / 3, 2 / 3, 2.6 / 3])
    assert {(row.x0, row.x1) for row in rows} == {(LEFT, RIGHT)}
    assert bar.bounds == pytest.approx((RIGHT + 0.01, rows[-1].y0, 0.01, rows[-1].height))


def test_closed_loop_plot(recording: Recording) -> None:
    rng, n = np.random.default_rng(0), len(recording.t_s)
    feel = SimpleNamespace(
        recording=recording,
        target_W_m=rng.standard_normal((n, 3)),
        p_W_m=rng.standard_normal((n, 3)),
        f_hand_W_N=rng.standard_normal((n, 3)),
        f_motor_W_N=rng.standard_normal((n, 3)),
        a_handle_m_s2=0.5 * recording.a_m_s2,
        latency_s=0.004,
        work_J=rng.standard_normal(n),
    )
    height, force, acceleration, work = (ax for ax in draw_hand_plot(feel, "a title").axes)
    lines = drawn(height)
    assert ["mm" in height.get_ylabel(), "N" in force.get_ylabel(), "mJ" in work.get_ylabel()] == [True] * 3
    np.testing.assert_allclose(lines["target of the hand"], 1e3 * feel.target_W_m[:, 2])
    np.testing.assert_allclose(lines["device"], 1e3 * feel.p_W_m[:, 2])
    on = np.where(recording.touching, 1e3 * recording.p_WP_m[:, 2], np.nan)
    np.testing.assert_allclose(lines["proxy on the surface"], on)
    lines = drawn(force)
    np.testing.assert_allclose(lines["hand"] ** 2, np.sum(feel.f_hand_W_N**2, axis=1))
    np.testing.assert_allclose(lines["motors"] ** 2, np.sum(feel.f_motor_W_N**2, axis=1))
    np.testing.assert_allclose(drawn(work)["work of the motors"], 1e3 * np.cumsum(feel.work_J))
    axes = height, force, acceleration, work
    legends = [[text.get_text() for text in ax.get_legend().get_texts()] for ax in axes]
    assert [len(names) for names in legends] == [3, 2, 2, 1] and legends[2] == ["requested", "handle"]
    assert all(spans(ax.collections[-1])[0] == pytest.approx((0.2, 0.25)) for ax in axes)
    assert work.get_xlim() == (recording.t_s[0], recording.t_s[-1]) and work.get_xlabel() == "time [s]"
    np.testing.assert_array_equal(work.lines[1].get_ydata(), 0.0)
    areas = {
        area.get_label(): area.get_paths()[0].vertices
        for area in acceleration.collections
        if area.get_label()[0] != "_"
    }
    assert np.abs(areas["requested"][:, 1]).max() == pytest.approx(3.0, rel=0.01)
    assert np.abs(areas["handle"][:, 1]).max() == pytest.approx(1.5, rel=0.01)
    assert areas["handle"][:, 0].min() == pytest.approx(-0.004)  # shifted by the latency
