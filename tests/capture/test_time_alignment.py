"""Time alignment: planted offsets and drifts are found, unrelated recordings are refused, joined streams are right."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from hapscene.capture.io.hsrec import Record
from hapscene.capture.io.recording import load_recording
from hapscene.capture.time_alignment import (
    ClockOffset,
    _correlations,
    clock_offset,
    join,
    level_changes,
    resampled,
)
from hapscene.cli import main
from hapscene.errors import CaptureError

from .simulated_event import farthest_s, planted

HZ = 7.0
SECONDS = 15.0


def found(seed: int, taps: bool, second: str, seconds: float | None = SECONDS) -> tuple[ClockOffset, float]:
    """The offset that is found, and how far it is off [s]."""
    one, two, offset_s, drift = planted(seed, taps=taps, second=second, seconds=seconds)
    known = clock_offset(Record(*one), Record(*two))
    length_s = len(next(iter(two[1].values()))) / two[0]
    return known, farthest_s(offset_s, drift, known.offset_s, known.drift, length_s)


@pytest.mark.parametrize(("taps", "most_s"), [(True, 6e-4), (False, 1.2e-3)])
def test_a_common_channel_is_aligned_to_a_millisecond(taps: bool, most_s: float) -> None:
    known, off_s = found(0, taps, "acceleration")
    assert known.common and off_s < most_s


def test_different_channels_are_aligned_to_some_milliseconds() -> None:
    known, off_s = found(0, True, "force+speed", 20.0)
    assert not known.common and off_s < 8e-3


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("taps", [True, False])
@pytest.mark.parametrize(("second", "most_s"), [("acceleration", 2e-3), ("force+speed", 8e-3), ("force", 10e-3)])
def test_many_planted_clocks(seed: int, taps: bool, second: str, most_s: float) -> None:
    assert found(seed, taps, second, None)[1] < most_s
    one, two, _, _ = planted(seed, taps=taps, second=second, seconds=20.0, related=False)
    with pytest.raises(CaptureError, match="no clear peak"):
        clock_offset(Record(*one), Record(*two))


def test_noise_silence_and_what_repeats_are_refused() -> None:
    rng, t = np.random.default_rng(0), np.arange(20_000)
    beat = np.sin(2.0 * np.pi * 80.0 * t / 1000.0) * (t % 500 < 100)
    pairs = [
        (rng.standard_normal(3000), rng.standard_normal(3000)),
        (np.zeros(3000), rng.standard_normal(3000)),
        (np.zeros(3000), np.zeros(3000)),
        (beat + 1e-3 * rng.standard_normal(len(t)), beat + 1e-3 * rng.standard_normal(len(t))),  # a metronome
    ]
    for one, two in pairs:
        with pytest.raises(CaptureError, match="no clear peak"):
            clock_offset(Record(1000.0, {"acceleration": one}), Record(1000.0, {"1": two}))
    with pytest.raises(CaptureError, match="sample rate"):
        clock_offset(Record(20.0, {"force": beat[:40]}), Record(5000.0, {"a": beat}))
    with pytest.raises(CaptureError, match="duration"):
        clock_offset(Record(5000.0, {"a": beat[:4000]}), Record(5000.0, {"a": beat}))


def test_level_changes_are_bounded_and_follow_the_level() -> None:
    rng = np.random.default_rng(2)
    level = 1.0 + 0.9 * np.sin(2.0 * np.pi * np.arange(50_000) / 5000.0 * 2.0)
    tone = level * np.sin(2.0 * np.pi * 80.0 * np.arange(50_000) / 5000.0)
    made = level_changes(tone + 0.01 * rng.standard_normal(50_000) + 3.0, 5000.0, oscillates=True)
    assert len(made) == 5000 and np.abs(made).max() <= 4.0
    rising = np.cos(2.0 * np.pi * np.arange(5000) / 500.0 * 2.0)
    assert np.corrcoef(made, rising)[0, 1] > 0.6


def test_windows_of_a_longer_recording_are_correlated() -> None:
    rng = np.random.default_rng(0)
    ours, theirs = rng.standard_normal(100), rng.standard_normal(300)
    found = _correlations(ours, theirs, np.array([0, 150, 300]), 20)
    shifted = np.array([np.interp(np.arange(300) + lag, np.arange(100), ours, 0.0, 0.0) for lag in range(-20, 21)])
    np.testing.assert_allclose(found, [shifted[:, :150] @ theirs[:150], shifted[:, 150:] @ theirs[150:]], atol=1e-9)


@pytest.mark.parametrize(("share", "most"), [(0.1, 6e-6), (0.2, 6e-4)])
def test_resampling_is_as_exact_as_stated(share: float, most: float) -> None:
    at = np.sort(np.random.default_rng(0).uniform(100.0, 9900.0, 20_000))
    made = resampled(np.sin(2.0 * np.pi * share * np.arange(10_000.0)), at)
    off = np.abs(made - np.sin(2.0 * np.pi * share * at)).max()
    assert 0.2 * most < off < most


def test_missing_samples_stay_missing() -> None:
    stream = np.sin(0.05 * np.arange(4000.0))
    stream[1000:1010] = np.nan
    at = np.linspace(10.0, 3900.0, 9000)
    made = resampled(stream, at)
    np.testing.assert_array_equal(np.isnan(made), (at > 999.0) & (at < 1010.0))
    far = np.abs(at - 1005.0) > 20.0
    np.testing.assert_allclose(made[far], np.sin(0.05 * at[far]), atol=1e-6)


# Files.


def write(path: Path, rate_Hz: float, streams: dict[str, np.ndarray], time: bool = False) -> Path:
    if time:
        streams = {"time": np.arange(len(next(iter(streams.values())))) / rate_Hz, **streams}
    np.savetxt(path, np.stack(list(streams.values()), axis=1), delimiter=",", header=",".join(streams), comments="")
    return path


def test_a_wav_and_a_table_are_merged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The second file also contains a sine of the first clock."""
    one, (rate_Hz, streams), offset_s, drift = planted(3, taps=True, second="acceleration", seconds=SECONDS)
    t_s = offset_s + (1.0 + drift) * np.arange(len(streams["acceleration"])) / rate_Hz
    wave, out = tmp_path / "handle.wav", tmp_path / "joined.npz"
    table = write(tmp_path / "plate.csv", rate_Hz, {**streams, "sine": np.sin(2.0 * np.pi * HZ * t_s)})
    wavfile.write(wave, 10_000, np.rint(one[1]["acceleration"] / 200.0 * 32767).astype(np.int16))
    assert main(["capture", "join", str(wave), str(table), "-o", str(out), "--rate", f"{rate_Hz:g}"]) == 0
    assert "a common channel" in capsys.readouterr().out
    with np.load(out, allow_pickle=False) as kept:
        sine, own, known = kept["sine"], kept["acceleration"], str(kept["provenance"])
        assert kept["rate_Hz"] == 10_000.0 and "acceleration_2" in kept.files
    start_s = float(known.partition("from ")[2].split()[0])
    assert start_s == pytest.approx(max(0.0, offset_s), abs=2e-3)
    first = int(np.ceil(start_s * 10_000.0 - 1e-6))
    np.testing.assert_allclose(own, one[1]["acceleration"][first : first + len(own)] / 200.0, atol=1e-4)
    t_s = (first + np.arange(len(sine))) / 10_000.0
    assert np.abs(sine - np.sin(2.0 * np.pi * HZ * t_s)).max() < 2.0 * np.pi * HZ * 1.5e-3
    recording = load_recording(out, units={"acceleration": "200 m/s2"})
    assert len(recording.acceleration_m_s2) == len(sine)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"out": "j.csv"}, r"j\.csv"),
        ({"paths": ["a.csv"]}, "two or more"),
        ({"paths": ["a.csv", "a.csv"]}, "different files"),
        ({"rate_Hz": None}, "--rate"),
        ({"paths": ["a.csv", "c.csv"]}, r"c\.csv: column 'x'"),
        ({}, r"a\.csv and b\.csv: .*duration"),
    ],
)
def test_files_that_cannot_be_merged_are_refused(
    more: dict[str, object], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, header in (("a.csv", "x,y"), ("b.csv", "x,z")):
        np.savetxt(name, np.arange(200.0).reshape(-1, 2), delimiter=",", header=header, comments="")
    Path("c.csv").write_text("x\nnan\nnan\nnan\n")
    given = {"paths": ["a.csv", "b.csv"], "out": "j.npz", "rate_Hz": 1000.0, **more}
    with pytest.raises(CaptureError, match=message):
        join(given.pop("paths"), given.pop("out"), **given)  # type: ignore[arg-type]
    assert not Path("j.npz").exists()


def test_streams_of_the_same_name_are_all_kept(tmp_path: Path) -> None:
    """The first file already has the name that the stream of the second file would get."""
    rng = np.random.default_rng(0)
    beat = rng.standard_normal(6000) * (1.0 + np.sin(np.arange(6000) / 90.0 + 8.0 * np.sin(np.arange(6000) / 800.0)))
    write(tmp_path / "a.csv", 1000.0, {"acceleration": beat, "acceleration_2": np.ones(6000)})
    write(tmp_path / "b.csv", 1000.0, {"acceleration": 2.0 * beat})
    join([tmp_path / "a.csv", tmp_path / "b.csv"], tmp_path / "c.npz", rate_Hz=1000.0)
    with np.load(tmp_path / "c.npz") as kept:
        assert np.all(kept["acceleration_2"] == 1.0)
        assert np.corrcoef(kept["acceleration_3"], kept["acceleration"])[0, 1] > 0.8
