"""Words and shelf: what is said of a swatch, found again by searching for it."""

import io
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import wavfile

import hapscene
from hapscene.errors import SwatchError
from hapscene.paint.session import Session
from hapscene.paint.shelf import (
    EASE_S,
    FULL_SCALE_M_S2,
    GREY,
    LOUDNESS,
    PAUSE_S,
    PITCH,
    START_S,
    concatenated,
    matching,
    ordered,
    phrases,
    shelf,
    swatch_sound,
    wav_bytes,
)
from hapscene.surface.library import add
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import figures
from hapscene.surface.taps import Taps


def tapped(amplitude_m_s2: float, frequency_Hz: float) -> Swatch:
    return Swatch("t", taps=Taps([0.1], [amplitude_m_s2], [frequency_Hz], [80.0]))


def test_a_swatch_in_words() -> None:
    wood = hapscene.load_swatch("wood")
    said = {phrase.quality: phrase for phrase in phrases(wood)}
    assert (said["hardness"].word, said["hardness"].figure) == ("firm", "650 N/m")
    assert said["texture"].figure.startswith(f"{figures(wood)['roughness_m_s2']:.2g} m/s² at 1 N, 0.1 m/s")
    assert said["friction"].figure == "µ 0.32, 0.32 at rest"
    assert said["taps"] == ("taps", "clear knocking taps", "5 m/s², 100 Hz at 0.1 m/s")
    assert [phrase.word for phrase in phrases(Swatch("bare"))] == ["firm", "silent", "slippery", "no taps"]


def test_gains_are_heard_in_the_words() -> None:
    session = Session(_scene())
    wood = session.painting.swatch_named("wood")
    session.tune(wood, texture_gain=4.0, tap_gain=0.1)
    said = {phrase.quality: phrase.word for phrase in phrases(session.scene.swatches[wood])}
    assert said["texture"] == "very rough" and said["taps"] == "faint knocking taps"
    session.tune(wood, texture_gain=0.0, tap_gain=0.0)
    told = [phrase.word for phrase in phrases(session.scene.swatches[wood])]
    assert told == ["firm", "silent", "sliding easily", "no taps"]


def _scene() -> hapscene.Scene:
    from trimesh.creation import box

    scene = hapscene.Scene()
    scene.add(box((1, 1, 1)), unit="cm", name="box", swatch="wood")
    return scene


@pytest.mark.parametrize("steps", [LOUDNESS, PITCH])
def test_every_step_is_reached_at_its_bound(steps) -> None:
    low = 1e-3
    for bound, word in steps:
        for value in (low, np.nextafter(bound, 0.0) if np.isfinite(bound) else 1e4):
            swatch = tapped(value, 100.0) if steps is LOUDNESS else tapped(5.0, value)
            assert word in phrases(swatch)[-1].word.split()
        low = bound


def test_the_shelf_has_the_scenes_own_first(library) -> None:
    add(Swatch("foam", stiffness_N_m=80.0, provenance="kitchen"))
    session = Session(_scene())
    session.tune(session.painting.swatch_named("wood"), stiffness_N_m=100.0)
    cards = shelf(session.scene)
    assert [(c.name, c.place, c.index) for c in cards[:3]] == [
        ("plain", "scene", 0),
        ("wood", "scene", 1),
        ("foam", "yours", None),
    ]
    assert [c.name for c in cards[3:6]] == ["epoxy", "leather", "paper"]  # wood is that of the scene
    assert len(cards) > 30 and {c.place for c in cards[6:]} == {"computed"}
    assert cards[1].phrases[0].word == "very soft"
    for card in cards[:9]:
        index = card.index if card.index is not None else session.add_swatch(card.source)
        assert session.scene.swatches[index].name == card.name
        assert card.albedo_rgb == session.scene.swatches[index].albedo_rgb
    (library / "foam.swatch").unlink()
    assert next(c for c in shelf(_scene()) if c.name == "foam").albedo_rgb == GREY


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", ["plain", "wood", "foam", "epoxy", "leather", "paper"]),
        ("WOOD", ["wood"]),
        ("kitchen soft", ["foam"]),
        ("knocking", ["wood", "paper"]),
        ("knock", ["wood", "paper"]),
        ("stiff", []),
        ("firm stiffness>=600", ["wood", "epoxy"]),
        ("friction<0.3 tap_Hz>100", ["epoxy"]),
        ("nothing like it", []),
    ],
)
def test_searching_the_shelf(library, text, names) -> None:
    add(Swatch("foam", stiffness_N_m=80.0, provenance="kitchen, stiffness by hand"))
    found = [card.name for card in matching(shelf(_scene()), text) if card.place != "computed"]
    assert found == names


