"""Fixtures of tests/capture."""

from tests.capture.conftest import *  # noqa: F403
