"""Random limits: simulated against predicted."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.stability.random_limit import KINDS, random_limits
from hapscene.stability.wall_chart import write_random_chart

pytestmark = pytest.mark.nightly

TOLERANCES = dict(zip(KINDS, (1e-6, 1e-6, 1e-6, 1e-4, 0.05), strict=True))


def test_few_of_each_kind(tmp_path: Path) -> None:
    cases = random_limits(5, seed=5)
    assert [case.kind for case in cases] == list(KINDS)
    for case in cases:
        assert case.error < TOLERANCES[case.kind], case
    write_random_chart(tmp_path / "limits.png", cases)
    assert (tmp_path / "limits.png").stat().st_size > 10_000


@pytest.mark.soak
def test_two_hundred_and_more() -> None:
    cases = random_limits(240)
    for kind, tolerance in TOLERANCES.items():
        errors = [case.error for case in cases if case.kind == kind]
        assert len(errors) == 48
        assert max(errors) < tolerance
        assert np.median(errors) < 0.2 * tolerance