def test_folders_tags_and_kinds_are_found(library) -> None:
    add(Swatch("foam"), inside="kitchen", tags=["sponge"])
    cards = shelf(_scene())
    (foam,) = matching(cards, "sponge")
    assert (foam.place, foam.folder, foam.own) == ("yours", "kitchen", library / "kitchen")
    assert matching(cards, "kitchen") == [foam]
    assert {card.entry.tags[1] for card in matching(cards, "computed sandpaper")} == {"sandpaper"}
    scene = _scene()
    scene.swatch_index("sandpaper-p60")
    scene.swatch_index("foam")
    inside = {card.name: card for card in shelf(scene) if card.place == "scene"}
    assert "sandpaper" in inside["sandpaper-p60"].entry.tags and inside["foam"].own == library / "kitchen"
    assert len(shelf(scene)) == len(cards)


def test_cards_are_sorted() -> None:
    cards = shelf(_scene())
    assert ordered(cards, "place") == cards
    names = [card.name for card in ordered(cards, "name")]
    assert names == sorted(names, key=str.casefold)
    rough = [card.entry.figures.get("roughness_m_s2", 0.0) for card in ordered(cards, "roughness")]
    assert rough == sorted(rough) and rough[-1] > 5.0
    taps = [card.entry.figures.get("tap_m_s2", 0.0) for card in ordered(cards, "loudness")]
    assert taps == sorted(taps)
    lately = [card.name for card in ordered(cards, "recently used", ["slate", "paper"])]
    assert lately[:3] == ["slate", "paper", "plain"]


def test_a_search_that_cannot_be(library) -> None:
    with pytest.raises(SwatchError, match="no figure 'colour'"):
        matching(shelf(_scene()), "colour<3")


# A swatch by ear: as loud as its texture, on one scale with what it is compared with.


WOOD = hapscene.load_swatch("wood")


def steady(sound, seconds: float) -> np.ndarray:
    """What is heard while the stroke has its full speed."""
    start, stop = START_S + EASE_S + 0.05, START_S + seconds - EASE_S - 0.05
    return sound.a_m_s2[round(start * sound.rate_Hz) : round(stop * sound.rate_Hz)]


def test_it_is_as_loud_as_the_texture() -> None:
    for force_N, speed_m_s, gain in ((1.0, 0.1, 1.0), (0.5, 0.2, 1.0), (1.0, 0.1, 3.0)):
        swatch = replace(WOOD, taps=None, effects={"lpc_texture": {"texture_gain": gain}})
        level = steady(swatch_sound(swatch, force_N, speed_m_s, 20.0), 20.0).std()
        known = gain * float(np.sqrt(WOOD.texture.power([force_N], [speed_m_s])[0]))  # type: ignore[union-attr]
        assert level == pytest.approx(known, rel=0.1)


def test_the_tap_is_first_and_the_swatchs_own() -> None:
    quiet = replace(WOOD, texture=None)
    sound = swatch_sound(quiet)
    tap = WOOD.taps.transient(0.1, sound.rate_Hz)  # type: ignore[union-attr]
    np.testing.assert_allclose(sound.a_m_s2[: len(tap)], tap)
    assert not swatch_sound(quiet, approach_m_s=0.0).a_m_s2.any()
    assert not swatch_sound(Swatch("bare")).a_m_s2.any()


def samples(data: bytes) -> tuple[int, np.ndarray]:
    rate, found = wavfile.read(io.BytesIO(data))
    assert found.dtype == np.int16 and found.ndim == 1
    return rate, found


def test_two_are_compared_on_one_scale() -> None:
    soft = replace(WOOD, effects={"lpc_texture": {"texture_gain": 0.25}, "tap": {"tap_gain": 0.25}})
    first, second = swatch_sound(WOOD), swatch_sound(soft)
    rate, both = samples(wav_bytes(concatenated([first, second])))
    n, gap = len(first.a_m_s2), round(PAUSE_S * rate)
    assert len(both) == 2 * n + gap and not both[n : n + gap].any()
    assert both[n + gap :].std() == pytest.approx(0.25 * both[:n].std(), rel=0.01)
    _, alone = samples(wav_bytes(second))
    np.testing.assert_array_equal(alone, both[n + gap :])  # as loud alone as beside the other


def test_what_is_too_loud_is_turned_down_and_silence_stays() -> None:
    loud = replace(WOOD, effects={"lpc_texture": {"texture_gain": 10.0}, "tap": {"tap_gain": 10.0}})
    _, found = samples(wav_bytes(swatch_sound(loud)))
    assert np.abs(swatch_sound(loud).a_m_s2).max() > FULL_SCALE_M_S2
    assert 29_000 < np.abs(found).max() < 32767
    assert not samples(wav_bytes(swatch_sound(Swatch("bare"))))[1].any()
