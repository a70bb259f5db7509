"""Grips are recorded and read; results of an identification are written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene.handle.fit import Identification, identify
from hapscene.handle.force_source import SimulatedSource
from hapscene.handle.handle_file import load_handle, write_result
from hapscene.handle.measure import GripRecording, Sweep, load_grip, load_grips, play_grips
from hapscene.handle.plant import Plant

RATE_HZ = 4000.0
SWEEP = Sweep(high_Hz=600.0, sweep_s=4.0)
HANDS = ((200.0, 3.0), (1500.0, 10.0))


@pytest.fixture(scope="module")
def recordings() -> list[GripRecording]:
    source = SimulatedSource(Plant(), RATE_HZ)

    def hold(i: int) -> None:
        source.plant = replace(Plant(), k_u_N_m=HANDS[i][0], b_u_Ns_m=HANDS[i][1])

    return play_grips(source, SWEEP, Plant(), ["light", "firm"], hold)


@pytest.fixture(scope="module")
def found(recordings: list[GripRecording]) -> Identification:
    return made_of(recordings)


def made_of(recordings: list[GripRecording]) -> Identification:
    responses = [recording.response((10.0, 600.0)) for recording in recordings]
    return identify(responses, RATE_HZ, [recording.name for recording in recordings], name="ours")


def test_tables_in_other_units_and_names(tmp_path: Path) -> None:
    t_s = np.arange(400) / RATE_HZ
    table = np.stack([1e3 * np.sin(t_s), np.cos(t_s), 0 * t_s], axis=1)
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="coil,a_x,a_y", comments="")
    options = {"columns": {"force": "coil", "acceleration": "a_x"}, "units": {"force": "mN", "acceleration": "g"}}
    recording = load_grip(str(tmp_path / "a.csv"), RATE_HZ, **options)
    np.testing.assert_allclose(recording.force_N, np.sin(t_s), atol=1e-12)
    np.testing.assert_allclose(recording.acceleration_m_s2, 9.80665 * np.cos(t_s), atol=1e-12)


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        ("force,acceleration_x,acceleration_y", {}, "acceleration=COLUMN"),
        ("force,x,y", {"acceleration": "x+y"}, "acceleration=COLUMN"),
        ("x,acceleration,y", {}, '"force"'),
        ("force,acceleration,y", {"acceleration": "z"}, "no column 'z'"),
    ],
)
def test_a_missing_column_is_named(tmp_path: Path, header: str, columns: dict[str, str], words: str) -> None:
    np.savetxt(tmp_path / "a.csv", np.ones((9, 3)), delimiter=",", header=header, comments="")
    with pytest.raises(HapsceneError, match=words):
        load_grip(str(tmp_path / "a.csv"), RATE_HZ, columns, {"force": "N", "acceleration": "m/s2"})


def test_grips_of_different_rates_are_refused(recordings: list[GripRecording], tmp_path: Path) -> None:
    recordings[0].save(tmp_path / "a.npz")
    replace(recordings[1], rate_Hz=5000.0).save(tmp_path / "b.npz")
    with pytest.raises(HapsceneError, match=r"b\.npz.*5000 Hz.*4000 Hz.*a\.npz"):
        load_grips([str(tmp_path / "a.npz"), str(tmp_path / "b.npz")])


def test_a_response_ends_below_half_of_the_rate() -> None:
    noise = np.random.default_rng(0).standard_normal(20_000)
    found = [GripRecording("x", noise, noise, 1000.0).response((20.0, high_Hz)) for high_Hz in (300.0, 600.0)]
    low = np.fft.irfft(np.fft.rfft(noise) * (np.fft.rfftfreq(len(noise), 1e-3) < 100.0))
    found.append(GripRecording("x", low, low, 1000.0).response((20.0, 300.0)))  # without the bands that have no force
    assert [one.frequency_Hz[-1] for one in found] == pytest.approx([300.0, 450.0, 100.0], rel=0.03)


def test_results_are_written(recordings: list[GripRecording], found: Identification, tmp_path: Path) -> None:
    responses = [recording.response((10.0, 600.0)) for recording in recordings]
    made = write_result(found, responses, recordings, tmp_path / "out")
    assert [file.name for file in made] == ["bode.png", "grip-1.npz", "grip-2.npz", "ours.handle"]
    assert load_handle(tmp_path / "out" / "ours.handle") == found
    assert (tmp_path / "out" / "bode.png").read_bytes()[:4] == b"\x89PNG"
    assert write_result(found, responses, [], tmp_path / "b.handle") == [tmp_path / "b.handle"]
    with pytest.raises(HapsceneError, match="a/b"):
        write_result(replace(found, name="a/b"), responses, [], tmp_path / "c")
    assert not (tmp_path / "c").exists()
