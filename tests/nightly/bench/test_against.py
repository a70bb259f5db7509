"""Comparison with another checkout."""

from pathlib import Path

import pytest

from hapscene.cli import main
from hapscene.errors import HapsceneError
from hapscene_evidence.bench import against

ROOT = Path(__file__).resolve().parents[3]


def test_checkout_is_as_fast_as_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("SUBDIVISIONS", 3), ("TICKS", 600), ("PASSES", 4)):
        monkeypatch.setattr(against, name, value)
    found = against.compare_checkouts(ROOT, 1, lambda _: None)
    assert [one.name for one in found] == list(against.FIGURES.values())
    for one in found:
        assert one.ours_us > 0.1 and one.ratios == [pytest.approx(one.ours_us / one.theirs_us)]
        assert 0.5 < one.ratio < 2.0


def test_command_fails_if_this_checkout_is_slower(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for ratio, code in ((1.0, 0), (1.1, 1)):
        found = [against.Compared("tick", ratio, 1.0, [ratio])]
        monkeypatch.setattr("hapscene_evidence.bench.run.compare_checkouts", lambda *_, found=found: found)
        assert main(["lab", "bench", "--against", str(tmp_path)]) == code


def test_folder_that_is_not_a_checkout_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(HapsceneError, match="not a checkout"):
        against.compare_checkouts(tmp_path, 1, lambda _: None)
