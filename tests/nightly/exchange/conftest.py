"""Fixtures of tests/exchange."""

from tests.exchange.conftest import *  # noqa: F403
