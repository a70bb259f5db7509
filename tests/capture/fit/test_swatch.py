"""Fits of all quantities of a recording to one swatch."""

import numpy as np
import pytest

from hapscene.capture.fit.segment import InteractionState, Segmentation, segment
from hapscene.capture.fit.stiffness import Stiffness
from hapscene.capture.fit.swatch import FitOptions, fit_recordings, prepare, recorded_ranges
from hapscene.capture.fit.windows import EXPONENT_SPREADS
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.capture.io.streams import Streams, clean
from hapscene.errors import CaptureError
from hapscene.surface.swatch_file import swatch_from_json, swatch_to_json

from ..signals import fit
from .test_contact import STIFFNESS_N_M, presses


def fitted(truth, part=slice(None), **options):
    named = {name: getattr(truth, name)[part] for name in ("force_N", "speed_m_s", "tangential_force_N", "depth_m")}
    return fit(truth.acceleration_m_s2[part], truth.rate_Hz, **named, **options)


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
    for i, (exponent, spread) in enumerate(zip(swatch.texture.exponents, EXPONENT_SPREADS, strict=True)):
        low, high = swatch.intervals[f"texture.exponents[{i}]"]
        assert 0.0 < high - low <= 2.0 * 1.96 * spread and low + high == pytest.approx(2.0 * exponent)
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


def test_ranges_are_those_of_the_sliding():
    states = np.repeat([InteractionState.AIR, InteractionState.SLIDING], 500).astype(np.int8)
    angle_rad = np.full(1000, np.radians(30.0))
    streams = Streams(1e3, *np.ones((4, 1000)), grip_force_N=np.linspace(0.0, 10.0, 1000), contact_angle_rad=angle_rad)
    sliding, air = (Segmentation(1e3, kind, (), None, None) for kind in (states, states[:500].repeat(2)))
    assert recorded_ranges([(streams, sliding)]) == "grip force 5.25 to 9.75 N, contact angle 30°"
    assert recorded_ranges([(streams, air)]) == "grip force 0.5 to 9.5 N, contact angle 30°"


def test_stiffness_that_was_fitted_with_damping_is_not_absent(monkeypatch):
    monkeypatch.setattr("hapscene.capture.fit.swatch.fit_stiffness", lambda parts: Stiffness(None, reason="no line"))
    swatch = fit_recordings(presses(damping=3.0))
    assert swatch.stiffness_N_m == pytest.approx(STIFFNESS_N_M, rel=0.1) and "stiffness_N_m" not in swatch.absent
