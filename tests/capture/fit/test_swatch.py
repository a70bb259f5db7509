"""All that a recording holds, in one swatch."""

import tracemalloc

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.fit.segment import segment
from hapscene.capture.fit.stiffness import Stiffness
from hapscene.capture.fit.swatch import FitOptions, fit_recordings, prepare
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import clean
from hapscene.errors import CaptureError
from hapscene.surface.swatch_file import swatch_from_json, swatch_to_json

from ..signals import fit
from .test_contact import STIFFNESS_N_M, presses


def fitted(truth, part=slice(None), **options):
    named = {name: getattr(truth, name)[part] for name in ("force_N", "speed_m_s", "tangential_force_N", "depth_m")}
    return fit(truth.acceleration_m_s2[part], truth.rate_Hz, **named, **options)


@pytest.mark.nightly
def test_a_recording_with_everything(handled_recording):
    truth = handled_recording(0)
    swatch = fitted(truth, name="oak")
    assert swatch.texture is not None and swatch.taps is not None
    assert swatch.friction_dynamic == pytest.approx(0.35, rel=0.02)
    assert swatch.stiffness_N_m == pytest.approx(500.0, rel=0.03)
    assert len(swatch.taps.approach_m_s) == 4 and swatch.taps.wave_m_s2 is not None
    assert {"stiffness_N_m", "friction_dynamic", "taps.decay_1_s[3]"} <= swatch.intervals.keys()
    silent = {"adhesion_N", "leaving", "breakaway_1_kg", "texture.life"}
    assert swatch.absent.keys() == {"friction_stribeck", "damping_Ns_m"} | silent
    assert swatch_from_json(swatch_to_json(swatch)) == swatch
    # the texture is that of the sliding alone: neither taps nor rest are in its level
    sliding = clean(truth.acceleration_m_s2, truth.rate_Hz).acceleration_m_s2[truth.states == 2]
    assert abs(10 * np.log10(swatch.texture.power(np.array([1.5]), np.array([0.15]))[0] / sliding.var())) < 0.5


def test_taps_alone_make_a_swatch_without_texture(handled_recording):
    truth = handled_recording(0)
    swatch = fitted(truth, slice(0, round(2.3 * truth.rate_Hz)))
    assert swatch.texture is None and swatch.taps is not None
    assert "never slides" in swatch.absent["texture"]
    assert "slides under a normal force for less" in swatch.absent["friction_dynamic"]
    assert swatch.friction_static == 0.0


def test_what_is_assumed_is_said():
    swatch = fit(np.random.default_rng(0).standard_normal(5000), 1000.0, order=2)
    assert swatch.absent["force_N"] == "was not recorded: 1 N assumed"
    assert swatch.absent["speed_m_s"] == "was not recorded: 0.1 m/s assumed"


def test_a_bad_model_count_is_an_error_whatever_else_there_is(handled_recording):
    with pytest.raises(CaptureError, match="model_count must be"):
        fitted(handled_recording(0), model_count=0)


@pytest.mark.nightly
def test_recordings_are_pooled_as_one(handled_recording):
    parts = []
    for seed in range(2):
        truth = handled_recording(seed)
        parts.append(
            prepare(
                SurfaceRecording(
                    truth.rate_Hz,
                    truth.acceleration_m_s2,
                    truth.force_N,
                    truth.speed_m_s,
                    truth.tangential_force_N,
                    truth.depth_m,
                )
            )
        )
    swatch = fit_recordings(parts, FitOptions("oak", 12))
    assert swatch.texture is not None and swatch.texture.order == 12
    assert swatch.taps is not None and len(swatch.taps.approach_m_s) == 4  # like speeds are one
    assert swatch.friction_dynamic == pytest.approx(0.35, rel=0.02)
    other = clean(np.random.default_rng(0).standard_normal(4000), 2000.0)
    with pytest.raises(CaptureError, match="must have one rate, these have 2000, 10000 Hz"):
        fit_recordings([parts[0], (other, segment(other))])
    with pytest.raises(CaptureError, match="one rate"):
        fit_recordings([])


