"""What tests share: the folder of reference data, where there is one."""

from pathlib import Path

import pytest
from hypothesis import settings

SHARED = Path(__file__).resolve().parents[2] / "shared"

settings.register_profile("fixed", derandomize=True, deadline=None)  # the same examples everywhere, at any speed
settings.load_profile("fixed")


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference data beside the checkout; tests that need it skip without it."""
    if not SHARED.is_dir():
        pytest.skip("no folder ../shared beside the checkout: reference data absent")
    return SHARED
