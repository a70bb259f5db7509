"""The haptography paper, reproduced: against planted models, SciPy, closed forms and what others measured."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import freqz, lfilter, resample_poly

from hapscene.capture.fit.distance import residual, spectrum
from hapscene.cli import main
from hapscene.errors import CaptureError
from hapscene.handle.plant import Plant
from hapscene_evidence.bench.teleoperation import Rendering
from hapscene_evidence.paper import handle_figure
from hapscene_evidence.paper.finding import REMEMBERED, Finding, Number
from hapscene_evidence.paper.handle_figure import CORNER_HZ, Trials, approximated, misfit_dB
from hapscene_evidence.paper.material import load_materials
from hapscene_evidence.paper.paper_page import TABLE_ONE, page_of, table_of_numbers
from hapscene_evidence.paper.prediction_figure import predictor, synthetic
from hapscene_evidence.paper.remote_figure import remote_numbers
from hapscene_evidence.paper.tap_study import HIGHEST, TIRED, distances, rate, williams_square

RATE_HZ = 10_000.0
PLANTED = Plant(m_c_kg=0.02, k_s_N_m=320.0, b_s_Ns_m=0.4, m_h_kg=0.1)
POLES = 0.97 * np.exp(2j * np.pi * np.array([200.0, 600.0]) / RATE_HZ)
AR = np.poly([*POLES, *POLES.conj()]).real


@pytest.fixture(scope="module")
def noise() -> np.ndarray:
    """A stretch of the planted texture."""
    return lfilter([1.0], AR, np.random.default_rng(1).standard_normal(200_000))


@pytest.fixture(scope="module")
def trials() -> Trials:
    return handle_figure.try_users(handle_figure.PAPER_BAND_HZ, PLANTED)


def test_what_is_left_is_the_noise_that_was_planted(noise: np.ndarray) -> None:
    first, second = np.array_split(noise, 2)
    for order in (4, 40, 120):
        assert residual(predictor(first, RATE_HZ, order)[0], second).std() == pytest.approx(1.0, rel=0.02)


def test_the_synthetic_has_the_spectrum_of_the_planted_filter(noise: np.ndarray) -> None:
    made = synthetic(*predictor(noise, RATE_HZ, 20), 200_000)
    assert made.std() == pytest.approx(noise.std(), rel=0.02)
    frequency, density = spectrum(made, RATE_HZ)
    felt = (frequency >= 50.0) & (frequency <= 1000.0)
    true = 2.0 * np.abs(freqz([1.0], AR, worN=frequency[felt], fs=RATE_HZ)[1]) ** 2 / RATE_HZ
    assert np.abs(10.0 * np.log10(density[felt] / true)).max() < 2.0  # chance: 0.4 dB a line


def test_power_left_is_what_others_measured(shared: Path) -> None:
    """The reference table of the recordings: at 5 kHz, of the half not fitted, at order 8, 20, 40 and 120."""
    materials = load_materials(shared / "data" / "recordings")
    told = {"leather": (0.096, 0.087, 0.080, 0.078), "wood": (0.051, 0.048, 0.046, 0.046)}
    for name, shares in told.items():
        first, second = np.array_split(resample_poly(materials[name].streams.acceleration_m_s2, 1, 2), 2)
        for order, share in zip((8, 20, 40, 120), shares, strict=True):
            left = residual(predictor(first, 5000.0, order)[0], second)
            assert np.mean(left**2) / np.mean(second**2) == pytest.approx(share, rel=0.05), (name, order)


def test_the_handle_is_found_that_was_planted(trials: Trials) -> None:
    assert len(trials.responses) == 15
    for name in ("m_c_kg", "k_s_N_m", "b_s_Ns_m", "m_h_kg"):
        assert getattr(trials.handle.plant, name) == pytest.approx(getattr(PLANTED, name), rel=0.05), name
    assert trials.handle.plant.m_h_kg == pytest.approx(PLANTED.m_h_kg, rel=2e-3)


def test_the_approximate_model_is_the_inverse_of_the_compensator(trials: Trials) -> None:
    """m_c (s + ω₀)⁴ over the denominator of eq. 8; 4 times the full model at f₀."""
    frequency_Hz = np.array([CORNER_HZ, 20.0, 200.0])
    s, omega = 2j * np.pi * frequency_Hz, 2.0 * np.pi * CORNER_HZ
    full = PLANTED.response(frequency_Hz)
    near = approximated(full, frequency_Hz)
    assert near == pytest.approx(PLANTED.m_c_kg * (s + omega) ** 4 / np.polyval(PLANTED.denominator(), s), rel=1e-9)
    assert abs(near[0] / full[0]) == pytest.approx(4.0)
    assert misfit_dB(trials) < 0.4 < misfit_dB(trials, approximate=True)


def test_silence_has_100_percent_exactly() -> None:
    desired = np.random.default_rng(0).standard_normal(10_000)
    errors = {"all": 0.3, "tap": 0.2, "stroke": 0.1}
    renderings = [Rendering(name, desired, 0.5 * desired, 0.0, errors) for name in ("none", "inverse", "flat")]
    numbers = {n.what: n for n in remote_numbers(renderings)}
    assert numbers["error of no output"].ours == numbers["error of no output"].paper == 100.0
    assert numbers["error, handle, inverse, above 60 Hz"].ours == pytest.approx(50.0)
    assert [n.ours for n in numbers.values() if n.paper == 48.0] == [pytest.approx(30.0)]


def test_every_order_and_every_pair_is_met_equally_often() -> None:
    square = williams_square(6)
    assert all(sorted(line) == list(range(6)) for line in (*square, *zip(*square, strict=True)))
    assert len({pair for row in square for pair in pairwise(row)}) == 30


def test_a_silent_handle_is_farther_from_a_tap_than_any_compensated_one() -> None:
    away = distances(0)
    assert np.all(away[:, 0] == 0.0) and away[:, 1].min() > 2.0 > 1.5 > away[:, 3:].max()


def test_balanced_orders_take_tiredness_out() -> None:
    ratings = rate(np.tile([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], (12, 1)), 0, scatter=0.0, whole=False)
    assert ratings.mean(axis=0) == pytest.approx(HIGHEST - np.arange(6) - 2.5 * TIRED)
    told = rate(np.tile([0.0, 1.0, 2.0, 3.0, 4.0, 50.0], (12, 1)), 0)
    assert set(np.unique(told)) <= set(range(1, 8)) and np.all(told[:, 5] == 1.0)


def test_recordings_where_they_are_and_swatches_where_not(shared: Path, tmp_path: Path) -> None:
    (tmp_path / "cdp_wood.csv").symlink_to(shared / "data" / "recordings" / "cdp_wood.csv")
    some, none = load_materials(tmp_path), load_materials(None)
    assert {name for name, material in some.items() if material.real} == {"wood"}
    assert not any(material.real for material in none.values())
    assert "Not from recordings: paper, leather, epoxy." in page_of({}, some).html()
    assert (
        "no recordings were given" in page_of({}, none).html()
        and "no recordings were given" not in page_of({}, some).html()
    )
    (tmp_path / "cdp_wood.csv").unlink()
    with pytest.raises(CaptureError, match="has no recording; expected one or more of cdp_wood"):
        load_materials(tmp_path)


def test_the_page_needs_nothing_but_itself() -> None:
    numbers = [Number("<b>", -1.5, "dB", 2.0, REMEMBERED, "a & b"), *(Number(f"n{i}", i) for i in range(20))]
    keys = {"taps"} | {key for *_, key in TABLE_ONE if key}
    findings = {key: Finding("<script>: it", "<i>", numbers, []) for key in sorted(keys)}
    html = page_of(findings, load_materials(None)).html()
    assert "<script>" not in html and "<i>" not in html and "&lt;b&gt;" in html and "−1.5 dB" in html
    assert f"2 dB ({REMEMBERED})" in html and "color-scheme: light dark" in html and "<summary>21 numbers" in html
    assert not re.search(r'(?:src|href)="(?!#|data:)', html) and "url(" not in html
    assert set(re.findall(r'href="#([^"]+)"', html)) <= set(re.findall(r'id="([^"]+)"', html))
    assert table_of_numbers(findings).splitlines()[1].endswith(f'<b>,dB,2.0,"{REMEMBERED}",-1.5,a & b')


@pytest.mark.parametrize("command", sorted({here for _, _, here, _ in TABLE_ONE}))
def test_the_commands_of_table_one_are_there(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*command.split()[1:], "--help"]) == 0
    assert command in capsys.readouterr().out
