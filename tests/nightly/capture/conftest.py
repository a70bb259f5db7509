"""What the tests in tests/capture share."""

from tests.capture.conftest import *  # noqa: F403
