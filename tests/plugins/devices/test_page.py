"""The guide to devices has a section or a row for each driver, with the driver's largest force."""

import re
from pathlib import Path

import pytest

from hapscene.device.driver_registry import DRIVERS

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "set-up-a-device.md"
TEXT = PAGE.read_text(encoding="utf-8")


def shipped() -> list[str]:
    return [name for name, offer in DRIVERS.listed().items() if offer.distribution == "hapscene"]


def test_each_driver_has_a_section_or_a_row() -> None:
    sections = re.findall(r"(?m)^## .*\(`(\w+)`\)$", TEXT)
    rows = re.findall(r"(?m)^\| `(\w+)` \|", TEXT)
    assert sorted(sections + rows) == shipped()


@pytest.mark.parametrize("name", shipped())
def test_a_section_states_the_limits_of_its_driver(name: str) -> None:
    driver = DRIVERS.load(name)
    section = TEXT.partition(f"(`{name}`)\n")[2].partition("\n## ")[0]
    if section and driver.model is not None:
        limits = driver.model.limits
        assert f"{limits.force_N:g} N ({driver.continuous_N:g} N continuously)" in section
        assert f"{limits.stiffness_N_m:g} N/m" in section
