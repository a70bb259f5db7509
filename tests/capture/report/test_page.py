"""The report: whole, safe to open, and right about a recording whose truth is known."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.fit.segment import InteractionState, Segmentation, segment
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import Streams, clean
from hapscene.capture.report import plots as report_plots
from hapscene.capture.report.numbers import judge, spectrum_along
from hapscene.capture.report.page import _verdict_line, report, rows, write_report
from hapscene.capture.report.plots import (
    plot_friction,
    plot_models,
    plot_plane,
    plot_spectra,
    plot_taps,
)
from hapscene.errors import CaptureError
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch

from ..signals import fit

RATE = 2000.0
A = np.convolve([1.0, -1.2, 0.8], [1.0, 0.5, 0.7])
VOID = {"meta", "line", "circle", "rect", "path", "use", "image"}


def recorded(count: int = 12_000, seed: int = 1) -> SurfaceRecording:
    """A stroke over a surface of known model, with force, speed and friction of 0.4."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / RATE
    force, speed = 1.5 + 0.1 * np.sin(3 * t), 0.15 + 0.01 * np.sin(2 * t)
    return SurfaceRecording(RATE, lfilter([1.0], A, rng.standard_normal(count)), force, speed, 0.4 * force)


@pytest.fixture(scope="module")
def recording() -> SurfaceRecording:
    return recorded()


class Page(HTMLParser):
    """Checks that tags are balanced, and collects tags and attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag


@pytest.fixture(scope="module")
def swatch(recording: SurfaceRecording) -> Swatch:
    """The swatch of that recording."""
    return fit(
        recording.acceleration_m_s2, RATE, force_N=recording.force_N, speed_m_s=recording.speed_m_s,
        tangential_force_N=recording.tangential_force_N, name="known", order=4,
    )  # fmt: skip


def test_a_known_surface_is_judged_good(swatch: Swatch, recording: SurfaceRecording) -> None:
    channels = clean(recording.acceleration_m_s2, RATE, recording.force_N, recording.speed_m_s)
    judgement = judge(swatch, channels, segment(channels))
    held = judgement.held_out
    assert held is not None
    assert held.distance_dB < held.floor_dB and abs(held.level_dB) < 0.4
    assert held.centroid_ratio == pytest.approx(1.0, abs=0.05)
    assert held.goodness_of_fit > 0.95
    assert judgement.spectrogram_error == pytest.approx(0.655, abs=0.05)
    assert [row.verdict for row in rows(judgement) if row.verdict] == ["good"] * 7


def test_a_swatch_of_another_surface_is_not_called_good(swatch: Swatch, recording: SurfaceRecording) -> None:
    """Its texture 12 dB softer than the recording in all bands, though the recording's own halves agree."""
    channels = clean(recording.acceleration_m_s2, RATE, recording.force_N, recording.speed_m_s)
    assert swatch.texture is not None
    texture = replace(swatch.texture, variance_m2_s4=swatch.texture.variance_m2_s4 / 16.0)
    judged = rows(judge(replace(swatch, texture=texture), channels, segment(channels)))
    whole = [row for row in judged if "the swatch is felt" in row.measure]
    assert [(row.value, row.verdict) for row in whole] == [("12 of 12", "short")]


def test_what_is_felt_to_be_off_is_not_called_good(swatch: Swatch, recording: SurfaceRecording) -> None:
    """Two of twelve bands by 4 and 3.5 dB: short, unless the recording's own halves differ in as many."""
    channels = clean(recording.acceleration_m_s2, RATE, recording.force_N, recording.speed_m_s)
    judgement = judge(swatch, channels, segment(channels))
    held, off_dB = judgement.held_out, np.array([0.0, -4.0, 0.0, 3.5, *np.zeros(8)])
    assert held is not None
    for halves_dB, verdict in ((np.zeros(12), "short"), (off_dB, "alike")):
        off = replace(judgement, held_out=replace(held, band_dB=off_dB, halves_band_dB=halves_dB))
        spectrum, _, _, bands, *_ = (row for row in rows(off) if row.verdict)
        assert spectrum.verdict == "alike" and bands.verdict == verdict  # near the floor, and yet felt
        assert bands.value == "2 of 12" and "−4.0 dB" in bands.required
        assert "bands that differ by more than is felt" in _verdict_line(off, rows(off), "")


