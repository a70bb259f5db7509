"""Plots of a report: lines, limits and captions."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from hapscene.capture.fit.order import PERCEPTUAL_JND
from hapscene.capture.fit.segment import InteractionState, Segmentation
from hapscene.capture.io.streams import Streams
from hapscene.capture.report import plots
from hapscene.surface.swatch import Swatch
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture

RATE_HZ = 2000.0
TEXTURE = Texture.from_models(
    RATE_HZ, [1.0, 2.0, 1.0, 2.0], [0.1, 0.1, 0.2, 0.2], a=[[1.0, -0.5]] * 4, variance_m2_s4=[0.1, 0.2, 0.4, 0.0]
)


@pytest.fixture
def axes(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The axes of the last plot."""
    made: list[Any] = []

    def draw_on_axes(name: str, draw: Callable[..., None], *size: Any, panels: Any = (1,), **more: Any) -> str:
        made[:] = Figure().subplots(len(panels), 1, squeeze=False)[:, 0]
        draw(*made)
        return name

    monkeypatch.setattr(plots, "drawn", draw_on_axes)
    return made


def lines(ax: Any) -> dict[str, np.ndarray]:
    """Places (2, n) of each line, by its label up to a comma."""
    return {line.get_label().partition(",")[0]: np.array(line.get_data(), np.float64) for line in ax.lines}


def over_band(ax: Any) -> bool:
    """Whether the horizontal axis is that of spectra."""
    ticks = [20, 50, 100, 200, 500, 1000]
    assert [text.get_text() for text in ax.get_xticklabels()] == list(map(str, ticks))
    assert ax.get_xticks().tolist() == ticks and not len(ax.get_xticks(minor=True))
    return "[Hz]" in ax.get_xlabel() and "[dB" in ax.get_ylabel() and ax.get_xlim() == (20.0, 1000.0)


def sliding(force_N: np.ndarray, tangential_N: np.ndarray) -> tuple[Streams, Segmentation]:
    count = len(force_N)
    streams = Streams(RATE_HZ, np.zeros(count), force_N, np.linspace(0.0, 0.25, count), tangential_N)
    return streams, Segmentation(RATE_HZ, np.full(count, InteractionState.SLIDING, np.int8), (), None, None)


def test_spectra_of_models(axes: list[Any]) -> None:
    plots.plot_models(TEXTURE)
    shown = [line.get_ydata() for line in axes[0].lines]
    frequency = axes[0].lines[0].get_xdata()
    assert frequency[[0, -1]] == pytest.approx([20.0, 1000.0]) and over_band(axes[0])
    labels = ["1 N, 100 mm/s", "1 N, 200 mm/s", "2 N, 100 mm/s", "2 N, 200 mm/s"]
    assert [line.get_label() for line in axes[0].lines] == labels and axes[0].get_xscale() == "log"
    for level, (force, speed) in zip(shown, ((1, 0.1), (1, 0.2), (2, 0.1), (2, 0.2)), strict=True):
        density = TEXTURE.density([force], [speed], frequency_Hz=frequency)[0]
        assert level == pytest.approx(10.0 * np.log10(np.maximum(density, 1e-30)))
    audible = np.concatenate(shown[:3])  # the last one is silent
    assert axes[0].get_ylim() == pytest.approx((audible.min() - 3.0, audible.max() + 3.0))
    plots.plot_models(replace(TEXTURE, rate_Hz=1000.0))
    assert axes[0].lines[0].get_xdata()[-1] == pytest.approx(500.0)


def test_spectra_of_halves(axes: list[Any]) -> None:
    frequency = np.array([10.0, 20.0, 1000.0, 1500.0])
    levels = {name: 10.0 ** np.array(power) for name, power in (("fitted", (9, 0, 1, 9)), ("held_out", (9, 2, 1, -9)))}
    plot = plots.plot_spectra(
        SimpleNamespace(frequency_Hz=frequency, **levels, model=np.ones(4), distance_dB=1.25, floor_dB=0.5)  # type: ignore[arg-type]
    )
    assert lines(axes[0])["model of the first half"][1].tolist() == [0.0] * 4
    assert axes[0].get_ylim() == (-3.0, 23.0) and "1.25 dB" in plot.caption
    assert len(axes[0].lines) == 3 and over_band(axes[0])


def test_order(axes: list[Any]) -> None:
    search: Any = SimpleNamespace(
        orders=np.arange(2, 8, 2), distance_dB=np.array([5.0, 2.0, 1.0]), floor_dB=1.5, chosen=6,
        difference_jnd=np.array([2.0, 1.0, 0.0]),
    )  # fmt: skip
    plot = plots.plot_order(search, 4)
    span = 4.7 - 1.0 + 0.2  # from the best order, or the floor, to the quantile of 95 %
    assert axes[0].get_ylim() == pytest.approx((1.0 - 0.2 * span, 4.7 + 0.4 * span))
    assert axes[1].get_ylim() == (0.0, 4.0 * PERCEPTUAL_JND)
    assert "distance of 2.00 dB; the best order has 1.00 dB" in plot.caption
    known = [[([2, 4, 6], [5.0, 2.0, 1.0]), ([0, 1], [1.5, 1.5]), ([4, 4], [0, 1])]]
    known += [[([0, 1], [PERCEPTUAL_JND] * 2), ([2, 4, 6], [2.0, 1.0, 0.0]), ([4, 4], [0, 1])]]
    for ax, drawn, unit in zip(axes, known, ("[dB]", "[JND]"), strict=True):
        assert [tuple(map(list, line.get_data())) for line in ax.lines] == drawn and unit in ax.get_ylabel()
    assert axes[1].get_xlabel() == "order of the models"


