"""What a stimulus sounds like, and in how many steps."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.capture import synthesize
from hapscene.capture.fit.segment import InteractionState, Segmentation
from hapscene.capture.io.streams import Streams, filtered
from hapscene.errors import HapsceneError, StudyError
from hapscene.study.plan import Stimulus, parse_plan
from hapscene.study.stimulus import (
    FADE_S,
    HEADROOM_DB,
    TRIES,
    StimulusMaker,
    all_stimuli,
    gain_of,
    resampled,
)
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch

from .plans import TEXT

RATE_HZ = 48_000.0


def stimulus(**keys: Any) -> Stimulus:
    return Stimulus(name="a", **keys)


@pytest.fixture
def maker(tmp_path: Path) -> StimulusMaker:
    return StimulusMaker(tmp_path)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with made.csv: 5 s of a surface with three resonances, slid over harder and softer."""
    t_s = np.arange(50_000) / 1e4
    force_N = 1.0 + 0.5 * np.sin(2.0 * np.pi * 0.4 * t_s)
    speed_m_s = 0.1 + 0.03 * np.sin(2.0 * np.pi * 0.7 * t_s)
    poles = 0.97 * np.exp(2j * np.pi * np.array([80.0, 300.0, 650.0]) / 1e4)
    texture = Texture.from_models(
        1e4, [2.0], [0.2], a=[np.real(np.poly([*poles, *poles.conj()]))], variance_m2_s4=[1e-4]
    )
    swatch = load_swatch("wood")
    a_m_s2 = synthesize(replace(swatch, texture=texture), force_N, speed_m_s, seed=3)
    folder = tmp_path_factory.mktemp("recorded")
    rows = np.column_stack([a_m_s2 / a_m_s2.std(), force_N, speed_m_s])
    np.savetxt(folder / "made.csv", rows, "%.6g", ",", header="acceleration,force,speed", comments="")
    return folder


@pytest.fixture(scope="module")
def of_it(recorded: Path) -> StimulusMaker:
    return StimulusMaker(recorded)


MADE = {
    "recording": "made.csv",
    "rate_Hz": 1e4,
    "units": {"acceleration": "m/s2", "force": "N", "speed": "m/s"},
    "seconds": 1.0,
}


