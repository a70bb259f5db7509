"""Layers by a third variable: found on surfaces made with them, and on others not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt

from hapscene.capture import fit
from hapscene.capture.layer_fit import Layers, find_layers
from hapscene.capture.recording_file import SurfaceRecording
from hapscene.capture.report import report
from hapscene.capture.streams import Streams
from hapscene.capture.swatch_fit import fit_parts, prepare
from hapscene.capture.texture_pieces import Pieces, cut, pooled
from hapscene.dsp.ar_filter import power_gain, power_response
from hapscene.errors import CaptureError
from hapscene.surface.swatch_summary import lines
from hapscene.surface.texture import PERIOD_RAD, layer_shares

RATE = 2500.0
LOW, HIGH = (
    np.convolve(*[[1.0, -2.0 * r * np.cos(2.0 * np.pi * f / RATE), r * r] for f, r in ((one, 0.93), (3.5 * one, 0.87))])
    for one in (110.0, 150.0)
)


def slow(rng, count, cutoff_Hz):
    smooth = butter(2, cutoff_Hz, fs=RATE, output="sos")
    made = sosfiltfilt(smooth, rng.standard_normal(count + 4000))[2000:-2000]
    return made / made.std()


def life(rng, count, spread=0.4):
    """A gain that forgets within 15 ms to a quarter of a second, as surfaces have it, mean power 1."""
    made = np.zeros(count)
    for forgets_s in (0.015, 0.04, 0.1, 0.25):
        stays = np.exp(-1.0 / (forgets_s * RATE))
        made += lfilter([np.sqrt(1.0 - stays**2)], [1.0, -stays], rng.standard_normal(count)) * spread / 2.0
    return np.exp(made - spread**2)


def stroke(rng, seconds, kind):
    """Force, speed and direction of a hand that goes to and fro along a line, turns it slowly, or goes in circles."""
    t = np.arange(round(seconds * RATE)) / RATE
    turns = np.cumsum(0.75 + 0.2 * slow(rng, len(t), 0.3)) / RATE
    force = np.clip(1.2 + 0.4 * slow(rng, len(t), 0.6), 0.2, None)
    if kind == "circles":
        return force, 0.1 + 0.02 * slow(rng, len(t), 1.0).clip(-3.0, 3.0), 2.0 * np.pi * turns
    along = 0.13 * np.cos(2.0 * np.pi * turns)
    way = 0.0 if kind == "line" else 0.3 * t
    return force, np.abs(along) + 1e-4, np.where(along >= 0.0, 0.0, np.pi) + way + 0.05 * slow(rng, len(t), 1.0)


def heard(rng, force, speed, share, louder_dB=0.0):
    """A surface that is a share of one voice and the rest of another, which is louder."""
    voices = [lfilter([1.0], a, rng.standard_normal(len(force))) / np.sqrt(power_gain(a[None])[0]) for a in (LOW, HIGH)]
    mixed = np.sqrt(share) * voices[0] + np.sqrt(1.0 - share) * 10.0 ** (louder_dB / 20.0) * voices[1]
    return mixed * life(rng, len(force)) * np.sqrt(force**0.5 * (speed / 0.1) ** 2)


def share_of(angle, by, swing=1.0):
    return 0.5 + 0.5 * swing * np.cos(2.0 * np.pi / PERIOD_RAD[by] * angle)


def true_density(share, force, speed, frequency_Hz, louder_dB=0.0):
    parts = [
        power_response(a[None], 2.0 * np.pi / RATE * frequency_Hz)[0] / power_gain(a[None])[0] for a in (LOW, HIGH)
    ]
    loud = 10.0 ** (louder_dB / 10.0)
    return 2.0 / RATE * (share * parts[0] + (1.0 - share) * loud * parts[1]) * force**0.5 * (speed / 0.1) ** 2


def pieces_of(seed, seconds, kind, by=None, leaning=0.0) -> Pieces:
    rng = np.random.default_rng(seed)
    force, speed, angle = stroke(rng, seconds, kind)
    force = force * (1.0 + leaning * np.cos(angle))  # a hand presses more on the way out
    y = heard(rng, force, speed, share_of(angle, by) if by else np.full(len(force), 0.5), 3.0)
    return cut(Streams(RATE, y, force, speed, None, direction_rad=np.angle(np.exp(1j * angle))))


@pytest.mark.parametrize(("kind", "leaning"), [("line", 0.0), ("circles", 0.0), ("turning", 0.3), ("circles", 0.3)])
def test_a_surface_without_direction_has_no_layers(kind, leaning):
    """At most one in twenty, whatever the hand does; alive, as real surfaces are."""
    found = [find_layers(pieces_of(seed, 12.0, kind, leaning=leaning), RATE, "direction") for seed in range(20)]
    assert sum(isinstance(one, Layers) for one in found) <= 1
    assert all("direction" in one for one in found if isinstance(one, str))


@pytest.mark.parametrize(
    ("kind", "by"), [("circles", "axis"), ("turning", "axis"), ("circles", "direction"), ("line", "direction")]
)
def test_a_surface_that_turns_has_layers_of_its_period(kind, by):
    found = [find_layers(pieces_of(seed, 20.0, kind, by), RATE, "direction") for seed in range(8)]
    assert sum(isinstance(one, Layers) and one.by == by for one in found) >= 7


def test_recordings_of_one_direction_each_are_pooled_into_layers():
    """One recording along, one across. Where a recording says no direction, the others do."""
    rng, parts = np.random.default_rng(3), []
    for way, voice in ((0.0, 0.9), (np.pi / 2.0, 0.1)):
        force, speed, _ = stroke(rng, 8.0, "line")
        y = heard(rng, force, speed, np.full(len(force), voice))
        recording = SurfaceRecording(RATE, y, force, speed, None, direction_rad=np.full(len(y), way))
        parts.append(prepare(recording))
    swatch = fit_parts(parts, order=10, model_count=1)
    assert swatch.texture is not None and swatch.texture.layer_by == "axis"
    np.testing.assert_allclose(swatch.texture.layer_at_rad, [0.0, np.pi / 2.0], atol=1e-6)
    assert "2 layers by the direction of sliding, to and fro alike, at 0°, 90°" in "\n".join(lines(swatch))
    silent = prepare(replace(recording, direction_rad=None))
    both = pooled([cut(channels) for channels, _ in (*parts, silent)])
    found = find_layers(both, RATE, "direction")
    assert isinstance(found, Layers) and np.all(found.near[np.isnan(both.direction_rad)] == -1)


@pytest.mark.parametrize("by", ["axis", "direction", "contact_angle"])
def test_an_angle_a_hair_below_0_is_0(by):
    """As of a recording to and fro, whose direction is half a turn but for what is rounded."""
    rng, parts = np.random.default_rng(3), []
    for way, voice in ((0.0, 0.9), (0.5 * np.pi, 0.1)):
        force, speed, _ = stroke(rng, 8.0, "line")
        y = heard(rng, force, speed, np.full(len(force), voice))
        angle = np.full(len(y), -1e-17 + way + (np.arange(len(y)) // 1250 % 2 * np.pi if by == "axis" else 0.0))
        stream = {"contact_angle_rad" if by == "contact_angle" else "direction_rad": angle}
        recording = SurfaceRecording(RATE, y, force, speed, None)
        parts.append(prepare(replace(recording, **stream)))
    swatch = fit_parts(parts, order=6, model_count=1)
    assert swatch.texture is not None and len(swatch.texture.layers) == 2
    np.testing.assert_allclose(swatch.texture.layer_at_rad, [0.0, 0.5 * np.pi], atol=0.02)


@pytest.fixture(scope="module")
def turning():
    """A stroke over a surface whose axis is felt, and what is fitted to it."""
    rng = np.random.default_rng(7)
    force, speed, angle = stroke(rng, 24.0, "circles")
    y = heard(rng, force, speed, share_of(angle, "axis", 0.9), 6.0)
    streams = {"force_N": force, "speed_m_s": speed, "direction_rad": angle}
    return y, streams, fit(y, RATE, **streams, order=12, model_count=1, name="ribs")


def test_level_and_spectrum_of_each_direction_are_recovered(turning):
    """At forces and speeds within those recorded: nearer to the truth than what knows no direction, and near it."""
    texture = turning[2].texture
    assert texture.layer_by == "axis" and texture.life is not None and texture.other is None
    at_Hz = np.geomspace(20.0, 1000.0, 60)
    off: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for way in np.radians([0.0, 45.0, 90.0, 135.0, 180.0, 300.0]):
        truth = true_density(share_of(way, "axis", 0.9), 1.2, 0.1, at_Hz, 6.0)
        for knows, found in off.items():
            made = texture.density([1.2], [0.1], frequency_Hz=at_Hz, third_rad=[way] if knows else None)[0]
            apart = 10.0 * np.log10(made / truth)
            level = 10.0 * np.log10((made * at_Hz).sum() / (truth * at_Hz).sum())
            found.append((level, float(np.std(apart))))
    (level, shape), (plain_level, plain_shape) = (np.sqrt(np.mean(np.square(off[knows]), axis=0)) for knows in off)
    assert level < 1.2 and shape < 1.5  # dB
    assert level < 0.6 * plain_level and shape < 0.75 * plain_shape
    np.testing.assert_allclose(texture.life.log_spread, 0.4, rtol=0.2)  # what turns with the way is no life


def test_layers_are_told_and_judged(turning):
    y, streams, swatch = turning
    part = slice(0, round(8.0 * RATE))
    recording = SurfaceRecording(RATE, y[part], *(streams[name][part] for name in ("force_N", "speed_m_s")), None)
    page = report(swatch, replace(recording, direction_rad=streams["direction_rad"][part]))
    assert "layers by the direction of sliding, to and fro alike" in page and "on the held-out half" in page


def test_why_there_are_none(turning):
    y, streams, _ = turning
    part = slice(0, round(4.0 * RATE))
    short = {name: stream[part] for name, stream in streams.items()}
    assert not fit(y[part], RATE, **short, order=4, model_count=1, third=None).texture.layers
    same = fit(y[part], RATE, **short | {"direction_rad": 0.3}, order=4, model_count=1)
    assert same.absent["texture.layers"] == "the direction changed too little for layers of it, or too seldom"
    told = fit(y[part], RATE, **short, order=4, model_count=1, third="contact_angle")
    assert told.absent["texture.layers"] == "no contact angle was recorded"
    with pytest.raises(CaptureError, match='third must be "auto", None or one of direction, contact_angle, is 3'):
        fit(y, RATE, third=3)


def test_the_angle_of_the_tool_makes_layers_on_a_line():
    rng = np.random.default_rng(1)
    force, speed, _ = stroke(rng, 16.0, "circles")
    lean = 0.25 + 0.2 * np.clip(slow(rng, len(force), 0.4), -1.2, 1.2)
    y = heard(rng, force, speed, np.clip(lean / 0.5, 0.0, 1.0))
    texture = fit(y, RATE, force_N=force, speed_m_s=speed, contact_angle_rad=lean, order=10, model_count=1).texture
    assert texture is not None and texture.layer_by == "contact_angle"
    assert np.all(np.diff(texture.layer_at_rad) > 0.087) and texture.layer_at_rad[-1] < 0.5
    assert np.array_equal(texture.layer_share([-1.0, 2.0])[:, [0, -1]], [[1.0, 0.0], [0.0, 1.0]])  # held at the ends


def test_shares_go_in_straight_lines_from_layer_to_layer_and_round():
    at = np.array([0.5, 2.0])
    angle = [0.5, 0.875, 2.0, np.pi, 0.5 + np.pi, 0.5 - np.pi, 0.25]
    over = (np.pi - 2.0) / (np.pi - 1.5)  # from 2 on to 0.5 + π
    expected = [1.0, 0.75, 0.0, over, 1.0, 1.0, 1.0 - 0.25 / (np.pi - 1.5)]
    np.testing.assert_allclose(layer_shares(angle, at, "axis"), np.transpose([expected, 1.0 - np.array(expected)]))
