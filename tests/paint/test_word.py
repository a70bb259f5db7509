"""Words and shelf: what is said of a swatch, found again by searching for it."""

import numpy as np
import pytest

import hapscene
from hapscene.errors import SwatchError
from hapscene.paint.session import Session
from hapscene.paint.shelf import GREY, matching, shelf
from hapscene.paint.word import LOUDNESS, PITCH, phrases, sentence
from hapscene.surface.library import add
from hapscene.surface.portrait import figures
from hapscene.surface.swatch import Swatch
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
    assert sentence(Swatch("bare")) == "firm, silent, slippery, no taps"


def test_gains_are_heard_in_the_words() -> None:
    session = Session(_scene())
    wood = session.swatch_named("wood")
    session.tune(wood, texture_gain=4.0, tap_gain=0.1)
    said = {phrase.quality: phrase.word for phrase in phrases(session.scene.swatches[wood])}
    assert said["texture"] == "very rough" and said["taps"] == "faint knocking taps"
    session.tune(wood, texture_gain=0.0, tap_gain=0.0)
    assert sentence(session.scene.swatches[wood]) == "firm, silent, sliding easily, no taps"


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
    session.tune(session.swatch_named("wood"), stiffness_N_m=100.0)
    cards = shelf(session.scene)
    assert [(c.name, c.place, c.index) for c in cards[:3]] == [
        ("plain", "scene", 0),
        ("wood", "scene", 1),
        ("foam", "yours", None),
    ]
    assert [c.name for c in cards[3:]] == ["epoxy", "leather", "paper"]  # wood is that of the scene
    assert cards[1].phrases[0].word == "very soft"
    for card in cards:
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
    found = [card.name for card in matching(shelf(_scene()), text)]
    assert found == names


def test_a_search_that_cannot_be(library) -> None:
    with pytest.raises(SwatchError, match="no figure 'colour'"):
        matching(shelf(_scene()), "colour<3")