def test_the_spectrum_along_a_stroke_is_the_mean_of_its_models() -> None:
    texture = Texture.from_models(RATE, [1.0], [0.1], a=[A], variance_m2_s4=[0.5])
    force, speed = np.full(4000, 1.0), np.full(4000, 0.1)
    frequency, density = spectrum_along(texture, force, speed)
    assert density.sum() * frequency[1] == pytest.approx(texture.power([1.0], [0.1])[0], rel=0.01)
    force[::20], force[19::20] = 9.0, 0.0  # each block of 10 ms is what it is in its middle
    speed[2000:] = 0.0  # silence in the second half
    assert spectrum_along(texture, force, speed)[1] == pytest.approx(0.5 * density)


def test_a_page_is_whole_and_alone(swatch: Swatch, recording: SurfaceRecording) -> None:
    text = report(swatch, recording, "known.csv")
    parsed = Page(text)
    assert "script" not in parsed.tags and "link" not in parsed.tags and "iframe" not in parsed.tags
    assert not any(name.startswith("on") for name, _ in parsed.attributes)
    for name, value in parsed.attributes:
        if name in ("src", "href", "xlink:href"):
            assert value and value.startswith(("data:image/png", "#")), f"{name}={value} would be fetched"
    assert "default-src 'none'" in text and "prefers-color-scheme: dark" in text
    drawings = re.findall(r"<svg role.*?</svg>", text, re.DOTALL)
    assert len(drawings) == 4
    for drawing in drawings:
        ET.fromstring(drawing)
    for title in ("Spectra", "Order", "Force and speed", "Friction", "Taps"):
        assert re.search(f"<h3>[^<]*{title}", text)
    for unit in ("frequency [Hz]", "slip speed [mm/s]", "normal force [N]", "LSD [dB]"):
        assert unit in text
    assert "var(--orange)" in text and "#d55e00;" in text  # verdicts take the page's colours
    assert all("light-dark(#222222, #e6e9ed)" in drawing for drawing in drawings)  # and drawings its ink
    ids = [
        value for name, value in parsed.attributes if name == "id" and value and re.match(r"(?:p|m|image)\w{10}", value)
    ]
    assert ids and len(ids) == len(set(ids))  # no drawing refers to another's parts


def test_without_a_recording_the_plots_say_so() -> None:
    text = report(load_swatch("wood"))
    assert text == report(load_swatch("wood"))  # the same content makes the same page
    assert text.count("Needs the recording") == 2
    assert "Spectra of the models" in text and "650 N/m" in text
    Page(text)


def test_friction_of_0_is_told_from_friction_that_was_not_measured() -> None:
    assert "not measured" not in report(PLAIN) and "the tool glides" in report(PLAIN)
    unknown = replace(PLAIN, absent={"friction_dynamic": "no tangential force", "friction_static": "no force"})
    assert '<div class="value">not measured</div>' in report(unknown)


def test_what_a_swatch_does_not_have_is_said() -> None:
    text = report(PLAIN)
    assert "What is absent, and why" in text and "sliding is silent" in text and "touch is silent" in text
    assert "has no texture" in report(PLAIN, recorded(2000))


def test_a_recording_without_sliding_leaves_the_rest_of_the_page(swatch: Swatch) -> None:
    rest = recorded(4000)
    still = replace(rest, speed_m_s=np.where(np.arange(4000) < 100, 0.2, 0.0))
    text = report(swatch, still)
    Page(text)
    assert "slides for less than" in text and "Force and speed" in text


WAVE = np.exp(-60 * np.arange(200) / RATE) * np.sin(2 * np.pi * 150 * np.arange(200) / RATE)
TAPS = Taps([0.1, 0.2], [5.0, 9.0], [150.0, 150.0], [60.0, 60.0], np.stack([5 * WAVE, 9 * WAVE]), RATE)


