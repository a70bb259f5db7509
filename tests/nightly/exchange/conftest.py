"""What the tests in tests/exchange share."""

from tests.exchange.conftest import *  # noqa: F403
