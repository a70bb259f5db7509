"""The guide to devices has a section or a row for each driver."""

import re
from pathlib import Path

from hapscene.device.driver_registry import DRIVERS

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "set-up-a-device.md"


def test_each_driver_has_a_section_or_a_row() -> None:
    text = PAGE.read_text(encoding="utf-8")
    sections = re.findall(r"(?m)^## .*\(`(\w+)`\)$", text)
    rows = re.findall(r"(?m)^\| `(\w+)` \|", text)
    assert sorted(sections + rows) == [n for n, offer in DRIVERS.listed().items() if offer.distribution == "hapscene"]
