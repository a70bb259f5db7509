"""The table of the chart: every claim follows from the measured settings, and no claim is smaller than the noise."""

from dataclasses import replace
from pathlib import Path

import pytest

from hapscene_evidence.chart.question import Measure, Point, Question, Setting, merge_identical
from hapscene_evidence.chart.rows import Row, rows_of, sentences
from hapscene_evidence.chart.run import QUESTIONS, question
from hapscene_evidence.chart.table import Table

RESULTS = Path(__file__).parents[2] / "docs" / "results"

ORDER = Question(
    name="order",
    title="Order",
    measures=(Measure("off", "levels", "JND", 1.0), Measure("held", "recordings", "JND", 1.0, excess=True)),
    settings=lambda scene: [],
    error=dict,
    time=lambda: (0.0, 0.0),
    conditions="",
)


def point(label: str, us: float, off: float, **more: object) -> Point:
    return replace(Point("Order", "", label, "", label == "40", us, us, 0.0, {"off": off}), **more)


def row(*points: Point) -> Row:
    (found,) = rows_of(ORDER, points)
    return found


def test_cheapest_setting_below_the_limit_is_chosen() -> None:
    found = row(point("40", 3.0, 0.1), point("20", 2.0, 0.9), point("8", 1.0, 1.5))
    assert found.chosen.label == "20" and found.saves_time and found.saved_us == pytest.approx(1.0)
    assert "8: 1.50 (levels)" in found.cells()[-1]
    assert "Order (20: 1 µs)" in sentences([found])[0]


@pytest.mark.parametrize(
    "points",
    [
        [point("40", 2.0, 0.1), point("20", 1.98, 0.2)],  # within 3 %
        [point("40", 2.0, 0.1, noise_us=0.6), point("20", 1.5, 0.2)],  # repetitions differ by more
        [point("40", 2.0, 0.1), point("20", 1.5, 0.2), point("8", 2.2, 0.3)],  # a coarser setting takes longer
        [point("40", 2.0, 0.1), point("40", 2.7, 0.1, case="b"), point("20", 1.9, 0.2)],  # cases differ by more
    ],
)
def test_lever_that_moves_the_time_by_less_than_the_noise_is_not_claimed(points: list[Point]) -> None:
    found = row(*points)
    assert not found.saves_time and found.chosen == found.default
    assert not any("Save" in sentence for sentence in sentences([found]))
    assert "noise" in found.cells()[3]


def test_error_of_a_reference_is_subtracted() -> None:
    held = (("40", 3.0, 1.4), ("20", 2.0, 1.3), ("8", 1.0, 2.5))
    found = row(*(point(name, us, 0.0, errors={"off": 0.1, "held": jnd}) for name, us, jnd in held))
    assert found.chosen.label == "20" and found.chosen.error == pytest.approx(0.1)


@pytest.mark.parametrize("off", [1.1, float("nan")])
def test_largest_error_of_all_cases_counts(off: float) -> None:
    found = row(point("40", 3.0, 0.1), point("20", 1.0, 0.1, case="a"), point("20", 1.0, off, case="b"))
    assert found.chosen.label == "40"


def test_settings_with_the_same_program_are_merged() -> None:
    one = replace(ORDER, program=lambda order: bytes([min(order, 6)]))
    settings = [Setting("Order", "", f"order {n}", {"order": n}, default=n == 40) for n in (40, 20, 6, 4)]
    merged = merge_identical(one, settings)
    assert [(s.label, s.default) for s in merged] == [("order 6 and finer", True), ("order 4", False)]
    assert merge_identical(ORDER, settings) == settings


def test_published_table_has_at_most_twelve_rows_and_true_claims() -> None:
    found = Table.read(RESULTS / "chart" / "chart.csv")
    assert list(found.points) == list(QUESTIONS)
    rows = [row for name, points in found.points.items() for row in rows_of(question(name), points)]
    page = (RESULTS / "chart.md").read_text(encoding="utf-8")
    assert found.quiet and len(rows) <= 12 and page.count("<picture>") == 1
    for each in rows:
        assert f"| {' | '.join(each.cells())} |" in page
        assert not each.saves_time or each.saved_us > each.noise_us
    claims = sentences(rows)
    assert claims and all(each in " ".join(page.split()) for each in claims)
    assert len([word for word in page.split() if any(map(str.isalnum, word))]) <= 520  # with the picture's HTML
