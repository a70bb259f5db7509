"""Slow tests: ten minutes for each, and the whole number of hypothesis' examples."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if HERE in item.path.parents and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(7200 if item.get_closest_marker("soak") else 600))
