"""docs/devices.md against the drivers: a section each, with all that the driver says of itself."""

import re
from pathlib import Path

import pytest

from hapscene.device.driver_registry import DRIVERS

PAGE = Path(__file__).parents[3] / "docs" / "devices.md"


def plain(text: str) -> str:
    return " ".join(text.split())


def sections() -> dict[str, str]:
    """Text of each driver's section, by its name."""
    _, *parts = re.split(r"(?m)^### (\S+)$", PAGE.read_text(encoding="utf-8").partition("\n## Drivers\n")[2])
    return dict(zip(parts[::2], map(plain, parts[1::2]), strict=True))


def ours() -> list[str]:
    return [name for name, offer in DRIVERS.listed().items() if offer.distribution == "hapscene"]


def test_there_is_a_section_for_each_driver_and_for_no_other() -> None:
    assert sorted(sections()) == ours()


@pytest.mark.parametrize("name", ours())
def test_a_section_says_what_the_driver_says(name: str) -> None:
    driver, section = DRIVERS.load(name), sections()[name]
    said = [driver.summary, driver.needs, *driver.assumptions, *(f"`{o.name}`: {o.meaning}" for o in driver.options)]
    assert [sentence for sentence in said if plain(sentence) not in section] == []
    if driver.model is not None and driver.force:
        assert f"{driver.model.limits.force_N:g} N at most" in section