def test_measured_taps_are_drawn_with_their_intervals(swatch: Swatch) -> None:
    told = replace(
        swatch, taps=TAPS, intervals={"taps.frequency_Hz[0]": (140.0, 160.0), "stiffness_N_m": (400.0, 600.0)},
        absent={"friction_static": "<b>never</b> at rest"},
    )  # fmt: skip
    text = report(told)
    Page(text)
    assert "95 % interval" in text and "95 %: 400 to 600" in text
    assert "friction static" in text and "&lt;b&gt;never" in text


def test_names_and_texts_of_strangers_are_escaped() -> None:
    evil = "<script>alert(1)</script>\"&'$x_1$</title><img src=x onerror=alert(1)>"
    told = replace(load_swatch("wood"), name=evil, provenance=evil, licence=evil, absent={evil: evil})
    for text in (report(told), report(replace(told, texture=None), recorded(2000), evil)):
        parsed = Page(text)
        assert "script" not in parsed.tags and "img" not in parsed.tags and "onerror" not in dict(parsed.attributes)


def test_a_recording_too_short_for_halves_is_reported_on_all_the_same() -> None:
    text = report(load_swatch("wood"), recorded(1500))
    assert "could not be judged on held-out data" in text


@pytest.mark.parametrize(("source", "said"), [("a.csv", "a.csv: "), ("", "")])
def test_a_recording_that_cannot_be_used_is_told_by_its_name(source: str, said: str) -> None:
    with pytest.raises(CaptureError, match=f"^{said}the acceleration "):
        report(PLAIN, replace(recorded(4000), acceleration_m_s2=np.zeros(4000)), source)


def test_a_page_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="cannot be written"):
        write_report(PLAIN, tmp_path / "none" / "a.html")
    write_report(PLAIN, tmp_path / "a.html")
    assert [file.name for file in tmp_path.iterdir()] == ["a.html"]


@pytest.fixture
def axes(monkeypatch: pytest.MonkeyPatch):
    """Axes on which the next plot of a report is drawn; its further panels are those of the same figure."""
    from matplotlib.figure import Figure

    axes = Figure().subplots()

    def drawn(name, draw, *size, panels=(1,), **legend):
        draw(axes, *(axes.figure.add_subplot() for _ in panels[1:]))
        return ""

    monkeypatch.setattr(report_plots, "drawn", drawn)
    return axes


def test_the_friction_that_is_drawn_is_the_swatch_s_over_what_was_recorded(axes) -> None:
    force = np.linspace(1.0, 2.0, 400)
    states = np.full(400, InteractionState.SLIDING, dtype=np.int8)
    states[300:] = InteractionState.STILL
    streams = Streams(1000.0, np.zeros(400), force, np.full(400, 0.1), -0.3 * force)
    swatch = Swatch("made", friction_static=0.5, friction_dynamic=0.3, intervals={"friction_dynamic": (0.25, 0.35)})
    told = plot_friction(swatch, streams, Segmentation(1000.0, states, (), None, None))
    assert "0.300 (95 % interval 0.250 to 0.350)" in told.caption and "between 0.30 and 0.30" in told.caption
    recorded, *lines = axes.lines
    assert (
        np.array_equal(recorded.get_ydata(), 0.3 * np.asarray(recorded.get_xdata()))
        and recorded.get_xdata().max() < 1.75
    )
    assert [line.get_ydata()[1] / line.get_xdata()[1] for line in lines] == pytest.approx([0.3, 0.5])
    x, y = axes.collections[0].get_paths()[0].vertices.T
    assert (y[x > 1.0] / x[x > 1.0]).min() == pytest.approx(0.25) and (y[x > 1.0] / x[x > 1.0]).max() == pytest.approx(
        0.35
    )
    still = Segmentation(1000.0, np.zeros(400, np.int8), (), None, None)
    assert "never slides" in plot_friction(swatch, streams, still).caption


