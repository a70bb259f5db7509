"""Distinct colours of swatches."""

from itertools import combinations

import pytest

from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.view.palette import DISTANCE_MIN, FORCE, PATH, _distance, albedo_colours, distinct_colours


def test_equal_colours_are_replaced() -> None:
    swatches = [PLAIN, *(Swatch(f"fitted {k}") for k in range(7))]
    colours = distinct_colours(swatches, range(8))
    assert colours[0] == albedo_colours([PLAIN])[0]
    assert min(_distance(a, b) for a, b in combinations([*colours, PATH, FORCE], 2)) >= DISTANCE_MIN


def test_distinct_colours_are_kept() -> None:
    swatches = [
        PLAIN,
        Swatch("a", albedo_rgb=(1, 0, 0)),
        Swatch("b", albedo_rgb=(1, 0, 0)),
        Swatch("c", albedo_rgb=(0, 0, 1)),
    ]
    colours = distinct_colours(swatches, [1, 3])  # b is not used
    assert colours == albedo_colours(swatches)
    assert distinct_colours(swatches, [1, 2, 3])[2] != colours[2]


@pytest.mark.parametrize(
    ("a", "b", "distance"), [("#000000", "#ffffff", 1.0), ("#ff0000", "#ff0000", 0.0), ("#ffffff", "#808080", 0.400)]
)
def test_distance_in_oklab(a: str, b: str, distance: float) -> None:
    assert _distance(a, b) == pytest.approx(distance, abs=2e-3)  # lightness of white 1, of #808080 0.5999
