"""The paper's experiment: the handle brings back what base motors cannot; the plots and numbers of it."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from hapscene.errors import HapsceneError
from hapscene.teleoperation.experiment import (
    MADE,
    Rendering,
    _draw,
    compare_handles,
    write_experiment,
    write_experiment_plot,
)
from hapscene_experiments.delay_study import (
    DelayOutcome,
    operate_case,
    study_delays,
    study_stiffness,
    summarise_delays,
    write_delay_plot,
)


@pytest.fixture(scope="module")
def renderings() -> list[Rendering]:
    return compare_handles("wood", ("none", "inverse"))


def test_the_handle_brings_back_what_base_motors_cannot(renderings: list[Rendering]) -> None:
    alone, handle = renderings
    assert alone.errors["stroke"] > 0.9 and handle.errors["stroke"] < 0.25
    assert handle.errors["all"] < 0.7 * alone.errors["all"]


@pytest.mark.parametrize("grip", ["light", "medium", "firm"])
def test_two_taps_and_five_drags_on_wood(grip: str) -> None:
    """Of the paper, whose handle had 48 %: what base motors and handle both move is not felt twice."""
    inverse, adaptive = compare_handles("wood", ("inverse", "adaptive"), grip, taps=2, strokes=5)
    assert adaptive.errors["all"] < min(0.30, inverse.errors["all"] + 0.02)


def test_latency_is_taken_out(renderings: list[Rendering]) -> None:
    """Within the strokes desired and rendered lie on each other, to the sample."""
    _, handle = renderings
    desired, rendered = handle.desired_m_s2, handle.rendered_m_s2
    late = slice(len(desired) // 2, len(desired) * 3 // 4)
    lags = np.arange(-20, 21)
    match = [np.dot(desired[late], np.roll(rendered, lag)[late]) for lag in lags]
    assert abs(lags[int(np.argmax(match))]) <= 1


def test_the_columns_of_the_plot_share_their_scales() -> None:
    """Times below, numbers at the left: each is told once, since all columns have the same."""
    noise = np.random.default_rng(0).standard_normal((2, 5000))
    figure = Figure(figsize=(9.0, 6.0))
    _draw(figure, [Rendering("none", noise[0], 3.0 * noise[1], 0.0, {"all": 1.0, "tap": 0.5})])
    *columns, levels = figure.axes
    told = [(axes.xaxis.get_major_ticks()[0].label1, axes.yaxis.get_major_ticks()[0].label1) for axes in columns]
    assert [(x.get_visible(), y.get_visible()) for x, y in told] == [(0, 1), (1, 1), (0, 0), (1, 0)]
    most_m_s2 = 1.05 * max(np.abs(noise[0]).max(), 3.0 * np.abs(noise[1]).max())
    assert {axes.get_ylim() for axes in columns[::2]} == {(-most_m_s2, most_m_s2)}
    assert (
        len({axes.get_ylim() for axes in columns[1::2]})
        == len({axes.images[0].get_clim() for axes in columns[1::2]})
        == 1
    )
    assert {axes.get_xlim() for axes in columns} == {(0.0, columns[1].images[0].get_extent()[1])}
    assert "error: all 100 %, taps 50 %" in columns[2].get_title() and levels.get_ylabel() == "dB re 1 m/s²"


def test_the_plots_are_drawn(renderings: list[Rendering], tmp_path: Path) -> None:
    write_experiment_plot(renderings, tmp_path / "experiment.png", "wood")
    outcomes = [
        DelayOutcome(scheme, delay_s, bad, case, grip, 0.2 if scheme == "position" and delay_s > 0.01 else 0.0, 0.0)
        for scheme in ("position", "wave")
        for delay_s in (0.0, 0.05)
        for bad in (False, True)
        for case in ("land", "swing")
        for grip in ("light", "firm")
    ]
    trace = {"wave": operate_case("wave", 0.05, False, "land", "light")}
    write_delay_plot(outcomes, study_stiffness((0.05,)), trace, tmp_path / "delay.png")
    for name in ("experiment.png", "delay.png"):
        with Image.open(tmp_path / name) as image:
            assert image.width > 1000
    assert summarise_delays(outcomes)["position"]["50 ms"]["clean"]["stable"] is False
    assert summarise_delays(outcomes)["wave"]["50 ms"]["bad"]["stable"] is True


@pytest.mark.soak
def test_waves_are_passive_at_every_delay_and_the_plain_controller_is_not() -> None:
    outcomes = study_delays()
    assert all(outcome.stable for outcome in outcomes if outcome.scheme == "wave")
    failed = {outcome.delay_s for outcome in outcomes if outcome.scheme == "position" and not outcome.stable}
    assert failed >= {0.02, 0.05, 0.1} and 0.0 not in failed


@pytest.mark.soak
def test_the_whole_experiment_is_written(tmp_path: Path) -> None:
    made = write_experiment(tmp_path / "out", "leather")
    assert [file.name for file in made] == list(MADE) and all(file.stat().st_size > 1000 for file in made)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["experiment"]["inverse"]["spectrogram_error"]["stroke"] < 0.4


def test_nothing_is_written_where_something_is_unknown(tmp_path: Path) -> None:
    with pytest.raises(HapsceneError, match="no compensator 'magic'"):
        write_experiment(tmp_path / "out", "wood", compensator="magic")
    assert not (tmp_path / "out").exists()