def test_plane(axes: list[Any]) -> None:
    channels, _ = sliding(np.linspace(0.0, 2.5, 2400), np.zeros(2400))
    plot = plots.plot_plane(TEXTURE, channels)
    found = lines(axes[0])
    np.testing.assert_allclose(found["the recording"], [1e3 * channels.speed_m_s[::3], channels.force_N[::3]])
    np.testing.assert_allclose(found["model"], [[100.0, 100.0, 200.0], [1.0, 2.0, 1.0]])
    np.testing.assert_allclose(found["silent model"][:, 0], [200.0, 2.0])  # before those at zero force or speed
    rms = [f"{power**0.5:.2g} m/s²" for power in TEXTURE.model_power_m2_s4[:3]]
    assert [(text.get_text(), text.get_ha()) for text in axes[0].texts] == [
        *((one, "left") for one in rms[:2]),
        (rms[2], "right"),
    ]
    assert len(axes[0].lines) == 5 and axes[0].get_xlim() == pytest.approx((-15.0, 264.8), abs=0.1)  # with triangles
    assert (axes[0].get_xlabel(), axes[0].get_ylabel()) == ("slip speed [mm/s]", "normal force [N]")
    assert plot.caption.startswith("3 models;") and " 20 % of the recording is beyond" in plot.caption


def test_friction(axes: list[Any]) -> None:
    force_N = np.linspace(0.0, 2.0, 1001)
    parts = sliding(force_N, 0.4 * force_N)
    swatch = Swatch("a", friction_static=0.5, friction_dynamic=0.4, intervals={"friction_dynamic": (0.38, 0.42)})
    plot = plots.plot_friction(swatch, *parts)
    found = lines(axes[0])
    assert found["recorded while sliding"][0].min() == pytest.approx(0.202)  # above a tenth of the largest force
    np.testing.assert_allclose(found["dynamic"], [[0.0, 2.1], [0.0, 0.84]])
    np.testing.assert_allclose(found["static"], [[0.0, 2.1], [0.0, 1.05]])
    assert axes[0].get_xlim() == (0.0, 2.1) and axes[0].get_ylim() == pytest.approx((0.0, 1.3 * 1.05))
    assert (axes[0].get_xlabel(), axes[0].get_ylabel()) == ("normal force [N]", "tangential force [N]")
    assert "0.400 (95 % interval 0.380 to 0.420). 90 % of the samples are between 0.40 and 0.40" in plot.caption
    band = axes[0].collections[0].get_paths()[0].vertices
    assert band[band[:, 0] > 2.0, 1] == pytest.approx([0.798, 0.882, 0.882], abs=0.085)


def test_taps(axes: list[Any]) -> None:
    taps = Taps([0.1, 0.2], [5.0, 9.0], [150.0, 140.0], [60.0, 50.0])
    plots.plot_taps(taps, {"taps.frequency_Hz[1]": (120.0, 180.0)})
    for ax, row, points, top in zip(axes, range(3), ([5, 9], [150, 140], [60, 50]), (9.0, 180.0, 60.0), strict=True):
        line, fitted = (np.array(one.get_data()) for one in ax.lines)
        np.testing.assert_allclose(fitted, [[100.0, 200.0], points])
        assert line[0][[0, -1]] == pytest.approx([0.0, 250.0])
        assert line[1] == pytest.approx([taps.at(speed / 1e3)[row] for speed in line[0]])
        assert ax.get_ylim() == pytest.approx((0.0, 1.2 * top))
    assert [ax.get_ylabel().split("\n")[0] for ax in axes] == ["amplitude", "frequency", "decay"]
    assert axes[2].get_xlabel() == "approach speed [mm/s]"
    assert axes[0].get_legend_handles_labels()[1] == ["rendered", "fitted, 95 % interval"]
    assert not axes[1].get_legend_handles_labels()[1] and not axes[2].get_legend_handles_labels()[1]
    bar = axes[1].collections[0].get_segments()[1]
    assert bar.tolist() == [[200.0, 120.0], [200.0, 180.0]]


def test_a_plot_is_as_high_as_its_legend_demands(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Figure] = []
    monkeypatch.setattr(plots, "inline_svg", lambda figure, name: made.append(figure) or name)

    def draw(*panels: Any) -> None:
        for count, ax in zip(counts, panels, strict=True):
            for k in range(count):
                ax.plot([0, 1], label=f"line {k}")

    for counts, rows in (((0, 0), 0), ((2, 0), 1), ((1, 2), 2)):
        assert plots.drawn("a", draw, 3.0, panels=(2, 1)) == "a"
        (figure,) = made
        assert figure.get_figheight() == pytest.approx(3.0 + rows * plots.LINE_IN) and made.pop() is figure
        assert [len(legend.texts) for legend in figure.legends] == ([sum(counts)] if rows else [])


def test_signs() -> None:
    assert [plots.signed(value, 1) for value in (-1.26, 0.0, 2.0)] == ["−1.3", "+0.0", "+2.0"]
