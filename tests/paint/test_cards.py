"""Words and cards: what is said of a swatch, found again by searching for it."""

import pytest

import hapscene
from hapscene.errors import SwatchError
from hapscene.paint.model.cards import GREY, all_cards, matching
from hapscene.paint.model.session import Session
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import figures, phrases
from hapscene.swatches.library import add


def test_description_of_a_swatch() -> None:
    wood = hapscene.load_swatch("wood")
    said = {phrase.quality: phrase for phrase in phrases(wood)}
    assert (said["hardness"].word, said["hardness"].figure) == ("firm", "650 N/m")
    assert said["texture"].figure.startswith(f"{figures(wood)['roughness_m_s2']:.2g} m/s² at 1 N, 0.1 m/s")
    assert said["friction"].figure == "µ 0.32, 0.32 at rest"
    assert said["taps"] == ("taps", "clear knocking taps", "5 m/s², 100 Hz at 0.1 m/s")
    bare = [phrase.word for phrase in phrases(Swatch("bare"))]
    assert bare == ["firm", "no texture", "slippery", "no taps"]


def test_descriptions_include_the_gains() -> None:
    session = Session(_scene())
    wood = session.painting.swatch_named("wood")
    session.tune(wood, texture_gain=4.0, tap_gain=0.1)
    said = {phrase.quality: phrase.word for phrase in phrases(session.scene.swatches[wood])}
    assert said["texture"] == "very rough" and said["taps"] == "faint knocking taps"
    session.tune(wood, texture_gain=0.0, tap_gain=0.0)
    described = [phrase.word for phrase in phrases(session.scene.swatches[wood])]
    assert described == ["firm", "no texture", "sliding easily", "no taps"]


def _scene() -> hapscene.Scene:
    from trimesh.creation import box

    scene = hapscene.Scene()
    scene.add(box((1, 1, 1)), unit="cm", name="box", swatch="wood")
    return scene


def test_swatches_of_the_scene_are_listed_first(library) -> None:
    add(Swatch("foam", stiffness_N_m=80.0, provenance="kitchen"))
    session = Session(_scene())
    session.tune(session.painting.swatch_named("wood"), stiffness_N_m=100.0)
    cards = all_cards(session.scene)
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
    assert next(c for c in all_cards(_scene()) if c.name == "foam").albedo_rgb == GREY


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", ["plain", "wood", "foam", "epoxy", "leather", "paper"]),
        ("WOOD", ["wood"]),
        ("kitchen soft", ["foam"]),
        ("knock", ["wood", "paper"]),
        ("stiff", []),
        ("friction<0.3 tap_Hz>100", ["epoxy"]),
    ],
)
def test_search_by_words_and_bounds(library, text, names) -> None:
    add(Swatch("foam", stiffness_N_m=80.0, provenance="kitchen, stiffness by hand"))
    found = [card.name for card in matching(all_cards(_scene()), text) if card.place != "computed"]
    assert found == names


def test_tags_and_kinds_are_found(library) -> None:
    add(Swatch("foam"), inside="kitchen", tags=["sponge"])
    cards = all_cards(_scene())
    (foam,) = matching(cards, "sponge")
    assert (foam.place, foam.source) == ("yours", library / "kitchen" / "foam.swatch")
    assert {card.entry.tags[1] for card in matching(cards, "computed sandpaper")} == {"sandpaper"}
    scene = _scene()
    scene.swatch_index("sandpaper-p60")
    scene.swatch_index("foam")
    inside = {card.name: card for card in all_cards(scene) if card.place == "scene"}
    assert "sandpaper" in inside["sandpaper-p60"].entry.tags and inside["foam"].entry.tags == ("sponge",)
    assert len(all_cards(scene)) == len(cards)


def test_invalid_search_is_refused(library) -> None:
    with pytest.raises(SwatchError, match="'colour'"):
        matching(all_cards(_scene()), "colour<3")