def test_the_plane_names_each_sounding_model_s_vibration(axes) -> None:
    force, speed = [1.0, 1.0, 2.0], [0.1, 0.2, 0.1]
    texture = Texture.from_models(1000.0, force, speed, a=[[1.0, -0.5]] * 3, variance_m2_s4=[3.0, 0.0, 0.75])
    told = plot_plane(texture, None)
    rms = np.sqrt(texture.model_power_m2_s4[[i for i, v in enumerate(texture.variance_m2_s4) if v > 0.0]])
    assert told.caption.startswith(f"{len(rms)} sounding models")
    assert [text.get_text() for text in axes.texts] == [f"{level:.2g} m/s²" for level in rms]
    sounding = next(line for line in axes.lines if line.get_label().startswith("model"))
    at = np.flatnonzero(texture.variance_m2_s4 > 0.0)
    assert np.array_equal(sounding.get_xdata(), 1e3 * texture.speed_m_s[at])
    assert np.array_equal(sounding.get_ydata(), texture.force_N[at])


def test_the_plane_says_how_much_of_what_touched_lies_beyond_the_models(axes) -> None:
    models = {"a": [[1.0, -0.5]] * 3, "variance_m2_s4": [1.0] * 3}
    texture = Texture.from_models(1000.0, [1.0, 1.0, 2.0], [0.1, 0.2, 0.1], **models)
    force = np.repeat([0.01, 1.0, 3.0], [500, 300, 100])
    told = plot_plane(texture, Streams(1000.0, np.zeros(900), force, np.full(900, 0.1), np.zeros(900)))
    assert "25 % of the recording lies beyond them" in told.caption


def test_a_spectrum_s_axes_hold_what_is_heard_of_it(axes) -> None:
    """All that is drawn between 20 and 1000 Hz, 3 dB of air about it."""
    frequency = np.geomspace(5.0, 5000.0, 200)
    levels = -40.0 - 20.0 * np.log10(frequency / 20.0) + np.array([[0.0], [4.0], [-6.0]])
    fitted, other, model = 10.0 ** (levels / 10.0)
    plot_spectra(SimpleNamespace(frequency_Hz=frequency, fitted=fitted, held_out=other, model=model, distance_dB=1.0,
                                 floor_dB=1.0))  # fmt: skip
    assert axes.get_xlim() == (20.0, 1000.0)
    assert [text.get_text() for text in axes.get_xticklabels()] == ["20", "50", "100", "200", "500", "1000"]
    assert axes.get_xticks().tolist() == [20, 50, 100, 200, 500, 1000] and not len(axes.get_xticks(minor=True))
    heard = levels[:, (frequency >= 20.0) & (frequency <= 1000.0)]
    assert axes.get_ylim() == pytest.approx((heard.min() - 3.0, heard.max() + 3.0))


def test_a_place_where_the_texture_is_silent_takes_no_room_in_its_spectra(axes) -> None:
    force, speed = [0.5, 1.0, 0.5, 1.0], [0.1, 0.1, 0.2, 0.2]
    texture = Texture.from_models(2000.0, force, speed, a=[[1.0, -0.5]] * 4, variance_m2_s4=[0.0, 1.0, 1.0, 1.0])
    plot_models(texture)
    levels = np.array([line.get_ydata() for line in axes.lines])
    assert levels[0].max() == -300.0
    assert axes.get_ylim() == pytest.approx((levels[1:].min() - 3.0, levels[1:].max() + 3.0))


def test_taps_are_drawn_from_0_with_all_of_their_intervals(axes) -> None:
    plot_taps(TAPS, {"taps.amplitude_m_s2[1]": (1.0, 30.0), "taps.decay_1_s[0]": (5.0, 61.0)})
    assert [panel.get_ylim() for panel in axes.figure.axes] == [(0.0, 1.2 * top) for top in (30.0, 150.0, 61.0)]
    assert [panel.get_ylabel().split("\n")[0] for panel in axes.figure.axes] == ["amplitude", "frequency", "decay"]
    assert axes.figure.axes[-1].get_xlabel() == "approach speed [mm/s]"
