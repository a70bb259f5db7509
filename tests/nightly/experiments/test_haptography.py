"""The tables of docs/haptography.md: distances against closed forms, HaTT's pipeline against a known surface."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from hapscene.capture.io.streams import Streams
from hapscene.surface.texture import Texture
from hapscene_experiments.haptography import TABLES, apart, hatt_pipeline, missed, put_in

RATE_HZ = 10_000.0
A = np.array([1.0, -1.6, 0.8])


@pytest.fixture(scope="module")
def stroke() -> Streams:
    """4 s of a known filter; after 2 s the force is doubled, and the vibration four times as loud."""
    count = round(4 * RATE_HZ)
    loud = np.where(np.arange(count) < count // 2, 1.0, 4.0)
    heard = loud * lfilter([1.0], A, np.random.default_rng(0).standard_normal(count))
    return Streams(RATE_HZ, heard, np.where(loud > 1.0, 2.0, 1.0), np.full(count, 0.1), None)


def test_distances_of_spectra_that_differ_as_planted() -> None:
    frequency = np.arange(0.0, 1500.0)
    true = 1.0 / (1.0 + (frequency / 300.0) ** 2)
    assert apart(4.0 * true, true, frequency) == pytest.approx((0.0, 20.0 * np.log10(2.0), 0.0), abs=1e-9)
    frequency = np.arange(20.0, 1000.0, 0.01)
    edge = np.sqrt(20.0 * 1000.0)  # six of the twelve bands, and `share` of the frequencies, are 6 dB louder
    found = apart(np.where(frequency > edge, 4.0, 1.0), np.ones(len(frequency)), frequency)
    share, step_dB = (1000.0 - edge) / 980.0, 20.0 * np.log10(2.0)
    level_dB = 10.0 * np.log10(1.0 + 3.0 * share)
    bands_dB = np.sqrt((level_dB**2 + (step_dB - level_dB) ** 2) / 2.0)
    assert found == pytest.approx((step_dB * np.sqrt(share * (1.0 - share)), level_dB, bands_dB), rel=1e-3)


def test_the_pipeline_of_hatt_finds_the_stretches_and_the_power_of_each(stroke: Streams) -> None:
    texture = hatt_pipeline(stroke)
    assert texture.interpolation == "hatt" and not texture.exponents.any()
    for force in (1.0, 2.0):
        half = Streams(
            RATE_HZ, stroke.acceleration_m_s2[stroke.force_N == force], np.full(100, force), np.full(100, 0.1), None
        )
        assert missed(texture, half).level_dB < 0.5 and missed(texture, half).shape_dB < 1.5
    quiet = Texture.from_models(RATE_HZ, [2.0], [0.1], a=A[None], variance_m2_s4=[1.0])
    assert missed(quiet, half).level_dB == pytest.approx(20.0 * np.log10(4.0), abs=0.5)


def test_tables_are_put_where_the_page_has_a_place_for_them() -> None:
    page = (Path(__file__).parents[3] / "docs" / "haptography.md").read_text(encoding="utf-8")
    made = put_in(page, dict.fromkeys(TABLES, "| a |\n"))
    assert made.count("| a |") == len(TABLES) and put_in(made, dict.fromkeys(TABLES, "| a |\n")) == made
    with pytest.raises(ValueError, match="no place for the table 'other'"):
        put_in(page, {"other": ""})
