"""What is measured is what is told."""

from hapscene_benchmarks.sheet import Sheet
from hapscene_benchmarks.surface_fit import measure_fit


def test_time_and_memory_of_a_fit_are_told() -> None:
    sheet = Sheet()
    measure_fit(sheet, (2.0,))
    assert sheet.cases("fit, ") == ["fit, 2 s"]
    assert sheet.number("fit, 2 s", "time") > 0.0 and sheet.number("fit, 2 s", "memory") > 2.0
