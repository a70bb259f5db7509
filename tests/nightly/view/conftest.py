"""What the tests in tests/view share."""

from tests.view.conftest import *  # noqa: F403
