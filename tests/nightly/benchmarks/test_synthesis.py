"""What is timed is what is told."""

import pytest

from hapscene_benchmarks import synthesis
from hapscene_benchmarks.sheet import Sheet


def test_every_order_and_shipped_swatch_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synthesis, "REPEATS", 1)
    monkeypatch.setattr(synthesis, "DURATION_S", 0.5)
    sheet = Sheet()
    synthesis.measure_synthesis(sheet)
    assert sheet.cases("synthesis, order ") == [f"synthesis, order {order}" for order in synthesis.ORDERS]
    for order in synthesis.ORDERS:
        for name in ("one model", "nine models", "nine models, alive", "lfilter"):
            assert sheet.number(f"synthesis, order {order}", f"{name} for 10 s") > 0.0
    for name in synthesis.SHIPPED:
        assert sheet.number(f"synthesis, {name}", "order") >= 4
        assert sheet.number(f"synthesis, {name}", "swatch for 10 s") > 0.0
