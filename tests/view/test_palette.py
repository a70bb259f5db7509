"""Distinct colours of swatches."""

from itertools import combinations

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
