"""`hapscene lab warmup`."""

import pytest

from hapscene import warm_up
from hapscene.cli import main
from hapscene.compiled import cache
from hapscene.compiled.native import INTERPRETED


def test_warmup_prints_the_folder(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []
    monkeypatch.setattr(warm_up, "warm_up", lambda: asked.append(True))
    assert main(["lab", "warmup"]) == (2 if INTERPRETED else 0)
    if not INTERPRETED:
        assert str(cache.cache_folder()) in capsys.readouterr().out.splitlines()[-1] and asked == [True]


def test_warmup_without_a_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_folder", lambda: None)
    monkeypatch.setattr(warm_up, "warm_up", lambda: pytest.fail("compiles"))
    assert main(["lab", "warmup"]) == 2
