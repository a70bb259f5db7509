"""What the tests share: options, timeouts, the reference data, a browser."""

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

NIGHTLY = Path(__file__).resolve().parent / "nightly"
SHARED = Path(__file__).resolve().parents[2] / "shared"

# A shell that starts the suite in the background, or nohup, sets these signals to be ignored; processes inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

settings.register_profile("fixed", derandomize=True, deadline=None)  # the same examples everywhere, at any speed
settings.load_profile("fixed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--device", metavar="NAME", help="try the contract of devices on this one, which is plugged in")
    parser.addoption("--device-option", action="append", default=[], metavar="KEY=VALUE", help="of its driver")
    parser.addoption("--update", action="store_true", help="renew tests/messages.golden from the present texts")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Set the timeout of nightly tests (10 minutes) and of soaks (2 hours); pyproject.toml has that of the others."""
    for item in items:
        slow = item.get_closest_marker("nightly") or NIGHTLY in item.path.parents
        soak = item.get_closest_marker("soak")
        if (slow or soak) and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(7200 if soak else 600))


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference data beside the checkout; tests that need it skip without it."""
    if not SHARED.is_dir():
        pytest.skip("no folder ../shared beside the checkout: reference data absent")
    return SHARED


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, one for the tests of a file; playwright's event loop runs meanwhile, and asyncio's cannot."""
    from tests.chromium import launched

    with launched() as made:
        yield made
