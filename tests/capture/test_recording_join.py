"""Files of one event joined: what was planted in one comes out by the other's clock, with its name and its unit."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from hapscene.capture.clock_offset import ClockOffset
from hapscene.capture.record_file import RecordWriter
from hapscene.capture.recording_file import load_recording
from hapscene.capture.recording_join import COMPUTER_S, join, resampled
from hapscene.cli import main
from hapscene.errors import CaptureError
from hapscene.wire.protocol import Column, Header, Run

from .simulated_event import Clocked, planted

pytestmark = pytest.mark.nightly

HZ = 7.0
SECONDS = 20.0


def write(path: Path, clocked: Clocked, time: bool = False) -> Path:
    """A CSV file of the streams, with a column of times where the rate is to be read from it."""
    rate_Hz, streams = clocked
    if time:
        streams = {"time": np.arange(len(next(iter(streams.values())))) / rate_Hz, **streams}
    header, table = ",".join(streams), np.stack(list(streams.values()), axis=1)
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.fixture(scope="module")
def event() -> tuple[Clocked, Clocked, float, float]:
    """Taps and strokes; the second device has a sine of the first clock beside its force and speed."""
    one, (rate_Hz, streams), offset_s, drift = planted(3, taps=True, seconds=SECONDS)
    t_s = offset_s + (1.0 + drift) * np.arange(len(streams["force"])) / rate_Hz
    return one, (rate_Hz, {**streams, "sine": np.sin(2.0 * np.pi * HZ * t_s)}), offset_s, drift


def test_what_was_planted_comes_out_by_the_other_clock(
    event: tuple[Clocked, Clocked, float, float], tmp_path: Path
) -> None:
    one, two, offset_s, drift = event
    paths = [write(tmp_path / "plate.csv", two, time=True), write(tmp_path / "handle.csv", one)]
    units = {"acceleration": "g", "force": "mN", "speed": "mm/s"}
    made = join(paths, tmp_path / "joined.npz", rates_Hz=[10_000.0], units=units)
    known = made.offsets[paths[0]]
    assert made.leader == paths[1] and known.by == "taps" and made.rate_Hz == 10_000.0
    start_s = max(0.0, offset_s)
    assert made.start_s == pytest.approx(start_s, abs=2e-3)
    assert made.duration_s == pytest.approx(min(SECONDS, SECONDS + offset_s) - start_s, abs=0.02)
    with np.load(made.path, allow_pickle=False) as kept:
        sine, said = kept["sine"], str(kept["provenance"])
        assert set(kept["units"]) == {f"{name}={unit}" for name, unit in units.items()}
        assert f"plate.csv: {known}" in said and "joined to the clock of handle.csv" in said
        first = round(np.ceil(made.start_s * 10_000.0 - 1e-6))
        own = one[1]["acceleration"][first : first + len(sine)]
        np.testing.assert_allclose(kept["acceleration"], own, rtol=1e-7)
    t_s = (first + np.arange(len(sine))) / 10_000.0
    assert np.abs(sine - np.sin(2.0 * np.pi * HZ * t_s)).max() < 2.0 * np.pi * HZ * 1e-3
    by_known_s = offset_s + (1.0 + drift) * (t_s - known.offset_s) / (1.0 + known.drift)
    inner = slice(100, -100)
    np.testing.assert_allclose(sine[inner], np.sin(2.0 * np.pi * HZ * by_known_s)[inner], atol=1e-6)
    recording = load_recording(made.path)  # in SI, without further words
    assert recording.force_N is not None and len(recording.acceleration_m_s2) == len(sine)
    np.testing.assert_allclose(recording.acceleration_m_s2, 9.80665 * own, rtol=1e-6)


def test_a_wav_beside_a_csv_by_the_command(
    event: tuple[Clocked, Clocked, float, float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, two, offset_s, _ = event
    wave, table = tmp_path / "handle.wav", write(tmp_path / "plate.csv", two)
    wavfile.write(wave, 10_000, np.rint(one[1]["acceleration"] / 200.0 * 32767).astype(np.int16))
    out = tmp_path / "oak.npz"
    words = ["--rate", f"{two[0]:g}", "--columns", "friction=plate.csv:sine"]
    units = ["--units", "acceleration=200 m/s2,force=N,speed=m/s"]
    assert main(["capture", "join", str(wave), str(table), "-o", str(out), *words, *units]) == 0
    said = capsys.readouterr().out
    assert (
        f"plate.csv: offset {1e3 * offset_s:+.0f}"[:-1] in said and "(95 %), by 6 taps" in said and f"  {out}" in said
    )
    assert "by the clock of handle.wav: acceleration, force, speed, friction" in said
    recording = load_recording(out)
    assert recording.tangential_force_N is not None  # of the friction
    assert recording.acceleration_m_s2.std() == pytest.approx(one[1]["acceleration"].std(), rel=0.2)


def test_what_is_not_certain_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, two, _, _ = planted(1, taps=False, seconds=15.0, related=False)
    paths = [str(write(tmp_path / "a.csv", one, time=True)), str(write(tmp_path / "b.csv", two, time=True))]
    assert main(["capture", "join", *paths, "-o", str(tmp_path / "j.npz")]) == 2
    told = capsys.readouterr().err
    assert told.startswith("hapscene: a.csv and b.csv: ") and told.count("\n") == 1
    assert "tap three times at the begin and three times at the end" in told and not (tmp_path / "j.npz").exists()


def recorded(path: Path, clock: str, start_s: float, rate_Hz: float, slow: float, seed: int) -> Path:
    """A record of noise whose probe began at a time of the computer's clock, and is slow by so much."""
    rng = np.random.default_rng(seed)
    with RecordWriter(path, Header(rate_Hz, (Column(f"sensor{seed}", "N", 1e-3),)), clock) as writer:
        for second in range(30):
            count = round((second + 1) * rate_Hz)
            writer.write(Run(round(second * rate_Hz), rng.integers(-999, 999, (round(rate_Hz), 1))))
            writer.write_time(count, start_s + (1.0 + slow) * count / rate_Hz + rng.exponential(2e-3))
        writer.end("stopped")
    return path


