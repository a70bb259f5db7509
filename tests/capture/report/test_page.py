"""Reports: content, safety, and comparison with a recording of known models."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.fit import distance as spectral
from hapscene.capture.fit.order import DISTANCE_RATIO
from hapscene.capture.fit.segment import InteractionState, Segmentation, segment
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import Streams, clean
from hapscene.capture.report.numbers import (
    DURATION_MIN_S,
    RUN_S,
    _correlated,
    compare_with_recording,
    sliding,
    spectrum_along,
)
from hapscene.capture.report.page import _verdict, report, rows, write_report
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


def test_a_fit_to_a_known_surface_is_usable(swatch: Swatch, recording: SurfaceRecording) -> None:
    channels = clean(recording.acceleration_m_s2, RATE, recording.force_N, recording.speed_m_s)
    comparison = compare_with_recording(swatch, channels, segment(channels))
    held = comparison.held_out
    assert held is not None
    assert held.distance_dB < held.floor_dB and abs(held.level_dB) < 0.4
    model, first, second = (spectral.band_power(x, held.frequency_Hz) for x in (held.model, held.fitted, held.held_out))
    for total_dB, band_dB, power in (
        (held.level_dB, held.band_dB, model),
        (held.halves_dB, held.halves_band_dB, first),
    ):
        assert total_dB == pytest.approx(10.0 * np.log10(power.sum() / second.sum()))
        assert band_dB == pytest.approx(10.0 * np.log10(power / second))
    assert [row.grade for row in rows(comparison)] == ["good"] * 6
    assert rows(comparison)[0].required.startswith(f"at most {DISTANCE_RATIO * held.floor_dB:.2f} dB")
    assert _verdict(swatch, comparison, rows(comparison), "").startswith("usable: ")


def test_a_hand_that_does_not_move_steadily_is_named_and_does_not_count(
    swatch: Swatch, recording: SurfaceRecording
) -> None:
    """The bounds are those of stationary signals; the second half of another one has one more pole."""
    rng = np.random.default_rng(2)
    steady = lfilter([1.0], A, rng.standard_normal(12_000))
    moved = np.concatenate((steady[:6000], lfilter([1.0], np.convolve(A, [1.0, 0.5]), rng.standard_normal(6000))))
    (found, bound), (off, _) = _correlated(steady, RATE), _correlated(moved, RATE)
    assert 5 <= found <= bound < off  # of 100: 5 by chance, more by the error of 120 coefficients
    channels = clean(recording.acceleration_m_s2, RATE, recording.force_N, recording.speed_m_s)
    comparison = compare_with_recording(swatch, channels, segment(channels))
    assert comparison.held_out is not None
    unsteady = rows(replace(comparison, held_out=replace(comparison.held_out, correlated=(60, 20))))
    assert [row.grade for row in unsteady].count("unsteady") == 1
    assert _verdict(swatch, comparison, unsteady, "") == _verdict(swatch, comparison, rows(comparison), "")


def test_a_swatch_of_another_surface_is_insufficient(swatch: Swatch, recording: SurfaceRecording) -> None:
    """The texture is 12 dB weaker than the recording in all bands, while the halves of the recording agree."""
    channels = clean(recording.acceleration_m_s2, RATE, recording.force_N, recording.speed_m_s)
    assert swatch.texture is not None
    texture = replace(swatch.texture, variance_m2_s4=swatch.texture.variance_m2_s4 / 16.0)
    *_, bands = rows(compare_with_recording(replace(swatch, texture=texture), channels, segment(channels)))
    assert (bands.value, bands.grade) == ("12 of 12", "short")


def test_perceptible_differences_are_compared_with_those_of_the_halves(
    swatch: Swatch, recording: SurfaceRecording
) -> None:
    """Differences of 4 and 3.5 dB in two bands are insufficient, unless the halves differ in as many."""
    channels = clean(recording.acceleration_m_s2, RATE, recording.force_N, recording.speed_m_s)
    comparison = compare_with_recording(swatch, channels, segment(channels))
    held, off_dB = comparison.held_out, np.array([0.0, -4.0, 0.0, 3.5, *np.zeros(8)])
    assert held is not None
    for halves_dB, verdict in ((np.zeros(12), "short"), (off_dB, "equal")):
        off = replace(comparison, held_out=replace(held, band_dB=off_dB, halves_band_dB=halves_dB))
        spectrum, _, bands, *_ = rows(off)
        assert spectrum.grade == "equal" and bands.grade == verdict  # within the limit, but perceptible
        assert bands.value == "2 of 12" and "−4.0 dB" in bands.required
        assert bands.measure in _verdict(swatch, off, rows(off), "")


def test_short_runs_of_sliding_are_left_out() -> None:
    long, short = round(RUN_S * 1000.0), round(RUN_S * 1000.0) - 1
    rows = np.arange(round(1000.0 * DURATION_MIN_S) + 1000.0)
    states = np.full(len(rows), InteractionState.SLIDING, np.int8)
    states[[10, 11 + short, 12 + short + long]] = InteractionState.AIR
    channels = Streams(1000.0, rows, rows, rows, rows)
    kept = sliding(channels, Segmentation(1000.0, states, (), None, None)).acceleration_m_s2
    np.testing.assert_array_equal(kept, [*rows[12 + short : 12 + short + long], *rows[13 + short + long :]])
    states[long + 1 :] = InteractionState.AIR
    with pytest.raises(CaptureError, match="longer strokes"):
        sliding(channels, Segmentation(1000.0, states, (), None, None))


def test_the_spectrum_along_a_stroke_is_the_mean_of_the_models() -> None:
    texture = Texture.from_models(RATE, [1.0], [0.1], a=[A], variance_m2_s4=[0.5])
    force, speed = np.full(4000, 1.0), np.full(4000, 0.1)
    frequency, density = spectrum_along(texture, force, speed)
    assert density.sum() * frequency[1] == pytest.approx(texture.power([1.0], [0.1])[0], rel=0.01)
    force[::20], force[19::20] = 9.0, 0.0  # only the middle of each block of 10 ms counts
    speed[2000:] = 0.0  # silence in the second half
    assert spectrum_along(texture, force, speed)[1] == pytest.approx(0.5 * density)


def test_the_page_is_complete_and_loads_nothing(swatch: Swatch, recording: SurfaceRecording) -> None:
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


def test_without_a_recording_two_plots_state_the_reason() -> None:
    text = report(load_swatch("wood"))
    assert text == report(load_swatch("wood"))  # the same content makes the same page
    assert text.count("Needs a recording") == 2
    assert "Spectra of the models" in text and "650 N/m" in text
    Page(text)


def test_quantities_that_were_not_measured_are_reported() -> None:
    text = report(PLAIN)
    assert text.count('<div class="value">not measured</div>') == 2 and "<h2>Not measured</h2>" in text
    unknown = replace(PLAIN, absent=dict.fromkeys(("friction_dynamic", "stiffness_N_m", "damping_Ns_m"), "a reason"))
    assert report(unknown).count('<div class="value">not measured</div>') == 5
    assert "has no texture" in report(PLAIN, recorded(2000))


def test_a_recording_without_sliding_gives_the_rest_of_the_page(swatch: Swatch) -> None:
    rest = recorded(4000)
    still = replace(rest, speed_m_s=np.where(np.arange(4000) < 100, 0.2, 0.0))
    text = report(swatch, still)
    Page(text)
    assert "slides for less than" in text and "Force and speed" in text


WAVE = np.exp(-60 * np.arange(200) / RATE) * np.sin(2 * np.pi * 150 * np.arange(200) / RATE)
TAPS = Taps([0.1, 0.2], [5.0, 9.0], [150.0, 150.0], [60.0, 60.0], np.stack([5 * WAVE, 9 * WAVE]), RATE)


def test_fitted_taps_have_intervals(swatch: Swatch) -> None:
    changed = replace(
        swatch, taps=TAPS, intervals={"taps.frequency_Hz[0]": (140.0, 160.0), "stiffness_N_m": (400.0, 600.0)},
        absent={"friction_static": "<b>never</b> at rest"},
    )  # fmt: skip
    text = report(changed)
    Page(text)
    assert "95 % interval" in text and "95 % interval 400 to 600" in text
    assert "friction static" in text and "&lt;b&gt;never" in text


def test_names_and_texts_are_escaped() -> None:
    evil = "<script>alert(1)</script>\"&'$x_1$</title><img src=x onerror=alert(1)>"
    changed = replace(load_swatch("wood"), name=evil, provenance=evil, licence=evil, absent={evil: evil})
    for text in (report(changed), report(replace(changed, texture=None), recorded(2000), evil)):
        parsed = Page(text)
        assert "script" not in parsed.tags and "img" not in parsed.tags and "onerror" not in dict(parsed.attributes)


def test_a_short_recording_has_no_held_out_comparison() -> None:
    text = report(load_swatch("wood"), recorded(1500))
    assert "record more: no comparison on held-out data" in text


@pytest.mark.parametrize(("source", "said"), [("a.csv", "a.csv: "), ("", "")])
def test_an_invalid_recording_is_named(source: str, said: str) -> None:
    with pytest.raises(CaptureError, match=f"^{said}the acceleration "):
        report(PLAIN, replace(recorded(4000), acceleration_m_s2=np.zeros(4000)), source)


def test_a_page_that_cannot_be_written_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="cannot be written"):
        write_report(PLAIN, tmp_path / "none" / "a.html")
    write_report(PLAIN, tmp_path / "a.html")
    assert [file.name for file in tmp_path.iterdir()] == ["a.html"]