def test_a_spring_that_its_damper_was_fitted_with_is_not_absent(monkeypatch):
    monkeypatch.setattr("hapscene.capture.fit.swatch.fit_stiffness", lambda parts: Stiffness(None, reason="no line"))
    swatch = fit_recordings(presses(damping=3.0))
    assert swatch.stiffness_N_m == pytest.approx(STIFFNESS_N_M, rel=0.1) and "stiffness_N_m" not in swatch.absent


NOISE = np.random.default_rng(0).standard_normal(2000)


@pytest.mark.parametrize(
    ("acceleration", "options", "message"),
    [
        (NOISE, {"rate_Hz": "1000"}, "rate_Hz must be a number, is '1000'"),
        (NOISE, {"rate_Hz": None}, "rate_Hz must be a number"),
        (NOISE + 1j, {}, "acceleration_m_s2 must be a list of real numbers, is of complex128"),
        (NOISE.astype(object), {}, "real numbers, is of object"),
        (["1", "2"], {}, "real numbers"),
        (1e7 * NOISE, {}, "check its unit"),
    ],
)
def test_what_is_no_acceleration_is_told(acceleration, options, message):
    with pytest.raises(CaptureError, match=message):
        fit(acceleration, **{"rate_Hz": 1000.0} | options)


def test_numbers_of_numpy_are_taken():
    assert fit(NOISE, np.int64(1000), order=np.int64(3), model_count=np.int32(1)).texture.order == 3


@pytest.mark.nightly
def test_a_long_recording_is_fitted_within_three_times_its_size() -> None:
    """What is held at most, the streams that are given counted as one; what a search adds to it does not grow."""
    rate, count = 10_000.0, 400_000
    t = np.arange(count) / rate
    force, speed = 1.0 + 0.5 * np.sin(0.8 * t), 0.12 + 0.05 * np.sin(1.9 * t)
    acceleration = lfilter([1.0], [1.0, -1.9, 0.92], np.random.default_rng(0).standard_normal(count)) * speed
    peaks = []
    for part in (slice(20_000), slice(None)):  # first what is imported
        tracemalloc.start()
        fit(acceleration[part], rate, force_N=force[part], speed_m_s=speed[part], order=8, model_count=1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] <= 1.95 * (acceleration.nbytes + force.nbytes + speed.nbytes)


def test_a_recording_that_nobody_else_holds_is_let_go_while_it_is_prepared() -> None:
    """Of a long one all that is held at most, itself counted."""
    count = 400_000
    peaks = []
    for part in (20_000, count):  # first what is imported
        tracemalloc.start()
        t = np.arange(part) / 10_000.0
        noise = np.random.default_rng(0).standard_normal(part)
        given = [SurfaceRecording(10_000.0, noise, 1.0 + 0.5 * np.sin(t), 0.1 + 0.05 * np.sin(2.0 * t), None)]
        del t, noise
        tracemalloc.reset_peak()
        part_of_it = prepare(given.pop())
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        del part_of_it
    assert peaks[1] <= 2.2 * 3 * 8 * count


@pytest.mark.parametrize(("domain", "warp"), [("plain", 0.0), ("warped", 0.75), ("auto", 0.0)])
def test_the_axis_can_be_said(domain: str, warp: float) -> None:
    noise = np.random.default_rng(0).standard_normal(20_000)
    texture = fit(noise, 10_000.0, order=8, model_count=1, domain=domain).texture
    assert texture is not None and texture.warp == pytest.approx(warp, abs=1e-4) and texture.order == 8
    with pytest.raises(CaptureError, match="domain must be one of auto, plain, warped, is 'bark'"):
        fit(noise, 10_000.0, domain="bark")
