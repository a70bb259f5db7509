"""What the tests in tests/paint share."""

from tests.paint.conftest import *  # noqa: F403
