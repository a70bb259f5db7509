"""Fixtures of tests/view."""

from tests.view.conftest import *  # noqa: F403
