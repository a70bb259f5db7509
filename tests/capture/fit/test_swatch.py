"""Fits of all quantities of a recording to one swatch."""

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
def test_a_recording_of_all_quantities(handled_recording):
    truth = handled_recording(0)
    swatch = fitted(truth, name="oak")
    assert swatch.texture is not None and swatch.taps is not None
    assert swatch.friction_dynamic == pytest.approx(0.35, rel=0.02)
    assert swatch.stiffness_N_m == pytest.approx(500.0, rel=0.03)
    assert len(swatch.taps.approach_m_s) == 4 and swatch.taps.wave_m_s2 is not None
    assert "taps.decay_1_s[3]" in swatch.intervals
    silent = {"adhesion_N", "leaving", "breakaway_1_kg", "texture.life"}
    silent |= {"friction_static.interval", "friction_dynamic.interval", "stiffness_N_m.interval"}  # too few strokes
    assert swatch.absent.keys() == {"friction_stribeck", "damping_Ns_m"} | silent
    assert swatch_from_json(swatch_to_json(swatch)) == swatch
    # the texture is that of the sliding alone: neither taps nor rest are in its level
    sliding = clean(truth.acceleration_m_s2, truth.rate_Hz).acceleration_m_s2[truth.states == 2]
    assert abs(10 * np.log10(swatch.texture.power(np.array([1.5]), np.array([0.15]))[0] / sliding.var())) < 0.5


def test_a_recording_of_taps_gives_a_swatch_without_texture(handled_recording):
    truth = handled_recording(0)
    swatch = fitted(truth, slice(0, round(2.3 * truth.rate_Hz)))
    assert swatch.texture is None and swatch.taps is not None
    assert "never slides" in swatch.absent["texture"]
    assert "friction_dynamic" in swatch.absent
    assert swatch.friction_static == 0.0


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
    assert swatch.taps is not None and len(swatch.taps.approach_m_s) == 4  # similar speeds are pooled
    assert swatch.friction_dynamic == pytest.approx(0.35, rel=0.02)
    other = clean(np.random.default_rng(0).standard_normal(4000), 2000.0)
    with pytest.raises(CaptureError, match="2000, 10000 Hz"):
        fit_recordings([parts[0], (other, segment(other))])
    with pytest.raises(CaptureError):
        fit_recordings([])


def test_stiffness_that_was_fitted_with_damping_is_not_absent(monkeypatch):
    monkeypatch.setattr("hapscene.capture.fit.swatch.fit_stiffness", lambda parts: Stiffness(None, reason="no line"))
    swatch = fit_recordings(presses(damping=3.0))
    assert swatch.stiffness_N_m == pytest.approx(STIFFNESS_N_M, rel=0.1) and "stiffness_N_m" not in swatch.absent


NOISE = np.random.default_rng(0).standard_normal(2000)


def test_numpy_numbers_are_accepted():
    assert fit(NOISE, np.int64(1000), order=np.int64(3), model_count=np.int32(1)).texture.order == 3


@pytest.mark.nightly
def test_a_long_recording_is_fitted_with_limited_memory() -> None:
    """Peak memory in addition to the given streams."""
    rate, count = 10_000.0, 400_000
    t = np.arange(count) / rate
    force, speed = 1.0 + 0.5 * np.sin(0.8 * t), 0.12 + 0.05 * np.sin(1.9 * t)
    acceleration = lfilter([1.0], [1.0, -1.9, 0.92], np.random.default_rng(0).standard_normal(count)) * speed
    peaks = []
    for part in (slice(20_000), slice(None)):  # the first pass imports modules
        tracemalloc.start()
        fit(acceleration[part], rate, force_N=force[part], speed_m_s=speed[part], order=8, model_count=1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] <= 1.95 * (acceleration.nbytes + force.nbytes + speed.nbytes)


def test_preparing_a_recording_frees_its_streams() -> None:
    """Peak memory of preparing a long recording, including the recording."""
    count = 400_000
    peaks = []
    for part in (20_000, count):  # the first pass imports modules
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
def test_the_frequency_axis_can_be_chosen(domain: str, warp: float) -> None:
    noise = np.random.default_rng(0).standard_normal(20_000)
    texture = fit(noise, 10_000.0, order=8, model_count=1, domain=domain).texture
    assert texture is not None and texture.warp == pytest.approx(warp, abs=1e-4) and texture.order == 8
