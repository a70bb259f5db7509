"""What the tests in tests/plugins share."""

from tests.plugins.conftest import *  # noqa: F403