def test_records_made_side_by_side_know_each_other_by_the_computers_clock(tmp_path: Path) -> None:
    one = recorded(tmp_path / "a-1.hsrec", "k", 1000.0, 2000.0, 0.0, 1)
    two = recorded(tmp_path / "a-2.hsrec", "k", 1007.3, 1000.0, 100e-6, 2)
    known = join([one, two], tmp_path / "j.npz").offsets[two]
    assert known.by == "clock" and known.interval_s == COMPUTER_S
    assert known.offset_s == pytest.approx(7.3, abs=5e-3) and known.drift == pytest.approx(100e-6, abs=150e-6)
    other = recorded(tmp_path / "b-2.hsrec", "another", 1007.3, 1000.0, 100e-6, 2)
    with pytest.raises(CaptureError, match="share nothing that tells"):
        join([one, other], tmp_path / "k.npz")


def test_samples_that_are_missing_stay_missing() -> None:
    t = np.arange(4000.0)
    stream = np.sin(0.05 * t)
    stream[1000:1010] = np.nan
    at = np.linspace(10.0, 3900.0, 9000)
    made = resampled(stream, at)
    gone = (at > 999.0) & (at < 1010.0)
    np.testing.assert_array_equal(np.isnan(made), gone)
    far = np.abs(at - 1005.0) > 20.0
    np.testing.assert_allclose(made[far], np.sin(0.05 * at[far]), atol=1e-6)


@pytest.mark.parametrize(("share", "most"), [(0.1, 6e-6), (0.2, 6e-4)])
def test_between_samples_it_is_off_by_as_much_as_is_said(share: float, most: float) -> None:
    at = np.sort(np.random.default_rng(0).uniform(100.0, 69_900.0, 100_000))  # more than a block
    made = resampled(np.sin(2.0 * np.pi * share * np.arange(70_000.0)), at)
    off = np.abs(made - np.sin(2.0 * np.pi * share * at)).max()
    assert 0.2 * most < off < most


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"out": "j.csv"}, r"written as \.npz"),
        ({"paths": ["a.csv"]}, "two files or more"),
        ({"paths": ["a.csv", "a.csv"]}, "each named once"),
        ({"rates_Hz": [1.0, 2.0, 3.0]}, "3 rates for 2 files"),
        ({"rates_Hz": []}, "does not say its sample rate"),
        ({"columns": {"force": "Fz"}}, r"no file has 'Fz'; there are: a\.csv: x, y; b\.csv: x, z"),
        ({"columns": {"force": "x"}}, r"'x' is in 2 files: say which one, as in force=a\.csv:x"),
        ({"columns": {"smell": "x"}}, "no quantity 'smell'"),
        ({"paths": ["a.csv", "c.csv"]}, "at least two of them"),
        ({}, r"too short to compare clocks"),
    ],
)
def test_what_cannot_be_joined_is_told(
    more: dict[str, object], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, header in (("a.csv", "x,y"), ("b.csv", "x,z")):
        np.savetxt(name, np.arange(200.0).reshape(-1, 2), delimiter=",", header=header, comments="")
    Path("c.csv").write_text("x\nnan\nnan\nnan\n")
    given = {"paths": ["a.csv", "b.csv"], "out": "j.npz", "rates_Hz": [1000.0], **more}
    with pytest.raises(CaptureError, match=message):
        join(given.pop("paths"), given.pop("out"), **given)  # type: ignore[arg-type]
    assert not Path("j.npz").exists()


def test_a_clock_is_told_in_words() -> None:
    said = str(ClockOffset(0.5, 1e-4, 7e-4, "taps", 6, 3.0))
    assert said == "offset +500.00 ms, drift +100.0 ppm, within 0.7 ms (95 %), by 6 taps"
    assert str(ClockOffset(0.5, 0.0, 0.02, "clock", 6, 1.0)).endswith(
        "within 20 ms (95 %), by the clock of the computer"
    )