def test_a_swatch_is_synthesised_resampled_and_faded(maker: StimulusMaker) -> None:
    made = maker.samples(stimulus(swatch="wood", force_N=0.8, speed_m_s=0.12, seconds=1.5), 7, RATE_HZ)
    rate_Hz = load_swatch("wood").texture.rate_Hz  # type: ignore[union-attr]
    count = round(1.5 * rate_Hz)
    known = synthesize("wood", np.full(count, 0.8), np.full(count, 0.12), seed=7)
    assert len(made) == 72_000
    edge = round(FADE_S * rate_Hz)
    known[:edge] *= np.sin(0.5 * np.pi * np.arange(edge) / edge) ** 2
    known[-edge:] *= np.sin(0.5 * np.pi * np.arange(edge) / edge)[::-1] ** 2
    lines = slice(30, 6000)  # 20 Hz to 4 kHz
    found, wanted = np.fft.rfft(made)[lines] / RATE_HZ, np.fft.rfft(known)[lines] / rate_Hz
    assert np.abs(found - wanted).max() < 1e-3 * np.abs(wanted).max()
    edge = round(FADE_S * RATE_HZ)
    assert made[0] == 0.0 and abs(made[-1]) < 1e-4 and np.abs(made[: edge // 8]).max() < 0.05 * np.abs(made).max()


def test_life_false_disables_amplitude_modulation(maker: StimulusMaker) -> None:
    def unsteadiness(life: bool) -> float:
        levels = []
        for seed in range(6):
            a = maker.samples(stimulus(swatch="wood", life=life, seconds=4.0), seed, RATE_HZ)
            levels += [np.log(part.std()) for part in a[2000:-2000].reshape(-1, 4700)]
        return float(np.std(levels))

    assert unsteadiness(True) > 3.0 * unsteadiness(False)


def test_a_recording_is_played_unchanged(recorded: Path, of_it: StimulusMaker) -> None:
    raw = np.genfromtxt(recorded / "made.csv", delimiter=",", names=True)["acceleration"]
    raw = filtered(raw, 1e4, 20.0, "highpass")  # as for a fit
    made = of_it.samples(stimulus(**MADE), 5, 1e4)[400:-400]
    match = np.correlate(raw, made, "valid") / np.sqrt(np.convolve(raw**2, np.ones(len(made)), "valid") * (made @ made))
    assert match.max() > 0.999  # an excerpt of the file


def test_a_swatch_at_the_force_and_speed_of_a_recording(recorded: Path, of_it: StimulusMaker) -> None:
    along = stimulus(**MADE, swatch="wood")
    excerpt = of_it._excerpt(along, 9)
    known = synthesize("wood", excerpt.force_N, excerpt.speed_m_s, seed=9)
    rate_Hz = load_swatch("wood").texture.rate_Hz  # type: ignore[union-attr]
    made = of_it.samples(along, 9, rate_Hz)
    count = min(len(made), len(known))
    np.testing.assert_allclose(made[400 : count - 400], known[400 : count - 400])


@pytest.mark.parametrize(
    ("shown", "match"),
    [
        ({**MADE, "seconds": 20.0}, "made.csv"),
        ({**MADE, "units": {}}, "unit"),
        ({**MADE, "recording": "none.csv"}, "none.csv"),
        ({"swatch": "oka"}, "no swatch 'oka'"),
        ({"swatch": "./oka.swatch"}, "oka.swatch"),
    ],
)
def test_invalid_stimuli(recorded: Path, shown: dict[str, Any], match: str) -> None:
    with pytest.raises(HapsceneError, match=match):
        StimulusMaker(recorded).samples(stimulus(**shown), 0, RATE_HZ)


def test_columns_and_units_of_a_recording_are_those_of_the_stimulus(maker: StimulusMaker, tmp_path: Path) -> None:
    rows = np.column_stack([np.random.default_rng(0).standard_normal(1000), np.full(1000, 500.0)])
    np.savetxt(tmp_path / "x.csv", rows, delimiter=",", header="a,f", comments="")
    named = stimulus(
        recording="x.csv",
        rate_Hz=1e3,
        columns={"acceleration": "a", "force": "f"},
        units={"acceleration": "g", "force": "mN"},
    )
    channels, _ = maker._recording(named)
    assert channels.rate_Hz == 1e3 and channels.force_N == pytest.approx(0.5) and "speed_m_s" in channels.assumed


def test_the_error_has_the_longest_slide(maker: StimulusMaker, monkeypatch: pytest.MonkeyPatch) -> None:
    states = np.full(3000, InteractionState.AIR, np.int8)
    states[100:400] = states[1000:2500] = InteractionState.SLIDING
    streams = Streams(1000.0, *[np.ones(3000)] * 4)
    monkeypatch.setattr(maker, "_recording", lambda one: (streams, Segmentation(1000.0, states, (), None, None)))
    with pytest.raises(StudyError, match=r"takes 1\.5 s"):
        maker._excerpt(stimulus(**MADE | {"seconds": 2.0}), 0)


def test_a_tone_is_resampled_to_16_bits() -> None:
    t_s = np.arange(10_000) / 1e4
    for frequency_Hz in (50.0, 997.0, 3000.0):
        made = resampled(np.sin(2.0 * np.pi * frequency_Hz * t_s), 1e4, RATE_HZ)
        known = np.sin(2.0 * np.pi * frequency_Hz * np.arange(48_000) / RATE_HZ)
        assert np.abs(made - known)[2000:-2000].max() < 0.5 / 32_767


def test_all_stimuli_have_the_same_gain(maker: StimulusMaker) -> None:
    stimuli = [stimulus(swatch=name, seconds=0.5) for name in ("wood", "paper")]
    peak = max(np.abs(maker.samples(one, seed, RATE_HZ)).max() for one in stimuli for seed in range(TRIES))
    assert 20.0 * np.log10(gain_of(maker, stimuli, RATE_HZ) * peak) == pytest.approx(-HEADROOM_DB)
    with pytest.raises(StudyError, match="silent"):
        gain_of(maker, [], RATE_HZ)


def test_all_levels_of_a_staircase_are_stimuli() -> None:
    text = TEXT.split("[[blocks]]")
    plan = parse_plan(f"{text[0]}[[blocks]]{text[-1]}".replace("[0.25, 8.0, 32]", "[1.0, 4.0, 3]\nreference = 3.0"))
    assert [one.gain_dB for one in all_stimuli(plan)] == pytest.approx([3.0, 4.0, 5.0, 7.0])
    assert {one.name for one in all_stimuli(plan)} == {"alive"}
