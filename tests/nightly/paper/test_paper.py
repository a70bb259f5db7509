"""The reproduction of the haptography paper, against known models, SciPy, closed forms and reference measurements."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import freqz, lfilter, resample_poly

from hapscene.capture.fit.distance import residual, spectrum
from hapscene.errors import CaptureError
from hapscene.handle.plant import Plant
from hapscene_evidence.paper import handle_figure
from hapscene_evidence.paper.handle_figure import CORNER_HZ, Trials, approximated, misfit_dB
from hapscene_evidence.paper.material import load_materials
from hapscene_evidence.paper.paper_page import page_of, summary, table_of_numbers
from hapscene_evidence.paper.prediction_figure import predictor, synthetic
from hapscene_evidence.paper.remote_figure import Rendering, remote_numbers
from hapscene_evidence.paper.result import FigureResult, Number

RATE_HZ = 10_000.0
TRUE_PLANT = Plant(m_c_kg=0.02, k_s_N_m=320.0, b_s_Ns_m=0.4, m_h_kg=0.1)
POLES = 0.97 * np.exp(2j * np.pi * np.array([200.0, 600.0]) / RATE_HZ)
AR = np.poly([*POLES, *POLES.conj()]).real


@pytest.fixture(scope="module")
def noise() -> np.ndarray:
    """Noise filtered by 1/A of a known filter."""
    return lfilter([1.0], AR, np.random.default_rng(1).standard_normal(200_000))


@pytest.fixture(scope="module")
def trials() -> Trials:
    return handle_figure.try_users(handle_figure.PAPER_BAND_HZ, TRUE_PLANT)


def test_residual_is_the_noise_that_drives_the_known_filter(noise: np.ndarray) -> None:
    first, second = np.array_split(noise, 2)
    for order in (4, 40, 120):
        assert residual(predictor(first, RATE_HZ, order)[0], second).std() == pytest.approx(1.0, rel=0.02)


def test_synthetic_signal_has_the_spectrum_of_the_known_filter(noise: np.ndarray) -> None:
    made = synthetic(*predictor(noise, RATE_HZ, 20), 200_000)
    assert made.std() == pytest.approx(noise.std(), rel=0.02)
    frequency, density = spectrum(made, RATE_HZ)
    felt = (frequency >= 50.0) & (frequency <= 1000.0)
    true = 2.0 * np.abs(freqz([1.0], AR, worN=frequency[felt], fs=RATE_HZ)[1]) ** 2 / RATE_HZ
    assert np.abs(10.0 * np.log10(density[felt] / true)).max() < 2.0  # standard deviation of the estimate: 0.4 dB


def test_residual_power_equals_reference_measurements(shared: Path) -> None:
    """At 5 kHz, on the half that was not fitted, at orders 8, 20, 40 and 120."""
    materials = load_materials(shared / "data" / "recordings")
    reference = {"leather": (0.096, 0.087, 0.080, 0.078), "wood": (0.051, 0.048, 0.046, 0.046)}
    for name, shares in reference.items():
        first, second = np.array_split(resample_poly(materials[name].streams.acceleration_m_s2, 1, 2), 2)
        for order, share in zip((8, 20, 40, 120), shares, strict=True):
            left = residual(predictor(first, 5000.0, order)[0], second)
            assert np.mean(left**2) / np.mean(second**2) == pytest.approx(share, rel=0.05), (name, order)


def test_identification_finds_the_simulated_handle(trials: Trials) -> None:
    assert len(trials.responses) == 15
    for name in ("m_c_kg", "k_s_N_m", "b_s_Ns_m", "m_h_kg"):
        assert getattr(trials.handle.plant, name) == pytest.approx(getattr(TRUE_PLANT, name), rel=0.05), name
    assert trials.handle.plant.m_h_kg == pytest.approx(TRUE_PLANT.m_h_kg, rel=2e-3)


def test_the_approximate_model_is_the_inverse_of_the_compensator(trials: Trials) -> None:
    """m_c (s + ω₀)⁴ over the denominator of eq. 8; 4 times the full model at f₀."""
    frequency_Hz = np.array([CORNER_HZ, 20.0, 200.0])
    s, omega = 2j * np.pi * frequency_Hz, 2.0 * np.pi * CORNER_HZ
    full = TRUE_PLANT.response(frequency_Hz)
    near = approximated(full, frequency_Hz)
    assert near == pytest.approx(
        TRUE_PLANT.m_c_kg * (s + omega) ** 4 / np.polyval(TRUE_PLANT.denominator(), s), rel=1e-9
    )
    assert abs(near[0] / full[0]) == pytest.approx(4.0)
    assert misfit_dB(trials) < 0.4 < misfit_dB(trials, approximate=True)


def test_errors_are_relative_to_the_base_motors_alone() -> None:
    desired = np.zeros(9)
    renderings = [
        Rendering(name, desired, desired, dict.fromkeys(("all", "tap", "stroke", "above"), error))
        for name, error in (("none", 80.0), ("inverse", 40.0), ("flat", 20.0))
    ]
    numbers = {n.quantity: n for n in remote_numbers(renderings)}
    reference = numbers["error with the base motors alone"]
    assert reference.value == reference.paper == 100.0 and "80.0 %" in reference.note
    assert [n.value for n in numbers.values() if n.paper == 48.0] == [pytest.approx(50.0)]
    assert numbers["error with the handle, compensator inverse, above 60 Hz"].value == pytest.approx(50.0)
    assert numbers["error with the handle, compensator flat, taps"].value == pytest.approx(25.0)


def test_missing_recordings_are_synthesised_and_named(shared: Path, tmp_path: Path) -> None:
    (tmp_path / "cdp_wood.csv").symlink_to(shared / "data" / "recordings" / "cdp_wood.csv")
    some, none = load_materials(tmp_path), load_materials(None)
    assert {name for name, material in some.items() if material.recorded} == {"wood"}
    assert not any(material.recorded for material in none.values())
    assert "paper, leather, epoxy were given" in page_of({}, some).html()
    (tmp_path / "cdp_wood.csv").unlink()
    with pytest.raises(CaptureError, match="cdp_wood"):
        load_materials(tmp_path)


def test_page_is_self_contained_and_escaped() -> None:
    numbers = [Number("<b>", -1.5, "dB", 2.0, "Fig. 4", "a & b")]
    results = {"fig4": FigureResult("<script>: it", "<i>", numbers, [])}
    html = page_of(results, load_materials(None)).html()
    assert "<script>" not in html and "<i>" not in html and "&lt;b&gt;" in html and "−1.5 dB" in html
    assert "2 dB (Fig. 4)" in html and "color-scheme: light dark" in html
    assert not re.search(r'(?:src|href)="(?!#|data:)', html) and "url(" not in html
    assert "| <script>: <b> | 2 dB (Fig. 4) | −1.5 dB | a & b |" in summary(results, load_materials(None)).markdown(
        Path()
    )
    assert table_of_numbers(results).splitlines()[1] == "fig4,<b>,dB,2.0,Fig. 4,-1.5,a & b"
